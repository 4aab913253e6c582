//! The command lines of this package's verbs; defines arguments only and runs nothing.

pub mod margins;
pub mod recordings;
pub mod replay;
pub mod run;
pub mod tolerance;

//! The command lines of the verbs of this package. Carries nothing out.

pub mod recordings;
pub mod replay;
pub mod run;
pub mod tolerance;

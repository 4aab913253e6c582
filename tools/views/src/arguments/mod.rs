//! Command lines of this package's verbs. Contains no logic.

pub mod baseline;
pub mod export;
pub mod layout;
pub mod monitor;
pub mod panel;
pub mod report;
pub mod values;
mod width;

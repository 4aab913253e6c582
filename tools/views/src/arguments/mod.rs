//! The command lines of the verbs of this package. Carries nothing out.

pub mod export;
pub mod layout;
pub mod monitor;
pub mod panel;
pub mod report;
pub mod values;

//! Runs to look at, live or recorded: the monitor, the report, tables and layouts for other programs. Judges
//! nothing itself, and changes no run.

pub mod export;
pub mod layout;
pub mod monitor;
pub mod report;

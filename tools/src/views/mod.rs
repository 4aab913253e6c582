//! Runs to look at, live or recorded: the monitor, the report, tables and layouts for other programs.
//! Judges nothing itself and changes no recording; requests from the monitor's keys go to a running
//! session through [`session`](crate::session).

pub mod export;
pub(crate) mod layout;
pub(crate) mod monitor;
pub(crate) mod offline_page;
pub(crate) mod panel;
pub(crate) mod plots;
pub(crate) mod report;
pub(crate) mod values;

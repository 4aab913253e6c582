//! Runs to look at, live or recorded: monitor, panel, `hil get` and `hil watch` ([`values`]), report, export, layout;
//! [`plots`] chooses what report, monitor and layout draw. Judges no run and changes no recording; requests to a
//! running session go through [`session`](hil_facts::session).

pub mod export;
pub(crate) mod layout;
pub(crate) mod monitor;
pub(crate) mod offline_page;
pub(crate) mod panel;
pub(crate) mod plots;
pub(crate) mod report;
pub(crate) mod values;

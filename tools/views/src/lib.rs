//! Views of live and recorded runs: monitor, panel, `hil get` and `hil watch` ([`values`]), report, export and
//! layout. [`plots`] selects what report, monitor and layout draw. Never judges a run or changes a recording;
//! requests to a running session go through [`session`](hil_facts::session).

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub(crate) mod band;
pub mod export;
pub(crate) mod figures;
pub mod layout;
pub mod monitor;
pub mod offline_page;
pub(crate) mod pages;
pub mod panel;
pub mod plots;
pub mod prefix;
pub mod report;
pub mod table_file;
pub mod values;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod fixture;

//! Verification: compares, repeats, replays and judges runs, checks them against baselines, and combines runs to
//! suites and audits; a single `hil run` is a suite of one. Scenarios are executed by [`run`](hil_run); plots are
//! drawn elsewhere.

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub mod baseline;
pub mod compare;
pub mod evidence;
pub mod judge;
pub mod repetition;
pub mod replay;
pub mod rerun;
pub mod suite;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
mod fixture;
#[cfg(test)]
#[path = "../../facts/tests/shared/rig.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod rig;

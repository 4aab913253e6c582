//! Answers to "is it the same?" and "is it right?": runs compared, repeated, replayed, judged once
//! more, compared with baselines, and put together as suites and audits; a single `hil run` is a suite
//! of one. Scenarios are run by [`run`](hil_run); no plot is made here.

#![expect(
    missing_docs,
    reason = "fields and variants whose names say what they are"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub mod baseline;
pub mod compare;
#[cfg(test)]
mod damage;
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

//! Facts about runs: their programs, their results, and a running session as seen from another terminal. Starts no run
//! and compares none.
//!
//! | Module | Contents |
//! |---|---|
//! | [`session`] | a running session from another terminal: requests, faults, records |
//! | [`checkpoint`] | the state of both sides before a step, from which another run can continue |
//! | [`results`] | the end of a run, its verdicts, its latency with a grade, its summary |
//! | [`programs`] | plant and controller programs, and the scenario checked against them |
//! | [`arguments`] | arguments shared by verbs of several packages |

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere
#[cfg(test)]
extern crate self as hil_facts; // the name that shared pieces of tests know

pub mod arguments;
pub mod checkpoint;
pub mod programs;
pub mod results;
pub mod session;
pub mod tables;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod fixture;
#[cfg(test)]
#[path = "../tests/shared/rig.rs"]
mod rig;

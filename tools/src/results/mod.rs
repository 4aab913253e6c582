//! The facts of a run and what they mean: its end, its verdict, its faults, its controllers, its late commands,
//! its latency, and the summary that tells of all. Takes records from whoever has them, the recorder or a
//! recording; starts nothing and watches nothing.

pub(crate) mod collector;
pub mod ended;
pub mod ending;
pub mod evaluation;
pub mod faults;
pub(crate) mod handover;
pub(crate) mod late_commands;
pub mod latency;
pub(crate) mod outcome;
pub mod recorded;
pub(crate) mod recorded_run;
pub mod requirements;
pub mod resumed;
pub mod settings;
pub mod summary;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
pub(crate) mod fixture;

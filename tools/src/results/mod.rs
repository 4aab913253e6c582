//! The facts of a run and what they mean: its end, its verdict, its faults, its controllers, its late commands,
//! its latency, and the summary that tells of all. Takes records from whoever has them, the recorder or a
//! recording; starts nothing and watches nothing.

pub(crate) mod collector;
pub(crate) mod company;
pub(crate) mod curves;
pub(crate) mod ended;
pub(crate) mod ending;
pub(crate) mod evaluation;
pub(crate) mod faults;
pub(crate) mod handover;
pub(crate) mod late_commands;
pub(crate) mod latency;
pub(crate) mod outcome;
pub(crate) mod recorded;
pub(crate) mod recorded_run;
pub(crate) mod requirements;
pub(crate) mod resumed;
pub(crate) mod settings;
pub(crate) mod summary;
pub(crate) mod target;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
pub(crate) mod fixture;

//! Facts of a run and what they mean. `collector` takes records in, from the recorder or a recording; `ending` doubts
//! the plant's account of the end; `requirements` makes verdict and exit code; `faults`, `handover`, `late_commands`
//! and [`latency`] say what became of each; `outcome` reads a recording as far as it goes; `summary` tells all,
//! and `lost` what is left to tell where `hil` was killed. `restoration` compares second sides from a checkpoint
//! with the run.
//! Starts no process. Of the machine it reads processor times alone (`company`).

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
pub(crate) mod lost;
pub(crate) mod outcome;
pub(crate) mod recorded;
pub(crate) mod recorded_run;
pub(crate) mod requirements;
pub(crate) mod restoration;
pub(crate) mod resumed;
pub(crate) mod settings;
pub(crate) mod summary;
pub(crate) mod target;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
pub(crate) mod fixture;

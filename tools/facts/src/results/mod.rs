//! Facts of a run and what they mean. `collector` takes records in, from the recorder or a recording; `ending` doubts
//! the plant's account of the end; `requirements` makes verdict and exit code; `faults`, `handover`, `late_commands`
//! and [`latency`] say what became of each; `outcome` reads a recording as far as it goes; `summary` tells all,
//! and `lost` what is left to tell where `hil` was killed. `restoration` compares second sides from a checkpoint
//! with the run.
//! Starts no process. Of the machine it reads processor times alone (`company`).

pub mod collector;
pub mod company;
pub mod curve;
pub mod curves;
pub mod ended;
pub mod ending;
pub mod evaluation;
pub mod faults;
pub mod handover;
pub mod late_commands;
pub mod latency;
pub mod lost;
pub mod outcome;
pub mod recorded;
pub mod recorded_run;
pub mod requirements;
pub mod restoration;
pub mod resumed;
pub mod settings;
pub mod summary;
pub mod target;

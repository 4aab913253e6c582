//! Facts of a run and their meaning. `collector` collects records from the recorder or a recording; `ending` checks the
//! plant's report of the end; `requirements` determines verdict and exit code; `faults`, `handover`, `held_commands`,
//! `late_commands` and [`latency`] report on their subjects; `outcome` reads a recording as far as possible; `summary` reports
//! everything, and `lost` reports the facts that remain after `hil` was killed. `restoration` compares second sides
//! from a checkpoint with the run. Starts no process. Reads nothing of the machine except processor times (`company`).

pub mod collector;
pub mod company;
pub mod curve;
pub mod curves;
pub mod ended;
pub mod ending;
pub mod evaluation;
pub mod faults;
pub mod handover;
pub mod held_commands;
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

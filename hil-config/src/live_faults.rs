//! Faults that are asked for while a run goes on: text to checked events.
//!
//! Used by the plant's service for requests from a command line. The text is the `[[faults]]` of a
//! scenario and is checked by the same code. Reads no file: who asks puts tables of points inline.

use shared_types::describe::{FaultKindDescription, PlantDescription, Settings};
use shared_types::live::Refusal;
use shared_types::table::Field;
use shared_types::time::Rate;

use crate::check;
use crate::plan::{FaultEvent, Stimulus};
use crate::problem::{Problem, Problems};

/// The run that faults are asked for.
#[derive(Clone, Copy, Debug)]
pub struct FaultContext<'a> {
    /// Its plant.
    pub plant: &'a PlantDescription,
    /// The kinds of faults on signals, links and timing.
    pub kinds: &'a [FaultKindDescription],
    /// The plant's healthy parameters.
    pub parameters: &'a Settings,
    /// Its reference signals.
    pub stimuli: &'a [Stimulus],
    /// What the law shows of itself.
    pub internals: &'a [Field],
    /// The scenario's derived signals by name and expression.
    pub derived: &'a [(String, String)],
    /// Steps per second.
    pub rate: Rate,
    /// Number of steps of the whole run.
    pub steps: u64,
    /// Names and numbers of the events there are, of the scenario and live ones.
    pub names: &'a [(String, u32)],
    /// The number of the first new event; all lower ones are taken.
    pub first_id: u32,
}

/// Checks `[[faults]]` against a running run: all of them, or everything that is wrong.
///
/// An event without a trigger takes hold [at once](crate::plan::Trigger::Now).
///
/// # Errors
/// With everything that is wrong.
pub fn check_faults(toml: &str, context: &FaultContext<'_>) -> Result<Vec<FaultEvent>, Problems> {
    check::live(toml, context)
}

impl From<&Problem> for Refusal {
    fn from(problem: &Problem) -> Self {
        let message = match &problem.help {
            Some(help) => format!("{}; {help}", problem.message),
            None => problem.message.clone(),
        };
        Self {
            key: problem.key.clone(),
            message,
            expected: problem.expected.clone(),
            nearest: problem.nearest.clone(),
        }
    }
}

//! Faults that are asked for while a run goes on: text to checked events.
//!
//! Used by the plant's service for requests from a command line. The text is the `[[faults]]` of a
//! scenario and is checked by the same code. Reads no file: who asks puts tables of points inline.

use shared_types::live::Refusal;

use crate::check;
pub use crate::check::FaultContext;
use crate::plan::FaultEvent;
use crate::problem::{Problem, Problems};

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

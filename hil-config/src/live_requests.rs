//! Faults and changes of values requested during a run: from text to checked events.
//!
//! Used by the plant's service for requests from a command line or a panel. Faults have the form of a scenario's
//! `[[faults]]` and changes that of its `[[changes]]`, and both are checked by the same code, in `check`; a problem
//! becomes a refusal here. Reads no file: requests contain tables of points inline.

use shared_types::live::Refusal;

pub use crate::check::RequestContext;
use crate::problem::Problem;

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

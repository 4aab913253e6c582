//! A program's answer to `--linearise`.

use std::path::Path;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use shared_types::local_map::LocalMap;
use shared_types::text;

use super::Binary;
use super::answer::{asked, objection};

/// Words with which an older program refuses the option.
const UNKNOWN: &str = "unexpected argument '--linearise'";

impl Binary {
    /// Asks for the map of a side at a point, as the question file states it.
    ///
    /// # Errors
    /// If the program cannot be asked, or refuses with a reason.
    pub fn local_map(
        &self,
        question: &Path,
        interruption: &Interruption,
    ) -> Result<LocalMap, Failure> {
        let path = self.path.display();
        let arguments = ["--linearise".as_ref(), question.as_os_str()];
        let answer = match &self.host {
            Some(host) => host.ask(&self.path, &arguments, interruption)?,
            None => asked(&self.path, &arguments, interruption)?,
        };
        let answer = answer
            .map_err(|error| Failure::infrastructure(format!("{path} --linearise: {error}")))?;
        if let Some(reason) = objection(&answer, false) {
            let program = &self.description.program;
            return Err(Failure::Differ(match reason.contains(UNKNOWN) {
                true => format!("{path} is of an older version without `--linearise`; rebuild it"),
                false => format!("{program}: {}", text::printable(&reason)),
            }));
        }
        serde_json::from_str(&answer.stdout).map_err(|error| {
            Failure::infrastructure(format!(
                "{path}: its answer to --linearise is not a linear model: {error}"
            ))
        })
    }
}

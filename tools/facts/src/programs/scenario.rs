//! Scenario read, checked against its programs and shown complete.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;

use crate::programs::binaries::{Binaries, Choices};
use toml_edit::DocumentMut;

use crate::arguments::BinaryArguments;
use crate::arguments::run::Changes;
use crate::programs::binaries::named::Named;
use crate::programs::binaries::reached::Reached;
use crate::tables::FORMATS;

/// Parts of a scenario that determine what runs. The other parts disturb the run, which the samples already reflect, or
/// judge it by signals that another controller may not know.
const KEPT: [&str; 7] = [
    "schema",
    "name",
    "run",
    "plant",
    "controller",
    "connect",
    "stimuli",
];

/// File of a scenario as it was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScenarioFile {
    /// Absolute path.
    pub path: PathBuf,
    /// BLAKE3 hash of its text.
    pub blake3: String,
}

impl ScenarioFile {
    /// Name of the fact that has the path.
    pub const PATH: &str = "scenario_file";
    /// Name of the fact that has the hash.
    pub const BLAKE3: &str = "scenario_file_blake3";

    /// Describes a file with this text.
    #[must_use]
    pub fn of(path: &Path, text: &str) -> Self {
        Self {
            path: std::path::absolute(path).unwrap_or_else(|_| path.to_owned()),
            blake3: blake3::hash(text.as_bytes()).to_hex().to_string(),
        }
    }

    /// Returns the file that the facts of a recording name; `None` if the run had none, or no name in UTF-8.
    pub fn recorded<'a>(fact: impl Fn(&str) -> Option<&'a str>) -> Option<Self> {
        Some(Self {
            path: fact(Self::PATH)?.into(),
            blake3: fact(Self::BLAKE3)?.to_owned(),
        })
    }

    /// Returns the facts that a recording has of the file.
    pub fn facts(&self) -> impl Iterator<Item = (&'static str, String)> {
        let path = self.path.to_str().map(str::to_owned);
        path.into_iter()
            .flat_map(|path| [(Self::PATH, path), (Self::BLAKE3, self.blake3.clone())])
    }
}

/// Returns a plan as complete, runnable TOML.
///
/// # Errors
/// If the plan does not belong to the binaries.
pub fn show(plan: &Plan, binaries: &Binaries) -> Result<String, Failure> {
    let (plants, laws, kinds) = binaries.described();
    hil_config::show::show(plan, plants, laws, kinds).map_err(Failure::usage)
}

/// Reader of scenarios that also finds the programs of each scenario.
pub struct Finder<'a> {
    arguments: &'a BinaryArguments,
    at: Option<&'a Reached>,
    interruption: &'a Interruption,
    /// Binaries of earlier scenarios, so that each binary is asked for its description only once.
    found: Vec<(Choices, Arc<Binaries>)>,
}

impl<'a> Finder<'a> {
    /// Creates a finder that has asked no program yet.
    pub const fn new(
        arguments: &'a BinaryArguments,
        at: Option<&'a Reached>,
        interruption: &'a Interruption,
    ) -> Self {
        Self {
            arguments,
            at,
            interruption,
            found: Vec::new(),
        }
    }

    /// Reads a scenario, applies the changes and checks it against its programs; also describes its file. With `json`
    /// the problems are also written to standard output as JSON.
    ///
    /// # Errors
    /// All problems of the scenario or its programs.
    pub fn read(
        &mut self,
        path: &Path,
        changes: &Changes,
        json: bool,
    ) -> Result<(Plan, Arc<Binaries>, ScenarioFile), Failure> {
        changes.check()?;
        let read = || {
            let scenario = Scenario::read(path)?.with_formats(FORMATS);
            Ok(scenario.set(&changes.as_set()))
        };
        let scenario = self.interruption.at_once(read)?;
        let scenario = scenario.or_else(|problems| refused(&problems, json))?;
        let file = ScenarioFile::of(path, scenario.text());
        let choices = Choices::of(self.arguments, &Named::by(&scenario), self.at)?;
        let entry = self.found.iter().find(|(entry, _)| *entry == choices);
        let binaries = match entry {
            Some((_, binaries)) => Arc::clone(binaries),
            None => choices.find(self.interruption)?,
        };
        if entry.is_none() {
            self.found.push((choices, Arc::clone(&binaries)));
        }
        let plan = (self.interruption).at_once(|| finish(scenario, &binaries, json))??;
        Ok((plan, binaries, file))
    }
}

/// Applies the changes to a scenario and checks it; with `json` the problems are also written to standard output as
/// JSON.
///
/// # Errors
/// All problems of the scenario.
pub fn check(
    scenario: Result<Scenario, Problems>,
    changes: &Changes,
    binaries: &Binaries,
    json: bool,
) -> Result<Plan, Failure> {
    changes.check()?;
    let scenario = scenario.or_else(|problems| refused(&problems, json))?;
    finish(scenario.set(&changes.as_set()), binaries, json)
}

/// Returns the plan of a scenario with its programs.
fn finish(scenario: Scenario, binaries: &Binaries, json: bool) -> Result<Plan, Failure> {
    let (plants, laws, kinds) = binaries.described();
    let scenario = scenario.advise(binaries.advice());
    let plan = scenario.check(plants, laws, kinds);
    let plan = plan.or_else(|problems| refused(&problems, json))?;
    Ok(Plan {
        programs: binaries.programs(),
        ..plan
    })
}

fn refused<T>(problems: &Problems, json: bool) -> Result<T, Failure> {
    if json {
        output::write(&format!(
            "{}\n",
            serde_json::json!({ "problems": problems })
        ))?;
    }
    Err(Failure::Usage(problems.to_string()))
}

/// Returns the parts of a scenario that determine what runs.
///
/// # Errors
/// If the scenario is not valid TOML.
pub fn kept(text: &str) -> Result<DocumentMut, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    document.retain(|key, _| KEPT.contains(&key));
    Ok(document)
}

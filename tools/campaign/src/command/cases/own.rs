//! External programs of the cases, with the permissions and settings of each case.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use hil_config::plan::Programs;
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::named::Named;
use hil_facts::programs::binaries::{Binaries, Choices};

/// Maximum number of combinations of permissions and settings whose program descriptions are cached.
const MOST_KNOWN: usize = 64;

/// External programs. The description of an FMU depends on the permissions and settings of a case.
pub(super) struct ExternalPrograms {
    /// Command-line flags that choose the programs.
    arguments: BinaryArguments,
    /// Programs that the scenario names; empty where copies replace them.
    named: Programs,
    interruption: Interruption,
    /// Programs as described for the first case.
    pub(super) first: Arc<Binaries>,
    /// Programs with other permissions and settings, newest last.
    others: Mutex<Vec<(Programs, Arc<Binaries>)>>,
}

impl ExternalPrograms {
    /// Queries the descriptions of the programs with the permissions and settings of the first case.
    ///
    /// # Errors
    /// If a program cannot be run, or rejects the settings.
    pub(super) fn new(
        first: &Scenario,
        of_first: Programs,
        arguments: BinaryArguments,
        named: Programs,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let choices = choices(first, &arguments, &named, of_first)?;
        Ok(Self {
            first: choices.find(interruption)?,
            arguments,
            named,
            interruption: interruption.clone(),
            others: Mutex::default(),
        })
    }

    /// Returns the programs with these permissions and settings, querying them only if they are not cached.
    ///
    /// # Errors
    /// See [`new`](Self::new).
    pub(super) fn with(
        &self,
        scenario: &Scenario,
        programs: &Programs,
    ) -> Result<Arc<Binaries>, Failure> {
        let key = unnamed(programs.clone());
        if key == unnamed(self.first.programs()) {
            return Ok(Arc::clone(&self.first));
        }
        let others = || self.others.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, entry)) = others().iter().find(|(entry, _)| *entry == key) {
            return Ok(Arc::clone(entry));
        }
        let choices = choices(scenario, &self.arguments, &self.named, key.clone())?;
        let binaries = choices.find(&self.interruption)?;
        let mut others = others();
        if others.len() >= MOST_KNOWN {
            others.remove(0);
        }
        others.push((key, Arc::clone(&binaries)));
        Ok(binaries)
    }
}

/// Strips the program names from the permissions and settings of both sides.
fn unnamed(programs: Programs) -> Programs {
    Programs {
        plant: None,
        controller: None,
        ..programs
    }
}

/// Chooses the programs given by flags or by `named`, with the permissions and settings of `of_case`.
///
/// # Errors
/// If a program named in a file may not be run.
pub(super) fn choices(
    scenario: &Scenario,
    arguments: &BinaryArguments,
    named: &Programs,
    of_case: Programs,
) -> Result<Choices, Failure> {
    let named = Named::Scenario {
        file: scenario.path(),
        text: scenario.text(),
        programs: Box::new(Programs {
            plant: named.plant.clone(),
            controller: named.controller.clone(),
            ..of_case
        }),
    };
    Choices::of(arguments, &named, None)
}

/// Returns the keys of a scenario that apply only to FMUs.
pub(super) fn keys_of_fmus(programs: &Programs) -> impl Iterator<Item = String> {
    let locals = (!programs.locals.is_empty()).then(|| "plant.locals".to_owned());
    let plant = (programs.plant_permissions.given()).chain(programs.plant_settings.given());
    let controller =
        (programs.controller_permissions.given()).chain(programs.controller_settings.given());
    let plant = plant.map(|key| format!("plant.{key}"));
    (locals.into_iter().chain(plant)).chain(controller.map(|key| format!("controller.{key}")))
}

/// Returns the folder of a scenario, to which its paths are relative.
fn folder(scenario: &Scenario) -> PathBuf {
    let folder = scenario.path().parent().unwrap_or(Path::new(""));
    std::path::absolute(Path::new(".").join(folder)).unwrap_or_else(|_| folder.to_owned())
}

/// Lists files of FMUs whose paths are relative to the scenario.
pub(super) fn relative_files(scenario: &Scenario, programs: &Programs) -> Vec<String> {
    let folder = folder(scenario);
    let sides = [&programs.plant_settings, &programs.controller_settings];
    let files = sides.into_iter().flat_map(|side| side.files.values());
    let relative = files.filter_map(|file| Path::new(file).strip_prefix(&folder).ok()?.to_str());
    relative.map(str::to_owned).collect()
}

/// Replaces files of FMUs by their copies.
pub(super) fn with_copies(
    scenario: &Scenario,
    mut programs: Programs,
    copies: &BTreeMap<String, String>,
) -> Programs {
    let folder = folder(scenario);
    let sides = [
        &mut programs.plant_settings,
        &mut programs.controller_settings,
    ];
    for file in sides.into_iter().flat_map(|side| side.files.values_mut()) {
        let name = Path::new(file.as_str()).strip_prefix(&folder).ok();
        let copy = name.and_then(|name| copies.get(name.to_str()?));
        let copy = copy.and_then(|copy| Some(folder.join(copy).to_str()?.to_owned()));
        if let Some(copy) = copy {
            *file = copy;
        }
    }
    programs
}

//! Scenarios of sessions in this process, read and checked as by the command line.

use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use controller_process::controller::LawKind;
use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_console::terminal::exit::Failure;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::{CONTROLLER, Named, PLANT, Role};
use hil_facts::tables::FORMATS;
use hil_in_process::{Kinds, LAWS, PLANTS};
use hil_run::alone;
use plant_process::plant::PlantKind;
use pyo3::PyResult;
use shared_types::describe::Description;

use crate::class::Classes;
use crate::failure::{raised, refused};

/// Descriptions of the plants, laws and faults that are built into `hil`.
static BUILT_IN: LazyLock<Arc<[Description; 2]>> = LazyLock::new(|| Arc::new(alone::built_in()));

/// Plan with what it was checked against, and with the kinds of a session that has Python classes.
pub(crate) struct Checked {
    pub(crate) plan: Plan,
    pub(crate) described: Arc<[Description; 2]>,
    pub(crate) kinds: Option<Kinds>,
}

/// Reads a scenario, applies `KEY=VALUE` flags and checks it against plants and laws in this process: those that are
/// built in, and the given ones. Returns `None` if the scenario or the environment names a program that none of the
/// given ones replaces, so that the session needs a process.
///
/// # Errors
/// All problems of the scenario.
pub(crate) fn read(
    path: PathBuf,
    flags: &[String],
    Classes { plant, law }: &Classes,
) -> PyResult<Option<Checked>> {
    let raised = |failure: Failure| raised(&failure);
    let scenario = Scenario::read(path).map_err(|problems| refused(&problems))?;
    let scenario = scenario.with_formats(FORMATS).set(flags);
    let mut programs = scenario.programs();
    // A given class takes the place of the program.
    if plant.is_some() {
        programs.plant = None;
    }
    if law.is_some() {
        programs.controller = None;
    }
    let named = Named::Scenario {
        file: scenario.path(),
        text: scenario.text(),
        programs: Box::new(programs),
    };
    let choices = Choices::of(&BinaryArguments::default(), &named, None);
    if choices.map_err(raised)?.names_one() {
        return Ok(None);
    }
    let described = match (plant, law) {
        (None, None) => Arc::clone(&BUILT_IN),
        (plant, law) => with_classes(plant.as_deref(), law.as_deref()),
    };
    let [plants, laws] = &*described;
    let advice = Advice {
        plant: advice("plant", &PLANT),
        law: advice("law", &CONTROLLER),
    };
    let programs = scenario.programs();
    let plan = scenario.advise(advice);
    let plan = plan.check(&plants.plants, &laws.laws, &plants.faults);
    let plan = plan.map_err(|problems| refused(&problems))?;
    let kinds =
        kinds(&plan, plant.as_ref(), law.as_ref()).map_err(|name| raised(Failure::usage(name)))?;
    if kinds.is_none() {
        alone::check(&plan, &described).map_err(raised)?;
    }
    Ok(Some(Checked {
        plan: Plan { programs, ..plan },
        described,
        kinds,
    }))
}

/// Adds the given plant and law to those that are built in; a name is taken once.
fn with_classes(plant: Option<&PlantKind>, law: Option<&LawKind>) -> Arc<[Description; 2]> {
    let [mut plants, mut laws] = (**BUILT_IN).clone();
    if let Some(plant) = plant {
        plants
            .plants
            .retain(|other| other.name != plant.description.name);
        plants.plants.push(plant.description.clone());
    }
    if let Some(law) = law {
        laws.laws.retain(|other| other.name != law.description.name);
        laws.laws.push(law.description.clone());
    }
    Arc::new([plants, laws])
}

/// Returns the plant and the law of a plan, of which one is given; `None` if none is.
///
/// # Errors
/// If a given one is not that of the plan.
fn kinds(
    plan: &Plan,
    plant: Option<&Arc<PlantKind>>,
    law: Option<&Arc<LawKind>>,
) -> Result<Option<Kinds>, String> {
    if plant.is_none() && law.is_none() {
        return Ok(None);
    }
    let other = |what: &str, class: &str, key: &str, name: &str| {
        format!("the {what} `{class}` is given, but {key} is `{name}`")
    };
    let (model, name) = (&plan.plant.model, &plan.controller.law);
    if let Some(plant) = plant.filter(|plant| plant.description.name != *model) {
        let class = &plant.description.name;
        return Err(other("plant", class, "plant.model", model));
    }
    if let Some(law) = law.filter(|law| law.description.name != *name) {
        let class = &law.description.name;
        return Err(other("law", class, "controller.law", name));
    }
    let plant = plant.or_else(|| PLANTS.iter().find(|kind| kind.description.name == *model));
    let suits = |kind: &&Arc<LawKind>| {
        kind.description.name == *name && kind.description.suits(&plan.controller.made_for)
    };
    let law = law.or_else(|| LAWS.iter().find(suits));
    let both = plant.zip(law).map(|(plant, law)| Kinds {
        plant: Arc::clone(plant),
        law: Arc::clone(law),
    });
    both.map(Some)
        .ok_or_else(|| "the plant or the law is missing".into())
}

/// Returns the advice on an unknown plant or law.
fn advice(what: &str, role: &Role) -> String {
    let (key, flag) = (role.key, role.flag);
    format!(
        "a custom {what} needs its own program; name the program with `{key}` in the scenario or {flag} PATH"
    )
}

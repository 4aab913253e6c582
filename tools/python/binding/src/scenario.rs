//! Scenarios of sessions in this process, read and checked as by the command line.

use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use hil_config::plan::Plan;
use hil_config::scenario::{Advice, Scenario};
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::{CONTROLLER, Named, PLANT, Role};
use hil_facts::tables::FORMATS;
use hil_run::alone;
use pyo3::PyResult;
use shared_types::describe::Description;

use crate::failure::{raised, refused};

/// Descriptions of the plants, laws and faults that are built into `hil`.
static BUILT_IN: LazyLock<Arc<[Description; 2]>> = LazyLock::new(|| Arc::new(alone::built_in()));

/// Plan with the descriptions against which it was checked.
pub(crate) type Checked = (Plan, Arc<[Description; 2]>);

/// Reads a scenario, applies `KEY=VALUE` flags and checks it against plants and laws in this process. Returns `None` if
/// the scenario or the environment names a program, which needs a process.
///
/// # Errors
/// All problems of the scenario.
pub(crate) fn read(path: PathBuf, flags: &[String]) -> PyResult<Option<Checked>> {
    let scenario = Scenario::read(path).map_err(|problems| refused(&problems))?;
    let scenario = scenario.with_formats(FORMATS).set(flags);
    let choices = Choices::of(&BinaryArguments::default(), &Named::by(&scenario), None);
    if choices.map_err(|failure| raised(&failure))?.names_one() {
        return Ok(None);
    }
    let described = Arc::clone(&BUILT_IN);
    let [plant, controller] = &*described;
    let advice = Advice {
        plant: advice("plant", &PLANT),
        law: advice("law", &CONTROLLER),
    };
    let plan = scenario.advise(advice);
    let plan = plan.check(&plant.plants, &controller.laws, &plant.faults);
    let plan = plan.map_err(|problems| refused(&problems))?;
    alone::check(&plan, &described).map_err(|failure| raised(&failure))?;
    Ok(Some((plan, described)))
}

/// Returns the advice on an unknown plant or law.
fn advice(what: &str, role: &Role) -> String {
    let (key, flag) = (role.key, role.flag);
    format!(
        "a custom {what} needs its own program; name the program with `{key}` in the scenario or {flag} PATH"
    )
}

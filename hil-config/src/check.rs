//! From what was written to what it means.
//!
//! [`Scenario::check`](crate::scenario::Scenario::check) is the way in. Each part of a scenario has
//! its file below; a part that is wrong is reported and left out, and the others are checked as far
//! as they can be without it. The order is that of the data: run, plant, law, stimuli, binding,
//! faults, expressions.

mod binding;
mod controller;
mod faults;
mod parameters;
mod plant;
mod points;
mod run;
mod signals;
mod stimuli;

use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription};

use crate::expression::Columns;
use crate::keys;
use crate::live_faults::FaultContext;
use crate::plan::{FaultEvent, FaultSource, Plan};
use crate::problem::{ProblemKind, Problems};
use crate::reader::{Reader, Section};
use crate::scenario::Scenario;
use crate::source::{Place, Sources};

pub(crate) use controller::law_for;
pub(crate) use faults::targets;

pub(crate) fn check(
    scenario: &Scenario,
    mut reader: Reader,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Result<Plan, Problems> {
    let start = Place {
        source: Sources::SCENARIO,
        span: 0..0,
    };
    let root = Section {
        table: &scenario.table,
        keys: keys::SCENARIO,
        path: String::new(),
        place: &start,
    };
    let plan = if root.table.get("schema").is_some() && reader.integer(&root, "schema").is_none() {
        // Every key may mean something else there; more messages would only mislead.
        None
    } else {
        parts(&mut reader, &root, scenario, plants, laws, kinds)
    };
    let Reader {
        sources,
        mut problems,
    } = reader;
    match plan {
        Some(plan) if problems.is_empty() => Ok(plan),
        _ => {
            let file = sources.name(Sources::SCENARIO);
            problems.sort_by_key(|problem| {
                let at = problem.excerpt.as_ref().map(|at| (at.line, at.column));
                (problem.source != file, at)
            });
            Err(Problems(problems))
        }
    }
}

/// Checks the `[[faults]]` of a running run.
pub(crate) fn live(toml: &str, context: &FaultContext<'_>) -> Result<Vec<FaultEvent>, Problems> {
    let scenario = Scenario::parse(toml, "request")?;
    let mut reader = Reader {
        sources: scenario.sources.clone(),
        problems: Vec::new(),
    };
    let start = Place {
        source: Sources::SCENARIO,
        span: 0..0,
    };
    let root = Section {
        table: &scenario.table,
        keys: keys::SCENARIO,
        path: String::new(),
        place: &start,
    };
    let grid = run::Grid {
        rate: context.rate,
        steps: context.steps,
    };
    let (plant, nominal) = (Some(context.plant), Some(context.parameters));
    let mut events = faults::check(&mut reader, &root, plant, nominal, Some(grid));
    for (id, event) in (context.first_id..).zip(&mut events) {
        (event.id, event.source) = (id, FaultSource::Cli);
    }
    if reader.problems.is_empty() {
        Ok(events)
    } else {
        Err(Problems(reader.problems))
    }
}

fn parts(
    reader: &mut Reader,
    root: &Section<'_>,
    scenario: &Scenario,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    _kinds: &[FaultKindDescription],
) -> Option<Plan> {
    reader.integer(root, "schema");
    reader.refuse_unknown(root, &[]);
    let name = name(reader, root, scenario);
    let description = reader.text(root, "description").unwrap_or_default();

    let (grid, run) = run::check(reader, root);
    let plant_section = reader.section(root, "plant");
    let plant = plant_section
        .as_ref()
        .and_then(|section| plant::find(reader, section, plants));
    let plant_plan = plant_section
        .as_ref()
        .and_then(|section| plant::check(reader, section, plant));

    let controller_section = reader.section(root, "controller");
    let law = controller_section
        .as_ref()
        .and_then(|section| controller::find(reader, section, laws, plant));
    let stimuli = stimuli::check(reader, root, scenario, grid, law);
    let controller_plan = controller_section.as_ref().and_then(|section| {
        let nominal = plant_plan.as_ref().map(|plan| &plan.parameters);
        controller::check(reader, section, laws, law, plant, nominal, grid)
    });
    if let (Some(section), Some(law), Some(plant)) = (&controller_section, law, plant) {
        binding::check(reader, section, law, plant, stimuli.as_deref());
    }

    let nominal = plant_plan.as_ref().map(|plan| &plan.parameters);
    let faults = faults::check(reader, root, plant, nominal, grid);
    let columns = match (plant, law, &stimuli) {
        (Some(plant), Some(law), Some(stimuli)) => {
            Some(Columns::of(plant, stimuli, &law.internals))
        }
        _ => None,
    };
    let (derived, metrics) = signals::check(reader, root, columns, grid);
    Some(Plan {
        name,
        description: description.into(),
        run: run?,
        plant: plant_plan?,
        controller: controller_plan?,
        stimuli: stimuli?,
        faults,
        derived,
        metrics,
    })
}

/// The scenario's name, which becomes part of folder names.
fn name(reader: &mut Reader, root: &Section<'_>, scenario: &Scenario) -> String {
    let stem = scenario
        .path
        .file_stem()
        .map(|stem| stem.to_string_lossy().into_owned())
        .unwrap_or_default();
    let written = reader.text(root, "name");
    let name = written.map_or(stem, Into::into);
    let legal = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    if name.is_empty() || name.len() > 64 || !name.chars().all(legal) {
        let message = match written {
            Some(_) => format!("`name` is `{name}`"),
            None => {
                format!("`name` is missing, and the file's name `{name}` cannot take its place")
            }
        };
        reader
            .report(
                ProblemKind::OutOfRange,
                "name",
                root.place_of("name"),
                message,
            )
            .expected("1 to 64 letters, digits, - and _");
    }
    name
}

/// Whether a text can be the name of a signal.
fn is_signal_name(name: &str) -> bool {
    let mut characters = name.chars();
    characters
        .next()
        .is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
        && characters.all(|c| c.is_ascii_alphanumeric() || c == '_')
}

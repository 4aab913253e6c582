//! `[controller]`: the law, its parameters, its model of the plant, its rate.

use std::collections::BTreeMap;

use shared_types::describe::{LawDescription, PlantDescription, Settings};
use shared_types::number::exact as number;
use shared_types::table::Field;

use super::parameters;
use super::run::Grid;
use crate::keys::CONTROLLER;
use crate::plan::ControllerPlan;
use crate::problem::{ProblemKind, listed};
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Finds the law of a name for a plant. Laws for different plants may share a name; if no such law is made for the
/// plant, any law of that name is returned.
fn law_for<'d>(
    laws: &'d [LawDescription],
    name: &str,
    plant: Option<&str>,
) -> Option<&'d LawDescription> {
    let named = || laws.iter().filter(|law| law.name == name);
    named().find(|law| fits(law, plant)).or(named().next())
}

fn fits(law: &LawDescription, plant: Option<&str>) -> bool {
    plant.is_none_or(|plant| law.suits(plant))
}

/// Finds the description of the requested law, made for a plant of this name.
pub(super) fn find<'d>(
    reader: &mut Reader,
    section: &Section<'_>,
    laws: &'d [LawDescription],
    plant: Option<&str>,
    advice: &str,
) -> Option<&'d LawDescription> {
    let name = reader.text(section, "law")?;
    let law = law_for(laws, name, plant);
    if let Some(law) = law
        && fits(law, plant)
    {
        return Some(law);
    }
    let fitting = laws.iter().filter(|law| fits(law, plant));
    let mut names: Vec<&str> = fitting.map(|law| law.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let (kind, message) = match law {
        Some(_) => (
            ProblemKind::Mismatch,
            format!(
                "law `{name}` is not made for plant `{}`",
                plant.unwrap_or_default()
            ),
        ),
        None => (ProblemKind::UnknownName, format!("unknown law `{name}`")),
    };
    let problem = reader
        .report_at(section, "law", kind, message)
        .expected(format!("one of {}", listed(names.iter().copied())));
    match law {
        Some(law) => {
            let plants = listed(law.plants.iter().map(String::as_str));
            problem.help(format!(
                "law `{name}` is made for {plants}; set `made_for` to one of them and use [[connect]] to bind the law to another plant"
            ));
        }
        None => {
            problem.nearest(name, names).help(advice);
        }
    }
    None
}

pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    laws: &[LawDescription],
    (law, home): (Option<&LawDescription>, Option<&str>),
    plant: Option<&PlantDescription>,
    nominal: Option<&Settings>,
    grid: Option<Grid>,
) -> Option<ControllerPlan> {
    let tables = law_tables(reader, section, laws, home);
    let command_delay_steps = reader.integer(section, "command_delay_steps");
    let rate_divisor = match section.table.get("rate_hz") {
        None => Some(1),
        Some(_) => (reader.number(section, "rate_hz"))
            .and_then(|rate_hz| rate_divisor(reader, section, rate_hz, grid)),
    };
    let model_section = reader.section(section, "model");

    // Another law's model may stand here too, so that one flag can switch the law.
    let mut fields: Vec<Field> = law.map(|law| law.model.clone()).unwrap_or_default();
    for field in laws.iter().flat_map(|law| &law.model) {
        if fields.iter().all(|other| other.name != field.name) {
            fields.push(field.clone());
        }
    }
    let given_model = model_section
        .as_ref()
        .map(|section| parameters::given(reader, section, &fields, "the model of a law"))
        .unwrap_or_default();

    let law = law?;
    let none = BTreeMap::new();
    let values = tables.get(law.name.as_str()).unwrap_or(&none);
    let table = Section {
        path: section.path_of(&law.name),
        ..section.clone()
    };
    let parameters = parameters::complete(reader, &table, &law.parameters, values, |_| None);

    let (nominal, plant) = (nominal?, plant?);
    let model_table = Section {
        path: section.path_of("model"),
        ..section.clone()
    };
    let of_plant = |field: &Field| {
        let same = |other: &&Field| other.name == field.name && other.unit == field.unit;
        let parameter = plant.parameters.iter().find(same)?;
        nominal.get(&parameter.name)
    };
    let model = parameters::complete(reader, &model_table, &law.model, &given_model, of_plant);
    for field in &law.model {
        let value = model.get(&field.name);
        let borrowed = !given_model.contains_key(&field.name);
        if let Some(value) = value
            && borrowed
            && !field.admits(value)
        {
            let name = &field.name;
            let message = format!(
                "`controller.model.{name}` takes the plant's value {}, out of range for law `{}`",
                number(value),
                law.name
            );
            reader
                .report(
                    ProblemKind::OutOfRange,
                    model_table.path_of(name),
                    section.place_of("law"),
                    message,
                )
                .expected(Quantity::from(field).expected())
                .help(format!("give `{name}` in [controller.model]"));
        }
    }
    Some(ControllerPlan {
        law: law.name.clone(),
        made_for: home?.into(),
        connections: Vec::new(),
        parameters,
        model,
        rate_divisor: rate_divisor?,
        command_delay_steps: u32::try_from(command_delay_steps?).ok()?,
    })
}

/// Checks the tables of all laws, `[controller.<law>]`, and returns their values by law.
fn law_tables<'d>(
    reader: &mut Reader,
    section: &Section<'_>,
    laws: &'d [LawDescription],
    plant: Option<&str>,
) -> BTreeMap<&'d str, BTreeMap<String, f64>> {
    let mut names: Vec<&str> = laws.iter().map(|law| law.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    reader.refuse_unknown(section, &names);
    names.retain(|name| CONTROLLER.iter().all(|key| key.name != *name));
    let mut tables = BTreeMap::new();
    for name in names {
        let Some(law) = law_for(laws, name, plant) else {
            continue;
        };
        if let Some(table) = reader.table(section, name) {
            let owner = format!("law `{name}`");
            let values = parameters::given(reader, &table, &law.parameters, &owner);
            tables.insert(name, values);
        }
    }
    tables
}

/// Returns the number of exchange steps in the period of a section's `rate_hz`.
pub(super) fn rate_divisor(
    reader: &mut Reader,
    section: &Section<'_>,
    rate_hz: f64,
    grid: Option<Grid>,
) -> Option<u32> {
    let run_hz = grid?.rate.hz();
    let ratio = run_hz / rate_hz;
    let whole = ratio.round();
    if whole >= 1.0 && whole <= f64::from(u32::MAX) && (ratio - whole).abs() <= 1e-9 * whole {
        return Some(whole as u32);
    }
    let below = (run_hz / (ratio.floor() + 1.0), run_hz / ratio.floor());
    let help = if ratio < 1.0 {
        format!("the highest is {}", number(run_hz))
    } else {
        format!(
            "the nearest are {} and {}",
            number(below.0),
            number(below.1)
        )
    };
    reader
        .report_at(
            section,
            "rate_hz",
            ProblemKind::Mismatch,
            format!(
                "`{}` is {}, not a whole fraction of `run.rate_hz` = {}",
                section.path_of("rate_hz"),
                number(rate_hz),
                number(run_hz)
            ),
        )
        .expected("run.rate_hz divided by 1, 2, 3, .. in Hz")
        .help(help);
    None
}

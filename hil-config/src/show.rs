//! Formats a plan as a complete scenario: every effective value, with unit and range in a comment.
//!
//! Implements `hil config show` and writes the `scenario.toml` of every run. The text can be run, and its check yields
//! the original plan. Needs the descriptions against which the plan was checked. Keys follow the order of the tables in
//! `keys`; a key that is not handled here fails at once.

mod analyses;
mod bus;
mod changes;
mod faults;
mod instruments;
mod model;
mod plots;
mod requirements;
mod toml_text;

use std::fmt::{self, Write};

use serde::Serialize;
use shared_types::connection::Connection;
use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription, Settings};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use crate::keys::{self, Key, KeyKind, SCHEMA};
use crate::plan::{
    Clock, ControllerProgram, Derived, DerivedSource, FaultEvent, Metric, Permissions, Plan,
    Realtime, Run, Stimulus, Waveform,
};
use crate::quantity::{Quantity, toml_float};
use toml_text::{array, comment, dotted, inline, key, list, string, strings, toml_value};

/// Plan that cannot be shown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShowError {
    /// The plan refers to a plant, law or kind of fault without a description.
    #[error("{0} has no description; provide the descriptions against which the plan was checked")]
    Undescribed(String),
    /// A scenario cannot express an immediate change.
    #[error("change {0} is immediate; give it the step at which it took place")]
    NowChange(u32),
    /// A scenario cannot express an immediate fault.
    #[error("fault {0} takes effect at once; give it the step at which it did")]
    Now(u32),
}

/// Reason why a plan cannot be written.
#[derive(Debug)]
enum Failure {
    Show(ShowError),
    /// Formatting error, which writing to a string never causes.
    Format(fmt::Error),
}

impl From<fmt::Error> for Failure {
    fn from(error: fmt::Error) -> Self {
        Self::Format(error)
    }
}

type Written = Result<(), Failure>;

/// Writes a plan as a scenario.
///
/// # Errors
/// If its plant, law or a kind of fault is not described.
pub fn show(
    plan: &Plan,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Result<String, ShowError> {
    written(|text| write(text, plan, plants, laws, kinds))
}

/// Formats one event as `[[faults]]` of a scenario. An event that it waits for is named by number.
///
/// # Errors
/// If its kind is not described, or if the event takes effect [at once](crate::plan::Trigger::Now).
pub fn fault_toml(
    event: &FaultEvent,
    plant: &PlantDescription,
    kinds: &[FaultKindDescription],
    rate: Rate,
) -> Result<String, ShowError> {
    let look = faults::Look {
        plant,
        kinds,
        rate,
        others: &[],
    };
    written(|text| look.event(text, event))
}

fn written(write: impl FnOnce(&mut String) -> Written) -> Result<String, ShowError> {
    let mut text = String::new();
    match write(&mut text) {
        Ok(()) => Ok(text),
        Err(Failure::Show(error)) => Err(error),
        Err(Failure::Format(error)) => unreachable!("a string takes any text: {error}"),
    }
}

fn undescribed(what: String) -> Failure {
    Failure::Show(ShowError::Undescribed(what))
}

fn write(
    text: &mut String,
    plan: &Plan,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Written {
    let plant = (plan.whole_plant_among(plants))
        .ok_or_else(|| undescribed(format!("plant `{}`", plan.plant.model)))?;
    let law = (plan.law_among(laws))
        .ok_or_else(|| undescribed(format!("law `{}`", plan.controller.law)))?;

    for key in keys::SCENARIO {
        match key.name {
            "schema" => writeln!(text, "schema = {SCHEMA}")?,
            "name" => writeln!(text, "name = {}", string(&plan.name))?,
            "description" if plan.description.is_empty() => {}
            "description" => writeln!(text, "description = {}", string(&plan.description))?,
            "further_plots" if plan.further_plots => {}
            "further_plots" => writeln!(text, "further_plots = false")?,
            "run" => {
                run(text, &plan.run)?;
                realtime(text, &plan.realtime)?;
            }
            "realtime" => {} // beside the run
            "plant" => plant_tables(text, plan, plant)?,
            "controller" => controller(text, plan, &law)?,
            "connect" => each(text, &plan.controller.connections, connection)?,
            "sensors" => each(text, &plan.sensors, |text, one| {
                instruments::instrument(text, one, "sensors", keys::SENSOR)
            })?,
            "actuators" => each(text, &plan.actuators, |text, one| {
                instruments::instrument(text, one, "actuators", keys::ACTUATOR)
            })?,
            "bus" => {
                if let Some(one) = &plan.bus {
                    bus::bus(text, plan, one, plant)?;
                }
            }
            "stimuli" => each(text, &plan.stimuli, stimulus)?,
            "faults" => {
                let look = faults::Look {
                    plant,
                    kinds,
                    rate: plan.run.rate,
                    others: &plan.faults,
                };
                each(text, &plan.faults, |text, event| look.event(text, event))?;
            }
            "changes" => each(text, &plan.changes, |text, one| {
                changes::change(text, one, plan.run.rate)
            })?,
            "derived" => each(text, &plan.derived, derived)?,
            "metrics" => {
                each(text, &plan.metrics, metric)?;
                each(text, &plan.analyses, |text, one| {
                    analyses::analysis(text, one, plan)
                })?;
            }
            "requirements" => each(text, &plan.requirements, requirements::requirement)?,
            "plots" => each(text, &plan.plots, plots::plot)?,
            "panel" => plots::panel(text, &plan.panel)?,
            other => forgotten(other),
        }
    }
    Ok(())
}

fn each<T>(text: &mut String, all: &[T], write: impl Fn(&mut String, &T) -> Written) -> Written {
    all.iter().try_for_each(|one| write(text, one))
}

/// Writes the simple keys of a table, in order; `value` formats each of them and omits defaults.
fn section(text: &mut String, keys: &[Key], value: impl Fn(&str) -> Option<String>) -> Written {
    let is_table = |key: &&Key| {
        matches!(
            key.kind,
            KeyKind::Section(_) | KeyKind::List(_) | KeyKind::Described
        )
    };
    for key in keys.iter().filter(|key| !is_table(key)) {
        if let Some(value) = value(key.name) {
            writeln!(text, "{} = {value}", key.name)?;
        }
    }
    Ok(())
}

/// Panics at a key that this module does not handle: the first scenario shown reveals the omission.
fn forgotten(key: &str) -> ! {
    unreachable!("the value of the key `{key}` is not known here")
}

fn run(text: &mut String, run: &Run) -> Written {
    writeln!(text, "\n[run]")?;
    section(text, keys::RUN, |key| {
        Some(match key {
            "duration_s" => {
                let duration_s = toml_float(run.rate.seconds(Step(run.steps)));
                format!("{duration_s} # {} steps", run.steps)
            }
            "rate_hz" => toml_float(run.rate.hz()),
            "seed" => run.seed.to_string(),
            "clock" => string(run.clock.name()),
            "pace" => match run.clock {
                Clock::Paced { factor } => toml_float(factor),
                Clock::Lockstep | Clock::Realtime => return None,
            },
            "overrun" => string(run.overrun.name()),
            "deadline" => toml_float(run.deadline),
            "on_controller_loss" => string(run.on_controller_loss.name()),
            other => forgotten(other),
        })
    })
}

fn realtime(text: &mut String, realtime: &Realtime) -> Written {
    writeln!(text, "\n[realtime]")?;
    let number = |value: Option<u32>| value.map(|value| value.to_string());
    section(text, keys::REALTIME, |key| match key {
        "plant_core" => number(realtime.plant_core),
        "controller_core" => number(realtime.controller_core),
        "recorder_core" => number(realtime.recorder_core),
        "dma_latency_us" => number(realtime.dma_latency_us),
        "priority" => number(Some(realtime.priority)),
        "lock_memory" => Some(realtime.lock_memory.to_string()),
        "prefault" => Some(realtime.prefault.to_string()),
        "wait" => Some(string(realtime.wait.name())),
        other => forgotten(other),
    })
}

fn plant_tables(text: &mut String, plan: &Plan, plant: &PlantDescription) -> Written {
    let (program, locals) = (&plan.programs.plant, &plan.programs.locals);
    let permissions = plan.programs.plant_permissions;
    let fmu = &plan.programs.plant_settings;
    let plan = &plan.plant;
    writeln!(text, "\n[plant] # {}", comment(&plant.summary))?;
    section(text, keys::PLANT, |key| match key {
        "model" => Some(string(&plan.model)),
        "program" => program.as_ref()?.to_str().map(string),
        "locals" => (!locals.is_empty()).then(|| strings(locals)),
        "trust_archive" | "allow_execution_tool" => permission(permissions, key),
        "tolerance" | "start_time_s" | "stop_time_s" => model::number(fmu, key),
        "substeps" => Some(plan.substeps.to_string()),
        other => forgotten(other),
    })?;
    model::tables(text, "plant", fmu)?;
    settings(
        text,
        "plant.parameters",
        &plan.parameters,
        &plant.parameters,
    )?;
    if !plan.limits.is_empty() {
        writeln!(text, "\n[plant.limits]")?;
    }
    for limit in &plan.limits {
        writeln!(
            text,
            "{} = {}",
            key(&limit.signal),
            list(&[limit.min, limit.max])
        )?;
    }
    let safe = &plan.safe_command;
    let (driven, commands): (Vec<Field>, Vec<Field>) =
        { plant.commands.iter().cloned() }.partition(|field| safe.get(&field.name).is_none());
    settings(text, "plant.safe_command", safe, &commands)?;
    let constant = driven.into_iter();
    let constant = constant.filter(|field| plan.inputs.get(&field.name).is_some());
    let constant: Vec<Field> = constant.collect();
    settings(text, "plant.inputs", &plan.inputs, &constant)
}

/// Returns a permission of an FMU, if granted.
fn permission(permissions: Permissions, key: &str) -> Option<String> {
    let is_given = permissions.given().any(|key_name| key_name == key);
    is_given.then(|| "true".into())
}

fn controller(text: &mut String, plan: &Plan, law: &LawDescription) -> Written {
    let made_for = &plan.controller.made_for;
    let made_for = (*made_for != plan.plant.model).then(|| string(made_for));
    let permissions = plan.programs.controller_permissions;
    let fmu = &plan.programs.controller_settings;
    let (rate, program, plan) = (plan.run.rate, &plan.programs.controller, &plan.controller);
    writeln!(text, "\n[controller] # {}", comment(&law.summary))?;
    section(text, keys::CONTROLLER, |name| match name {
        "law" => Some(string(&plan.law)),
        "made_for" => made_for.clone(),
        "program" => match program.as_ref()? {
            ControllerProgram::One(file) => file.to_str().map(string),
            ControllerProgram::ByMachine(files) => {
                let named = files.iter().filter_map(|(machine, file)| {
                    Some(format!("{} = {}", key(machine), string(file.to_str()?)))
                });
                Some(inline(named))
            }
        },
        "trust_archive" | "allow_execution_tool" => permission(permissions, name),
        "tolerance" | "start_time_s" | "stop_time_s" => model::number(fmu, name),
        "rate_hz" => Some(toml_float(rate.hz() / f64::from(plan.rate_divisor))),
        "command_delay_steps" => Some(plan.command_delay_steps.to_string()),
        other => forgotten(other),
    })?;
    model::tables(text, "controller", fmu)?;
    let table = format!("controller.{}", key(&plan.law));
    settings(text, &table, &plan.parameters, &law.parameters)?;
    settings(text, "controller.model", &plan.model, &law.model)
}

fn connection(text: &mut String, connection: &Connection) -> Written {
    let label = comment(&connection.to_string());
    writeln!(text, "\n[[connect]] # {label}")?;
    let path = |name: &str| string(&format!("{}.{name}", connection.kind.prefix()));
    let if_given = |value: f64| connection.is_given.then(|| toml_float(value));
    section(text, keys::CONNECT, |key| match key {
        "law" => Some(path(&connection.law)),
        "plant" => Some(path(&connection.plant)),
        "factor" => if_given(connection.conversion.factor),
        "offset" => if_given(connection.conversion.offset),
        other => forgotten(other),
    })
}

/// Writes a table of values in the order of the description.
fn settings(text: &mut String, table: &str, values: &Settings, fields: &[Field]) -> Written {
    if fields.is_empty() {
        return Ok(());
    }
    writeln!(text, "\n[{table}]")?;
    // In TOML `p` and `p.q` cannot both have values, but `p` and `"p.q"` can.
    let is_nested = |one: &str| {
        one.match_indices('.')
            .any(|(dot, _)| fields.iter().any(|other| other.name == one[..dot]))
    };
    let named = |name: &str| {
        if is_nested(name) {
            string(name)
        } else {
            dotted(name)
        }
    };
    for field in fields {
        let Some(value) = values.get(&field.name) else {
            if field.is_optional {
                continue;
            }
            return Err(undescribed(format!("`{}` that fits the plan", field.name)));
        };
        let range = Quantity::from(field).range();
        let mut notes = vec![field.unit.clone(), range];
        if field.faultable {
            notes.push("faultable".into());
        }
        if field.tunable {
            notes.push("tunable".into());
        }
        notes.retain(|note| !note.is_empty());
        writeln!(
            text,
            "{} = {} # {}. {}",
            named(&field.name),
            toml_float(value),
            notes.join(", "),
            comment(&field.description)
        )?;
    }
    Ok(())
}

fn stimulus(text: &mut String, stimulus: &Stimulus) -> Written {
    writeln!(text, "\n[[stimuli]]")?;
    writeln!(text, "target = {}", string(&stimulus.target))?;
    writeln!(text, "unit = {}", string(&stimulus.unit))?;
    let sequence = match &stimulus.waveform {
        Waveform::Sequence(sequence) => sequence,
        waveform => return lines(text, waveform),
    };
    writeln!(text, "kind = {}", string(keys::SEQUENCE_KIND))?;
    each(text, &sequence.parts, |text, part| {
        writeln!(text, "[[stimuli.parts]]")?;
        writeln!(text, "length_s = {}", toml_float(part.length_s))?;
        lines(text, &part.waveform)
    })
}

fn lines(text: &mut String, waveform: &Waveform) -> Written {
    for entry in entries(waveform) {
        writeln!(text, "{entry}")?;
    }
    Ok(())
}

fn derived(text: &mut String, derived: &Derived) -> Written {
    writeln!(text, "\n[[derived]]")?;
    writeln!(text, "name = {}", string(&derived.name))?;
    writeln!(text, "unit = {}", string(&derived.unit))?;
    match &derived.source {
        DerivedSource::Expression(expression) => {
            writeln!(text, "expression = {}", string(&expression.to_string()))?;
        }
        DerivedSource::Table(table) => {
            for entry in entries(table) {
                writeln!(text, "{entry}")?;
            }
        }
    }
    Ok(())
}

fn metric(text: &mut String, metric: &Metric) -> Written {
    writeln!(text, "\n[[metrics]]")?;
    writeln!(text, "name = {}", string(&metric.name))?;
    section(text, keys::EXPRESSION, |key| match key {
        "unit" => Some(string(&metric.unit)),
        "expression" => Some(string(&metric.expression.to_string())),
        "windows_s" => {
            let windows = metric.windows.iter();
            let windows = windows.map(|window| list(&[window.start_s, window.end_s]));
            (!metric.windows.is_empty()).then(|| array(windows))
        }
        "published_note" => metric.published_note.as_deref().map(string),
        other => forgotten(other),
    })?;
    each(text, &metric.published, |text, published| {
        writeln!(text, "[[metrics.published]]")?;
        section(text, keys::PUBLISHED, |key| {
            Some(match key {
                "law" => string(&published.law),
                "window_s" => list(&published.window_s),
                "value" => toml_float(published.value),
                "source" => string(&published.source),
                other => forgotten(other),
            })
        })
    })
}

/// Formats the values of a waveform or profile as `key = value`, beginning with its kind. Table points are included, so
/// that the text does not depend on another file.
fn entries(course: &impl Serialize) -> Vec<String> {
    // Plain numbers and words always serialise.
    let value = serde_json::to_value(course).unwrap_or_default();
    let entries = value.as_object().into_iter().flatten();
    let entries = entries.map(|(name, value)| format!("{name} = {}", toml_value(value)));
    entries.collect()
}

//! A plan as a complete scenario: every value that is in effect, with unit and range beside it.
//!
//! Behind `hil config show` and the `scenario.toml` of every run. The text can be run, and checks
//! to the plan that it was made from. Needs the descriptions that the plan was checked against.

mod analyses;
mod faults;
mod plots;
mod requirements;

use std::fmt::{self, Write};
use std::path::Path;

use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription, Settings};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use crate::keys::SCHEMA;
use crate::plan::{
    Clock, ControllerPlan, ControllerProgram, FaultEvent, Metric, Plan, PlantPlan, Realtime, Run,
    Stimulus, Sweep, Waveform,
};
use crate::quantity::{Quantity, toml_float};

/// A plan cannot be shown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShowError {
    /// It speaks of something that no description has.
    #[error("there is no description of {0}; give those that the plan was checked against")]
    Undescribed(String),
    /// A scenario has no word for a fault that takes hold at once.
    #[error("fault {0} takes hold at once; give it the step at which it did")]
    Now(u32),
}

/// Why a plan cannot be written.
#[derive(Debug)]
enum Failure {
    Show(ShowError),
    /// Writing to a string does not fail, but says that it might.
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

/// Writes one event as `[[faults]]` of a scenario. An event that it waits for is named by number.
///
/// # Errors
/// If its kind is not described, or if it takes hold [at once](crate::plan::Trigger::Now).
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
    let plant = (plan.plant_among(plants))
        .ok_or_else(|| undescribed(format!("plant `{}`", plan.plant.model)))?;
    let law = (plan.law_among(laws))
        .ok_or_else(|| undescribed(format!("law `{}`", plan.controller.law)))?;

    writeln!(text, "schema = {SCHEMA}")?;
    writeln!(text, "name = {}", string(&plan.name))?;
    if !plan.description.is_empty() {
        writeln!(text, "description = {}", string(&plan.description))?;
    }
    run(text, &plan.run)?;
    realtime(text, &plan.realtime)?;
    let programs = &plan.programs;
    plant_tables(text, &plan.plant, plant, programs.plant.as_deref())?;
    let program = programs.controller.as_ref();
    controller(text, &plan.controller, law, plan.run.rate, program)?;
    for one in &plan.stimuli {
        stimulus(text, one)?;
    }
    let look = faults::Look {
        plant,
        kinds,
        rate: plan.run.rate,
        others: &plan.faults,
    };
    for event in &plan.faults {
        look.event(text, event)?;
    }
    for derived in &plan.derived {
        writeln!(text, "\n[[derived]]")?;
        writeln!(text, "name = {}", string(&derived.name))?;
        writeln!(text, "unit = {}", string(&derived.unit))?;
        writeln!(
            text,
            "expression = {}",
            string(&derived.expression.to_string())
        )?;
    }
    for one in &plan.metrics {
        metric(text, one)?;
    }
    for analysis in &plan.analyses {
        analyses::analysis(text, analysis, plan)?;
    }
    for one in &plan.requirements {
        requirements::requirement(text, one)?;
    }
    for one in &plan.plots {
        plots::plot(text, one)?;
    }
    Ok(())
}

fn run(text: &mut String, run: &Run) -> Written {
    let duration_s = toml_float(run.rate.seconds(Step(run.steps)));
    writeln!(text, "\n[run]")?;
    writeln!(text, "duration_s = {duration_s} # {} steps", run.steps)?;
    writeln!(text, "rate_hz = {}", toml_float(run.rate.hz()))?;
    writeln!(text, "seed = {}", run.seed)?;
    writeln!(text, "clock = \"{}\"", run.clock.name())?;
    if let Clock::Paced { factor } = run.clock {
        writeln!(text, "pace = {}", toml_float(factor))?;
    }
    writeln!(text, "overrun = \"{}\"", run.overrun.name())?;
    writeln!(text, "deadline = {}", toml_float(run.deadline))?;
    let on_loss = run.on_controller_loss.name();
    writeln!(text, "on_controller_loss = \"{on_loss}\"")?;
    Ok(())
}

fn realtime(text: &mut String, realtime: &Realtime) -> Written {
    writeln!(text, "\n[realtime]")?;
    for (key, value) in [
        ("plant_core", realtime.plant_core),
        ("controller_core", realtime.controller_core),
        ("recorder_core", realtime.recorder_core),
        ("dma_latency_us", realtime.dma_latency_us),
    ] {
        if let Some(value) = value {
            writeln!(text, "{key} = {value}")?;
        }
    }
    writeln!(text, "priority = {}", realtime.priority)?;
    writeln!(text, "lock_memory = {}", realtime.lock_memory)?;
    writeln!(text, "prefault = {}", realtime.prefault)?;
    writeln!(text, "wait = \"{}\"", realtime.wait.name())?;
    Ok(())
}

fn plant_tables(
    text: &mut String,
    plan: &PlantPlan,
    plant: &PlantDescription,
    program: Option<&Path>,
) -> Written {
    writeln!(text, "\n[plant] # {}", comment(&plant.summary))?;
    writeln!(text, "model = {}", string(&plan.model))?;
    if let Some(program) = program.and_then(|program| program.to_str()) {
        writeln!(text, "program = {}", string(program))?;
    }
    writeln!(text, "substeps = {}", plan.substeps)?;
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
        let (min, max) = (toml_float(limit.min), toml_float(limit.max));
        writeln!(text, "{} = [{min}, {max}]", key(&limit.signal))?;
    }
    let safe = &plan.safe_command;
    settings(text, "plant.safe_command", safe, &plant.commands)
}

fn controller(
    text: &mut String,
    plan: &ControllerPlan,
    law: &LawDescription,
    rate: Rate,
    program: Option<&ControllerProgram>,
) -> Written {
    writeln!(text, "\n[controller] # {}", comment(&law.summary))?;
    writeln!(text, "law = {}", string(&plan.law))?;
    match program {
        None => {}
        Some(ControllerProgram::One(file)) => {
            if let Some(file) = file.to_str() {
                writeln!(text, "program = {}", string(file))?;
            }
        }
        Some(ControllerProgram::ByMachine(files)) => {
            let named =
                (files.iter()).filter_map(|(machine, file)| Some((machine, file.to_str()?)));
            for (machine, file) in named {
                writeln!(text, "program.{} = {}", key(machine), string(file))?;
            }
        }
    }
    let rate_hz = toml_float(rate.hz() / f64::from(plan.rate_divisor));
    writeln!(text, "rate_hz = {rate_hz}")?;
    writeln!(text, "command_delay_steps = {}", plan.command_delay_steps)?;
    let table = format!("controller.{}", key(&plan.law));
    settings(text, &table, &plan.parameters, &law.parameters)?;
    settings(text, "controller.model", &plan.model, &law.model)
}

/// A table of values in the order of the description.
fn settings(text: &mut String, table: &str, values: &Settings, fields: &[Field]) -> Written {
    if fields.is_empty() {
        return Ok(());
    }
    writeln!(text, "\n[{table}]")?;
    for field in fields {
        let Some(value) = values.get(&field.name) else {
            return Err(undescribed(format!("`{}` that fits the plan", field.name)));
        };
        let name: Vec<String> = field.name.split('.').map(key).collect();
        let range = Quantity::from(field).range();
        let mut notes = vec![field.unit.clone(), range];
        if field.faultable {
            notes.push("faultable".into());
        }
        notes.retain(|note| !note.is_empty());
        writeln!(
            text,
            "{} = {} # {}. {}",
            name.join("."),
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
    let (kind, numbers) = match stimulus.waveform {
        Waveform::Paper {
            amplitude,
            frequency_hz,
            onset_per_s3,
        } => (
            "paper",
            vec![
                ("amplitude", amplitude),
                ("frequency_hz", frequency_hz),
                ("onset_per_s3", onset_per_s3),
            ],
        ),
        Waveform::Step {
            at_s,
            before,
            after,
        } => (
            "step",
            vec![("at_s", at_s), ("before", before), ("after", after)],
        ),
        Waveform::Ramp {
            at_s,
            duration_s,
            start,
            end,
        } => (
            "ramp",
            vec![
                ("at_s", at_s),
                ("duration_s", duration_s),
                ("start", start),
                ("end", end),
            ],
        ),
        Waveform::Sine {
            amplitude,
            frequency_hz,
            phase_rad,
            offset,
        } => (
            "sine",
            vec![
                ("amplitude", amplitude),
                ("frequency_hz", frequency_hz),
                ("phase_rad", phase_rad),
                ("offset", offset),
            ],
        ),
        Waveform::Chirp {
            amplitude,
            start_hz,
            end_hz,
            duration_s,
            sweep: _,
            offset,
        } => (
            "chirp",
            vec![
                ("amplitude", amplitude),
                ("start_hz", start_hz),
                ("end_hz", end_hz),
                ("duration_s", duration_s),
                ("offset", offset),
            ],
        ),
        Waveform::Table { .. } => ("table", Vec::new()),
    };
    writeln!(text, "kind = \"{kind}\"")?;
    for (name, value) in numbers {
        writeln!(text, "{name} = {}", toml_float(value))?;
    }
    if let Waveform::Chirp { sweep, .. } = stimulus.waveform
        && sweep != Sweep::Linear
    {
        writeln!(text, "sweep = \"{}\"", sweep.name())?;
    }
    // The points themselves, so that the text does not depend on another file.
    if let Waveform::Table { time_s, values } = &stimulus.waveform {
        writeln!(text, "time_s = {}", list(time_s))?;
        writeln!(text, "values = {}", list(values))?;
    }
    Ok(())
}

fn metric(text: &mut String, metric: &Metric) -> Written {
    writeln!(text, "\n[[metrics]]")?;
    writeln!(text, "name = {}", string(&metric.name))?;
    writeln!(text, "unit = {}", string(&metric.unit))?;
    writeln!(
        text,
        "expression = {}",
        string(&metric.expression.to_string())
    )?;
    if !metric.windows.is_empty() {
        let windows: Vec<String> = metric
            .windows
            .iter()
            .map(|window| list(&[window.start_s, window.end_s]))
            .collect();
        writeln!(text, "windows_s = [{}]", windows.join(", "))?;
    }
    if let Some(note) = &metric.published_note {
        writeln!(text, "published_note = {}", string(note))?;
    }
    for published in &metric.published {
        writeln!(text, "[[metrics.published]]")?;
        writeln!(text, "law = {}", string(&published.law))?;
        writeln!(text, "window_s = {}", list(&published.window_s))?;
        writeln!(text, "value = {}", toml_float(published.value))?;
        writeln!(text, "source = {}", string(&published.source))?;
    }
    Ok(())
}

fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| toml_float(*value)).collect();
    format!("[{}]", values.join(", "))
}

/// A TOML string.
fn string(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// A TOML key, quoted if it must be.
fn key(name: &str) -> String {
    let bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    if !name.is_empty() && name.chars().all(bare) {
        name.into()
    } else {
        string(name)
    }
}

/// Text that may stand behind a `#`: one line, no control characters.
fn comment(text: &str) -> String {
    text.split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace(char::is_control, "")
}

//! `hil linearise`: the linear model of a plant, a law or their loop at a point of a scenario. Changes no scenario.

use std::path::Path;
use std::sync::Arc;

use hil_config::plan::Plan;
use hil_console::files::destination::{Destination, deliver};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::programs::binaries::host::ModelKind;
use hil_facts::programs::binaries::{Binaries, Binary};
use hil_facts::programs::scenario::Finder;
use shared_types::time::Step;

use crate::acting;
use crate::arguments::{LineariseArguments, Part};
use crate::closed_loop;
use crate::continuous;
use crate::file::{File, Origin};
use crate::model::LinearModel;
use crate::point::Point;
use crate::question::{Asker, Changed};

/// Runs the command.
///
/// # Errors
/// If the scenario is invalid, a side does not name its state, or there is no linear model at the point.
pub fn linearise(arguments: &LineariseArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let mut finder = Finder::new(&arguments.binaries, None, &interruption);
    let (plan, binaries, _) =
        finder.read(&arguments.scenario, &arguments.changes, arguments.json)?;
    let sides = match arguments.of {
        Part::Plant => [true, false],
        Part::Law => [false, true],
        Part::Loop => [true, true],
    };
    refuse_unnamed(&plan, &binaries, sides, Basis::Derivatives)?;
    if arguments.of != Part::Plant {
        refuse_renamed(&plan)?;
    }
    if arguments.of == Part::Loop {
        refuse_between(&plan)?;
    }
    if arguments.of != Part::Plant && arguments.at <= 0.0 {
        return Err(Failure::usage(
            "a law has no past before its first sample; give a later point with --at",
        ));
    }
    if arguments.of == Part::Loop {
        refuse_fault_between(&plan, plan.run.rate.step_at_or_after(arguments.at))?;
    }
    // Refused before anything runs.
    let is_file = |path: &&Path| *path != Path::new("-");
    let path = arguments.output.as_deref().filter(is_file);
    let destination = path.map(|path| Destination::open(Some(path), arguments.force));
    let destination = destination.transpose()?;
    let folder = tempfile::tempdir().map_err(Failure::infrastructure)?;
    let out = folder.path().join("run");
    let point = Point::reach(plan, &binaries, (arguments.at, &out, false), &interruption)?;
    let asker = Asker {
        point: &point,
        folder: folder.path(),
        interruption: &interruption,
    };
    let model = match arguments.of {
        Part::Plant => plant(&asker)?,
        Part::Law => law(&asker)?.0,
        Part::Loop => {
            let (law, measured) = law(&asker)?;
            closed_loop::joined(&plant(&asker)?, &law, measured).map_err(Failure::Differ)?
        }
    };
    let origin = Origin {
        scenario: &point.plan.name,
        of: match arguments.of {
            Part::Plant => "plant",
            Part::Law => "law",
            Part::Loop => "loop",
        },
        time_s: point.time_s(),
        step: point.step.0,
    };
    let file = File::of(&model, &origin).map_err(Failure::Differ)?;
    if let Some(destination) = destination {
        deliver(&output::pretty(&file)?, destination, path)?;
    }
    let is_json = arguments.json || (arguments.output.is_some() && path.is_none());
    output::result(is_json, &file, || file.text())?;
    Ok(Exit::Pass)
}

/// Returns the model of the plant with the inputs of the point.
fn plant(asker: &Asker<'_>) -> Result<LinearModel, Failure> {
    let inputs = asker.point.plant_inputs(&asker.plant()?.commands)?;
    let map = asker.ask_plant(&inputs, &Changed::default())?;
    Ok(match map.is_continuous {
        true => continuous::sampled(map),
        false => LinearModel::of(map).reduced(),
    })
}

/// Returns the model of the law with the sample of the point, and its number of measured inputs.
fn law(asker: &Asker<'_>) -> Result<(LinearModel, usize), Failure> {
    let law = asker.law()?;
    let sample = asker.point.sample(&law)?;
    let map = asker.ask_law(&sample, &Changed::default())?;
    let measured = map
        .inputs
        .iter()
        .filter(|input| input.name.starts_with("measured."));
    let measured = measured.count();
    let model = match map.is_continuous {
        true => continuous::stepped(map),
        false => LinearModel::of(map).reduced(),
    };
    Ok((model, measured))
}

/// Basis of an operating point in a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Basis {
    /// Named numbers of the state, which can be set.
    Numbers,
    /// Named numbers of the state, or the directional derivatives of an FMU.
    Derivatives,
}

/// Refuses sides without the basis; `sides` are the plant and the law.
pub(crate) fn refuse_unnamed(
    plan: &Plan,
    binaries: &Arc<Binaries>,
    sides: [bool; 2],
    basis: Basis,
) -> Result<(), Failure> {
    let (plants, laws, _) = binaries.described();
    let plant = plants.iter().find(|plant| plant.name == plan.plant.model);
    let law = plan.law_among(laws);
    let states = [
        plant.and_then(|plant| plant.state.as_ref()),
        law.as_ref().and_then(|law| law.state.as_ref()),
    ];
    let names = [
        ("plant", &plan.plant.model, &binaries.plant),
        ("law", &plan.controller.law, &binaries.controller),
    ];
    let differentiates = |binary: &Binary| {
        let imported = binary.description.imported.as_ref();
        let has_states = imported.is_some_and(|fmu| !fmu.continuous_states.is_empty());
        basis == Basis::Derivatives && has_states
    };
    let mut both = sides.into_iter().zip(states).zip(names);
    if let Some((_, (side, name, binary))) = both.find(|((is_needed, state), (_, _, binary))| {
        *is_needed && state.is_none() && !differentiates(binary)
    }) {
        let what = match binary.host.as_ref().map(|host| host.kind) {
            Some(ModelKind::Fmu) if basis == Basis::Numbers => {
                "is an FMU, whose state is bytes and cannot be set to another point"
            }
            Some(ModelKind::Fmu) => {
                "is an FMU that provides no directional derivatives by its continuous states (`providesDirectionalDerivative`, in FMI 3 `providesDirectionalDerivatives`, and their derivatives in the model structure), and whose state is bytes"
            }
            Some(ModelKind::Port) => {
                "is behind a port: hardware, or a program of others, whose state is not known here"
            }
            Some(ModelKind::Python) => {
                "does not name the numbers of its state, which `state=` of its decorator does"
            }
            None => {
                "does not name the numbers of its state, which `StateOf::named` does, and `state` in C"
            }
        };
        let lacks = match basis {
            Basis::Numbers => "no equilibrium can be solved for",
            Basis::Derivatives => "there is no linear model of it",
        };
        return Err(Failure::Differ(format!("{side} `{name}` {what}: {lacks}")));
    }
    Ok(())
}

fn refuse_renamed(plan: &Plan) -> Result<(), Failure> {
    match plan.controller.connections.first() {
        None => Ok(()),
        Some(_) => Err(Failure::Differ(
            "the law's signals have other names and units in this scenario (`[connect]`), which a linear model does not follow in this version; use --of plant".into(),
        )),
    }
}

/// Refuses a loop with something between plant and law that has a state of its own.
fn refuse_between(plan: &Plan) -> Result<(), Failure> {
    match between(plan) {
        None => Ok(()),
        Some(what) => Err(Failure::Differ(format!(
            "the loop has {what}, whose state has no names, so the linear loop would lack it; use --of plant and --of law"
        ))),
    }
}

/// Refuses a loop with a fault between plant and law at a step, before the run that would show if a condition held.
fn refuse_fault_between(plan: &Plan, step: Step) -> Result<(), Failure> {
    match acting::between(plan, step, &[]) {
        None => Ok(()),
        Some(fault) => Err(Failure::Differ(format!(
            "{fault}, and the linear loop would lack it; choose an --at where it does not act, take it out of the scenario, or use --of plant and --of law"
        ))),
    }
}

/// Returns what stands between plant and law and has a state of its own, if anything.
pub(crate) fn between(plan: &Plan) -> Option<&'static str> {
    let all = [
        ("sensors (`[[sensors]]`)", !plan.sensors.is_empty()),
        ("actuators (`[[actuators]]`)", !plan.actuators.is_empty()),
        ("a bus (`[bus]`)", plan.bus.is_some()),
        (
            "a delay of the command (`controller.command_delay_steps`)",
            plan.controller.command_delay_steps > 0,
        ),
        (
            "a slower law (`controller.rate_hz`)",
            plan.controller.rate_divisor > 1,
        ),
    ];
    let mut there = all.into_iter().filter(|(_, is_there)| *is_there);
    there.next().map(|(what, _)| what)
}

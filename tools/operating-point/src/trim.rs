//! `hil trim`: the equilibrium of a plant and its law at a point of a scenario, and the checkpoint that begins there.
//! Finds nothing by running: the equations are those of one period.

use std::collections::BTreeMap;
use std::path::Path;

use hil_console::files::folder;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::checkpoint;
use hil_facts::programs::scenario::Finder;
use shared_types::describe::{PlantDescription, Settings};
use shared_types::extremes::larger;
use shared_types::local_map::{LocalMap, Variable};
use shared_types::number::{counted, exact, exact_in};
use shared_types::side::Side;
use shared_types::table::{Field, nearest};
use shared_types::time::Step;

use crate::acting;
use crate::arguments::{ResolvedLists, TrimArguments};
use crate::equilibrium::{Equilibrium, Law, Row};
use crate::later;
use crate::limits::exceeded;
use crate::linearise::{Basis, between, refuse_unnamed};
use crate::model::LinearModel;
use crate::modes::{self, Mode};
use crate::point::Point;
use crate::question::{Asker, Changed};
use crate::solver::{Held, Place, Problem, Residual, Solution, relative, solve};

/// Times at which the equations are evaluated again, as shares of the rest of the run.
const LATER: [f64; 3] = [0.25, 0.5, 0.9];

/// Question without changes: an equilibrium may be at a kink.
const ROUGH: Changed<'static> = Changed {
    state: Settings(BTreeMap::new()),
    save: None,
    passes_kinks: true,
    later_steps: 0,
};

/// Runs the command.
///
/// # Errors
/// If the scenario is invalid, a side does not name its state, or there is no equilibrium.
pub fn trim(arguments: &TrimArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let mut finder = Finder::new(&arguments.binaries, None, &interruption);
    let ResolvedLists {
        scenario,
        hold,
        free,
    } = arguments.resolved();
    let scenario = scenario.ok_or_else(|| {
        Failure::usage("the scenario is missing; hil trim SCENARIO.toml --hold SIGNAL=VALUE")
    })?;
    let (plan, binaries, _) = finder.read(scenario, &arguments.changes, arguments.json)?;
    refuse_unnamed(&plan, &binaries, [true, false], Basis::Numbers)?;
    let plant = plan.whole_plant_among(binaries.described().0);
    let plant = plant.ok_or_else(|| Failure::infrastructure("the plant is missing"))?;
    // Refused before anything runs.
    let (problem, inputs) = problem(plant, hold, free)?;
    let first_s = plan.run.rate.seconds(Step(1));
    let at_s = match arguments.at {
        Some(at_s) if at_s < first_s => {
            return Err(Failure::usage(format!(
                "--at {} is too early: a checkpoint has a past; the first step that can have one is at {}",
                exact(at_s),
                exact_in(first_s, "s")
            )));
        }
        at_s => at_s.unwrap_or(first_s),
    };
    let out = folder::of_run(arguments.out.as_deref(), &plan.name, "trim");
    let scratch = tempfile::tempdir().map_err(Failure::infrastructure)?;
    let is_new = !out.exists();
    // The run is only the way to the point, and kept with its result alone.
    let discard = || {
        if is_new {
            let _ = std::fs::remove_dir_all(&out);
        }
    };
    let point = Point::reach(plan, &binaries, (at_s, &out, true), &interruption);
    let point = point.inspect_err(|_| discard())?;
    let asker = Asker {
        point: &point,
        folder: scratch.path(),
        interruption: &interruption,
    };
    let result = trimmed(&asker, &problem, &inputs, scratch.path());
    let result = result.inspect_err(|_| discard())?;
    output::result(arguments.json, &result, || result.text())?;
    Ok(Exit::Pass)
}

/// Resolves the held and the free signals; returns also the inputs that are held at a value.
fn problem(
    plant: &PlantDescription,
    hold: &[String],
    free: &[String],
) -> Result<(Problem, Settings), Failure> {
    let states = plant.state.as_deref().unwrap_or_default();
    let place = |fields: &[Field], name: &str| fields.iter().position(|field| field.name == name);
    let bare = |name: &str| {
        let prefixes = ["state.", "command.", "measured."];
        let prefix = prefixes.iter().find_map(|prefix| name.strip_prefix(prefix));
        prefix.unwrap_or(name).to_owned()
    };
    let find = |name: &str| {
        let own = bare(name);
        let is_for = |group: &str| !name.contains('.') || name.starts_with(group);
        let input = place(&plant.commands, &own).filter(|_| is_for("command."));
        let state = place(states, &own).filter(|_| is_for("state."));
        let output = place(&plant.measured, &own).filter(|_| is_for("measured."));
        (input.map(Place::Input))
            .or_else(|| state.map(Place::State))
            .or_else(|| output.map(Place::Output))
    };
    let unknown = |flag: &str, name: &str, all: &[&Field]| {
        let names = all.iter().map(|field| field.name.as_str());
        let near = nearest(name, names.clone());
        let hint = match near.is_empty() {
            true => format!("there are {}", names.collect::<Vec<_>>().join(", ")),
            false => format!("did you mean {}?", near.join(", ")),
        };
        Failure::usage(format!(
            "{flag} {name}: the plant has no such number; {hint}"
        ))
    };
    let (mut held, mut inputs) = (Vec::new(), Settings::default());
    for text in hold {
        let (name, value) = text
            .split_once('=')
            .ok_or_else(|| Failure::usage(format!("--hold {text}: expected SIGNAL=VALUE")))?;
        let value: f64 = (value.parse().ok())
            .filter(|value: &f64| value.is_finite())
            .ok_or_else(|| Failure::usage(format!("--hold {text}: {value} is not a number")))?;
        if held.iter().any(|one: &Held| one.name == name) || inputs.get(&bare(name)).is_some() {
            return Err(Failure::usage(format!("`{name}` is held twice")));
        }
        match find(name) {
            Some(Place::Input(place)) => inputs.set(&plant.commands[place].name, value),
            Some(place) => held.push(Held {
                name: name.into(),
                place,
                value,
            }),
            None => {
                let all = plant.commands.iter().chain(states).chain(&plant.measured);
                return Err(unknown("--hold", name, &all.collect::<Vec<_>>()));
            }
        }
    }
    let mut places = Vec::new();
    for name in free {
        let Some(Place::Input(place)) = find(name) else {
            let all: Vec<&Field> = plant.commands.iter().collect();
            return Err(unknown("--free", name, &all));
        };
        let name = &plant.commands[place].name;
        if inputs.get(name).is_some() {
            return Err(Failure::usage(format!(
                "`{name}` is both in --hold and in --free; every state is free anyway"
            )));
        }
        places.push(place);
    }
    Ok((Problem { held, free: places }, inputs))
}

/// Solves the plant, then the law, and writes both into the checkpoint.
fn trimmed(
    asker: &Asker<'_>,
    problem: &Problem,
    held_inputs: &Settings,
    scratch: &Path,
) -> Result<Equilibrium, Failure> {
    let plant = asker.plant()?;
    let mut inputs = asker.point.plant_inputs(&plant.commands)?;
    inputs.0.extend(held_inputs.0.clone());
    let start = asker.ask_plant(&inputs, &ROUGH)?;
    let names = start.clone();
    let mut map = |states: &[f64], inputs: &[f64]| {
        asker.interruption.check()?;
        let changed = Changed {
            state: settings(&names.states, states),
            ..ROUGH
        };
        asker.ask_plant(&settings(&names.inputs, inputs), &changed)
    };
    let solution = solve(start, problem, &mut map)?;
    refuse(&solution, plant, problem)?;
    let map = &solution.map;
    let (states, inputs) = (values(&map.states), values(&map.inputs));
    let later_residual = later_residual(asker, map, &states, &inputs)?;

    let changed = Changed {
        state: states,
        save: Some(scratch),
        ..ROUGH
    };
    asker.ask_plant(&inputs, &changed)?;
    replace(asker, Side::Plant, scratch)?;
    let law = law(asker, map, scratch)?;

    let reduced = LinearModel::of(map.clone()).reduced();
    let modes = modes::of(&reduced.a, reduced.period_s).map_err(Failure::Differ)?;
    let largest = modes.first().map_or(0.0, |mode| mode.magnitude);
    let rows = map.states.iter().zip(&map.next);
    Ok(Equilibrium {
        scenario: asker.point.plan.name.clone(),
        time_s: asker.point.time_s(),
        step: asker.point.step.0,
        states: rows
            .map(|(state, next)| Row {
                variable: state.clone(),
                residual: next - state.value,
            })
            .collect(),
        inputs: map.inputs.clone(),
        outputs: map.outputs.clone(),
        evaluations: solution.evaluations,
        largest_eigenvalue: largest,
        is_stable: modes.iter().all(Mode::decays),
        undetermined: solution.undetermined.clone(),
        exceeded: exceeded(&asker.point.plan, plant, map),
        still_to_come: later::events(&asker.point.plan, asker.point.step, &asker.point.begun),
        law,
        later_residual,
        checkpoint: asker.point.checkpoint.clone().unwrap_or_default(),
    })
}

fn settings(variables: &[Variable], values: &[f64]) -> Settings {
    let mut settings = Settings::default();
    for (variable, value) in variables.iter().zip(values) {
        settings.set(&variable.name, *value);
    }
    settings
}

fn values(variables: &[Variable]) -> Settings {
    let values: Vec<f64> = variables.iter().map(|one| one.value).collect();
    settings(variables, &values)
}

/// Refuses a solution that is no equilibrium or beyond the range of a command.
fn refuse(solution: &Solution, plant: &PlantDescription, problem: &Problem) -> Result<(), Failure> {
    if !solution.holds() {
        let violated = solution.violated();
        let line = |one: &&Residual| {
            let (name, unit, value) = (&one.name, &one.unit, one.value);
            match one.is_held {
                true => format!("\n  `{name}` is off its held value by {value:e} {unit}"),
                false => format!("\n  `{name}` changes by {value:e} {unit} in a step"),
            }
        };
        let lines: Vec<String> = violated.iter().take(4).map(line).collect();
        let advice = match problem.free.is_empty() {
            true => "let a command move with --free, or hold other values",
            false => "hold fewer or other values",
        };
        return Err(Failure::Differ(format!(
            "no equilibrium: the closest point, found in {}, leaves residuals; {advice}:{}",
            counted(solution.evaluations.into(), "evaluation"),
            lines.concat()
        )));
    }
    for (input, field) in solution.map.inputs.iter().zip(&plant.commands) {
        if !field.admits(input.value) {
            return Err(Failure::Differ(format!(
                "no equilibrium within bounds: it needs `{}` = {} {}, outside {} to {}",
                input.name,
                exact(input.value),
                input.unit,
                exact(field.min),
                exact(field.max)
            )));
        }
    }
    Ok(())
}

/// Returns the largest relative residual of a state in one period at later times.
fn later_residual(
    asker: &Asker<'_>,
    equilibrium: &LocalMap,
    states: &Settings,
    inputs: &Settings,
) -> Result<f64, Failure> {
    let rest = asker.point.plan.run.steps - asker.point.step.0;
    let mut largest = 0.0_f64;
    for share in LATER {
        let changed = Changed {
            state: states.clone(),
            later_steps: (share * rest as f64) as u64,
            ..ROUGH
        };
        let map = asker.ask_plant(inputs, &changed)?;
        largest = relative(&map, equilibrium)
            .into_iter()
            .fold(largest, larger);
    }
    Ok(largest)
}

/// Brings the law to the state in which it holds the plant's equilibrium, if there is one.
fn law(asker: &Asker<'_>, plant: &LocalMap, scratch: &Path) -> Result<Law, Failure> {
    let described = asker.law()?;
    let refused = |reason: String| {
        Ok(Law {
            refused: Some(reason),
            ..Law::default()
        })
    };
    if described.state.is_none() {
        return refused("it does not name the numbers of its state".into());
    }
    if !asker.point.plan.controller.connections.is_empty() {
        return refused("its signals have other names in this scenario".into());
    }
    let (plan, step) = (&asker.point.plan, asker.point.step);
    let part = between(plan).map(|what| format!("the loop has {what}"));
    if let Some(what) = part.or_else(|| acting::between(plan, step, &asker.point.begun)) {
        return refused(format!("{what}, with which it was not solved"));
    }
    let mut sample = asker.point.sample(&described)?;
    for output in &plant.outputs {
        let name = format!("measured.{}", output.name);
        if sample.get(&name).is_some() {
            sample.set(&name, output.value);
        }
    }
    let start = asker.ask_law(&sample, &ROUGH)?;
    let commanded = |(place, command): (usize, &Variable)| {
        let input = plant
            .inputs
            .iter()
            .find(|input| input.name == command.name)?;
        Some(Held {
            name: command.name.clone(),
            place: Place::Output(place),
            value: input.value,
        })
    };
    let problem = Problem {
        held: start
            .outputs
            .iter()
            .enumerate()
            .filter_map(commanded)
            .collect(),
        free: Vec::new(),
    };
    let names = start.clone();
    let mut map = |states: &[f64], _: &[f64]| {
        asker.interruption.check()?;
        let changed = Changed {
            state: settings(&names.states, states),
            ..ROUGH
        };
        asker.ask_law(&sample, &changed)
    };
    let solution = solve(start, &problem, &mut map)?;
    if let [worst, ..] = solution.violated()[..] {
        return refused(format!(
            "with this sample `{}` is off by {:e} {}",
            worst.name, worst.value, worst.unit
        ));
    }
    let changed = Changed {
        state: values(&solution.map.states),
        save: Some(scratch),
        ..ROUGH
    };
    asker.ask_law(&sample, &changed)?;
    replace(asker, Side::Controller, scratch)?;
    Ok(Law {
        states: solution.map.states,
        refused: None,
    })
}

fn replace(asker: &Asker<'_>, side: Side, scratch: &Path) -> Result<(), Failure> {
    let checkpoint = asker.point.checkpoint.as_ref();
    let checkpoint = checkpoint.ok_or_else(|| Failure::infrastructure("there is no checkpoint"))?;
    checkpoint::replace(
        checkpoint,
        side,
        &scratch.join(side.file(asker.point.step)),
        "its state is that of hil trim, not of the run",
    )
}

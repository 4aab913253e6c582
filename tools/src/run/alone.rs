//! A run in the thread that asks for it: no session, no folder, no recording and no other thread.
//!
//! For very many runs of what is built into `hil`. Engine, runner and the recorder's work are those of every
//! other run, so digest, metrics and requirements are too. Waits for nobody: both sides and the recorder take
//! turns.

use std::sync::Arc;

use controller_process::runner::Runner;
use hil_campaign::curve::Grid;
use hil_config::plan::{Clock, Plan};
use plant_process::engine::Engine;
use shared_types::describe::Description;
use shared_types::link::in_process::{self, InProcessLink};
use shared_types::record::Outcome;
use shared_types::wait::{WaitLimit, WaitStrategy, Waiter};

use super::in_process::{FAULTS, LAWS, PLANTS, plant_of, runner, turns};
use super::jobs;
use super::recorder::direct::DirectRecorder;
use crate::results::ended::EndedRun;
use crate::terminal::exit::Failure;
use crate::terminal::interruption::Interruption;

/// Number of every session that is none: no frame of such a run leaves its thread.
const NO_SESSION: u64 = 0;

/// Plants, laws and kinds of faults that are built into `hil`.
pub(crate) fn built_in() -> [Description; 2] {
    let version = env!("CARGO_PKG_VERSION");
    let mut plant = Description::new("plant-process", version);
    plant.plants = PLANTS.iter().map(|kind| kind.description.clone()).collect();
    plant.faults = FAULTS.iter().map(|kind| kind.description.clone()).collect();
    let mut controller = Description::new("controller-process", version);
    controller.laws = LAWS.iter().map(|kind| kind.description.clone()).collect();
    [plant, controller]
}

/// Refuses a plan whose result depends on the clock.
///
/// # Errors
/// If it is one.
pub(crate) fn refuse_clock(plan: &Plan) -> Result<(), Failure> {
    match plan.run.clock {
        Clock::Lockstep => Ok(()),
        Clock::Paced { .. } | Clock::Realtime => Err(Failure::usage(format!(
            "run.clock = \"{}\": very many runs are in lockstep, which waits for no clock",
            plan.run.clock.name()
        ))),
    }
}

/// Both sides of a run, and the recorder that the plant writes to.
type Sides<'a> = (
    Engine<InProcessLink, DirectRecorder>,
    Runner<'a, InProcessLink>,
    DirectRecorder,
);

/// Makes both sides of a plan that was checked against what is [built in](built_in).
fn sides(
    plan: &Plan,
    [plant, controller]: &[Description; 2],
    grid: Option<Arc<Grid>>,
) -> Result<Sides<'static>, Failure> {
    let both = (plan.plant_among(&plant.plants)).zip(plan.law_among(&controller.laws));
    let (plant, law) = both.ok_or_else(|| Failure::infrastructure("hil lost its plant or law"))?;
    let layout = plan.record_layout(plant, &law);
    let plant = plant_process::job::Job {
        law: Some(law),
        ..plant_process::job::Job::of(plan, NO_SESSION, f64::INFINITY)
    };
    let controller = jobs::controller(plan, NO_SESSION, f64::INFINITY);
    let (plant_link, controller_link) = in_process::pair();
    let recorder = DirectRecorder::new(plan.clone(), layout, grid);
    let kind = plant_of(&plant).map_err(Failure::usage)?;
    let engine = Engine::new(kind, &FAULTS, plant, plant_link, recorder.clone());
    let engine = engine.map_err(Failure::usage)?;
    let runner = runner(controller, controller_link).map_err(Failure::usage)?;
    Ok((engine, runner, recorder))
}

/// Checks the jobs of a plan as `--check` of programs does.
///
/// # Errors
/// Objection of a side to its job.
pub(crate) fn check(plan: &Plan, described: &[Description; 2]) -> Result<(), Failure> {
    sides(plan, described, None).map(|_| ())
}

/// Runs a plan that was checked against what is [built in](built_in); takes its curve if there is a grid for it.
///
/// # Errors
/// If a side refuses its job, or it was interrupted.
pub(crate) fn run(
    plan: &Plan,
    described: &[Description; 2],
    grid: Option<Arc<Grid>>,
    interruption: &Interruption,
) -> Result<EndedRun, Failure> {
    let (mut engine, mut runner, recorder) = sides(plan, described, grid)?;
    let limit = WaitLimit::from_seconds(f64::INFINITY);
    let waiter = Waiter::with(limit, WaitStrategy::Hybrid, true);
    let wants_stop = || interruption.came() || recorder.has_failed();
    let turned = turns(&mut engine, &mut runner, waiter, wants_stop);
    let end = engine.end().cloned();
    drop(engine);
    let recorded = recorder.finish();
    interruption.check()?;
    turned.map_err(Failure::infrastructure)?;
    let (outcome, reason) = match (&recorded.error, end) {
        (Some(error), _) => (Outcome::Failed, Some(error.clone())),
        (None, Some(end)) => (end.outcome, end.reason),
        (None, None) => (
            Outcome::Failed,
            Some("the run ended without saying how".into()),
        ),
    };
    Ok(EndedRun::new(recorded, outcome, reason))
}

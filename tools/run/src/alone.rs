//! Run in the calling thread: no session, no folder, no recording and no other thread.
//!
//! Used for large numbers of runs of the plants and laws built into `hil`. Engine, runner and recorder are the same as
//! in every other run, and so are digest, metrics and requirements. Never blocks: both sides and the recorder take
//! turns.

use std::sync::Arc;

use controller_process::job::Job as ControllerJob;
use hil_config::plan::{Clock, Plan};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::results::curve::Grid;
use hil_facts::results::ended::EndedRun;
use hil_in_process::{FAULTS, LAWS, PLANTS, Turns, check_controller, check_plant};
use hil_session::waiter::Waiter;
use plant_process::job::Job as PlantJob;
use shared_types::describe::Description;
use shared_types::record::{Outcome, RecordLayout, RunEnd};
use shared_types::stream::RecordSink;
use shared_types::wait::{WaitLimit, WaitStrategy};

use super::jobs;
use super::recorder::direct::DirectRecorder;

/// Session number of such runs, whose frames never leave the thread.
const NO_SESSION: u64 = 0;

/// Returns the descriptions of the plants, laws and fault kinds built into `hil`.
pub fn built_in() -> [Description; 2] {
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
/// If the result depends on the clock.
pub fn refuse_clock(plan: &Plan) -> Result<(), Failure> {
    match plan.run.clock {
        Clock::Lockstep => Ok(()),
        Clock::Paced { .. } | Clock::Realtime => Err(Failure::usage(format!(
            "run.clock = \"{}\": runs without processes are in lockstep, which ignores the clock",
            plan.run.clock.name()
        ))),
    }
}

/// Creates the jobs of a plan checked against the [built-in](built_in) descriptions, and the layout of its records.
pub(super) fn jobs_of(
    plan: &Plan,
    [plant, controller]: &[Description; 2],
) -> Result<(PlantJob, ControllerJob, RecordLayout), Failure> {
    let both = (plan.plant_among(&plant.plants)).zip(plan.law_among(&controller.laws));
    let (plant, law) = both
        .ok_or_else(|| Failure::infrastructure("the plan's plant or law is not built into hil"))?;
    let layout = plan.record_layout(&plant, &law);
    let plant = PlantJob {
        law: Some(law),
        ..PlantJob::of(plan, NO_SESSION, f64::INFINITY)
    };
    let controller = jobs::controller(plan, NO_SESSION, f64::INFINITY);
    Ok((plant, controller, layout))
}

/// Checks the jobs of a plan as `--check` of the programs does.
///
/// # Errors
/// The objection of a side to its job.
pub fn check(plan: &Plan, described: &[Description; 2]) -> Result<(), Failure> {
    let (plant, controller, _) = jobs_of(plan, described)?;
    check_plant(plant).map_err(Failure::usage)?;
    check_controller(controller).map_err(Failure::usage)
}

/// Executes a plan checked against the [built-in](built_in) descriptions; records its curve if `grid` is set.
///
/// # Errors
/// If a side refuses its job, or the run was interrupted.
pub fn run(
    plan: &Plan,
    described: &[Description; 2],
    grid: Option<Arc<Grid>>,
    interruption: &Interruption,
) -> Result<EndedRun, Failure> {
    let (plant, controller, layout) = jobs_of(plan, described)?;
    let mut recorder = DirectRecorder::new(plan.clone(), layout, grid);
    let has_failed = recorder.failure();
    let wants_stop = || interruption.came() || has_failed();
    let ran = turn(plant, controller, &mut recorder, &wants_stop)?;
    let recorded = recorder.finish();
    interruption.check()?;
    let end = ran.map_err(Failure::infrastructure)?;
    let (outcome, reason) = match &recorded.error {
        Some(error) => (Outcome::Failed, Some(error.clone())),
        None => (end.outcome, end.reason),
    };
    Ok(EndedRun::new(recorded, outcome, reason))
}

/// Executes a plan checked against the [built-in](built_in) descriptions; its records go to the sink that `sink`
/// creates for their layout, and nothing judges them.
///
/// # Errors
/// If a side refuses its job, or the run was interrupted.
pub fn observe<S: RecordSink>(
    plan: &Plan,
    described: &[Description; 2],
    sink: impl FnOnce(&RecordLayout) -> S,
    interruption: &Interruption,
) -> Result<(RunEnd, S), Failure> {
    let (plant, controller, layout) = jobs_of(plan, described)?;
    let mut sink = sink(&layout);
    let ran = turn(plant, controller, &mut sink, &|| interruption.came())?;
    interruption.check()?;
    Ok((ran.map_err(Failure::infrastructure)?, sink))
}

/// Runs both sides in turns; the inner error is that of a side that failed.
fn turn(
    plant: PlantJob,
    controller: ControllerJob,
    sink: &mut dyn RecordSink,
    wants_stop: &dyn Fn() -> bool,
) -> Result<Result<RunEnd, String>, Failure> {
    let turns = Turns::new(plant, controller, sink).map_err(Failure::usage)?;
    let limit = WaitLimit::from_seconds(f64::INFINITY);
    let waiter = Waiter::with(limit, WaitStrategy::Hybrid, true);
    Ok(turns.run(waiter, wants_stop))
}

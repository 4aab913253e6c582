//! Jobs of a run: each side's part of the plan, written to the session's folder and checked by both programs before
//! anything is started.

use hil_config::plan::{Clock, ControllerPlan, Plan, law_keys, settings_after};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::programs::binaries::{Binaries, Binary};
use hil_in_process::Kinds;
use hil_session::asking;
use hil_session::session::SessionInfo;
use plant_process::live::Objections;
use serde::Serialize;
use shared_types::checkpoint::Checkpoints;
use shared_types::describe;
use shared_types::realtime;
use shared_types::time::Step;

use super::settings::Settings;

/// Makes the jobs of both sides, which save their state before these steps.
pub(super) fn of(
    plan: &Plan,
    binaries: &Binaries,
    session: &SessionInfo,
    settings: &Settings,
    steps: &[Step],
) -> (plant_process::job::Job, controller_process::job::Job) {
    let wait_limit_s = settings.wait_limit_s;
    let has_fmu = [&binaries.plant, &binaries.controller]
        .iter()
        .any(|binary| binary.host.is_some());
    let start_limit_s = has_fmu.then_some(match wait_limit_s > asking::LEAST_S {
        true => wait_limit_s,
        false => asking::LEAST_S,
    });
    let start_limit_s = start_limit_s.filter(|limit_s| limit_s.is_finite());
    // Between two samples of a paced run the controller waits for the clock, not for the plant.
    let between_s = match plan.run.clock {
        Clock::Lockstep => 0.0,
        Clock::Paced { factor } => plan.run.rate.period_s() / factor,
        Clock::Realtime => plan.run.rate.period_s(),
    };
    // The cores of a target are not this machine's.
    let is_elsewhere = binaries.controller.at.is_some();
    let side = |settings: realtime::Settings| realtime::Settings {
        peer_core: settings.peer_core.filter(|_| !is_elsewhere),
        ..settings
    };
    let plant = plant_process::job::Job {
        law: plan.law_among(binaries.described().1),
        is_controller_by_hand: settings.by_hand.controller,
        pause_at_s: settings.pause_at_s,
        checkpoints: Checkpoints {
            steps: steps.to_vec(),
            folder: session.folder.clone(),
            resume: None,
        },
        realtime: side(plan.realtime.plant()),
        start_limit_s,
        ..plant_process::job::Job::of(plan, session.id, wait_limit_s)
    };
    let controller = controller_process::job::Job {
        is_plant_by_hand: settings.by_hand.plant,
        checkpoints: plant.checkpoints.clone(),
        realtime: side(plan.realtime.controller()),
        start_limit_s,
        ..controller(plan, session.id, wait_limit_s + between_s)
    };
    (plant, controller)
}

/// Makes the job of a controller without checkpoints and real-time settings.
pub fn controller(plan: &Plan, session: u64, wait_limit_s: f64) -> controller_process::job::Job {
    let (made_for, law) = (&plan.controller.made_for, &plan.controller.law);
    let rate = plan.run.rate;
    let job = controller_process::job::Job::new(session, made_for, law, rate, wait_limit_s);
    let job = with_law(job, plan.controller.clone());
    controller_process::job::Job {
        changes: settings_after(&plan.changes, &law_keys(law), &plan.controller.parameters),
        ..job
    }
}

/// Sets another law in a job.
pub(super) fn with_law(
    job: controller_process::job::Job,
    plan: ControllerPlan,
) -> controller_process::job::Job {
    controller_process::job::Job {
        plant: plan.made_for,
        changes: Vec::new(),
        law: plan.law,
        connections: plan.connections,
        parameters: plan.parameters,
        model: plan.model,
        rate_divisor: plan.rate_divisor,
        command_delay_steps: plan.command_delay_steps,
        ..job
    }
}

/// Returns the job with other values of some parameters, for a law to judge; the job resumes from no checkpoint.
pub(super) fn tuned(
    mut job: controller_process::job::Job,
    parameters: &describe::Settings,
) -> controller_process::job::Job {
    job.checkpoints.resume = None;
    job.changes.clear();
    job.is_tuned = true;
    for (name, value) in &parameters.0 {
        job.parameters.set(name, value.0);
    }
    job
}

/// Returns a plant's job with other parameters, for the plant to judge.
pub(super) fn tuned_plant(
    mut job: plant_process::job::Job,
    parameters: &describe::Settings,
) -> plant_process::job::Job {
    job.checkpoints.resume = None;
    job.changes.clear();
    job.is_tuned = true;
    for (name, value) in &parameters.0 {
        job.plant.parameters.set(name, value.0);
    }
    job
}

/// Judges parameters of plant and law of a run in this process by starting each side with them.
pub(super) fn objections(
    kinds: Kinds,
    plant: plant_process::job::Job,
    controller: controller_process::job::Job,
) -> Objections {
    Box::new(move |question| {
        if question.epoch == 0 {
            return kinds.check_plant(tuned_plant(plant.clone(), &question.parameters));
        }
        kinds.check_controller(tuned(controller.clone(), &question.parameters))
    })
}

/// Writes a job to the session's folder and has its program check it.
///
/// # Errors
/// The objection of the program to its job.
pub(super) fn check(
    binary: &Binary,
    session: &SessionInfo,
    file: &str,
    job: &impl Serialize,
    interruption: &Interruption,
) -> Result<(), Failure> {
    (session.write_file(file, job)).map_err(Failure::infrastructure)?;
    binary.check(&session.folder.join(file), interruption)
}

//! Jobs of a run: the part of the plan that each side gets, put into the session's folder and looked at by
//! both programs before anything is started.

use controller_process::job::JOB_FILE as CONTROLLER_FILE;
use hil_config::plan::{Clock, Plan};
use plant_process::job::JOB_FILE as PLANT_FILE;
use shared_types::checkpoint::Checkpoints;
use shared_types::session::{SessionError, SessionInfo};
use shared_types::time::Step;

use super::settings::Settings;
use crate::programs::binaries::Binaries;
use crate::terminal::exit::Failure;
use crate::terminal::interruption::Interruption;

/// Makes the job of each side, which saves its state before these steps.
pub(super) fn of(
    plan: &Plan,
    binaries: &Binaries,
    session: &SessionInfo,
    settings: &Settings,
    steps: &[Step],
) -> (plant_process::job::Job, controller_process::job::Job) {
    let wait_limit_s = settings.wait_limit_s;
    // Between two samples of a paced run the controller waits for the clock, not for the plant.
    let between_s = match plan.run.clock {
        Clock::Lockstep => 0.0,
        Clock::Paced { factor } => plan.run.rate.period_s() / factor,
        Clock::Realtime => plan.run.rate.period_s(),
    };
    let plant = plant_process::job::Job {
        law: plan.law_among(binaries.described().1).cloned(),
        pause_at_s: settings.pause_at_s,
        checkpoints: Checkpoints {
            steps: steps.to_vec(),
            folder: session.folder.clone(),
            resume: None,
        },
        realtime: plan.realtime.plant(),
        ..plant_process::job::Job::of(plan, session.id, wait_limit_s)
    };
    let controller = controller_process::job::Job {
        checkpoints: plant.checkpoints.clone(),
        realtime: plan.realtime.controller(),
        ..controller(plan, session, wait_limit_s + between_s)
    };
    (plant, controller)
}

/// Makes the job of a controller that saves nothing and asks nothing of its machine.
pub(crate) fn controller(
    plan: &Plan,
    session: &SessionInfo,
    wait_limit_s: f64,
) -> controller_process::job::Job {
    let (model, rate) = (&plan.plant.model, plan.run.rate);
    let plan = &plan.controller;
    controller_process::job::Job {
        parameters: plan.parameters.clone(),
        model: plan.model.clone(),
        rate_divisor: plan.rate_divisor,
        command_delay_steps: plan.command_delay_steps,
        ..controller_process::job::Job::new(session.id, model, &plan.law, rate, wait_limit_s)
    }
}

/// Puts the jobs into the session's folder and has both programs look at theirs.
///
/// # Errors
/// Objection of a program to its job.
pub(super) fn check(
    binaries: &Binaries,
    session: &SessionInfo,
    plant: &plant_process::job::Job,
    controller: &controller_process::job::Job,
    interruption: &Interruption,
) -> Result<(), Failure> {
    let failed = |error: SessionError| Failure::infrastructure(error);
    session.write_file(PLANT_FILE, plant).map_err(failed)?;
    (session.write_file(CONTROLLER_FILE, controller)).map_err(failed)?;
    let folder = &session.folder;
    (binaries.plant).check(&folder.join(PLANT_FILE), interruption)?;
    (binaries.controller).check(&folder.join(CONTROLLER_FILE), interruption)
}

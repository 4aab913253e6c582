//! Objections to parameters of plant and law: before the plant accepts a change, it sends a query here, and the program
//! in question is run with `--check` on a job with the new values.

use std::sync::{Arc, Mutex, PoisonError};

use controller_process::job::Job;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::programs::binaries::Binary;
use hil_facts::programs::binaries::reached::Reached;
use hil_session::live::{self, Listening, OBJECTIONS};
use hil_session::session::SessionInfo;
use hil_target::name::Target;
use shared_types::live::{ParameterAnswer, ParameterQuestion, Refusal};

use super::jobs;

/// Job to check, in the session's folder.
const FILE: &str = "judge.json";

/// Started controllers: program and job of each, by their numbers from 1.
pub(super) type Programs = Arc<Mutex<Vec<(Binary, Job)>>>;

/// Answers such queries until the returned value is dropped.
///
/// # Errors
/// If the socket cannot be created.
pub(super) fn listen(
    session: &SessionInfo,
    plant: (Binary, plant_process::job::Job),
    programs: Programs,
    interruption: Interruption,
) -> Result<Listening, Failure> {
    let theirs = session.clone();
    let check_plant =
        move |session: &SessionInfo, question: &ParameterQuestion, interruption: &Interruption| {
            let (binary, job) = &plant;
            let job = jobs::tuned_plant(job.clone(), &question.parameters);
            let checked = jobs::check(binary, session, FILE, &job, interruption);
            checked.map_err(|failure| failure.reason())
        };
    let listening = live::listen(session, OBJECTIONS, move |client| {
        // A plant that disconnected needs no answer.
        let _ = live::answer(client, |question: Result<ParameterQuestion, Refusal>| {
            let result = question
                .map_err(|refusal| refusal.message)
                .and_then(|question| match question.epoch {
                    0 => check_plant(&theirs, &question, &interruption),
                    _ => check_controller(&theirs, &programs, &question, &interruption),
                });
            ParameterAnswer {
                objection: result.err(),
            }
        });
    });
    listening.map_err(Failure::infrastructure)
}

fn check_controller(
    session: &SessionInfo,
    programs: &Programs,
    question: &ParameterQuestion,
    interruption: &Interruption,
) -> Result<(), String> {
    let member = {
        let programs = programs.lock().unwrap_or_else(PoisonError::into_inner);
        let place = (question.epoch as usize).checked_sub(1);
        place.and_then(|place| programs.get(place).cloned())
    };
    let (binary, job) = member.ok_or("there is no such controller")?;
    let target = binary.at.as_ref().map(Reached::target);
    if let Some(target) = target.filter(|target| matches!(target, Target::Serve(_))) {
        return Err(format!(
            "{target} serves one session at a time, so its program cannot judge other parameters during a run; use `[[changes]]` of a scenario, which are judged before the run"
        ));
    }
    let job = jobs::tuned(job, &question.parameters);
    let checked = jobs::check(&binary, session, FILE, &job, interruption);
    checked.map_err(|failure| failure.reason())
}

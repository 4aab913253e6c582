//! Objections to parameters of plant and law: the plant asks before it takes a change, and the program that they
//! are for answers, by `--check` with a job that has them.

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

/// Job that is checked, in the session's folder.
const FILE: &str = "judge.json";

/// The controllers that were started: program and job of each, by their numbers from 1.
pub(super) type Crew = Arc<Mutex<Vec<(Binary, Job)>>>;

/// Listens until what it gives is dropped.
///
/// # Errors
/// If the socket cannot be made.
pub(super) fn listen(
    session: &SessionInfo,
    plant: (Binary, plant_process::job::Job),
    crew: Crew,
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
        // A plant that went away needs no answer.
        let _ = live::answer(client, |question: Result<ParameterQuestion, Refusal>| {
            let found = question
                .map_err(|refusal| refusal.message)
                .and_then(|question| match question.epoch {
                    0 => check_plant(&theirs, &question, &interruption),
                    _ => check_controller(&theirs, &crew, &question, &interruption),
                });
            ParameterAnswer {
                objection: found.err(),
            }
        });
    });
    listening.map_err(Failure::infrastructure)
}

fn check_controller(
    session: &SessionInfo,
    crew: &Crew,
    question: &ParameterQuestion,
    interruption: &Interruption,
) -> Result<(), String> {
    let member = {
        let crew = crew.lock().unwrap_or_else(PoisonError::into_inner);
        let place = (question.epoch as usize).checked_sub(1);
        place.and_then(|place| crew.get(place).cloned())
    };
    let (binary, job) = member.ok_or("there is no such controller")?;
    let target = binary.at.as_ref().map(Reached::target);
    if let Some(target) = target.filter(|target| matches!(target, Target::Serve(_))) {
        return Err(format!(
            "{target} serves one session at a time, so its program cannot judge other parameters meanwhile; `[[changes]]` of a scenario are judged before the run"
        ));
    }
    let job = jobs::tuned(job, &question.parameters);
    let checked = jobs::check(&binary, session, FILE, &job, interruption);
    checked.map_err(|failure| failure.reason())
}

//! The controller process: a job, a runner and the wait loop.
//!
//! `main` of every controller binary is one call of [`run`] with the laws that it offers.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::program::{self, COMPLETED, FAILED, Program};
use hil_session::realtime::{apply, waiter};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::describe::Description;
use shared_types::link::{Link, LinkError};
use shared_types::local_map::{LocalMap, Question};
use shared_types::lockstep::ControllerEvent;
use shared_types::origin::Origin;
use shared_types::realtime;
use shared_types::side::Side;
use shared_types::wait::WaitLimit;

use crate::controller::LawKind;
use crate::job::{JOB_FILE, Job};
use crate::laws::hold;
use crate::runner::{End, Progress, Runner, choose, local};

/// Runs a controller process that offers these laws, according to its arguments. Unless one of the laws has that
/// name, the process also offers [`hold`], which suits every plant.
///
/// The origin is [`origin!`](macro@shared_types::origin), or a version alone.
#[must_use]
pub fn run(program: &'static str, origin: impl Into<Origin>, laws: Vec<LawKind>) -> ExitCode {
    program::run(&of(program, origin, laws))
}

/// Does the same as [`run`] with explicit arguments, the first being the program's own path, for a `main` that is not
/// written in Rust; returns the exit code.
#[must_use]
pub fn answer(
    arguments: Vec<OsString>,
    program: String,
    version: String,
    laws: Vec<LawKind>,
) -> u8 {
    let program = of(&program, version, laws);
    program::with_stack(|| program::answer(&program, arguments))
}

/// Returns the program that [`run`] runs, for a `main` that extends its description.
#[must_use]
pub fn of(program: &str, origin: impl Into<Origin>, laws: Vec<LawKind>) -> impl Program + Sync {
    ControllerProgram {
        program: program.into(),
        origin: origin.into(),
        laws: with_hold(laws),
    }
}

fn with_hold(mut laws: Vec<LawKind>) -> Vec<LawKind> {
    let hold = hold::kind();
    let is_there = |law: &LawKind| law.description.name == hold.description.name;
    if !laws.iter().any(is_there) {
        laws.push(hold);
    }
    laws
}

struct ControllerProgram {
    program: String,
    origin: Origin,
    laws: Vec<LawKind>,
}

impl ControllerProgram {
    fn runner<L: Link>(&self, job: Job, link: L) -> Result<Runner<&LawKind, L>, String> {
        program::check_protocol(job.protocol)?;
        let kind = choose(&self.laws, &job.law, &job.plant).map_err(|e| e.to_string())?;
        Runner::new(kind, job, link).map_err(|e| e.to_string())
    }

    /// Runs a job to its end.
    fn run(
        &self,
        job: Job,
        link: &mut IceoryxLink,
        session: &SessionInfo,
        supervision: &Supervision,
    ) -> Result<End, String> {
        let (limit, settings) = (WaitLimit::from_seconds(job.wait_limit_s), job.realtime);
        let mut runner = self.runner(job, link)?;
        // Threads that exist by now keep ordinary scheduling.
        let report = apply(&settings);
        let report_result = session.write_file(realtime::CONTROLLER_FILE, &report);
        report_result.map_err(|e| e.to_string())?;
        drive(&mut runner, waiter(&report, limit), supervision).map_err(|e| e.to_string())?;
        let end = runner.end().cloned();
        end.ok_or_else(|| "the run ended without a result".into())
    }
}

impl Program for ControllerProgram {
    fn side(&self) -> Side {
        Side::Controller
    }

    fn description(&self) -> Description {
        let mut description = Description::of_origin(&self.program, self.origin.clone());
        description.laws = self
            .laws
            .iter()
            .map(|kind| kind.description.clone())
            .collect();
        description
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        let (link, _) = shared_types::link::in_process::pair();
        self.runner(program::read_job(job)?, link).map(|_| ())
    }

    fn linearise(&self, question: &Path) -> Result<LocalMap, String> {
        let question: Question<Job> = program::read_job(question)?;
        let job = &question.job;
        program::check_protocol(job.protocol)?;
        let kind = choose(&self.laws, &job.law, &job.plant);
        kind.and_then(|kind| local::answer(kind, &question))
            .map_err(|invalid| invalid.to_string())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let read = || program::read_job::<Job>(&session.folder.join(JOB_FILE));
        let mut job = read()?;
        let limit = WaitLimit::from_seconds(match job.is_plant_by_hand {
            true => f64::INFINITY,
            false => job.wait_limit_s,
        });
        let mut link = program::attach(session, job.epoch, limit, supervision)?;
        supervision.ring_at_news(link.bell());
        link.bell().tick();
        loop {
            let is_kept = job.is_kept;
            let end = self.run(job, &mut link, session, supervision)?;
            let code = match &end {
                End::Completed { .. } => COMPLETED,
                End::Aborted(abort) => {
                    program::say(&abort.to_string());
                    FAILED
                }
            };
            // After any other end the plant may be stuck: a launcher of persistent sides must see that one ends.
            if !is_kept || !end.is_of_plant() || !supervision.next_job() {
                return Ok(code);
            }
            job = read()?;
            link.begin_next();
        }
    }
}

/// Polls a runner until its end; every wait is bounded.
///
/// # Errors
/// If the link failed.
pub fn drive<L: Link>(
    runner: &mut Runner<&LawKind, L>,
    mut waiter: Waiter,
    supervision: &Supervision,
) -> Result<(), LinkError> {
    waiter.sleep_on(runner.sleeper());
    runner.begin()?;
    let since_ns = monotonic_ns();
    loop {
        if supervision.wants_stop() {
            runner.interrupt(&ControllerEvent::Stop)?;
        }
        // Read before the poll: messages that the plant sent before its end still count.
        let peer_gone = supervision.is_peer_gone();
        match runner.poll()? {
            Progress::Busy => waiter.done(),
            Progress::Over => return Ok(()),
            Progress::Held => waiter.renew(),
            Progress::Plant => {
                if peer_gone {
                    runner.interrupt(&ControllerEvent::PeerGone)?;
                } else if waiter.pause() {
                    let waited_ns = monotonic_ns() - since_ns;
                    if runner.is_plant_in_hand() || runner.is_plant_starting(waited_ns) {
                        waiter.renew();
                        continue;
                    }
                    runner.interrupt(&ControllerEvent::Deadline(waiter.limit().ms()))?;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws;

    fn names(laws: &[LawKind]) -> Vec<&str> {
        let names = laws.iter().map(|law| law.description.name.as_str());
        names.collect()
    }

    #[test]
    fn every_program_offers_hold_exactly_once() {
        let mut all = laws::all();
        let shipped: Vec<String> = names(&all).into_iter().map(str::to_owned).collect();
        assert_eq!(names(&with_hold(laws::all())), shipped);
        all.retain(|law| law.description.name != "hold");
        let others: Vec<String> = names(&all).into_iter().map(str::to_owned).collect();
        let offered_laws = with_hold(all);
        assert_eq!(names(&offered_laws)[..others.len()], others);
        assert_eq!(names(&offered_laws)[others.len()..], ["hold"]);
    }
}

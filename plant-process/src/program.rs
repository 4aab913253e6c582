//! The plant process: a job, an engine and the wait loop.
//!
//! `main` of every plant binary is one call of [`run`] with the plants that it offers.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use hil_config::plan::Clock;
use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::program::{self, COMPLETED, DIVERGED, FAILED, Program};
use hil_session::realtime::{apply, waiter};
use hil_session::session::SessionInfo;
use hil_session::stream::IceoryxSink;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::describe::Description;
use shared_types::link::{Link, LinkError};
use shared_types::local_map::{LocalMap, Question};
use shared_types::lockstep::PlantEvent;
use shared_types::origin::Origin;
use shared_types::realtime;
use shared_types::record::Outcome;
use shared_types::side::Side;
use shared_types::stream::{Backpressure, RecordSink};
use shared_types::wait::WaitLimit;

use crate::engine::{Engine, Progress};
use crate::faults::{FaultKindEntry, kinds};
use crate::job::{JOB_FILE, Job};
use crate::live::{self, LiveContext};
use crate::local;
use crate::plant::PlantKind;

/// Interval at which a held run checks for its resumption.
pub const HELD: Duration = Duration::from_millis(1);

/// Longest sleep between checks whether `hil` has recorded the controller that sent hello.
const KNOWN_NS: u64 = 5_000_000;

/// Runs a plant process that offers these plants, according to its arguments. The available faults are those of the
/// plants and the [built-in kinds](kinds::all).
///
/// The origin is [`origin!`](macro@shared_types::origin), or a version alone.
#[must_use]
pub fn run(program: &'static str, origin: impl Into<Origin>, plants: Vec<PlantKind>) -> ExitCode {
    run_with_faults(program, origin, plants, kinds::all())
}

/// Does the same with these fault kinds, both built-in and custom.
#[must_use]
pub fn run_with_faults(
    program: &'static str,
    origin: impl Into<Origin>,
    plants: Vec<PlantKind>,
    faults: Vec<FaultKindEntry>,
) -> ExitCode {
    program::run(&PlantProgram {
        program: program.into(),
        origin: origin.into(),
        plants,
        faults,
    })
}

/// Does the same as [`run`] with explicit arguments, the first being the program's own path, for a `main` that is not
/// written in Rust; returns the exit code.
#[must_use]
pub fn answer(
    arguments: Vec<OsString>,
    program: String,
    version: String,
    plants: Vec<PlantKind>,
) -> u8 {
    let program = of(&program, version, plants);
    program::with_stack(|| program::answer(&program, arguments))
}

/// Returns the program that [`run`] runs, for a `main` that extends its description.
#[must_use]
pub fn of(program: &str, origin: impl Into<Origin>, plants: Vec<PlantKind>) -> impl Program + Sync {
    PlantProgram {
        program: program.into(),
        origin: origin.into(),
        plants,
        faults: kinds::all(),
    }
}

struct PlantProgram {
    program: String,
    origin: Origin,
    plants: Vec<PlantKind>,
    faults: Vec<FaultKindEntry>,
}

impl PlantProgram {
    fn kind(&self, job: &Job) -> Result<&PlantKind, String> {
        program::check_protocol(job.protocol)?;
        let model = &job.plant.model;
        let plant_kind = self
            .plants
            .iter()
            .find(|kind| kind.description.name == *model);
        plant_kind.ok_or_else(|| format!("this binary has no plant `{model}`; see --describe"))
    }

    /// Runs a job to its end and returns the exit code.
    fn run(
        &self,
        job: Job,
        (link, sink): (&mut IceoryxLink, &mut IceoryxSink),
        session: &SessionInfo,
        supervision: &Supervision,
    ) -> Result<u8, String> {
        let (limit, settings) = (WaitLimit::from_seconds(job.wait_limit_s), job.realtime);
        let (kind, is_kept) = (self.kind(&job)?, job.is_kept);
        let context = LiveContext::new(kind, &self.faults, &job);
        let engine = Engine::new(kind, &self.faults, job, link, sink);
        let mut engine = engine.map_err(|e| e.to_string())?;
        let _listening = match is_kept {
            true => None,
            false => {
                let (queue, builder) = (engine.queue(), engine.builder());
                let objections = live::objections_of(session);
                Some(live::serve(session, context, queue, builder, objections)?)
            }
        };
        // Threads that exist by now keep ordinary scheduling.
        let report = apply(&settings);
        let report_result = session.write_file(realtime::PLANT_FILE, &report);
        report_result.map_err(|e| e.to_string())?;
        drive(&mut engine, waiter(&report, limit), supervision).map_err(|e| e.to_string())?;
        let end = engine.end().ok_or("the run ended without a result")?;
        if let Some(reason) = &end.reason {
            program::say(reason);
        }
        Ok(match end.outcome {
            Outcome::Completed => COMPLETED,
            Outcome::Diverged => DIVERGED,
            Outcome::Stopped | Outcome::Failed => FAILED,
        })
    }
}

impl Program for PlantProgram {
    fn side(&self) -> Side {
        Side::Plant
    }

    fn description(&self) -> Description {
        let mut description = Description::of_origin(&self.program, self.origin.clone());
        description.plants = self
            .plants
            .iter()
            .map(|kind| kind.description.clone())
            .collect();
        description.faults = (self.faults.iter())
            .map(|kind| kind.description.clone())
            .collect();
        description
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        let job: Job = program::read_job(job)?;
        check(self.kind(&job)?, &self.faults, job)
    }

    fn linearise(&self, question: &Path) -> Result<LocalMap, String> {
        let question: Question<Job> = program::read_job(question)?;
        local::answer(self.kind(&question.job)?, &question).map_err(|invalid| invalid.to_string())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let read = || program::read_job::<Job>(&session.folder.join(JOB_FILE));
        let mut job = read()?;
        let mut link = IceoryxLink::create(session).map_err(|e| e.to_string())?;
        supervision.ring_at_news(link.bell());
        link.bell().tick();
        let backpressure = match (job.observed, job.run.clock) {
            (false, _) => Backpressure::None,
            (true, Clock::Realtime) => Backpressure::AtStart,
            (true, Clock::Lockstep | Clock::Paced { .. }) => Backpressure::Always,
        };
        let mut sink = IceoryxSink::create(session, backpressure).map_err(|e| e.to_string())?;
        loop {
            let is_kept = job.is_kept;
            let code = self.run(job, (&mut link, &mut sink), session, supervision)?;
            if !is_kept || code == FAILED || !supervision.next_job() {
                return Ok(code);
            }
            job = read()?;
            link.begin_next();
        }
    }
}

/// Builds the engine of a job once, to check that the job can be run.
///
/// # Errors
/// The reason why the job cannot be run.
pub fn check(kind: &PlantKind, faults: &[FaultKindEntry], job: Job) -> Result<(), String> {
    let (link, _) = shared_types::link::in_process::pair();
    let (sink, _) = shared_types::stream::in_process::pair();
    let engine = Engine::new(kind, faults, job, link, sink);
    engine.map(|_| ()).map_err(|e| e.to_string())
}

/// Polls an engine until its end; every wait is bounded.
///
/// # Errors
/// If the link or the record stream failed.
pub fn drive<L: Link, S: RecordSink>(
    engine: &mut Engine<L, S>,
    mut waiter: Waiter,
    supervision: &Supervision,
) -> Result<(), LinkError> {
    waiter.sleep_on(engine.sleeper());
    let queue = engine.queue();
    let (mut announced, since_ns) = (0, monotonic_ns());
    loop {
        if supervision.wants_stop() {
            engine.interrupt(&PlantEvent::Stop)?;
        }
        if supervision.expected() > announced && !engine.is_greeting() {
            announced = supervision.expected();
            engine.expect(announced)?;
        }
        // Read before the poll: messages that the controller sent before its end still count.
        let gone_epochs = supervision.gone();
        match engine.poll()? {
            Progress::Busy => waiter.done(),
            Progress::Over => return Ok(()),
            Progress::Until(target_ns) => {
                // In real time a lost controller is not awaited, so this is where its successor's end is detected.
                if let Some(epoch) = engine.candidate_gone(gone_epochs) {
                    engine.interrupt(&PlantEvent::PeerGone(epoch))?;
                    continue;
                }
                waiter.until_ns(target_ns, || {
                    supervision.wants_stop() || queue.wants_attention()
                });
            }
            waits @ (Progress::Controller | Progress::ControllerUntil(_)) => {
                let deadline_ns = match waits {
                    Progress::ControllerUntil(deadline_ns) => deadline_ns,
                    // Nothing rings when the controller's identity is recorded.
                    _ if engine.is_greeting() => monotonic_ns() + KNOWN_NS,
                    _ => u64::MAX,
                };
                let event = if let Some(epoch) = engine.news(gone_epochs) {
                    PlantEvent::PeerGone(epoch)
                } else if waiter.pause_until(deadline_ns) {
                    let waited_ns = monotonic_ns() - since_ns;
                    if engine.is_controller_in_hand() || engine.is_controller_starting(waited_ns) {
                        waiter.renew();
                        continue;
                    }
                    PlantEvent::Deadline(waiter.limit().ms())
                } else {
                    continue;
                };
                // The end of an announced controller is not an awaited event.
                if engine.interrupt(&event)? {
                    waiter.done();
                }
            }
            // The recorder gets a core even beside a loop of real-time priority, and its buffer outlasts a nap.
            Progress::Recorder => {
                if waiter.sleep() {
                    engine.recorder_late()?;
                }
            }
            Progress::Held => {
                if let Some(epoch) = engine.news(gone_epochs) {
                    engine.interrupt(&PlantEvent::PeerGone(epoch))?;
                }
                std::thread::sleep(HELD);
                waiter.done();
            }
        }
    }
}

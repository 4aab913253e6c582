//! A run in one process: both sides in one thread, taking turns.

use std::sync::LazyLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use controller_process::controller::LawKind;
use controller_process::runner::{Runner, choose};
use plant_process::engine::{self, Engine};
use plant_process::faults::FaultKindEntry;
use plant_process::live::{self, LiveContext};
use plant_process::plant::PlantKind;
use plant_process::program::HELD;
use shared_types::link::{LinkError, in_process};
use shared_types::lockstep::{ControllerEvent, PlantEvent};
use shared_types::realtime::PLANT_FILE;
use shared_types::record::{Outcome, RecordLayout, RunEnd};
use shared_types::session::SessionInfo;
use shared_types::stream::{self, RecordSink};
use shared_types::supervision::Supervision;
use shared_types::wait::{WaitLimit, Waiter};

use super::attach::refuse_other_layout;
use super::jobs::{tuned, tuned_plant};
use super::prepare::PreparedRun;
use super::realtime::Watched;
use crate::programs::binaries::Binaries;
use crate::results::ended::EndedRun;
use crate::terminal::exit::Failure;

/// Time between two looks at what may end a run before its time.
const LOOK: Duration = Duration::from_millis(10);

/// The plants, kinds of faults and laws that are built into `hil`, for all runs of this process.
pub(super) static PLANTS: LazyLock<Vec<PlantKind>> = LazyLock::new(plant_process::models::all);
pub(super) static FAULTS: LazyLock<Vec<FaultKindEntry>> =
    LazyLock::new(plant_process::faults::kinds::all);
pub(super) static LAWS: LazyLock<Vec<LawKind>> = LazyLock::new(controller_process::laws::all);

pub(super) fn plant_of(job: &plant_process::job::Job) -> Result<&'static PlantKind, String> {
    let model = &job.plant.model;
    let kind = PLANTS.iter().find(|kind| kind.description.name == *model);
    kind.ok_or_else(|| format!("hil has no plant `{model}`"))
}

pub(super) fn runner(
    job: controller_process::job::Job,
    link: in_process::InProcessLink,
) -> Result<Runner<'static, in_process::InProcessLink>, String> {
    let law = choose(&LAWS, &job.law, &job.plant).map_err(|e| e.to_string())?;
    Runner::new(law, job, link).map_err(|e| e.to_string())
}

/// Checks both jobs as `--check` of their programs does.
///
/// # Errors
/// Objection of a side to its job.
pub(super) fn check(
    plant: &plant_process::job::Job,
    controller: &controller_process::job::Job,
    binaries: &Binaries,
) -> Result<(), Failure> {
    plant_of(plant)
        .and_then(|kind| plant_process::program::check(kind, &FAULTS, plant.clone()))
        .map_err(|why| binaries.plant.refused_job(&why))?;
    let (link, _) = in_process::pair();
    runner(controller.clone(), link)
        .map(|_| ())
        .map_err(|why| binaries.controller.refused_job(&why))
}

/// A sink that tells the recorder the layout when the stream opens.
struct TellingSink {
    sink: stream::in_process::InProcessSink,
    tell: std::sync::mpsc::Sender<RecordLayout>,
}

impl RecordSink for TellingSink {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        let _ = self.tell.send(layout.clone()); // a recorder that ended needs no layout
        self.sink.open(layout)
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        self.sink.has_room()
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.sink.record(words)
    }

    fn event(&mut self, event: &shared_types::record::Event) -> Result<(), LinkError> {
        self.sink.event(event)
    }
}

/// Runs both sides in turns to the end of the run.
///
/// # Errors
/// If a side cannot begin, or the recorder broke.
pub(super) fn run(prepared: &PreparedRun, realtime: &mut Watched) -> Result<EndedRun, Failure> {
    let (sink, source) = stream::in_process::pair();
    let (tell, told) = channel();
    let described = prepared.layout.clone();
    let recorder = prepared.recorder(realtime.recorder_core(), move || {
        let mut source = Some(source);
        move || {
            let Ok(said) = told.recv_timeout(LOOK) else {
                return Ok(None);
            };
            refuse_other_layout(&described, &said)?;
            Ok(source.take().map(|source| (source, described.clone())))
        }
    });
    recorder.recall(&prepared.interruption)?;
    let supervision = Supervision::new();

    let (plant, controller) = (prepared.plant.clone(), prepared.controller.clone());
    let (theirs, session) = (supervision.clone(), prepared.session.clone());
    let (over, ended) = channel::<()>();
    let sides = std::thread::spawn(move || {
        let _over = over; // dropped when the thread ends, in whatever way
        let sink = TellingSink { sink, tell };
        take_turns(&session, plant, controller, sink, &theirs)
    });
    let mut progress = prepared.progress();
    while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        if prepared.interruption.came() {
            supervision.stop("interrupted");
        }
        if recorder.has_failed() {
            supervision.stop("the recorder failed");
        }
        progress.set(recorder.next_step());
        if let Some(refused) = realtime.look() {
            progress.tell(&refused);
        }
    }
    drop(progress);
    let ran = sides
        .join()
        .map_err(|panic| Failure::panicked("plant or controller", &*panic))?;
    let recorded = recorder.finish().map_err(Failure::infrastructure)?;
    let end = ran.map_err(Failure::infrastructure)?;
    let (mut outcome, mut reason) = (end.outcome, end.reason);
    if outcome == Outcome::Stopped && prepared.interruption.came() {
        let seen = reason.map_or_else(String::new, |seen| format!("; {seen}"));
        reason = Some(format!("interrupted{seen}"));
    }
    if let Some(error) = &recorded.error {
        reason = Some(error.clone());
        if outcome == Outcome::Completed {
            outcome = Outcome::Failed;
        }
    }
    Ok(EndedRun::new(recorded, outcome, reason))
}

/// Judges parameters of plant and law by a start of it.
fn objections(
    plant: plant_process::job::Job,
    job: controller_process::job::Job,
) -> live::Objections {
    Box::new(move |question| {
        if question.epoch == 0 {
            let job = tuned_plant(plant.clone(), &question.parameters);
            return plant_process::program::check(plant_of(&job)?, &FAULTS, job);
        }
        let (_, link) = in_process::pair();
        runner(tuned(job.clone(), &question.parameters), link).map(|_| ())
    })
}

/// Polls both sides in turns to the end of the run.
fn take_turns(
    session: &SessionInfo,
    plant: plant_process::job::Job,
    controller: controller_process::job::Job,
    sink: TellingSink,
    supervision: &Supervision,
) -> Result<RunEnd, String> {
    let (limit, settings) = (WaitLimit::from_seconds(plant.wait_limit_s), plant.realtime);
    let kind = plant_of(&plant)?;
    let (plant_link, controller_link) = in_process::pair();
    let context = LiveContext::new(kind, &FAULTS, &plant);
    let plant_job = plant.clone();
    let engine = Engine::new(kind, &FAULTS, plant, plant_link, sink);
    let mut engine = engine.map_err(|e| e.to_string())?;
    let _listening = live::serve(
        session,
        context,
        engine.queue(),
        engine.builder(),
        objections(plant_job, controller.clone()),
    )?;
    let mut runner = runner(controller, controller_link)?;
    // Both sides run in this thread: the plant's settings are those of both.
    let report = settings.apply();
    let told = session.write_file(PLANT_FILE, &report);
    told.map_err(|e| e.to_string())?;
    let waiter = report.waiter(limit);
    turns(&mut engine, &mut runner, waiter, || {
        supervision.wants_stop()
    })
    .map_err(|e| e.to_string())?;
    engine
        .end()
        .cloned()
        .ok_or_else(|| "the run ended without saying how".into())
}

/// Polls both sides in turns until the engine is over.
pub(super) fn turns<S: RecordSink>(
    engine: &mut Engine<in_process::InProcessLink, S>,
    runner: &mut Runner<'_, in_process::InProcessLink>,
    mut waiter: Waiter,
    wants_stop: impl Fn() -> bool,
) -> Result<(), LinkError> {
    let queue = engine.queue();
    runner.begin()?;
    loop {
        if wants_stop() {
            engine.interrupt(&PlantEvent::Stop)?;
            runner.interrupt(&ControllerEvent::Stop)?;
        }
        runner.poll()?;
        match engine.poll()? {
            engine::Progress::Over => return Ok(()),
            engine::Progress::Busy => waiter.done(),
            engine::Progress::Until(target_ns) => {
                waiter.until_ns(target_ns, || wants_stop() || queue.wants_attention());
                waiter.done();
            }
            engine::Progress::Held => {
                std::thread::sleep(HELD);
                waiter.done();
            }
            engine::Progress::Recorder => {
                if waiter.sleep() {
                    engine.recorder_late()?;
                }
            }
            engine::Progress::Controller | engine::Progress::ControllerUntil(_) => {
                // It had its turn; if nothing comes all the same, one of them is broken.
                if waiter.pause() {
                    engine.interrupt(&PlantEvent::Deadline(waiter.limit().ms()))?;
                }
            }
        }
    }
}

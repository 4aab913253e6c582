//! Run in one process: both sides take turns in one thread.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::Binaries;
use hil_facts::results::ended::EndedRun;
use hil_in_process::{FAULTS, Kinds, Turns, check_controller, check_plant};
use hil_session::realtime::{apply, waiter};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use plant_process::live::{self, LiveContext};
use shared_types::link::LinkError;
use shared_types::realtime::PLANT_FILE;
use shared_types::record::{Outcome, RecordLayout, RunEnd};
use shared_types::stream::{self, RecordSink};
use shared_types::wait::WaitLimit;

use super::attach::refuse_other_layout;
use super::jobs::objections;
use super::pause::PauseLookout;
use super::prepared::PreparedRun;
use super::realtime::Watched;

/// Interval between checks for an early end of the run.
const LOOK: Duration = Duration::from_millis(10);

/// Checks both jobs as `--check` of their programs does.
///
/// # Errors
/// The objection of a side to its job.
pub(super) fn check(
    plant: &plant_process::job::Job,
    controller: &controller_process::job::Job,
    binaries: &Binaries,
) -> Result<(), Failure> {
    check_plant(plant.clone()).map_err(|why| binaries.plant.refused_job(&why))?;
    check_controller(controller.clone()).map_err(|why| binaries.controller.refused_job(&why))
}

/// Sink that passes the layout to the recorder when the stream opens.
struct TellingSink {
    sink: stream::in_process::InProcessSink,
    tell: std::sync::mpsc::Sender<RecordLayout>,
}

impl RecordSink for TellingSink {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        let _ = self.tell.send(layout.clone()); // the recorder may have ended
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
/// If a side cannot begin, or the recorder failed.
pub(super) fn run(prepared: &PreparedRun, realtime: &mut Watched) -> Result<EndedRun, Failure> {
    let (sink, source) = stream::in_process::pair();
    let (tell, layouts) = channel();
    let described = prepared.layout.clone();
    let recorder = prepared.recorder(realtime.recorder_core(), move || {
        let mut source = Some(source);
        move || {
            let Ok(layout) = layouts.recv_timeout(LOOK) else {
                return Ok(None);
            };
            refuse_other_layout(&described, &layout)?;
            Ok(source.take().map(|source| (source, described.clone())))
        }
    });
    recorder.recall(&prepared.interruption)?;
    let supervision = Supervision::new();

    let (plant, controller) = (prepared.plant.clone(), prepared.controller.clone());
    let (theirs, session) = (supervision.clone(), prepared.session.clone());
    let (over, ended) = channel::<()>();
    let sides = std::thread::spawn(move || {
        let _over = over; // dropped however the thread ends
        let sink = TellingSink { sink, tell };
        take_turns(&session, plant, controller, sink, &theirs)
    });
    let (mut progress, mut pause) = (prepared.progress(), PauseLookout::new());
    while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        if prepared.interruption.came() {
            supervision.stop("interrupted");
        }
        if recorder.has_failed() {
            supervision.stop("the recorder failed");
        }
        pause.look(recorder.next_step(), &prepared.session, &mut progress);
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
        let cause = reason.map_or_else(String::new, |cause| format!("; {cause}"));
        reason = Some(format!("interrupted{cause}"));
    }
    if let Some(error) = &recorded.error {
        reason = Some(error.clone());
        if outcome == Outcome::Completed {
            outcome = Outcome::Failed;
        }
    }
    Ok(EndedRun::new(recorded, outcome, reason))
}

/// Polls both sides in turns until the end of the run.
fn take_turns(
    session: &SessionInfo,
    plant: plant_process::job::Job,
    controller: controller_process::job::Job,
    mut sink: TellingSink,
    supervision: &Supervision,
) -> Result<RunEnd, String> {
    let (limit, settings) = (WaitLimit::from_seconds(plant.wait_limit_s), plant.realtime);
    let kinds = Kinds::built_in(&plant, &controller)?;
    let context = LiveContext::new(&kinds.plant, &FAULTS, &plant);
    let objections = objections(kinds, plant.clone(), controller.clone());
    let turns = Turns::new(plant, controller, &mut sink)?;
    let (queue, builder) = (turns.queue(), turns.builder());
    let _listening = live::serve(session, context, queue, builder, objections)?;
    // Both sides run in this thread, so the plant's settings apply to both.
    let report = apply(&settings);
    let written = session.write_file(PLANT_FILE, &report);
    written.map_err(|e| e.to_string())?;
    turns.run(waiter(&report, limit), &|| supervision.wants_stop())
}

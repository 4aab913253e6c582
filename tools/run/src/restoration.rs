//! Checks of the checkpoints of a run: for each checkpoint, second sides start from its state and repeat the steps that
//! followed it in the run. Called after the end of the run, so that the checks cost the run nothing; does not affect
//! its verdict.
//!
//! A state that foreign code forgets to save shows in no other way: an FMU's solver may hide part of its history, and
//! saved bytes may contain addresses of the process that wrote them. The second sides run like those of the run, as
//! processes or in one thread, in lockstep: the controller answers the plant, and until the first difference both
//! receive the same data as in the run. Scenario faults, changes and stimuli come from the same job.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hil_config::plan::Clock;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::checkpoint::{note, state_file};
use hil_facts::results::recorded::Recorded;
use hil_facts::results::recorded::Stretch;
use hil_facts::results::restoration::{Check, Comparison, Verdict};
use hil_facts::results::resumed::MadeCheckpoint;
use hil_in_process::Turns;
use hil_session::session::{Session, SessionInfo};
use hil_session::stream::IceoryxSource;
use hil_session::supervision::{PEER_GONE, STOP};
use hil_session::waiter::Waiter;
use shared_types::checkpoint::{Checkpoints, Resume};
use shared_types::link::LinkError;
use shared_types::realtime;
use shared_types::record::{Event, RecordLayout};
use shared_types::side::Side;
use shared_types::stream::{Item, RecordSink, RecordSource};
use shared_types::time::Step;
use shared_types::wait::{WaitLimit, WaitStrategy};

use super::attach::attach;
use super::prepared::PreparedRun;
use super::side::{GRACE, LOOK, SideProcess};

/// Verdict on sides that ended before their comparison, with the cause in words.
type Fate = Option<(Verdict, String)>;

/// Checks the checkpoints of a run, and stores the result in each.
///
/// # Errors
/// If a result cannot be written.
pub(super) fn check(
    prepared: &PreparedRun,
    recorded: &Recorded,
    checkpoints: &mut [MadeCheckpoint],
) -> Result<(), Failure> {
    if !checkpoints.is_empty() && output::person_watches() && !prepared.settings.is_one_of_many {
        tell!("checking that the checkpoints restore exactly; Ctrl-C skips this");
    }
    for checkpoint in checkpoints {
        let folder = prepared.folder.join(&checkpoint.folder);
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        let check = check_one(prepared, recorded, Step(checkpoint.step), &folder)
            .unwrap_or_else(|failure| Check::missing(&failure.reason()));
        if let Some(warning) = check.warning() {
            tell!(
                "warning: checkpoint before step {}: {warning}",
                checkpoint.step
            );
        }
        note(&folder, &check)?;
        checkpoint.check = Some(check);
    }
    Ok(())
}

fn check_one(
    prepared: &PreparedRun,
    recorded: &Recorded,
    step: Step,
    folder: &Path,
) -> Result<Check, Failure> {
    prepared.interruption.check()?;
    if prepared.settings.by_hand.flag().is_some() {
        return Ok(Check::missing("a side was started by hand"));
    }
    let mut stretches = recorded.stretches.iter();
    let Some(stretch) = stretches.find(|stretch| stretch.first == step.0) else {
        return Ok(Check::missing("the run ended there"));
    };
    let mut comparison = Comparison::new(&prepared.layout, stretch, recorded);
    if !comparison.has_steps() {
        return Ok(Check::missing("the run ended or was changed there"));
    }
    let second = SecondSides {
        prepared,
        recorded,
        stretch,
        folder: folder.to_owned(),
    };
    let fate = match prepared.settings.link {
        LinkKind::Iceoryx2 => second.in_processes(&mut comparison)?,
        LinkKind::InProcess => second.in_process(&mut comparison),
    };
    if !comparison.is_over() {
        prepared.interruption.check()?;
    }
    Ok(comparison.check(fate))
}

/// Second sides of a run, which start from a checkpoint of that run.
struct SecondSides<'a> {
    prepared: &'a PreparedRun,
    recorded: &'a Recorded,
    stretch: &'a Stretch,
    /// Folder of the checkpoint.
    folder: PathBuf,
}

impl SecondSides<'_> {
    /// Creates the jobs of both sides: those of the run from the checkpoint on, with neither clock nor live
    /// requests.
    fn jobs(
        &self,
        session: &SessionInfo,
    ) -> (plant_process::job::Job, controller_process::job::Job) {
        let PreparedRun {
            plan,
            plant,
            controller,
            ..
        } = self.prepared;
        let checkpoints = |side: Side| Checkpoints {
            steps: Vec::new(),
            folder: session.folder.clone(),
            resume: Some(Resume {
                step: Step(self.stretch.first),
                state: self.folder.join(state_file(side)),
                memory: None,
            }),
        };
        let live = &self.recorded.faults.accepted[..self.stretch.accepted];
        let live = live.iter().map(|live| &live.event);
        let mut plant = plant_process::job::Job {
            session: session.id,
            faults: plan.faults.iter().chain(live).cloned().collect(),
            pause_at_s: None,
            // Long tables are in the run's folder; the session from which the run read them is gone.
            stimuli: plan.stimuli.clone(),
            derived: plan.definitions(),
            // Accepts no live requests.
            is_kept: true,
            checkpoints: checkpoints(Side::Plant),
            realtime: realtime::Settings::default(),
            ..plant.clone()
        };
        plant.run.clock = Clock::Lockstep;
        let controller = controller_process::job::Job {
            session: session.id,
            is_kept: true,
            checkpoints: checkpoints(Side::Controller),
            realtime: realtime::Settings::default(),
            ..controller.clone()
        };
        (plant, controller)
    }

    /// Runs both sides as processes until the comparison is complete or a side ends.
    fn in_processes(&self, comparison: &mut Comparison<'_>) -> Result<Fate, Failure> {
        let mut session = Session::create(None).map_err(Failure::infrastructure)?;
        let info = session.info().clone();
        let (plant, controller) = self.jobs(&info);
        let limit = limit(&plant);
        (info.write_file(plant_process::job::JOB_FILE, &plant))
            .and_then(|()| info.write_file(controller_process::job::JOB_FILE, &controller))
            .map_err(Failure::infrastructure)?;
        let binaries = &self.prepared.binaries;
        let start = |name, binary, log| SideProcess::start(name, binary, &info, &info.folder, log);
        let mut plant = start("plant", &binaries.plant, "plant.log")?;
        (session.add_child(plant.process_id())).map_err(Failure::infrastructure)?;
        let mut controller = start("controller", &binaries.controller, "controller.log")?;
        (session.add_controller(1, controller.process_id())).map_err(Failure::infrastructure)?;

        let mut stream = Stream {
            session: &info,
            layout: &self.prepared.layout,
            opened: None,
            source: None,
        };
        let mut since = Instant::now();
        let has_plant_ended = loop {
            // Checked before reading, so that messages from just before their end still count.
            let ended = [plant.has_ended(), controller.has_ended()];
            let has_news = stream.drain(comparison)?;
            let is_late = limit.is_some_and(|limit| since.elapsed() > limit);
            let is_unwanted = self.prepared.interruption.came();
            if comparison.is_over() || ended != [false; 2] || is_late || is_unwanted {
                break ended[0];
            }
            if has_news {
                since = Instant::now();
            } else {
                std::thread::sleep(LOOK);
            }
        };
        plant.tell(STOP);
        let since = Instant::now();
        while !plant.has_ended() {
            stream.drain(comparison)?;
            plant.end_if_due(since, GRACE);
            std::thread::sleep(LOOK);
        }
        stream.drain(comparison)?;
        controller.tell(PEER_GONE);
        controller.tell(STOP);
        let since = Instant::now();
        while !controller.has_ended() {
            controller.end_if_due(since, GRACE);
            std::thread::sleep(LOOK);
        }
        let sides = if has_plant_ended {
            [&plant, &controller]
        } else {
            [&controller, &plant]
        };
        Ok(Some(fate(sides, comparison)))
    }

    /// Runs both sides in turns in this thread, as in the run itself.
    fn in_process(&self, comparison: &mut Comparison<'_>) -> Fate {
        let (plant, controller) = self.jobs(&self.prepared.session);
        let limit = WaitLimit::from_seconds(plant.wait_limit_s);
        let interruption = &self.prepared.interruption;
        let is_over = Arc::new(AtomicBool::new(false));
        let mut sink = ComparisonSink {
            comparison,
            is_over: Arc::clone(&is_over),
        };
        // The state of panicked sides is not used again.
        let ran = catch_unwind(AssertUnwindSafe(|| {
            let turns = Turns::new(plant, controller, &mut sink)?;
            let waiter = Waiter::with(limit, WaitStrategy::Hybrid, true);
            let wants_stop = || is_over.load(Ordering::Relaxed) || interruption.came();
            turns.run(waiter, &wants_stop)
        }));
        match ran {
            Ok(Ok(end)) => Some((Verdict::Failed, end.reason.unwrap_or_default())),
            Ok(Err(reason)) => Some((Verdict::Failed, reason)),
            Err(panic) => {
                let failure = Failure::panicked("plant or controller", &*panic);
                Some((Verdict::Crashed, failure.reason()))
            }
        }
    }
}

/// Returns the time without a record after which neither side is reported late any more; `None` without a wait
/// limit.
fn limit(job: &plant_process::job::Job) -> Option<Duration> {
    let start_s = job
        .start_limit_s
        .filter(|start_s| *start_s > job.wait_limit_s);
    let limit = Duration::try_from_secs_f64(start_s.unwrap_or(job.wait_limit_s)).ok()?;
    limit.checked_add(GRACE)
}

/// Describes the fates of sides that ended before their comparison, in the order of their ends.
fn fate(sides: [&SideProcess; 2], comparison: &Comparison<'_>) -> (Verdict, String) {
    let words = |side: &SideProcess| {
        let words = [side.death(), side.last_word()].into_iter().flatten();
        words.collect::<Vec<_>>().join(": ")
    };
    let end = comparison.end.as_ref().and_then(|end| end.reason.clone());
    if let Some(side) = sides.iter().find(|side| side.has_crashed()) {
        return (Verdict::Crashed, words(side));
    }
    let last = || sides.iter().find_map(|side| side.last_word());
    if let Some(side) = sides.iter().find(|side| side.killed.is_some()) {
        // The other side may have noticed it.
        let other = sides.iter().filter(|other| other.name != side.name);
        let report = other.filter_map(|other| other.last_word()).next();
        let report = report.or(end).unwrap_or_else(|| "no record came".into());
        return (Verdict::Stuck, format!("{}; {report}", words(side)));
    }
    let reason = end.or_else(last).or_else(|| sides[0].death());
    let reason = reason.unwrap_or_else(|| format!("{} ended early", sides[0].name));
    (Verdict::Failed, reason)
}

/// Record stream of second sides.
struct Stream<'a> {
    session: &'a SessionInfo,
    layout: &'a RecordLayout,
    /// Opened stream whose layout is not available yet.
    opened: Option<IceoryxSource>,
    source: Option<IceoryxSource>,
}

impl Stream<'_> {
    /// Processes available items; returns `false` if there were none.
    fn drain(&mut self, comparison: &mut Comparison<'_>) -> Result<bool, Failure> {
        let Some(source) = &mut self.source else {
            let stream = attach(self.session, self.layout, &mut self.opened);
            let stream = stream.map_err(Failure::infrastructure)?;
            self.source = stream.map(|(source, _)| source);
            comparison.has_begun = self.source.is_some();
            return Ok(comparison.has_begun);
        };
        let count = source.drain(&mut |item| comparison.take(item));
        Ok(count.map_err(Failure::infrastructure)? > 0)
    }
}

/// Sink of second sides in one thread, which compares records immediately.
struct ComparisonSink<'a, 'b> {
    comparison: &'a mut Comparison<'b>,
    is_over: Arc<AtomicBool>,
}

impl RecordSink for ComparisonSink<'_, '_> {
    fn open(&mut self, _layout: &RecordLayout) -> Result<(), LinkError> {
        self.comparison.has_begun = true;
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.comparison.take(Item::Record(words));
        let is_over = self.comparison.is_over();
        self.is_over.store(is_over, Ordering::Relaxed);
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.comparison.take(Item::Event(event.clone()));
        Ok(())
    }
}

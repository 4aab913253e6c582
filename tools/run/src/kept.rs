//! Persistent processes: one session and one pair of processes for many consecutive runs.
//!
//! Used for large numbers of short runs of user programs whose start would take longer than the run. Writes no run
//! folder and accepts no live requests. A pair left in disorder by a run is ended; the next run starts a new pair.

use std::cell::Cell;
use std::sync::Arc;

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::Binaries;
use hil_facts::results::curve::Grid;
use hil_facts::results::ended::EndedRun;
use hil_session::session::{Session, SessionInfo};
use hil_session::stream::IceoryxSource;
use hil_session::supervision::NEXT;
use shared_types::record::{Event, Outcome, RecordLayout, RunEnd};
use shared_types::stream::{Item, RecordSink};

use super::attach::attach;
use super::recorder::direct::{drain, take_run};
use super::settings::Settings;
use super::side::{LOOK, SideProcess};
use super::{jobs, tables};

/// Maximum number of persistent pairs, all but one of which sleep.
const MOST_PAIRS: usize = 16;
/// Maximum number of runs of a pair between two runs that are repeated as a check.
const UNCHECKED: u64 = 251;

/// Persistent processes: a pair for each layout of records.
pub struct Kept {
    /// Pairs, the most recently used last.
    pairs: Vec<Pair>,
    settings: Settings,
}

/// Plant, controller and their session. Fields are dropped in this order: ends of the stream, processes, session.
struct Pair {
    source: IceoryxSource,
    plant: SideProcess,
    controller: SideProcess,
    session: Session,
    layout: RecordLayout,
    /// Runs begun after the first.
    runs: u64,
    /// `true` once a record of the latest run arrived.
    has_begun: bool,
    /// `true` if the plant ends with the latest run.
    ends: bool,
    /// Number of the run to repeat in new processes.
    checked: u64,
}

impl Kept {
    /// Creates an empty set of pairs. A side of a run may take this number of seconds to answer.
    #[must_use]
    pub fn new(wait_limit_s: f64) -> Self {
        Self {
            pairs: Vec::new(),
            settings: Settings {
                wait_limit_s,
                ..Settings::without_recording(LinkKind::Iceoryx2, None)
            },
        }
    }

    /// Executes a plan in an existing or a new pair; also returns whether the run should be repeated in new processes,
    /// which is a check made for a few of many runs. A pair lost before the first record of the run is replaced,
    /// because the run did not cause its end.
    ///
    /// # Errors
    /// If the run did not end by itself: a side died, refused its job or was late, or the run was interrupted.
    pub fn run(
        &mut self,
        plan: &Plan,
        binaries: &Binaries,
        grid: Option<Arc<Grid>>,
        interruption: &Interruption,
    ) -> Result<(EndedRun, bool), Failure> {
        self.with_pair(plan, binaries, interruption, |pair| {
            pair.take_run(plan, grid.clone(), interruption)
        })
    }

    /// Executes a plan in an existing or a new pair; its records go to the sink that `sink` creates for their layout,
    /// and nothing judges them. A run that ends with an invalid command has ended by itself.
    ///
    /// # Errors
    /// If a side died, refused its job or was late, or the run was interrupted.
    pub fn observe<S: RecordSink>(
        &mut self,
        plan: &Plan,
        binaries: &Binaries,
        sink: impl Fn(&RecordLayout) -> S,
        interruption: &Interruption,
    ) -> Result<(RunEnd, S), Failure> {
        let (ended, _) = self.with_pair(plan, binaries, interruption, |pair| {
            let sink = sink(&pair.layout);
            pair.observe(sink, interruption)
        })?;
        Ok(ended)
    }

    /// Has an existing or a new pair begin a run, which `take` observes to its end; also returns whether the run should
    /// be repeated.
    fn with_pair<T>(
        &mut self,
        plan: &Plan,
        binaries: &Binaries,
        interruption: &Interruption,
        take: impl Fn(&mut Pair) -> Result<T, Failure>,
    ) -> Result<(T, bool), Failure> {
        let layout = binaries.record_layout(plan)?;
        let mut pair = match self.take(&layout) {
            Some(mut pair) => {
                pair.runs += 1;
                write_jobs(
                    plan,
                    binaries,
                    pair.session.info(),
                    pair.runs,
                    &self.settings,
                )?;
                for side in [&mut pair.plant, &mut pair.controller] {
                    side.forget_output();
                    side.tell(NEXT);
                }
                pair
            }
            None => Pair::start(plan, binaries, layout.clone(), &self.settings, interruption)?,
        };
        let mut ended = take(&mut pair);
        if let Err(Failure::Infrastructure(cause)) = &ended
            && pair.runs > 0
            && !pair.has_begun
        {
            // It may be left over from the previous run; if this run causes it, it will also do so in new
            // processes.
            tell!("between two runs: {cause}; starting another pair");
            drop(pair);
            pair = Pair::start(plan, binaries, layout, &self.settings, interruption)?;
            ended = take(&mut pair);
        }
        let ended = match ended {
            Err(Failure::Infrastructure(cause)) => {
                // An error that would have prevented the run is not fixed by another attempt.
                refuse_jobs(plan, binaries, &self.settings, interruption)?;
                return Err(Failure::Infrastructure(cause));
            }
            ended => ended?,
        };
        let is_to_check = pair.is_to_check();
        // The size of their logs is limited when they are checked.
        for other in &mut self.pairs {
            let _ = other.plant.has_ended() | other.controller.has_ended(); // reported when the pair is needed
        }
        if !pair.ends {
            self.pairs.push(pair);
        }
        if self.pairs.len() > MOST_PAIRS {
            self.pairs.remove(0);
        }
        Ok((ended, is_to_check))
    }

    /// Takes the pair of a layout, if there is one and both processes are alive.
    fn take(&mut self, layout: &RecordLayout) -> Option<Pair> {
        let place = self.pairs.iter().position(|pair| pair.layout == *layout)?;
        let mut pair = self.pairs.remove(place);
        for side in [&mut pair.plant, &mut pair.controller] {
            if side.has_ended() {
                let fate = side.death();
                let fate = fate.unwrap_or_else(|| format!("{} ended", side.name));
                tell!("after the end of a run: {fate}; starting another pair");
                return None;
            }
        }
        Some(pair)
    }
}

/// Writes the jobs of a run to the session's folder. The session number in frames differs between runs, so that a late
/// frame of one run is refused in the next.
fn write_jobs(
    plan: &Plan,
    binaries: &Binaries,
    session: &SessionInfo,
    number: u64,
    settings: &Settings,
) -> Result<(), Failure> {
    let of_run = SessionInfo {
        id: session.id.wrapping_add(number),
        ..session.clone()
    };
    let plan = tables::in_session(plan, &session.folder)?;
    let (mut plant, mut controller) = jobs::of(&plan, binaries, &of_run, settings, &[]);
    (plant.is_kept, controller.is_kept) = (true, true);
    (session.write_file(plant_process::job::JOB_FILE, &plant))
        .and_then(|()| session.write_file(controller_process::job::JOB_FILE, &controller))
        .map_err(Failure::infrastructure)
}

impl Pair {
    /// Starts both processes with their first run.
    fn start(
        plan: &Plan,
        binaries: &Binaries,
        layout: RecordLayout,
        settings: &Settings,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let mut session = Session::create(None).map_err(Failure::infrastructure)?;
        // Removed once both have opened their logs, so that nothing remains however hil ends.
        let folder = tempfile::tempdir().map_err(Failure::infrastructure)?;
        let info = session.info().clone();
        write_jobs(plan, binaries, &info, 0, settings)?;
        let start = |name, binary, log| SideProcess::start(name, binary, &info, folder.path(), log);
        let mut plant = start("plant", &binaries.plant, "plant.log")?;
        (session.add_child(plant.process_id())).map_err(Failure::infrastructure)?;
        let mut controller = start("controller", &binaries.controller, "controller.log")?;
        (session.add_controller(1, controller.process_id())).map_err(Failure::infrastructure)?;
        drop(folder);
        let mut opened = None;
        let source = loop {
            // Checked before reading, so that messages from just before their end still count.
            let is_over = plant.has_ended() || controller.has_ended();
            match attach(&info, &layout, &mut opened).map_err(Failure::infrastructure)? {
                Some((source, _)) => break source,
                None if interruption.came() => return Err(Failure::Interrupted),
                None if is_over => return Err(disorder(None, [&mut plant, &mut controller])),
                None => std::thread::sleep(LOOK),
            }
        };
        Ok(Self {
            source,
            plant,
            controller,
            session,
            layout,
            runs: 0,
            has_begun: false,
            ends: false,
            checked: 1,
        })
    }

    /// Returns `true` if the finished run should be repeated: the second run of the pair, and later ones at growing
    /// intervals, at odd and even numbers because variants alternate.
    fn is_to_check(&mut self) -> bool {
        let is_to_check = self.runs == self.checked;
        if is_to_check {
            let further = self.runs / 2 + 2;
            self.checked += if further < UNCHECKED {
                further
            } else {
                UNCHECKED
            };
        }
        is_to_check
    }

    /// Drains the records of the run that both sides were told to begin.
    fn take_run(
        &mut self,
        plan: &Plan,
        grid: Option<Arc<Grid>>,
        interruption: &Interruption,
    ) -> Result<EndedRun, Failure> {
        let Self {
            source,
            plant,
            controller,
            has_begun,
            ..
        } = self;
        let is_over = || interruption.came() || plant.has_ended() || controller.has_ended();
        let recorded = take_run(plan.clone(), &self.layout, grid, source, is_over);
        *has_begun = recorded.records > 0;
        interruption.check()?;
        let end = recorded.end.clone();
        match (&recorded.error, end) {
            (None, Some(end)) if matches!(end.outcome, Outcome::Completed | Outcome::Diverged) => {
                Ok(EndedRun::new(recorded, end.outcome, end.reason))
            }
            (error, end) => {
                let cause = error.clone().or_else(|| end.and_then(|end| end.reason));
                Err(disorder(cause, [plant, controller]))
            }
        }
    }

    /// Passes the records of the run that both sides were told to begin to a sink.
    fn observe<S: RecordSink>(
        &mut self,
        sink: S,
        interruption: &Interruption,
    ) -> Result<(RunEnd, S), Failure> {
        let Self {
            source,
            plant,
            controller,
            has_begun,
            ends,
            ..
        } = self;
        let mut observed = Observed {
            sink,
            end: None,
            error: None,
        };
        let begun = Cell::new(false);
        let take = |observed: &mut Observed<S>, item: Result<Item<'_>, String>| {
            begun.set(begun.get() || matches!(item, Ok(Item::Record(_))));
            observed.take(item);
        };
        let has_ended = |one: &Observed<S>| one.end.is_some() || one.error.is_some();
        drain(source, &mut observed, take, has_ended, || {
            interruption.came() || plant.has_ended() || controller.has_ended()
        });
        *has_begun = begun.get();
        interruption.check()?;
        match (observed.error, observed.end) {
            (None, Some(end)) if matches!(end.outcome, Outcome::Completed | Outcome::Diverged) => {
                Ok((end, observed.sink))
            }
            (None, Some(end)) if end.is_of_invalid_command() => {
                *ends = true;
                Ok((end, observed.sink))
            }
            (error, end) => {
                let cause = error.or_else(|| end.and_then(|end| end.reason));
                Err(disorder(cause, [plant, controller]))
            }
        }
    }
}

/// Sink of an observed run, with the end of the run.
struct Observed<S> {
    sink: S,
    end: Option<RunEnd>,
    error: Option<String>,
}

impl<S: RecordSink> Observed<S> {
    fn take(&mut self, item: Result<Item<'_>, String>) {
        let passed = match item {
            Ok(Item::Record(words)) => self.sink.record(words).map_err(|e| e.to_string()),
            Ok(Item::Event(event)) => {
                let passed = self.sink.event(&event).map_err(|e| e.to_string());
                if let Event::End(end) = event {
                    self.end = Some(end);
                }
                passed
            }
            Ok(Item::Lost(count)) => Err(format!("{count} records were lost")),
            Ok(Item::Broken(reason)) | Err(reason) => Err(reason),
        };
        if let Err(error) = passed {
            self.error.get_or_insert(error);
        }
    }
}

/// Has both sides check their jobs, as before a run in new processes.
///
/// # Errors
/// The objection of a side.
fn refuse_jobs(
    plan: &Plan,
    binaries: &Binaries,
    settings: &Settings,
    interruption: &Interruption,
) -> Result<(), Failure> {
    let session = Session::create(None).map_err(Failure::infrastructure)?;
    let info = session.info();
    let plan = tables::in_session(plan, &info.folder)?;
    let (plant, controller) = jobs::of(&plan, binaries, info, settings, &[]);
    let file = plant_process::job::JOB_FILE;
    jobs::check(&binaries.plant, info, file, &plant, interruption)?;
    let file = controller_process::job::JOB_FILE;
    jobs::check(&binaries.controller, info, file, &controller, interruption)
}

/// Describes a run that did not end by itself: the cause, and the fates of its sides.
fn disorder(cause: Option<String>, sides: [&mut SideProcess; 2]) -> Failure {
    let mut parts: Vec<String> = cause.into_iter().collect();
    for side in sides {
        if side.has_ended() {
            parts.extend(side.death());
            parts.extend(side.last_word());
        }
    }
    parts.dedup();
    if parts.is_empty() {
        parts.push("a side ended before the run was over".into());
    }
    Failure::infrastructure(parts.join("; "))
}

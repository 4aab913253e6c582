//! A run in two processes: starting them, watching over them, and ending both whatever happens.

use std::io::Write;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use hil_config::plan::Clock;
use shared_types::link::LinkError;
use shared_types::process::{MARK, ProcessId};
use shared_types::record::{Outcome, RecordLayout};
use shared_types::session::{Session, SessionInfo};
use shared_types::stream::iceoryx::{IceoryxSource, LAYOUT_FILE};
use shared_types::supervision::{PEER_GONE, STOP};

use super::controllers::Controllers;
use super::log::Log;
use super::realtime::Watched;
use crate::programs::binaries::{Binary, end_group, reap};
use crate::results::ended::Ended;
use crate::results::handover::told;
use crate::results::recorded::Recorded;
use crate::run::recorder::Recorder;
use crate::run::swap::{self, Ground, Wanted};
use crate::run::{Prepared, open_files};
use crate::session::{observer, standing};
use crate::terminal::exit::Failure;
use crate::terminal::output;
use crate::terminal::progress::Progress;

/// How often the processes are looked at.
pub(crate) const LOOK: Duration = Duration::from_millis(2);
/// How long a process may take to end once it was told to.
pub(crate) const GRACE: Duration = Duration::from_secs(2);
/// How long it may take if it is stopped, which it cannot end from.
const STOPPED_GRACE: Duration = Duration::from_millis(200);
/// How often files of a session that are open to others are closed before a run is refused for them.
const LOOKS: u32 = 20;
/// Exit code of a Rust program that panicked.
const PANIC: i32 = 101;

/// One side of the run.
pub(crate) struct Side {
    name: &'static str,
    process: Child,
    id: Option<ProcessId>,
    log: Log,
    status: Option<ExitStatus>,
    /// It had to be ended, and the state it was found in.
    killed: Option<&'static str>,
    told_to_stop: bool,
}

impl Side {
    /// Starts it; its output goes to a log of this name in a folder.
    ///
    /// # Errors
    /// If it cannot be started, or is not the file any more that was checked.
    pub(crate) fn start(
        name: &'static str,
        binary: &Binary,
        session: &SessionInfo,
        folder: &Path,
        log: &str,
    ) -> Result<Self, Failure> {
        open_files::ensure()?;
        let cannot = |error: std::io::Error| {
            Failure::infrastructure(format!("cannot start {}: {error}", binary.path.display()))
        };
        let log = Log::create(folder.join(log)).map_err(cannot)?;
        let process = Command::new(&binary.path)
            .arg("--session")
            .arg(&session.folder)
            .stdin(Stdio::piped())
            .stdout(log.output().map_err(cannot)?)
            .stderr(log.output().map_err(cannot)?)
            .env(MARK, &session.prefix)
            // A group of its own: Ctrl-C is for hil, which ends both in order.
            .process_group(0)
            .spawn()
            .map_err(cannot)?;
        let id = ProcessId::of(process.id());
        let side = Self {
            name,
            process,
            id,
            log,
            status: None,
            killed: None,
            told_to_stop: false,
        };
        // After the start: what was replaced just before it ends with the side.
        binary.refuse_changed()?;
        Ok(side)
    }

    pub(crate) fn process_id(&self) -> u32 {
        self.process.id()
    }

    /// Whether it has ended, and all that it started in its group with it; bounds its log.
    pub(crate) fn has_ended(&mut self) -> bool {
        if self.status.is_none() {
            // An error here means that there is no such process, which is an end too.
            self.status = match reap(&mut self.process) {
                Ok(status) => status,
                Err(_) => Some(ExitStatus::from_raw(0xff00)),
            };
            self.log.bound();
        }
        self.status.is_some()
    }

    /// Writes a line to its input. It may have ended, which shows elsewhere.
    pub(super) fn tell(&mut self, line: &str) {
        if let Some(input) = &mut self.process.stdin {
            let _ = writeln!(input, "{line}").and_then(|()| input.flush());
        }
    }

    /// Ends it if it had its time to end by itself, `since` it was to.
    pub(super) fn end_if_due(&mut self, since: Instant) {
        let waited = since.elapsed();
        let is_due = waited > GRACE || waited > STOPPED_GRACE && self.is_stopped();
        if is_due && !self.has_ended() {
            self.kill();
        }
    }

    fn is_stopped(&self) -> bool {
        self.id.is_some_and(ProcessId::is_stopped)
    }

    pub(crate) fn kill(&mut self) {
        self.killed = Some(if self.is_stopped() {
            "stopped"
        } else {
            "stuck"
        });
        end_group(&self.process);
        self.status = self.process.wait().ok();
        self.log.bound();
    }

    /// How it ended, if there is something to say about it, and where to read more.
    pub(super) fn fate(&self) -> Option<String> {
        let death = self.death()?;
        let panicked = self.status.and_then(|status| status.code()) == Some(PANIC);
        Some(if panicked && self.killed.is_none() {
            format!("{death}, see {}", self.log.path().display())
        } else {
            death
        })
    }

    /// How it ended, if not in order.
    pub(crate) fn death(&self) -> Option<String> {
        if let Some(state) = self.killed {
            return Some(format!("{} was {state} and had to be killed", self.name));
        }
        let status = self.status?;
        match (status.code(), status.signal()) {
            (Some(0), _) => None,
            (Some(PANIC), _) => Some(format!("{} panicked", self.name)),
            (Some(code), _) => Some(format!("{} ended with exit code {code}", self.name)),
            (None, Some(signal)) => {
                let name = signal_hook::low_level::signal_name(signal).unwrap_or("a signal");
                Some(format!("{} was killed by {name} ({signal})", self.name))
            }
            (None, None) => None,
        }
    }

    /// The last line of its output, without the word `error`.
    pub(super) fn last_word(&self) -> Option<String> {
        self.log.last_word()
    }

    /// The first and last lines of its output.
    pub(crate) fn excerpt(&self) -> String {
        self.log.excerpt()
    }
}

impl Drop for Side {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.kill();
        }
    }
}

pub(super) fn run(
    prepared: &Prepared,
    session: &mut Session,
    run_dir: &Path,
    realtime: &mut Watched,
) -> Result<Ended, Failure> {
    open_files::warn_of_few_addresses();
    let info = session.info().clone();
    let (plan, recording) = (prepared.plan.clone(), prepared.recording.clone());
    let marks = prepared.marks.clone();
    let attached = info.clone();
    let described = prepared.layout.clone();
    let core = realtime.recorder_core();
    let recorder = Recorder::start(plan, recording, marks, prepared.past.clone(), move || {
        core.apply();
        let mut source = None;
        move || attach(&attached, &described, &mut source)
    });
    let theirs = info.clone();
    let recorder = recorder.unblocked_by(move || theirs.remove_unfinished());
    recorder.recall(&prepared.interruption)?;
    let binaries = &prepared.binaries;
    let mut plant = Side::start("plant", &binaries.plant, &info, run_dir, "plant.log")?;
    session
        .add_child(plant.process.id())
        .map_err(Failure::infrastructure)?;
    let mut controllers = Controllers::start(
        session,
        run_dir.to_owned(),
        prepared.plan.run.on_controller_loss,
        (binaries.controller.clone(), prepared.controller.clone()),
    )?;
    let door = swap::listen(
        &info,
        Ground {
            plan: prepared.plan.clone(),
            binaries: binaries.clone(),
            job: prepared.controller.clone(),
            saves: prepared.plant.checkpoints.any(),
            interruption: prepared.interruption.clone(),
            wait_limit_s: prepared.plant.wait_limit_s,
        },
    )?;

    let _standing = standing::listen(&info, recorder.board())?;

    let mut progress = prepared.progress(&session.info().name);
    let mut watched = Watch {
        prepared,
        session,
        plant: &mut plant,
        controllers: &mut controllers,
        recorder: &recorder,
        wanted: &door.wanted,
        progress: &mut progress,
        realtime,
        ending_since: None,
        stopped_since: None,
        first: None,
    };
    watched.look_until_all_ended();
    let first = watched.first.unwrap_or("plant");
    drop(progress);
    let recorded = recorder.finish().map_err(Failure::infrastructure)?;
    // A short run may be over before anybody looked.
    for change in recorded.changes.iter().skip(controllers.known_changes()) {
        controllers.note(change);
    }
    let started = controllers.started();
    let controller = controllers.latest();
    let mut ended = conclude(prepared, recorded, (&plant, &controllers), first);
    ended.controllers = started;
    if ended.outcome != Outcome::Completed && ended.outcome != Outcome::Stopped {
        for side in [&plant, controller] {
            let excerpt = side.excerpt();
            if !excerpt.is_empty() {
                output::tell(&format!("{}:\n{excerpt}\n", side.log.path().display()));
            }
        }
    }
    Ok(ended)
}

/// Attaches the recorder: first the stream, then the layout that the plant writes after hello. That must
/// be the one that was described.
fn attach(
    session: &SessionInfo,
    described: &RecordLayout,
    source: &mut Option<IceoryxSource>,
) -> Result<Option<(IceoryxSource, RecordLayout)>, String> {
    if source.is_none() {
        match IceoryxSource::open(session, true) {
            Ok(opened) => {
                session.tighten();
                *source = Some(opened);
            }
            Err(LinkError::Absent { .. }) => return Ok(None),
            Err(error) => return Err(cannot_attach(&error)),
        }
    }
    if !session.folder.join(LAYOUT_FILE).exists() {
        return Ok(None);
    }
    refuse_open(session).map_err(|open| cannot_attach(&open))?;
    let said: RecordLayout = (session.read_file(LAYOUT_FILE)).map_err(|e| cannot_attach(&e))?;
    refuse_other_layout(described, &said)?;
    observer::admit(session, described).map_err(|e| cannot_attach(&e))?;
    Ok(source.take().map(|source| (source, described.clone())))
}

/// Closes what is open to other users, and refuses what stays so. What a side makes just now may be open
/// between two looks.
fn refuse_open(session: &SessionInfo) -> Result<(), String> {
    for _ in 0..LOOKS {
        session.tighten();
        if session.open_to_others().is_empty() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let open = session.open_to_others();
    (open.first()).map_or(Ok(()), |open| {
        Err(format!("{} is open to other users", open.display()))
    })
}

fn cannot_attach(error: &dyn std::fmt::Display) -> String {
    format!("cannot attach to the record stream: {error}")
}

/// Refuses records with other signals than both binaries described.
pub(super) fn refuse_other_layout(
    described: &RecordLayout,
    said: &RecordLayout,
) -> Result<(), String> {
    described.difference(said).map_or(Ok(()), |difference| {
        Err(format!(
            "at hello plant and controller agreed on {difference}"
        ))
    })
}

/// Looks after the processes of a run.
struct Watch<'a> {
    prepared: &'a Prepared,
    session: &'a mut Session,
    plant: &'a mut Side,
    controllers: &'a mut Controllers,
    recorder: &'a Recorder,
    /// Controllers that somebody wants to take over.
    wanted: &'a Receiver<Wanted>,
    progress: &'a mut Progress,
    realtime: &'a mut Watched,
    /// Since when the run is to end.
    ending_since: Option<Instant>,
    /// Since when the plant is stopped.
    stopped_since: Option<Instant>,
    /// Which side ended first.
    first: Option<&'static str>,
}

impl Watch<'_> {
    fn look_until_all_ended(&mut self) {
        while !(self.plant.has_ended() && self.controllers.have_ended()) {
            self.progress.set(self.recorder.next_step());
            if let Some(refused) = self.realtime.look() {
                self.progress.tell(&refused);
            }
            self.attend_controllers();
            self.look_for_the_end();
            std::thread::sleep(LOOK);
        }
    }

    fn attend_controllers(&mut self) {
        let changes = self
            .recorder
            .changes_after(self.controllers.known_changes());
        for change in &changes {
            self.progress.tell(&told(change));
        }
        (self.controllers).hear(self.session, self.plant, &changes);
        if self.ending_since.is_none() {
            self.controllers.look(self.plant);
            if let Ok(wanted) = self.wanted.try_recv() {
                self.controllers.swap(self.session, self.plant, wanted);
            }
        }
        for started in self.controllers.unrecorded() {
            self.recorder.add_facts(started.facts());
        }
    }

    /// Ends a plant that is stopped, or that says nothing about a controller that is gone, for longer
    /// than a side may be silent.
    fn end_a_stuck_plant(&mut self) {
        let run = &self.prepared.plan.run;
        let pace = match run.clock {
            Clock::Paced { factor } => factor,
            Clock::Lockstep | Clock::Realtime => 1.0,
        };
        // Against the clock it may wait for the next step first.
        let limit_s = self.prepared.plant.wait_limit_s + run.rate.period_s() / pace;
        let Ok(limit) = Duration::try_from_secs_f64(limit_s) else {
            return; // without a limit, as under a debugger
        };
        if self.plant.is_stopped() {
            self.stopped_since.get_or_insert_with(Instant::now);
        } else {
            self.stopped_since = None;
        }
        let is_stopped = self
            .stopped_since
            .is_some_and(|since| since.elapsed() > limit);
        if !self.plant.has_ended() && (is_stopped || self.controllers.plant_is_silent(limit)) {
            self.plant.kill();
        }
    }

    fn look_for_the_end(&mut self) {
        self.end_a_stuck_plant();
        let plant_ended = self.plant.has_ended();
        let stop = self.prepared.interruption.came()
            || self.recorder.has_failed()
            || self.controllers.unknown().is_some();
        if stop && !self.plant.told_to_stop {
            self.plant.tell(STOP);
            self.plant.told_to_stop = true;
            self.ending_since.get_or_insert_with(Instant::now);
        }
        let is_over = |since: &Instant, grace| since.elapsed() > grace;
        // The plant passes a stop on; one that cannot must not take the controller with it.
        if (self.ending_since.as_ref()).is_some_and(|since| is_over(since, GRACE / 2)) {
            self.controllers.tell_once(STOP);
        }
        if plant_ended || self.controllers.death_ends_run() {
            if self.first.is_none() {
                self.first = Some(if plant_ended { "plant" } else { "controller" });
            }
            if plant_ended {
                self.controllers.tell_once(PEER_GONE);
            } else {
                self.controllers.look(self.plant);
            }
            self.ending_since.get_or_insert_with(Instant::now);
        }
        if let Some(since) = self.ending_since {
            self.plant.end_if_due(since);
            self.controllers.end_if_due(since);
        }
    }
}

/// How the run ended, from what the plant saw and what became of the processes.
fn conclude(
    prepared: &Prepared,
    recorded: Recorded,
    (plant, controllers): (&Side, &Controllers),
    first: &'static str,
) -> Ended {
    let controller = controllers.latest();
    let interrupted = prepared.interruption.came();
    let seen = recorded.end.as_ref();
    let outcome = seen.map_or(Outcome::Failed, |end| end.outcome);
    let unknown = controllers.unknown();
    if outcome == Outcome::Completed && recorded.error.is_none() && unknown.is_none() {
        // Both confirmed the last step; an end in disorder after it is still worth a word.
        let disorder = plant.fate().or_else(|| controllers.in_office()?.fate());
        let outcome = if disorder.is_some() {
            Outcome::Failed
        } else {
            outcome
        };
        return Ended {
            recorded,
            outcome,
            reason: disorder,
            controllers: Vec::new(),
        };
    }
    let mut parts: Vec<String> = Vec::new();
    parts.extend(recorded.error.clone());
    parts.extend(unknown);
    if interrupted {
        parts.push("interrupted".into());
    }
    parts.extend(seen.and_then(|end| end.reason.clone()));
    parts.extend(controllers.exhausted());
    if seen.is_none() && recorded.error.is_some() {
        // Nobody listened: that neither side's end was heard is no fault of theirs.
        parts.extend([plant.fate(), controller.fate()].into_iter().flatten());
        parts.push(format!("{} steps were recorded", recorded.records));
    } else if seen.is_none() {
        parts.extend(unseen_end(plant, controller, first, recorded.records));
    } else {
        // Its exit code adds nothing to what the plant said; a signal or a killing does.
        let told_why = |fate: &String| !fate.contains("exit code");
        parts.extend(
            [plant.fate(), controller.fate()]
                .into_iter()
                .flatten()
                .filter(told_why),
        );
    }
    let outcome = match outcome {
        Outcome::Completed => Outcome::Failed,
        Outcome::Failed if interrupted => Outcome::Stopped,
        other => other,
    };
    Ended {
        recorded,
        outcome,
        reason: Some(parts.join("; ")),
        controllers: Vec::new(),
    }
}

/// Why a run ended whose plant could not say: the cause first.
fn unseen_end(plant: &Side, controller: &Side, first: &str, records: u64) -> Vec<String> {
    let (cause, other) = if plant.killed.is_some() || first == "plant" {
        (plant, controller)
    } else {
        (controller, plant)
    };
    let early = || format!("{} ended before the run was over", cause.name);
    let mut parts = vec![cause.fate().unwrap_or_else(early)];
    // A process that was stopped or stuck has said nothing; what the other saw of it tells more.
    let words = [cause.last_word(), other.last_word()].into_iter().flatten();
    parts.extend(words.take(1));
    parts.extend(other.fate());
    parts.push(format!("{records} steps were recorded"));
    parts
}

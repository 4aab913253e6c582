//! Run in two processes: starts and supervises them, and always ends both.

use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use hil_config::plan::Clock;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use hil_console::terminal::progress::Progress;
use hil_facts::results::ended::EndedRun;
use hil_facts::results::handover::describe;
use hil_facts::session::standing;
use hil_session::process::Ending;
use hil_session::session::Session;
use hil_session::stream::LAYOUT_FILE;
use hil_session::supervision::{PEER_GONE, STOP};
use shared_types::record::Outcome;

use super::attach::attach;
use super::controllers::Controllers;
use super::manual_start::ByHand;
use super::objections;
use super::pause::PauseLookout;
use super::prepared::PreparedRun;
use super::realtime::Watched;
use super::side::{GRACE, LOOK, SideProcess};
use super::termination::termination;
use crate::open_files;
use crate::recorder::Recorder;
use crate::swap::{self, SwapContext, SwapRequest};

/// Polling interval for a run, because each poll takes a core from the loop; the end of a process is noticed at once.
const WATCH: Duration = Duration::from_millis(10);

/// Minimum time limit for the recorder to progress in the stream of dead sides, even on a busy machine.
const LEAST_STREAM_LIMIT: Duration = Duration::from_secs(2);

/// Runs both sides until they end, for whatever reason.
///
/// # Errors
/// If a side cannot be started, or the recorder failed.
pub(super) fn run(
    prepared: &PreparedRun,
    session: &mut Session,
    mut by_hand: ByHand,
    realtime: &mut Watched,
) -> Result<EndedRun, Failure> {
    open_files::warn_of_few_addresses();
    let info = &prepared.session;
    let (attached, described) = (info.clone(), prepared.layout.clone());
    let recorder = prepared.recorder(realtime.recorder_core(), move || {
        let mut source = None;
        move || attach(&attached, &described, &mut source)
    });
    let theirs = info.clone();
    let limit = Duration::try_from_secs_f64(prepared.plant.wait_limit_s).ok();
    let limit = limit.map(|limit| limit.max(LEAST_STREAM_LIMIT));
    let recorder = recorder.unblocked_by(limit, move || theirs.remove_unfinished());
    recorder.recall(&prepared.interruption)?;
    let binaries = &prepared.binaries;
    let start = |session: &mut Session, by_hand: Option<SideProcess>| {
        Controllers::start(
            session,
            prepared.folder.clone(),
            prepared.plan.run.on_controller_loss,
            (binaries.controller.clone(), prepared.controller.clone()),
            by_hand,
        )
    };
    // The plant waits for the controller from its own start on.
    let mut early = None;
    if binaries.controller.at.is_some() {
        let controllers: &mut Controllers = early.insert(start(session, None)?);
        controllers.wait_until_ready(&prepared.interruption);
    }
    let mut plant = match by_hand.plant.take() {
        Some(plant) => plant,
        None => {
            let (program, folder) = (&binaries.plant, &prepared.folder);
            let plant = SideProcess::start("plant", program, info, folder, "plant.log")?;
            session
                .add_child(plant.process_id())
                .map_err(Failure::infrastructure)?;
            plant
        }
    };
    let mut controllers = match early {
        Some(controllers) => controllers,
        None => start(session, by_hand.controller.take())?,
    };
    let listener = swap::listen(
        info,
        SwapContext {
            plan: prepared.plan.clone(),
            binaries: Arc::clone(binaries),
            job: prepared.controller.clone(),
            saves: prepared.plant.checkpoints.any(),
            interruption: prepared.interruption.clone(),
            wait_limit_s: prepared.plant.wait_limit_s,
        },
    )?;

    let _objections = objections::listen(
        info,
        (binaries.plant.clone(), prepared.plant.clone()),
        controllers.programs(),
        prepared.interruption.clone(),
    )?;
    let _standing = standing::listen(info, recorder.board())?;

    let mut progress = prepared.progress();
    let mut watched = Watch {
        prepared,
        session,
        plant: &mut plant,
        controllers: &mut controllers,
        recorder: &recorder,
        requests: &listener.requests,
        progress: &mut progress,
        pause: PauseLookout::new(),
        realtime,
        ending_since: None,
        stopped_since: None,
        first: None,
    };
    watched.look_until_all_ended();
    let first = watched.first.unwrap_or("plant");
    drop(progress);
    let recorded = recorder.finish().map_err(Failure::infrastructure)?;
    // A short run may be over before the first poll.
    for change in recorded.changes.iter().skip(controllers.known_changes()) {
        controllers.note(change);
    }
    let started = controllers.started();
    let controller = controllers.latest();
    let mut ended = termination(prepared, recorded, (&plant, &controllers), first);
    ended.controllers = started;
    // Among many runs, a diverged one is only a row in a table.
    let is_shown = match ended.outcome {
        Outcome::Completed | Outcome::Stopped => false,
        Outcome::Diverged => !prepared.settings.is_one_of_many,
        Outcome::Failed => true,
    };
    for (name, side) in [("plant", &plant), ("controller", controller)] {
        match side.shown_log().filter(|_| is_shown) {
            Some(log) => output::tell(&format!("{log}\n")),
            None if prepared.settings.is_one_of_many => {}
            None => (side.warnings().iter()).for_each(|warning| tell!("{name}: {warning}")),
        }
    }
    Ok(ended)
}

/// Supervision of a run's processes.
struct Watch<'a> {
    prepared: &'a PreparedRun,
    session: &'a mut Session,
    plant: &'a mut SideProcess,
    controllers: &'a mut Controllers,
    recorder: &'a Recorder,
    /// Requests for another controller.
    requests: &'a Receiver<SwapRequest>,
    progress: &'a mut Progress,
    pause: PauseLookout,
    realtime: &'a mut Watched,
    /// Time since which the run should end.
    ending_since: Option<Instant>,
    /// Time since which the plant is stopped.
    stopped_since: Option<Instant>,
    /// Side that ended first.
    first: Option<&'static str>,
}

impl Watch<'_> {
    fn look_until_all_ended(&mut self) {
        let mut running = self.running();
        while running > 0 {
            let (session, next_step) = (&self.prepared.session, self.recorder.next_step());
            self.pause.look(next_step, session, self.progress);
            if let Some(refused) = self.realtime.look() {
                self.progress.tell(&refused);
            }
            self.attend_controllers();
            self.look_for_the_end();
            running = self.wait(running);
        }
    }

    /// Waits until one of `before` running sides ends, or until the next poll; returns the number of running sides.
    fn wait(&mut self, before: usize) -> usize {
        let running = self.running();
        if running != before {
            return running;
        }
        let limit = if self.controllers.are_settled() {
            WATCH
        } else {
            LOOK
        };
        let endings = (self.plant.ending().into_iter()).chain(self.controllers.endings());
        let has_one_ended = Ending::wait_for_any(endings, limit);
        let running = self.running();
        if has_one_ended && running == before {
            // A debugger traces it and has not reaped it.
            std::thread::sleep(LOOK);
        }
        running
    }

    /// Counts the sides that have not ended.
    fn running(&mut self) -> usize {
        usize::from(!self.plant.has_ended()) + self.controllers.running()
    }

    fn attend_controllers(&mut self) {
        let changes = self
            .recorder
            .changes_after(self.controllers.known_changes());
        for change in &changes {
            self.progress.tell(&describe(change));
        }
        (self.controllers).hear(self.session, self.plant, &changes);
        if self.ending_since.is_none() {
            if let Ok(request) = self.requests.try_recv() {
                self.controllers.swap(self.session, request);
            }
            self.controllers.look(self.plant);
        }
        for started in self.controllers.unrecorded() {
            self.recorder.add_facts(started.facts());
        }
    }

    /// Ends a plant that is stopped, or does not react to the end of a controller, for longer than a side may be
    /// silent.
    fn end_a_stuck_plant(&mut self) {
        let run = &self.prepared.plan.run;
        let pace = match run.clock {
            Clock::Paced { factor } => factor,
            Clock::Lockstep | Clock::Realtime => 1.0,
        };
        // Before hello there is no limit for a plant started by hand.
        let is_in_hand = self.prepared.settings.by_hand.plant
            && !self.prepared.session.folder.join(LAYOUT_FILE).exists();
        // In real time it may wait for the next step first.
        let limit_s = self.prepared.plant.wait_limit_s + run.rate.period_s() / pace;
        let Ok(limit) = Duration::try_from_secs_f64(limit_s) else {
            return; // no limit, for example under a debugger
        };
        if !is_in_hand && self.plant.is_stopped() {
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
        // The plant forwards a stop; if it cannot, the controller must not be stopped with it.
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
            let grace = self.grace();
            self.plant.end_if_due(since, grace);
            self.controllers.end_if_due(since, grace);
        }
    }

    /// Returns the time limit for a side to end after the other: after a complete run it is as long as a step may take,
    /// because an FMU may have much to free.
    fn grace(&self) -> Duration {
        let is_complete = !self.plant.told_to_stop
            && match self.first {
                Some("plant") => self.plant.death().is_none(),
                Some(_) => self.controllers.latest().death().is_none(),
                None => false,
            };
        let limit = Duration::try_from_secs_f64(self.prepared.plant.wait_limit_s);
        match is_complete {
            true => limit.unwrap_or(Duration::MAX).max(GRACE),
            false => GRACE,
        }
    }
}

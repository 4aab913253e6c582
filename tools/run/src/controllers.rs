//! Controllers of a run: the active one, its predecessors, and the next one.
//!
//! The plant decides which controller is active and reports it in the record stream; here processes are started and
//! ended accordingly.

use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use controller_process::job::{JOB_FILE, Job};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::programs::binaries::Binary;
use hil_facts::results::ended::Started;
use hil_session::process::Ending;
use hil_session::session::{Session, SessionInfo};
use hil_session::supervision::{EXPECT, MOST_EPOCHS, PEER_GONE};
use shared_types::lockstep::OnLoss;
use shared_types::record::{ControllerChange, ControllerFate};

use super::jobs;
use super::objections::Programs;
use super::side::{LOOK, SideProcess};
use crate::swap::{SwapRequest, Swapped};

/// Maximum number of restarts of a lost controller in one run.
const RESTARTS: u32 = 3;
/// Time limit for a controller to end by itself after it is no longer active.
const PARTING: Duration = Duration::from_millis(500);

/// All controllers started in a run.
pub(super) struct Controllers {
    members: Vec<Member>,
    policy: OnLoss,
    run_dir: PathBuf,
    session: SessionInfo,
    restarts: u32,
    /// Reason why no controller is restarted any more.
    exhausted: Option<String>,
    /// Number of processed controller changes.
    known: usize,
    /// Number of controllers in the recording's facts.
    recorded: usize,
    /// Controller that the plant reported although it was never started.
    unknown: Option<u32>,
    /// Programs and jobs, for judging parameters.
    programs: Programs,
}

/// Controller process.
struct Member {
    epoch: u32,
    side: SideProcess,
    binary: Binary,
    job: Job,
    /// Values of the scenario changed for the controller.
    set: Vec<String>,
    standing: Role,
    /// `true` once the plant was told to expect the controller.
    is_announced: bool,
    /// Time at which the plant was told that the controller had ended.
    plant_told_at: Option<Instant>,
    /// `true` once the controller was told that the run is over.
    is_told_of_end: bool,
    /// Request that caused the controller's start.
    requester: Option<Requester>,
}

impl Member {
    const fn new(
        epoch: u32,
        side: SideProcess,
        binary: Binary,
        job: Job,
        set: Vec<String>,
    ) -> Self {
        Self {
            epoch,
            side,
            binary,
            job,
            set,
            standing: Role::Coming,
            is_announced: epoch == 1,
            plant_told_at: None,
            is_told_of_end: false,
            requester: None,
        }
    }
}

/// Pending request for a controller.
struct Requester {
    answer: Sender<Result<Swapped, String>>,
    /// Keys of the running scenario that none of the controller's laws has.
    left_out: Vec<String>,
}

/// Role of a controller in the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Coming,
    InOffice,
    /// Replaced or lost at this time.
    Past(Instant),
}

impl Controllers {
    /// Waits until the first controller can be expected to say hello (on a target, this takes as long as `ssh` does),
    /// until it has ended, or until the wait is interrupted.
    pub(super) fn wait_until_ready(&mut self, interruption: &Interruption) {
        let Self {
            members, session, ..
        } = self;
        while let Some(member) = members.first_mut()
            && !member.binary.is_ready(session, member.epoch)
            && !member.side.has_ended()
            && !interruption.came()
        {
            std::thread::sleep(LOOK);
        }
    }

    /// Starts the first controller, unless it was started by hand.
    ///
    /// # Errors
    /// If the controller cannot be started.
    pub(crate) fn start(
        session: &mut Session,
        run_dir: PathBuf,
        policy: OnLoss,
        (binary, job): (Binary, Job),
        by_hand: Option<SideProcess>,
    ) -> Result<Self, Failure> {
        let mut controllers = Self {
            members: Vec::new(),
            policy,
            run_dir,
            session: session.info().clone(),
            restarts: 0,
            exhausted: None,
            known: 0,
            recorded: 1, // the first is recorded from the start
            unknown: None,
            programs: Programs::default(),
        };
        match by_hand {
            Some(side) => {
                controllers.know(&binary, &job);
                (controllers.members).push(Member::new(1, side, binary, job, Vec::new()));
            }
            None => {
                controllers.add(session, binary, job, Vec::new())?;
            }
        }
        controllers.members[0].standing = Role::InOffice;
        Ok(controllers)
    }

    /// Returns programs and jobs of all controllers, including later ones.
    pub(super) fn programs(&self) -> Programs {
        Programs::clone(&self.programs)
    }

    /// Registers a controller for judging parameters.
    fn know(&self, binary: &Binary, job: &Job) {
        let mut programs = self.programs.lock().unwrap_or_else(PoisonError::into_inner);
        programs.push((binary.clone(), job.clone()));
    }

    /// Starts another controller.
    fn add(
        &mut self,
        session: &mut Session,
        binary: Binary,
        job: Job,
        set: Vec<String>,
    ) -> Result<u32, Failure> {
        let epoch = self.next_epoch();
        if epoch > MOST_EPOCHS {
            return Err(Failure::usage(format!(
                "a run can have at most {MOST_EPOCHS} controllers"
            )));
        }
        let job = Job { epoch, ..job };
        let info = session.info().clone();
        info.write_file(JOB_FILE, &job)
            .map_err(Failure::infrastructure)?;
        let log = match epoch {
            1 => "controller.log".into(),
            _ => format!("controller-{epoch}.log"),
        };
        let side = SideProcess::start("controller", &binary, &info, &self.run_dir, &log)?;
        session
            .add_controller(epoch, side.process_id())
            .map_err(Failure::infrastructure)?;
        self.know(&binary, &job);
        self.members
            .push(Member::new(epoch, side, binary, job, set));
        Ok(epoch)
    }

    fn next_epoch(&self) -> u32 {
        self.members.last().map_or(1, |last| last.epoch + 1)
    }

    /// Returns the active controller.
    pub(super) fn in_office(&self) -> Option<&SideProcess> {
        let member = &self.members[self.place_in_office()];
        (member.standing == Role::InOffice).then_some(&member.side)
    }

    /// Returns the active controller, or the one started last.
    pub(super) fn latest(&self) -> &SideProcess {
        &self.members[self.place_in_office()].side
    }

    fn place_in_office(&self) -> usize {
        let in_office = |member: &Member| member.standing == Role::InOffice;
        let place = self.members.iter().rposition(in_office);
        place.unwrap_or(self.members.len() - 1)
    }

    /// Counts the controllers that have not ended.
    pub(crate) fn running(&mut self) -> usize {
        let runs = |member: &mut Member| usize::from(!member.side.has_ended());
        self.members.iter_mut().map(runs).sum()
    }

    /// Returns the pending ends of controllers.
    pub(super) fn endings(&self) -> impl Iterator<Item = &Ending> {
        self.members
            .iter()
            .filter_map(|member| member.side.ending())
    }

    /// Returns `true` if the active controller has died and its death ends the run. During a takeover, only the plant
    /// knows which controller is active.
    pub(super) fn death_ends_run(&mut self) -> bool {
        if self.is_one_coming() {
            return false;
        }
        let place = self.place_in_office();
        let member = &mut self.members[place];
        self.policy == OnLoss::Abort && member.standing == Role::InOffice && member.side.has_ended()
    }

    /// Returns `true` unless a takeover is pending, or the plant was told of a death and has not reported the
    /// consequence.
    pub(super) fn are_settled(&self) -> bool {
        !self.is_one_coming() && !self.plant_is_silent(Duration::ZERO)
    }

    fn is_one_coming(&self) -> bool {
        let coming = |member: &Member| member.standing == Role::Coming;
        self.members.iter().any(coming)
    }

    /// Returns `true` if the plant was told more than `limit` ago that a controller had ended, and has not reported the
    /// consequence.
    pub(super) fn plant_is_silent(&self, limit: Duration) -> bool {
        self.members.iter().any(|member| {
            member.standing == Role::InOffice
                && member
                    .plant_told_at
                    .is_some_and(|since| since.elapsed() > limit)
        })
    }

    /// Returns the reason why no lost controller is restarted any more, if there is one.
    pub(super) fn exhausted(&self) -> Option<String> {
        self.exhausted.clone()
    }

    /// Describes a controller reported by the plant that was never started.
    pub(crate) fn unknown(&self) -> Option<String> {
        let describe =
            |epoch| format!("the plant reports controller {epoch}, which was never started");
        self.unknown.map(describe)
    }

    /// Tells all controllers once that the run is over, with this line.
    pub(super) fn tell_once(&mut self, line: &str) {
        for member in &mut self.members {
            if !std::mem::replace(&mut member.is_told_of_end, true) {
                member.side.tell(line);
            }
        }
    }

    /// Ends the controllers whose grace period is over.
    pub(super) fn end_if_due(&mut self, since: Instant, grace: Duration) {
        for member in &mut self.members {
            member.side.end_if_due(since, grace);
        }
    }

    /// Returns the started controllers in order.
    pub(crate) fn started(&self) -> Vec<Started> {
        let started = |member: &Member| Started {
            epoch: member.epoch,
            binary: member.binary.clone(),
            law: member.job.law.clone(),
            set: member.set.clone(),
            fate: member.side.fate(),
        };
        self.members.iter().map(started).collect()
    }

    /// Returns the controllers started since the last call.
    pub(super) fn unrecorded(&mut self) -> Vec<Started> {
        let recorded = std::mem::replace(&mut self.recorded, self.members.len());
        if recorded == self.members.len() {
            return Vec::new();
        }
        self.started().split_off(recorded)
    }

    /// Returns the number of processed changes.
    pub(super) const fn known_changes(&self) -> usize {
        self.known
    }

    /// Starts a requested controller.
    pub(crate) fn swap(&mut self, session: &mut Session, request: SwapRequest) {
        let SwapRequest {
            binary,
            law,
            set,
            left_out,
            answer,
        } = request;
        if self.is_one_coming() {
            let busy = "another controller is about to take over".to_owned();
            let _ = answer.send(Err(busy)); // the requester may be gone
            return;
        }
        let place = self.place_in_office();
        let job = jobs::with_law(self.members[place].job.clone(), law);
        match self.add(session, binary, job, set) {
            Ok(_) => {
                if let Some(member) = self.members.last_mut() {
                    member.requester = Some(Requester { answer, left_out });
                }
            }
            Err(failure) => {
                let _ = answer.send(Err(failure.to_string()));
            }
        }
    }

    /// Processes the plant's report of the active controller, and of one to restart.
    pub(crate) fn hear(
        &mut self,
        session: &mut Session,
        plant: &mut SideProcess,
        changes: &[ControllerChange],
    ) {
        for change in changes {
            self.note(change);
            if matches!(change.change, ControllerFate::Lost { .. })
                && self.policy == OnLoss::WaitForRestart
            {
                self.restart(session, plant, change.epoch);
            }
        }
    }

    /// Records the active controller, and answers its requester.
    pub(crate) fn note(&mut self, change: &ControllerChange) {
        self.known += 1;
        let ControllerChange {
            epoch,
            step,
            change,
        } = change;
        if (self.members.iter()).all(|member| member.epoch != *epoch) {
            self.unknown.get_or_insert(*epoch);
            return;
        }
        let past = Role::Past(Instant::now());
        if matches!(change, ControllerFate::Joined { .. }) {
            let in_office = |member: &&mut Member| member.standing == Role::InOffice;
            for member in self.members.iter_mut().filter(in_office) {
                member.standing = past;
            }
        }
        let Some(member) = (self.members.iter_mut()).find(|member| member.epoch == *epoch) else {
            return;
        };
        let requester = match change {
            ControllerFate::Lost { .. } => None,
            _ => member.requester.take(),
        };
        let result = match change {
            ControllerFate::Lost { .. } => {
                member.standing = past;
                return;
            }
            ControllerFate::Refused { reason } => {
                member.standing = past;
                // Its own last message says more than the fact of its end.
                let word = member.side.last_word().filter(|_| member.side.has_ended());
                Err(word.unwrap_or_else(|| reason.clone()))
            }
            ControllerFate::Joined { law } => {
                member.standing = Role::InOffice;
                Ok(Swapped {
                    epoch: *epoch,
                    step: *step,
                    law: law.clone(),
                    binary: member.binary.path.clone(),
                    left_out: (requester.as_ref())
                        .map_or_else(Vec::new, |one| one.left_out.clone()),
                })
            }
        };
        if let Some(requester) = requester {
            let _ = requester.answer.send(result); // the requester may be gone
        }
    }

    /// Restarts a lost controller, or tells the plant that none follows.
    fn restart(&mut self, session: &mut Session, plant: &mut SideProcess, lost: u32) {
        if self.is_one_coming() {
            return; // another one was just requested
        }
        if self.restarts == RESTARTS {
            let most = format!("it was already restarted {RESTARTS} times, which is the maximum");
            self.exhausted = Some(most);
            plant.tell(&format!("{PEER_GONE} {}", self.next_epoch()));
            return;
        }
        self.restarts += 1;
        let member = (self.members.iter()).find(|member| member.epoch == lost);
        let Some(member) = member else {
            return;
        };
        let (binary, job, set) = (
            member.binary.clone(),
            member.job.clone(),
            member.set.clone(),
        );
        match self.add(session, binary, job, set) {
            Ok(_) => {} // announced once it can say hello
            Err(failure) => {
                let why = failure.reason();
                self.exhausted = Some(format!("it cannot be restarted: {why}"));
                plant.tell(&format!("{PEER_GONE} {}", self.next_epoch()));
            }
        }
    }

    /// Tells the plant of controllers that ended, and ends those no longer needed.
    pub(crate) fn look(&mut self, plant: &mut SideProcess) {
        for member in &mut self.members {
            let has_ended = member.side.has_ended();
            if !member.is_announced
                && (has_ended || member.binary.is_ready(&self.session, member.epoch))
            {
                member.is_announced = true;
                plant.tell(&format!("{EXPECT} {}", member.epoch));
            }
            match member.standing {
                Role::Past(since) if !has_ended && since.elapsed() > PARTING => {
                    member.side.kill();
                }
                Role::Coming | Role::InOffice if has_ended && member.plant_told_at.is_none() => {
                    member.plant_told_at = Some(Instant::now());
                    plant.tell(&format!("{PEER_GONE} {}", member.epoch));
                }
                _ => {}
            }
        }
    }
}

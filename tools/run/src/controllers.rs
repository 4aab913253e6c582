//! The controllers of a run: the active one, those before it, and the one that is to take over.
//!
//! The plant decides which one is active and tells it in the record stream; here processes are started
//! and ended accordingly.

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
use super::objections::Crew;
use super::side::{LOOK, SideProcess};
use crate::swap::{Swapped, Wanted};

/// Most restarts of a lost controller in one run.
const RESTARTS: u32 = 3;
/// Longest time that a controller may take to end by itself once it is not active any more.
const PARTING: Duration = Duration::from_millis(500);

/// All controllers that were started.
pub(super) struct Controllers {
    members: Vec<Member>,
    policy: OnLoss,
    run_dir: PathBuf,
    session: SessionInfo,
    restarts: u32,
    /// Reason for which no controller is started anew any more.
    exhausted: Option<String>,
    /// Changes that were heard of.
    known: usize,
    /// Members that the recording tells of.
    recorded: usize,
    /// The plant told of one that was never started.
    unknown: Option<u32>,
    /// Programs and jobs, for those who judge parameters.
    crew: Crew,
}

/// Controller process.
struct Member {
    epoch: u32,
    side: SideProcess,
    binary: Binary,
    job: Job,
    /// Values of the scenario that were changed for it.
    set: Vec<String>,
    standing: Standing,
    /// The plant was told that it comes.
    is_announced: bool,
    /// Time at which the plant was told that the controller ended.
    told_gone: Option<Instant>,
    /// The controller was told that the run is over.
    told_over: bool,
    /// Request that the controller was started for.
    asked: Option<Asked>,
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
            standing: Standing::Coming,
            is_announced: epoch == 1,
            told_gone: None,
            told_over: false,
            asked: None,
        }
    }
}

/// Somebody who asked for a controller.
struct Asked {
    answer: Sender<Result<Swapped, String>>,
    /// Keys of the running scenario that the controller does not have.
    left_out: Vec<String>,
}

/// Role of a controller in the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    Coming,
    InOffice,
    /// Since when it is of no more use.
    Past(Instant),
}

impl Controllers {
    /// Waits until the first may be expected to say hello, which on a target takes as long as `ssh` does; or until it
    /// has ended, or somebody interrupted that.
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

    /// Starts the first one, unless somebody did so by hand.
    ///
    /// # Errors
    /// If it cannot be started.
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
            recorded: 1, // of the first it tells from the start
            unknown: None,
            crew: Crew::default(),
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
        controllers.members[0].standing = Standing::InOffice;
        Ok(controllers)
    }

    /// Programs and jobs of all that were started, those to come included.
    pub(super) fn crew(&self) -> Crew {
        Crew::clone(&self.crew)
    }

    /// Takes down one that starts, for those who judge parameters.
    fn know(&self, binary: &Binary, job: &Job) {
        let mut crew = self.crew.lock().unwrap_or_else(PoisonError::into_inner);
        crew.push((binary.clone(), job.clone()));
    }

    /// Starts one more.
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
                "a run has {MOST_EPOCHS} controllers at most"
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

    /// The active one.
    pub(super) fn in_office(&self) -> Option<&SideProcess> {
        let member = &self.members[self.place_in_office()];
        (member.standing == Standing::InOffice).then_some(&member.side)
    }

    /// The active one, or the one that was started last.
    pub(super) fn latest(&self) -> &SideProcess {
        &self.members[self.place_in_office()].side
    }

    fn place_in_office(&self) -> usize {
        let in_office = |member: &Member| member.standing == Standing::InOffice;
        let place = self.members.iter().rposition(in_office);
        place.unwrap_or(self.members.len() - 1)
    }

    /// Counts those that have not ended.
    pub(crate) fn running(&mut self) -> usize {
        let runs = |member: &mut Member| usize::from(!member.side.has_ended());
        self.members.iter_mut().map(runs).sum()
    }

    /// Returns the ends that are still to come.
    pub(super) fn endings(&self) -> impl Iterator<Item = &Ending> {
        self.members
            .iter()
            .filter_map(|member| member.side.ending())
    }

    /// Returns true if the active controller has died and that ends the run. While another is to take over,
    /// only the plant knows which controller is active.
    pub(super) fn death_ends_run(&mut self) -> bool {
        if self.is_one_coming() {
            return false;
        }
        let place = self.place_in_office();
        let member = &mut self.members[place];
        self.policy == OnLoss::Abort
            && member.standing == Standing::InOffice
            && member.side.has_ended()
    }

    /// Returns true unless one is to take over, or the plant was told of a death and has not said what follows.
    pub(super) fn are_settled(&self) -> bool {
        !self.is_one_coming() && !self.plant_is_silent(Duration::ZERO)
    }

    fn is_one_coming(&self) -> bool {
        let coming = |member: &Member| member.standing == Standing::Coming;
        self.members.iter().any(coming)
    }

    /// Returns true if the plant was told more than `limit` ago that a controller is gone, and has not said
    /// what follows.
    pub(super) fn plant_is_silent(&self, limit: Duration) -> bool {
        self.members.iter().any(|member| {
            member.standing == Standing::InOffice
                && member.told_gone.is_some_and(|told| told.elapsed() > limit)
        })
    }

    /// Returns the reason for which no lost controller is started anew any more, if there is one.
    pub(super) fn exhausted(&self) -> Option<String> {
        self.exhausted.clone()
    }

    /// Describes what the plant told of a controller that was never started, if it did.
    pub(crate) fn unknown(&self) -> Option<String> {
        let told = |epoch| format!("the plant tells of controller {epoch}, which was not started");
        self.unknown.map(told)
    }

    /// Tells all of them that it is over, in this way, if they were not told yet.
    pub(super) fn tell_once(&mut self, line: &str) {
        for member in &mut self.members {
            if !std::mem::replace(&mut member.told_over, true) {
                member.side.tell(line);
            }
        }
    }

    /// Ends those that had their time to end by themselves.
    pub(super) fn end_if_due(&mut self, since: Instant, grace: Duration) {
        for member in &mut self.members {
            member.side.end_if_due(since, grace);
        }
    }

    /// Returns the controllers that were started, in order.
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

    /// Returns the controllers that were started since the last call.
    pub(super) fn unrecorded(&mut self) -> Vec<Started> {
        let recorded = std::mem::replace(&mut self.recorded, self.members.len());
        if recorded == self.members.len() {
            return Vec::new();
        }
        self.started().split_off(recorded)
    }

    /// Changes that were heard of.
    pub(super) const fn known_changes(&self) -> usize {
        self.known
    }

    /// Somebody wants another one.
    pub(crate) fn swap(&mut self, session: &mut Session, wanted: Wanted) {
        let Wanted {
            binary,
            law,
            set,
            left_out,
            answer,
        } = wanted;
        if self.is_one_coming() {
            let busy = "another controller is about to take over".to_owned();
            let _ = answer.send(Err(busy)); // who asked may be gone
            return;
        }
        let place = self.place_in_office();
        let job = jobs::with_law(self.members[place].job.clone(), law);
        match self.add(session, binary, job, set) {
            Ok(_) => {
                if let Some(member) = self.members.last_mut() {
                    member.asked = Some(Asked { answer, left_out });
                }
            }
            Err(failure) => {
                let _ = answer.send(Err(failure.to_string()));
            }
        }
    }

    /// Takes in what the plant told: the controller that is active, and the one that is to be started anew.
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

    /// Takes down which one is active, and answers who asked for it.
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
        let past = Standing::Past(Instant::now());
        if matches!(change, ControllerFate::Joined { .. }) {
            let in_office = |member: &&mut Member| member.standing == Standing::InOffice;
            for member in self.members.iter_mut().filter(in_office) {
                member.standing = past;
            }
        }
        let Some(member) = (self.members.iter_mut()).find(|member| member.epoch == *epoch) else {
            return;
        };
        let asked = match change {
            ControllerFate::Lost { .. } => None,
            _ => member.asked.take(),
        };
        let told = match change {
            ControllerFate::Lost { .. } => {
                member.standing = past;
                return;
            }
            ControllerFate::Refused { reason } => {
                member.standing = past;
                // Its own last word says more than that it is gone.
                let word = member.side.last_word().filter(|_| member.side.has_ended());
                Err(word.unwrap_or_else(|| reason.clone()))
            }
            ControllerFate::Joined { law } => {
                member.standing = Standing::InOffice;
                Ok(Swapped {
                    epoch: *epoch,
                    step: *step,
                    law: law.clone(),
                    binary: member.binary.path.clone(),
                    left_out: (asked.as_ref()).map_or_else(Vec::new, |one| one.left_out.clone()),
                })
            }
        };
        if let Some(asked) = asked {
            let _ = asked.answer.send(told); // who asked may be gone
        }
    }

    /// Starts a lost controller anew, or lets the plant know that none comes any more.
    fn restart(&mut self, session: &mut Session, plant: &mut SideProcess, lost: u32) {
        if self.is_one_coming() {
            return; // somebody asked for another one just before
        }
        if self.restarts == RESTARTS {
            let most = format!("it was started anew {RESTARTS} times, which is the most");
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
                self.exhausted = Some(format!("it cannot be started anew: {why}"));
                plant.tell(&format!("{PEER_GONE} {}", self.next_epoch()));
            }
        }
    }

    /// Tells the plant of those that ended, and ends those that are of no more use.
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
                Standing::Past(since) if !has_ended && since.elapsed() > PARTING => {
                    member.side.kill();
                }
                Standing::Coming | Standing::InOffice
                    if has_ended && member.told_gone.is_none() =>
                {
                    member.told_gone = Some(Instant::now());
                    plant.tell(&format!("{PEER_GONE} {}", member.epoch));
                }
                _ => {}
            }
        }
    }
}

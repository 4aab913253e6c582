//! Settings of a run: the command-line options, checked as far as possible without a scenario.
//!
//! Created once by each command that runs scenarios; a suite gives each of its runs a folder and a session of its own.
//! Contains no plan and starts nothing.

use std::path::PathBuf;
use std::sync::Arc;

use hil_config::plan::{Clock, Plan};
use hil_console::terminal::exit::Failure;
use hil_facts::arguments::run::{LinkKind, RunOptions, StartKind};
use hil_facts::programs::binaries::{Binaries, Binary};
use hil_facts::programs::scenario::ScenarioFile;
use hil_facts::results::curve::Grid;
use hil_session::asking;
use shared_types::side::Side;

use hil_recording::compression::Compression;
use hil_recording::excerpt::Choice;

/// Default maximum silence of a live process in s.
pub(crate) const WAIT_LIMIT_S: f64 = 5.0;

/// Checked settings of a run, independent of its scenario.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Link between plant and controller.
    pub link: LinkKind,
    /// Folder of the run; `None` for a new one below `runs`.
    pub out: Option<PathBuf>,
    /// Name of the session; `None` for a random one.
    pub session: Option<String>,
    /// Settings of the recording; `None` if none is written.
    pub recording: Option<RecordingSettings>,
    /// Maximum silence of a live process in s.
    pub wait_limit_s: f64,
    /// Simulated time at which the run pauses.
    pub pause_at_s: Option<f64>,
    /// Times before which the state of both sides is saved.
    pub checkpoints_at_s: Vec<f64>,
    /// Changed values of the scenario, as `KEY=VALUE`.
    pub set: Vec<String>,
    /// File of the scenario, if the run has one.
    pub scenario_file: Option<ScenarioFile>,
    /// `true` if several runs share the terminal.
    pub is_one_of_many: bool,
    /// Grid of the recorded curve of a campaign's case.
    pub curve: Option<Arc<Grid>>,
    /// Sides that are started by hand.
    pub by_hand: ByHand,
}

/// Sides of a run that are started by hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByHand {
    pub(crate) plant: bool,
    pub(crate) controller: bool,
}

/// Settings of a recording.
#[derive(Clone, Debug)]
pub struct RecordingSettings {
    pub(crate) compression: Compression,
    /// Selection of the run's records.
    pub(crate) choice: Choice,
}

impl ByHand {
    fn of(options: &RunOptions) -> Result<Self, Failure> {
        let by_hand = Self {
            plant: options.plant == StartKind::External,
            controller: options.controller == StartKind::External,
        };
        let Some(flag) = by_hand.flag() else {
            return Ok(by_hand);
        };
        if options.link == LinkKind::InProcess {
            return Err(Failure::usage(format!(
                "{flag} needs a process to start, but --link in-process starts none; omit --link in-process"
            )));
        }
        if options.target.target.is_some() {
            return Err(Failure::usage(format!(
                "{flag} works only for a side on this machine; omit --target"
            )));
        }
        Ok(by_hand)
    }

    /// Returns the sides started by hand.
    pub(crate) fn roles(self) -> impl Iterator<Item = Side> {
        let all = [
            (self.plant, Side::Plant),
            (self.controller, Side::Controller),
        ];
        (all.into_iter()).filter_map(|(is_by_hand, side)| is_by_hand.then_some(side))
    }

    /// Returns the flag for a side.
    pub fn flag(self) -> Option<String> {
        let side = self.roles().next()?;
        Some(format!("--{} external", side.name()))
    }

    /// Refuses programs that cannot be identified by the executable of their process.
    ///
    /// # Errors
    /// If a program is a script or a model.
    pub(crate) fn check(self, binaries: &Binaries) -> Result<(), Failure> {
        for side in self.roles() {
            let (name, binary) = (side.name(), binaries.of_side(side));
            if binary.host.is_some() {
                let path = binary.path.display();
                return Err(Failure::usage(format!(
                    "--{name} external: {path} is a model, which another program runs; name a program instead"
                )));
            }
            if binary.is_script() {
                let path = binary.path.display();
                return Err(Failure::usage(format!(
                    "--{name} external: {path} is a script, whose process is its interpreter and so cannot be identified; name a compiled program instead"
                )));
            }
        }
        Ok(())
    }
}

impl Settings {
    /// Checks the options.
    ///
    /// # Errors
    /// If a value is out of range, or options contradict each other.
    pub fn of(options: &RunOptions) -> Result<Self, Failure> {
        if options.wait_limit.is_nan() || options.wait_limit <= 0.0 {
            return Err(Failure::usage(
                "--wait-limit must be a number above 0, or inf",
            ));
        }
        asking::allow_seconds(options.wait_limit);
        let binaries = &options.binaries;
        let is_given = binaries.plant_bin.is_some() || binaries.controller_bin.is_some();
        if options.link == LinkKind::InProcess && is_given {
            return Err(Failure::usage(
                "--link in-process runs built-in plants and laws, so --plant-bin and --controller-bin have no effect; omit them, or omit --link in-process",
            ));
        }
        let checkpoints_at_s = options.checkpoints.checkpoint_at.clone();
        if options.no_record && !checkpoints_at_s.is_empty() {
            return Err(Failure::usage(
                "--checkpoint-at needs the recording up to the checkpoint; omit --no-record",
            ));
        }
        let choice = options.choice.choice(
            !options.no_record,
            !options.checkpoints.checkpoint_at.is_empty(),
        )?;
        Ok(Self {
            link: options.link,
            out: options.out.clone(),
            session: options.session.clone(),
            recording: (!options.no_record).then_some(RecordingSettings {
                compression: options.compression,
                choice,
            }),
            wait_limit_s: options.wait_limit,
            pause_at_s: options.pause_at,
            checkpoints_at_s,
            set: options.changes.as_set(),
            scenario_file: None,
            is_one_of_many: false,
            by_hand: ByHand::of(options)?,
            curve: None,
        })
    }

    /// Creates the settings of a run without a recording.
    pub fn without_recording(link: LinkKind, out: Option<PathBuf>) -> Self {
        Self {
            link,
            out,
            session: None,
            recording: None,
            wait_limit_s: WAIT_LIMIT_S,
            pause_at_s: None,
            checkpoints_at_s: Vec::new(),
            set: Vec::new(),
            scenario_file: None,
            is_one_of_many: false,
            by_hand: ByHand::default(),
            curve: None,
        }
    }

    /// Creates the settings of a run with a complete recording.
    pub fn with_recording(link: LinkKind, out: Option<PathBuf>) -> Self {
        Self {
            recording: Some(RecordingSettings {
                compression: Compression::Lz4,
                choice: Choice::default(),
            }),
            ..Self::without_recording(link, out)
        }
    }

    /// Returns the level of evidence that a run provides, as named in its recording and its summary.
    pub(crate) fn evidence(&self, plan: &Plan, binaries: &Binaries) -> &'static str {
        let Binaries { plant, controller } = binaries;
        let plant = plan.whole_plant_among(&plant.description.plants);
        let port = plant.and_then(|plant| plant.port.as_ref());
        let is_hardware = port.is_some_and(|port| port.simulated.is_empty());
        let level = match (self.link, &controller.at) {
            (LinkKind::InProcess, _) => "in-process",
            (LinkKind::Iceoryx2, None) => "sil",
            (LinkKind::Iceoryx2, Some(at)) => {
                at.evidence(&controller.path, plan.run.clock == Clock::Realtime)
            }
        };
        match level {
            // Emulated code is no evidence about a target, whatever the plant.
            "sil-emulated" => level,
            _ if is_hardware => "hil",
            _ => level,
        }
    }
}

/// Refuses programs that were named although no process is started.
pub fn refuse_in_process(link: LinkKind, binaries: &[&Binary]) -> Result<(), Failure> {
    if link != LinkKind::InProcess {
        return Ok(());
    }
    if let Some(at) = binaries.iter().find_map(|binary| binary.at.as_ref()) {
        let target = at.target();
        return Err(Failure::usage(format!(
            "--link in-process runs the law in hil, but --target {target} needs a process on the target; omit one of them"
        )));
    }
    let named = binaries.iter().find(|binary| binary.named().is_some());
    match named {
        Some(Binary { path, by, .. }) => Err(Failure::usage(format!(
            "--link in-process runs built-in plants and laws, but {} ({by}) needs a process; omit --link in-process",
            path.display()
        ))),
        None => Ok(()),
    }
}

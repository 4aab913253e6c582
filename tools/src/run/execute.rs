//! `hil run`: one scenario from the command line to the summary. `hil rerun` runs its own in the same
//! way.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hil_config::plan::{Clock, Plan};
use hil_recording::excerpt::Choice;
use hil_recording::reader::{EXCERPT, RECORDING};
use hil_recording::reserve::Reserve;
use hil_recording::size;
use hil_recording::writer::{Enclosure, Provenance};
use plant_process::repeat::Missed;
use shared_types::checkpoint::{Checkpoints, Side};
use shared_types::describe::{LawDescription, PROTOCOL};
use shared_types::lockstep::OnLoss;
use shared_types::number::{exact, exact_in};
use shared_types::record::{Outcome, RecordLayout};
use shared_types::session::{Session, SessionError, SessionInfo};
use shared_types::time::Step;

use super::{in_process, processes, realtime};
use crate::arguments::run::{LinkKind, RunOptions};
use crate::checkpoint;
use crate::checkpoint::branch::Branch;
use crate::checkpoint::past::{Past, PastRecords};
use crate::doctor;
use crate::files::{folder, part_file};
use crate::programs::binaries::{Binaries, Binary, seal};
use crate::programs::scenario;
use crate::results::requirements;
use crate::results::summary::Summary;
use crate::run::recorder::RecordingPlan;
use crate::session::observer::Notice;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::interruption::Interruption;
use crate::terminal::progress::Progress;

/// Room that is kept on the disk for the summary.
const SUMMARY_BYTES: u64 = 256 << 10;

/// What both ways of running need.
pub(super) struct Prepared {
    pub(super) plan: Plan,
    pub(super) binaries: Binaries,
    pub(super) plant: plant_process::job::Job,
    pub(super) controller: controller_process::job::Job,
    pub(super) recording: Option<RecordingPlan>,
    /// What its records hold, by what both binaries say of themselves.
    pub(super) layout: RecordLayout,
    /// After how many records the digest is wanted besides.
    pub(super) marks: Vec<u64>,
    /// The records that the run goes on from.
    pub(super) past: Option<PastRecords>,
    pub(super) interruption: Interruption,
    /// Several runs share the terminal.
    pub(super) is_one_of_many: bool,
}

impl Prepared {
    /// The progress of the run, with the hold that was asked for.
    pub(super) fn progress(&self, session: &str) -> Progress {
        let shown = !self.is_one_of_many;
        let mut progress = Progress::new(self.plan.run.steps, self.plan.run.rate, shown);
        if let Some(pause_at_s) = self.plant.pause_at_s {
            progress.announce_pause(pause_at_s, session);
        }
        progress
    }
}

/// What a run needs before its scenario is looked at.
#[derive(Clone)]
pub(crate) struct Setup {
    pub(crate) binaries: Binaries,
    pub(crate) interruption: Interruption,
    /// Several runs share the terminal.
    pub(crate) is_one_of_many: bool,
}

/// What a run has besides its scenario.
pub(crate) enum Basis {
    /// Nothing.
    Scenario,
    /// A recorded run that it repeats.
    Repeated(Repeated),
    /// A checkpoint that it goes on from.
    Checkpoint(Box<Past>, Branch),
}

/// What a run is to repeat of a recorded one.
pub(crate) struct Repeated {
    /// How many of its records are compared.
    pub(crate) records: u64,
    /// Where its controller was not in time.
    pub(crate) missed: Vec<Missed>,
}

/// What a run left.
pub(crate) struct Ran {
    pub(crate) exit: Exit,
    pub(crate) digest: Option<String>,
    /// The digests after the first records, by how many, as far as they were asked for and there
    /// were so many.
    pub(crate) partial_digests: BTreeMap<u64, String>,
    /// Its recording, if there is one.
    pub(crate) recording: Option<PathBuf>,
    /// From the first to the last record, in s.
    pub(crate) wall_time_s: f64,
    /// Its folder.
    pub(crate) folder: PathBuf,
    pub(crate) summarised: Summary,
    /// The summary as a machine reads it.
    pub(crate) summary: String,
    /// The summary as a person reads it.
    pub(crate) table: String,
    /// Whether the summary could be written. To be told after the summary: neither a full disk nor
    /// a broken output may hide the other.
    pub(crate) written: Result<(), Failure>,
}

/// Looks at the options and begins to listen to signals.
///
/// # Errors
/// If options do not go together.
pub(crate) fn begin(options: &RunOptions) -> Result<Interruption, Failure> {
    if options.wait_limit.is_nan() || options.wait_limit <= 0.0 {
        return Err(Failure::usage(
            "--wait-limit takes a number above 0, or inf",
        ));
    }
    let given = &options.binaries;
    let is_given = given.plant_bin.is_some() || given.controller_bin.is_some();
    if options.link == LinkKind::InProcess && is_given {
        return Err(Failure::usage(
            "--link in-process runs what is built into hil; --plant-bin and --controller-bin need processes",
        ));
    }
    Interruption::listen()
}

impl Setup {
    /// # Errors
    /// If the binaries do not go with the options.
    pub(crate) fn new(
        options: &RunOptions,
        binaries: Binaries,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        refuse_in_process(options.link, &[&binaries.plant, &binaries.controller])?;
        Ok(Self {
            binaries,
            interruption: interruption.clone(),
            is_one_of_many: false,
        })
    }
}

/// Refuses programs that were named where none is started.
///
/// # Errors
/// If there is one.
pub(crate) fn refuse_in_process(link: LinkKind, binaries: &[&Binary]) -> Result<(), Failure> {
    let named = binaries.iter().find(|binary| binary.named().is_some());
    match named {
        Some(Binary { path, by, .. }) if link == LinkKind::InProcess => {
            Err(Failure::usage(format!(
                "--link in-process runs what is built into hil; {} ({by}) needs a process",
                path.display()
            )))
        }
        _ => Ok(()),
    }
}

/// Runs a checked scenario, perhaps to repeat a recorded run or to go on from a checkpoint.
///
/// # Errors
/// If the run could not be started.
pub(crate) fn execute(
    plan: Plan,
    setup: Setup,
    options: &RunOptions,
    basis: Basis,
) -> Result<Ran, Failure> {
    let Setup {
        binaries,
        interruption,
        is_one_of_many,
    } = setup;
    let end_s = plan.run.rate.seconds(Step(plan.run.steps));
    if let Some(pause_at_s) = options.pause_at.filter(|pause_at_s| *pause_at_s >= end_s) {
        return Err(Failure::usage(format!(
            "--pause-at {} is not before the end of the run at {}",
            exact(pause_at_s),
            exact_in(end_s, "s")
        )));
    }
    if plan.run.clock == Clock::Realtime && options.link == LinkKind::InProcess {
        return Err(Failure::usage(
            "--clock realtime needs two processes: in one thread no side can be late for the other; leave out --link in-process",
        ));
    }
    realtime::check(&plan.realtime, options.link)?;
    let first = match &basis {
        Basis::Checkpoint(past, _) => past.first(),
        Basis::Scenario | Basis::Repeated(_) => Step(0),
    };
    let steps = checkpoint::steps(options, &plan, first)?;
    if !steps.is_empty() || first > Step(0) {
        checkpoint::refuse_unsaveable(&plan, &binaries)?;
    }
    if !steps.is_empty() && plan.run.on_controller_loss != OnLoss::Abort {
        return Err(Failure::usage(format!(
            "--checkpoint-at with run.on_controller_loss = \"{}\": a lost controller's state cannot be saved",
            plan.run.on_controller_loss.name()
        )));
    }
    let choice = options.choice.choice(options)?;
    let layout = binaries.record_layout(&plan)?;
    tell_size(&plan, &layout, options, &choice, is_one_of_many)?;
    let effective = scenario::show(&plan, &binaries)?;

    let mut session = Session::create(options.session.as_deref()).map_err(|error| match error {
        SessionError::Name(_) | SessionError::Taken { .. } => Failure::usage(error),
        other => Failure::infrastructure(other),
    })?;
    let info = session.info().clone();
    let law = plan.law_among(binaries.described().1).cloned();
    let (mut plant, mut controller) = jobs(&plan, law, &info, options);
    plant.checkpoints.steps.clone_from(&steps);
    controller.checkpoints.steps.clone_from(&steps);
    let mut marks: Vec<u64> = steps.iter().map(|step| step.0).collect();
    let mut past = None;
    let mut resumed = None;
    match basis {
        Basis::Scenario => {}
        Basis::Repeated(repeated) => {
            if !steps.is_empty() && !repeated.missed.is_empty() {
                return Err(Failure::usage(
                    "--checkpoint-at: the run that is repeated was against the clock; what its controller missed cannot be saved",
                ));
            }
            marks.push(repeated.records);
            plant.missed = repeated.missed;
        }
        Basis::Checkpoint(from, branch) => {
            plant.faults.extend(from.live_faults());
            plant.checkpoints = from.resume(Side::Plant, &plant.checkpoints);
            controller.checkpoints = from.resume(Side::Controller, &controller.checkpoints);
            past = Some(from.records(layout.clone()));
            resumed = Some(from.resumed(branch));
        }
    }
    check(&binaries, &info, &plant, &controller, &interruption)?;
    Notice::write(
        &info,
        &effective,
        &binaries,
        options.link == LinkKind::InProcess,
    )?;
    let run_dir = folder::create(options.out.as_deref(), &plan.name, &info.name)?;
    session
        .set_run_dir(&absolute(&run_dir))
        .map_err(Failure::infrastructure)?;
    part_file::write_text(&run_dir.join("scenario.toml"), &effective).inspect_err(|_| {
        // Nothing was run: the next try finds the folder as this one did.
        let _ = std::fs::remove_dir(&run_dir);
    })?;

    let evidence = match options.link {
        LinkKind::Iceoryx2 => "sil",
        LinkKind::InProcess => "in-process",
    };
    let recording = (!options.no_record).then(|| RecordingPlan {
        path: run_dir.join(RECORDING),
        compression: options.compression,
        choice: choice.clone(),
        provenance: {
            let mut provenance = provenance(&plan, &info, &binaries, evidence, &effective);
            if let Some(resumed) = &resumed {
                provenance.facts.extend(resumed.facts());
            }
            if !choice.is_all() {
                (provenance.facts).insert(EXCERPT.into(), choice.told());
            }
            provenance
        },
        session: info.clone(),
    });
    let prepared = Prepared {
        layout,
        plan,
        binaries,
        plant,
        controller,
        recording,
        marks,
        past,
        interruption,
        is_one_of_many,
    };
    let mut reserve = Reserve::of(&run_dir, SUMMARY_BYTES);
    let mut realtime = realtime::Watched::begin(prepared.plan.realtime, options.link, &info);
    let mut ended = match options.link {
        LinkKind::Iceoryx2 => processes::run(&prepared, &mut session, &run_dir, &mut realtime)?,
        LinkKind::InProcess => in_process::run(&prepared, &info, &mut realtime)?,
    };
    let realtime = realtime.end();
    let has_joined = options.link == LinkKind::InProcess || realtime.controller.is_some();
    if ended.outcome == Outcome::Completed && !has_joined {
        ended.outcome = Outcome::Failed;
        let what = "the plant says that it completed the run, and no controller came to its link";
        ended.reason = Some(what.into());
    }
    if ended.outcome == Outcome::Failed {
        let reason = ended.reason.take().unwrap_or_default();
        ended.reason = Some(crate::terminal::advice::behind(&reason));
    }
    let collected = match &ended.recorded.error {
        None => checkpoint::collect(
            &steps,
            &prepared.plan,
            (&prepared.binaries, &info),
            (&run_dir, &effective),
            &ended.recorded.partial_digests,
        ),
        Some(_) => Ok(Vec::new()),
    };
    drop(session);
    let (checkpoints, collected) = match collected {
        Ok(made) => (made, Ok(())),
        Err(failure) => (Vec::new(), Err(failure)),
    };

    // A run may end before there is anything to record.
    let is_recorded = !options.no_record && run_dir.join(RECORDING).exists();
    let recorded_to = is_recorded.then_some(RECORDING);
    let summary = Summary::new(
        &prepared.plan,
        &prepared.binaries,
        &info,
        evidence,
        recorded_to,
        realtime,
        &ended,
    )
    .with_checkpoints(resumed, checkpoints);
    let json = serde_json::to_string_pretty(&summary).map_err(Failure::infrastructure)?;
    reserve.release();
    Ok(Ran {
        exit: match ended.outcome {
            _ if ended.recorded.error.is_some() => Exit::Infrastructure,
            Outcome::Completed => requirements::exit(&summary.requirements),
            Outcome::Diverged => Exit::Failed,
            Outcome::Stopped if prepared.interruption.came() => Exit::Interrupted,
            Outcome::Stopped | Outcome::Failed => Exit::Infrastructure,
        },
        wall_time_s: ended.recorded.wall_time_s,
        digest: ended.recorded.digest,
        partial_digests: ended.recorded.partial_digests,
        recording: recorded_to.map(|name| run_dir.join(name)),
        table: summary.table(&prepared.plan, &run_dir),
        written: part_file::write_text(&run_dir.join("summary.json"), &json).and(collected),
        summary: json,
        summarised: summary,
        folder: run_dir,
    })
}

/// Tells how large the recording can get, where a person watches or the disk may not have room.
fn tell_size(
    plan: &Plan,
    layout: &RecordLayout,
    options: &RunOptions,
    choice: &Choice,
    is_one_of_many: bool,
) -> Result<(), Failure> {
    let largest = size::largest(layout, plan.run.steps, choice).map_err(Failure::usage)?;
    if options.no_record {
        return Ok(());
    }
    let shown = size::shown(largest);
    let folder = options.out.as_deref().unwrap_or(Path::new("."));
    let there = folder.ancestors().find(|folder| folder.is_dir());
    let there = there.unwrap_or(Path::new("."));
    if let Ok(disk) = rustix::fs::statvfs(there) {
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        if largest > free {
            tell!(
                "warning: the recording takes up to {shown} before compression, and {} are free; --record, --record-every and --record-around-faults make it smaller",
                size::shown(free)
            );
            return Ok(());
        }
    }
    if crate::terminal::output::person_watches() && !is_one_of_many {
        tell!("recording: up to {shown} before compression");
    }
    Ok(())
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Each side's part of the plan.
fn jobs(
    plan: &Plan,
    law: Option<LawDescription>,
    session: &SessionInfo,
    options: &RunOptions,
) -> (plant_process::job::Job, controller_process::job::Job) {
    let wait_limit_s = options.wait_limit;
    // Between two samples of a paced run the controller waits for the clock, not for the plant.
    let between_s = match plan.run.clock {
        Clock::Lockstep => 0.0,
        Clock::Paced { factor } => plan.run.rate.period_s() / factor,
        Clock::Realtime => plan.run.rate.period_s(),
    };
    let plant = plant_process::job::Job {
        protocol: PROTOCOL,
        session: session.id,
        run: plan.run,
        plant: plan.plant.clone(),
        stimuli: plan.stimuli.clone(),
        faults: plan.faults.clone(),
        derived: (plan.derived.iter())
            .map(|derived| (derived.name.clone(), derived.expression.to_string()))
            .collect(),
        missed: Vec::new(),
        law,
        pause_at_s: options.pause_at,
        observed: true,
        checkpoints: Checkpoints {
            steps: Vec::new(),
            folder: session.folder.clone(),
            resume: None,
        },
        realtime: plan.realtime.plant(),
        wait_limit_s,
    };
    let controller = controller_process::job::Job {
        protocol: PROTOCOL,
        session: session.id,
        epoch: 1,
        plant: plan.plant.model.clone(),
        law: plan.controller.law.clone(),
        parameters: plan.controller.parameters.clone(),
        model: plan.controller.model.clone(),
        rate: plan.run.rate,
        rate_divisor: plan.controller.rate_divisor,
        command_delay_steps: plan.controller.command_delay_steps,
        checkpoints: plant.checkpoints.clone(),
        realtime: plan.realtime.controller(),
        wait_limit_s: wait_limit_s + between_s,
    };
    (plant, controller)
}

/// Puts the jobs into the session's folder and has both binaries look at theirs.
fn check(
    binaries: &Binaries,
    session: &SessionInfo,
    plant: &plant_process::job::Job,
    controller: &controller_process::job::Job,
    interruption: &Interruption,
) -> Result<(), Failure> {
    use controller_process::job::JOB_FILE as CONTROLLER_FILE;
    use plant_process::job::JOB_FILE as PLANT_FILE;
    session
        .write_file(PLANT_FILE, plant)
        .map_err(Failure::infrastructure)?;
    session
        .write_file(CONTROLLER_FILE, controller)
        .map_err(Failure::infrastructure)?;
    binaries
        .plant
        .check(&session.folder.join(PLANT_FILE), interruption)?;
    binaries
        .controller
        .check(&session.folder.join(CONTROLLER_FILE), interruption)
}

/// What the recording says of its run.
fn provenance(
    plan: &Plan,
    session: &SessionInfo,
    binaries: &Binaries,
    evidence: &str,
    effective: &str,
) -> Provenance {
    let mut facts = BTreeMap::new();
    let mut fact = |name: &str, value: String| facts.insert(name.to_owned(), value);
    fact("scenario", plan.name.clone());
    fact("session", session.name.clone());
    fact("session_id", format!("{:016x}", session.id));
    fact("evidence", evidence.into());
    fact("seed", plan.run.seed.to_string());
    fact("rate_hz", plan.run.rate.hz().to_string());
    fact("steps", plan.run.steps.to_string());
    fact("protocol", PROTOCOL.to_string());
    fact("hil_version", env!("CARGO_PKG_VERSION").into());
    fact("hil_commit", env!("HIL_COMMIT").into());
    fact("plant_blake3", binaries.plant.blake3.clone());
    fact("controller_blake3", binaries.controller.blake3.clone());
    let named = [
        ("plant_binary", &binaries.plant),
        ("controller_binary", &binaries.controller),
    ];
    let named = (named.into_iter()).filter_map(|(name, one)| Some((name, one.named()?.to_str()?)));
    let named: Vec<_> = named.collect();
    for (name, path) in &named {
        fact(name, (*path).into());
    }
    let host = rustix::system::uname();
    fact("host", host.nodename().to_string_lossy().into_owned());
    let kernel = format!(
        "{} {}",
        host.release().to_string_lossy(),
        host.version().to_string_lossy()
    );
    fact("kernel", kernel);
    fact("machine", host.machine().to_string_lossy().into_owned());
    let cores = std::thread::available_parallelism().map_or(0, std::num::NonZero::get);
    fact("cores", cores.to_string());
    for (name, finding) in doctor::facts() {
        fact(&name, finding);
    }
    let started = humantime::format_rfc3339_millis(std::time::SystemTime::now());
    fact("started_utc", started.to_string());
    if !named.is_empty()
        && let Err(why) = seal::seal(&mut facts)
    {
        tell!(
            "note: the recording cannot be marked as this user's ({why}): `hil rerun` will ask for its programs"
        );
    }
    let json = |value: &shared_types::describe::Description| {
        serde_json::to_string_pretty(value).unwrap_or_default()
    };
    let enclosures = vec![
        Enclosure {
            name: "scenario.toml",
            media_type: "application/toml",
            text: effective.into(),
        },
        Enclosure {
            name: "plant-description.json",
            media_type: "application/json",
            text: json(&binaries.plant.description),
        },
        Enclosure {
            name: "controller-description.json",
            media_type: "application/json",
            text: json(&binaries.controller.description),
        },
    ];
    Provenance { facts, enclosures }
}

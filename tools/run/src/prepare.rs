//! Preparation of a run: the checks that need its plan, its session, its folder and its jobs.
//!
//! Neither side runs yet; the two programs only check their jobs.

use std::path::Path;
use std::time::SystemTime;

use hil_config::plan::{Clock, Plan};
use hil_console::files::begun::BegunRun;
use hil_console::files::runs::SCENARIO;
use hil_console::files::{begun, folder, part_file};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::checkpoint;
use hil_facts::programs::binaries::Binaries;
use hil_facts::programs::scenario;
use hil_facts::results::resumed::Resumed;
use hil_facts::session::observer::Notice;
use hil_recording::excerpt::Choice;
use hil_recording::reader::RECORDING;
use hil_recording::reserve::Reserve;
use hil_recording::size;
use hil_session::session::{Session, SessionError};
use shared_types::lockstep::OnLoss;
use shared_types::number::{exact, exact_in};
use shared_types::record::RecordLayout;
use shared_types::side::Side;
use shared_types::time::Step;

use super::environment::{Environment, Origin};
use super::prepared::{PreparedRun, leave};
use super::settings::Settings;
use super::{in_process, jobs, provenance, realtime, tables};
use crate::recorder::RecordingPlan;

/// Disk space reserved for the summary.
const SUMMARY_BYTES: u64 = 256 << 10;

/// Checks a run and creates its session and its folder.
///
/// # Errors
/// If the run cannot be executed as requested.
pub(super) fn prepare(
    plan: Plan,
    environment: Environment,
    origin: Origin,
) -> Result<(PreparedRun, Session), Failure> {
    let Environment {
        binaries,
        settings,
        interruption,
    } = environment;
    let checkpoints = check(&plan, &binaries, &settings, &origin)?;
    let mut plan = tapped(plan, &binaries, &settings, &origin);
    let layout = binaries.record_layout(&plan)?;
    tell_size(&plan, &layout, &settings)?;

    let is_in_process = settings.link == LinkKind::InProcess;
    let create = if is_in_process {
        Session::of_one_process
    } else {
        Session::create
    };
    let mut session = create(settings.session.as_deref()).map_err(|error| match error {
        SessionError::Name(_) | SessionError::Group(_) | SessionError::Taken { .. } => {
            Failure::usage(error)
        }
        other => Failure::infrastructure(other),
    })?;
    let info = session.info().clone();
    let folder = folder::of_run(settings.out.as_deref(), &plan.name, &info.name);
    let absolute = std::path::absolute(&folder).unwrap_or_else(|_| folder.clone());
    let long_tables = tables::refer(&mut plan, &absolute);
    let effective = scenario::show(&plan, &binaries)?;
    let of_session = match is_in_process || long_tables.is_empty() {
        true => None,
        false => Some(tables::in_session(&plan, &info.folder)?),
    };
    let of_jobs = of_session.as_ref().unwrap_or(&plan);
    let (mut plant, mut controller) = jobs::of(of_jobs, &binaries, &info, &settings, &checkpoints);
    let mut marks: Vec<u64> = checkpoints.iter().map(|step| step.0).collect();
    let mut past = None;
    let mut resumed = None;
    match origin {
        Origin::Scenario => {}
        Origin::Repeated(repeated) => {
            marks.push(repeated.records);
            plant.missed = repeated.missed;
        }
        Origin::Checkpoint(from, branch) => {
            plant.faults.extend(from.live_faults());
            plant.checkpoints = from.resume(Side::Plant, &plant.checkpoints);
            controller.checkpoints = from.resume(Side::Controller, &controller.checkpoints);
            past = Some(from.records(layout.clone()));
            resumed = Some(from.resumed(branch));
        }
    }
    if is_in_process {
        in_process::check(&plant, &controller, &binaries)?;
    } else {
        let plant_file = plant_process::job::JOB_FILE;
        jobs::check(&binaries.plant, &info, plant_file, &plant, &interruption)?;
        let controller_file = controller_process::job::JOB_FILE;
        jobs::check(
            &binaries.controller,
            &info,
            controller_file,
            &controller,
            &interruption,
        )?;
    }
    Notice::write(&info, &effective, &binaries, is_in_process)?;
    let started_utc = humantime::format_rfc3339_millis(SystemTime::now()).to_string();
    begun::note(|| BegunRun {
        folder: absolute.clone(),
        scenario: plan.name.clone(),
        law: plan.controller.law.clone(),
        session: info.name.clone(),
        started_utc: started_utc.clone(),
        set: settings.set.clone(),
        evidence: (settings.evidence(&plan, &binaries)).into(),
        clock: plan.run.clock.name().into(),
        rate_hz: plan.run.rate.hz(),
        seed: plan.run.seed,
        has_folder: false,
    });
    folder::create(&folder)?;
    begun::note_folder(&absolute);
    session
        .set_run_dir(&absolute)
        .map_err(Failure::infrastructure)?;
    let in_place = is_in_process && settings.recording.is_none();
    write_scenario(&folder, &effective, in_place)?;
    tables::write(&long_tables)?;
    let recording = (settings.recording.as_ref()).map(|recording| {
        let mut provenance =
            provenance::of(&plan, &info, &binaries, &settings, &effective, &started_utc);
        let resumed = resumed.iter().flat_map(Resumed::facts);
        provenance.facts.extend(resumed);
        RecordingPlan {
            path: folder.join(RECORDING),
            compression: recording.compression,
            choice: recording.choice.clone(),
            provenance,
            session: info.clone(),
        }
    });
    let prepared = PreparedRun {
        plan,
        binaries,
        settings,
        interruption,
        session: info,
        started_utc,
        // Where thousands of runs keep only their summaries, this would take longer than the runs.
        reserve: if is_in_process && recording.is_none() {
            Reserve::default()
        } else {
            Reserve::of(&folder, SUMMARY_BYTES)
        },
        folder,
        effective,
        plant,
        controller,
        recording,
        layout,
        checkpoints,
        marks,
        past,
        resumed,
    };
    Ok((prepared, session))
}

/// Writes the scenario to the new folder, atomically; or faster with `in_place`, where a folder counts only with
/// its summary.
fn write_scenario(folder: &Path, effective: &str, in_place: bool) -> Result<(), Failure> {
    let path = folder.join(SCENARIO);
    let written = if in_place {
        std::fs::write(&path, effective).map_err(|error| {
            Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
        })
    } else {
        part_file::write_text(&path, effective)
    };
    // Nothing was run: the next attempt finds the same state.
    written.inspect_err(|_| leave(folder))
}

/// Refuses combinations of plan and settings that are impossible; returns the steps of the checkpoints.
fn check(
    plan: &Plan,
    binaries: &Binaries,
    settings: &Settings,
    origin: &Origin,
) -> Result<Vec<Step>, Failure> {
    let end_s = plan.run.rate.seconds(Step(plan.run.steps));
    if let Some(pause_at_s) = settings.pause_at_s.filter(|at_s| *at_s >= end_s) {
        return Err(Failure::usage(format!(
            "--pause-at {} is not before the end of the run at {}",
            exact(pause_at_s),
            exact_in(end_s, "s")
        )));
    }
    if plan.run.clock == Clock::Realtime && settings.link == LinkKind::InProcess {
        return Err(Failure::usage(
            "--clock realtime needs two processes, because in one thread neither side can be late for the other; omit --link in-process",
        ));
    }
    settings.by_hand.check(binaries)?;
    let target = binaries.controller.at.as_ref();
    realtime::check(&plan.realtime, settings.link, target)?;
    let first = origin.first();
    let steps = checkpoint::steps(&settings.checkpoints_at_s, plan, first)?;
    if !steps.is_empty() || first > Step(0) {
        checkpoint::refuse_unsaveable(plan, binaries)?;
        if let Some(at) = &binaries.controller.at {
            let target = at.target();
            return Err(Failure::usage(format!(
                "--checkpoint-at cannot be used with --target {target}, because the controller's state is on the target, where nothing is stored; omit one of them"
            )));
        }
    }
    if !steps.is_empty() && plan.run.on_controller_loss != OnLoss::Abort {
        return Err(Failure::usage(format!(
            "--checkpoint-at cannot be used with run.on_controller_loss = \"{}\", because a lost controller's state cannot be saved; use \"abort\"",
            plan.run.on_controller_loss.name()
        )));
    }
    if let Origin::Repeated(repeated) = origin
        && !steps.is_empty()
        && !repeated.missed.is_empty()
    {
        return Err(Failure::usage(
            "--checkpoint-at cannot be used here: the repeated run was in real time, and the commands that its controller missed cannot be saved; omit --checkpoint-at",
        ));
    }
    Ok(steps)
}

/// Adds the inputs of instruments that `--record` selects. A continuation records what its past did.
fn tapped(mut plan: Plan, binaries: &Binaries, settings: &Settings, origin: &Origin) -> Plan {
    let (plants, ..) = binaries.described();
    if let Some(recording) = &settings.recording
        && !matches!(origin, Origin::Checkpoint(..))
        && let Some(plant) = plan.plant_among(plants)
    {
        plan.tap(&plant, |name| recording.choice.asks_for(name));
    }
    plan
}

/// Prints the maximum size of the recording, if a user watches or the disk may lack space.
fn tell_size(plan: &Plan, layout: &RecordLayout, settings: &Settings) -> Result<(), Failure> {
    let all = Choice::default();
    let recording = settings.recording.as_ref();
    let choice = recording.map_or(&all, |recording| &recording.choice);
    let largest = size::largest(layout, plan.run.steps, choice).map_err(Failure::usage)?;
    if recording.is_none() {
        return Ok(());
    }
    let size_text = size::shown(largest);
    let folder = settings.out.as_deref().unwrap_or(Path::new("."));
    let there = folder.ancestors().find(|folder| folder.is_dir());
    let there = there.unwrap_or(Path::new("."));
    if let Ok(disk) = rustix::fs::statvfs(there) {
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        if largest > free {
            tell!(
                "warning: the recording takes up to {size_text} before compression, and {} are free; --record, --record-every and --record-around-faults make it smaller",
                size::shown(free)
            );
            return Ok(());
        }
    }
    if output::person_watches() && !settings.is_one_of_many {
        tell!("recording: up to {size_text} before compression");
    }
    Ok(())
}

//! Checkpoints: the state of both sides before a step, stored in the folder of a run, from which another run can
//! continue. Nothing is run or recorded here.
//!
//! A checkpoint is a folder `checkpoint-<step>` next to the run's `run.mcap`: `plant.state` and `controller.state`,
//! which only the binaries that wrote them can read, and `checkpoint.json`, which describes them. `hil run
//! --checkpoint-at` makes a checkpoint:
//!
//! 1. `steps` determines the steps, and `refuse_unsaveable` checks that everything can be saved.
//! 2. Both sides write their state into the session's folder when they reach the step.
//! 3. `collect` stores both states next to the recording, with the digest of the records before the step.
//! 4. `note` adds the result of the check that the state restores exactly.
//!
//! `hil run --from` reads a checkpoint with [`Past`](past::Past), which verifies everything; [`branch`] defines which
//! parts of the scenario may differ from there on.

pub mod branch;
pub mod past;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use hil_config::plan::{Clock, Plan};
use hil_console::files::part_file::{self, PartFolder};
use hil_console::terminal::exit::Failure;
use hil_recording::reader::RECORDING;
use hil_session::session::SessionInfo;
use serde::{Deserialize, Serialize};
use shared_types::describe::PROTOCOL;
use shared_types::number::{exact, exact_in};
use shared_types::record::ValueChange;
use shared_types::side::Side;
use shared_types::time::{Rate, Step};

use crate::programs::binaries::host::ModelKind;
use crate::programs::binaries::{Binaries, Binary};
use crate::results::faults::FaultLog;
use crate::results::restoration::Check;
use crate::results::resumed::MadeCheckpoint;

/// Version of the folder's format.
const SCHEMA: u32 = 1;
/// Name of the file that describes a checkpoint.
const FILE: &str = "checkpoint.json";

/// Description of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    schema: u32,
    /// Step before which the state was saved: the first step of a run that continues from it.
    pub step: u64,
    /// Time of the step in s.
    pub time_s: f64,
    /// Name of the run's scenario.
    pub scenario: String,
    /// Name of the run's session.
    pub session: String,
    protocol: u32,
    hil_version: String,
    hil_commit: String,
    plant: SavedSide,
    controller: SavedSide,
    recording: SavedPast,
    /// Check that the state restores exactly; absent until made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    check: Option<Check>,
}

/// State of a side.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct SavedSide {
    /// Name of the plant or law.
    of: String,
    /// Hash of the binary that wrote the state.
    binary_blake3: String,
    /// Name of the file.
    file: String,
    /// Hash of the file.
    blake3: String,
}

/// Recorded past of a checkpoint: the records before its step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct SavedPast {
    /// Path of the recording, relative to the checkpoint's folder.
    file: String,
    /// Hash of the scenario in the recording.
    scenario_blake3: String,
    /// Number of records before the step.
    records: u64,
    /// Their digest.
    digest: String,
}

/// Returns the checkpoints in the folder of a run, by their steps.
#[must_use]
pub fn of_run(run: &Path) -> Vec<(Step, PathBuf)> {
    let entries = fs::read_dir(run).into_iter().flatten().flatten();
    let mut checkpoints: Vec<(Step, PathBuf)> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let step = name.strip_prefix("checkpoint-")?.parse().ok()?;
            let path = entry.path();
            path.join(FILE).is_file().then_some((Step(step), path))
        })
        .collect();
    checkpoints.sort_unstable();
    checkpoints
}

/// Returns the nearest checkpoint of a run from which a step can be reached again: at or before the step, without a
/// live intervention between both, which a run from the checkpoint would lack.
#[must_use]
pub fn nearest(
    run: &Path,
    step: Step,
    log: &FaultLog,
    changes: &[ValueChange],
) -> Option<(Step, PathBuf)> {
    let accepted = log.accepted.iter().map(|live| live.step);
    let cleared = log.ended.iter().filter(|ended| ended.cleared);
    let live = changes.iter().filter(|change| change.live);
    let interventions = accepted
        .chain(cleared.map(|ended| ended.step))
        .chain(live.map(|change| change.step));
    let last = interventions.filter(|one| *one < step.0).max();
    let usable = |at: Step| at <= step && last.is_none_or(|last| at.0 > last);
    of_run(run).into_iter().rev().find(|(at, _)| usable(*at))
}

/// Returns the command line that continues from a checkpoint and is held at a step, as words of a shell.
#[must_use]
pub fn command_line(checkpoint: &Path, step: Step, rate: Rate) -> String {
    let folder = checkpoint.display().to_string();
    let folder = shlex::try_quote(&folder).map_or_else(|_| folder.clone(), Into::into);
    let at_s = rate.seconds(step);
    format!("hil run --from {folder} --pause-at {at_s} --panel")
}

/// Returns the steps before which the state is saved, in increasing order; the run begins at `first`.
///
/// # Errors
/// If there is nothing to save at a time, or no run could continue from that time.
pub fn steps(at_s: &[f64], plan: &Plan, first: Step) -> Result<Vec<Step>, Failure> {
    let rate = plan.run.rate;
    let mut steps = Vec::new();
    for &at_s in at_s {
        let step = rate.step_at_or_after(at_s);
        let (first_s, end_s) = (rate.seconds(first), rate.seconds(Step(plan.run.steps)));
        if step <= first {
            return Err(Failure::usage(format!(
                "--checkpoint-at {} is not after the beginning of the run at {}",
                exact(at_s),
                exact_in(first_s, "s")
            )));
        }
        if step.0 >= plan.run.steps {
            return Err(Failure::usage(format!(
                "--checkpoint-at {} is not before the end of the run at {}",
                exact(at_s),
                exact_in(end_s, "s")
            )));
        }
        steps.push(step);
    }
    steps.sort_unstable();
    steps.dedup();
    if !steps.is_empty() && plan.run.clock == Clock::Realtime {
        return Err(Failure::usage(
            "--checkpoint-at: in real time the state depends on late commands; use --clock lockstep or paced",
        ));
    }
    Ok(steps)
}

/// Returns the declaration that a model needs to save its state, if the program is a model.
fn state_of_model(binary: &Binary) -> Option<&'static str> {
    let imported = binary.description.imported.as_ref()?;
    let host = binary.host.as_ref()?;
    if host.kind == ModelKind::Python {
        return Some("`state=` in its decorator, or `save` and `restore`");
    }
    Some(match imported.format.starts_with("FMI 2") {
        true => "`canGetAndSetFMUstate` and `canSerializeFMUstate` in its model description",
        false => "`canGetAndSetFMUState` and `canSerializeFMUState` in its model description",
    })
}

/// Refuses a run whose state cannot be saved or restored, naming the cause.
///
/// # Errors
/// If the plant, the law or a fault cannot save its state; the error names the part and the function that it needs.
pub fn refuse_unsaveable(plan: &Plan, binaries: &Binaries) -> Result<(), Failure> {
    let cannot = |what: String, needs: &str| {
        Err(Failure::usage(format!(
            "{what} cannot save its state, so there can be no checkpoint; it needs {needs}, see docs/checkpoints.md"
        )))
    };
    let [plant_needs, law_needs] = [
        (&binaries.plant, "`Plant::state`"),
        (&binaries.controller, "`Controller::state`"),
    ]
    .map(|(binary, own)| state_of_model(binary).unwrap_or(own));
    let (plants, laws, kinds) = binaries.described();
    if !plan.plant_among(plants).is_some_and(|plant| plant.saves) {
        return cannot(format!("plant `{}`", plan.plant.model), plant_needs);
    }
    if !plan.law_among(laws).is_some_and(|law| law.saves) {
        return cannot(format!("law `{}`", plan.controller.law), law_needs);
    }
    for event in &plan.faults {
        let kind = kinds.iter().find(|kind| kind.kind == event.kind);
        if kind.is_some_and(|kind| !kind.saves) {
            return cannot(format!("fault `{}`", event.kind), "`FaultKind::state`");
        }
    }
    Ok(())
}

/// Moves the states that both sides wrote to the session's folder next to the recording. `digests` are the digests of
/// the first records, by number of records.
///
/// # Errors
/// If a file cannot be read or written.
pub fn collect(
    steps: &[Step],
    plan: &Plan,
    (binaries, session): (&Binaries, &SessionInfo),
    (run_dir, scenario): (&Path, &str),
    digests: &BTreeMap<u64, String>,
) -> Result<Vec<MadeCheckpoint>, Failure> {
    let mut checkpoints = Vec::new();
    for &step in steps {
        let states = Side::ALL.map(|side| session.folder.join(side.file(step)));
        let (true, Some(digest)) = (
            states.iter().all(|state| state.exists()),
            digests.get(&step.0),
        ) else {
            tell!("note: no checkpoint before step {step}: the run ended earlier, or lost records");
            continue;
        };
        let folder = format!("checkpoint-{step}");
        let target = run_dir.join(&folder);
        let cannot = |error: std::io::Error| {
            let target_text = target.display();
            Failure::infrastructure(format!("cannot write {target_text}: {error}"))
        };
        let part = PartFolder::beside(&target).map_err(cannot)?;
        let saved = |side: Side, of: &str, binary: &str, state: &Path| {
            let content = fs::read(state)?;
            let file = state_file(side);
            fs::write(part.path().join(&file), &content)?;
            Ok(SavedSide {
                of: of.into(),
                binary_blake3: binary.into(),
                file,
                blake3: blake3::hash(&content).to_hex().to_string(),
            })
        };
        let [plant, controller] = &states;
        let (model, law) = (&plan.plant.model, &plan.controller.law);
        let checkpoint = Checkpoint {
            schema: SCHEMA,
            step: step.0,
            time_s: plan.run.rate.seconds(step),
            scenario: plan.name.clone(),
            session: session.name.clone(),
            protocol: PROTOCOL,
            hil_version: env!("CARGO_PKG_VERSION").into(),
            hil_commit: crate::programs::own::commit().into(),
            plant: saved(Side::Plant, model, &binaries.plant.blake3, plant).map_err(cannot)?,
            controller: saved(
                Side::Controller,
                law,
                &binaries.controller.blake3,
                controller,
            )
            .map_err(cannot)?,
            recording: SavedPast {
                file: format!("../{RECORDING}"),
                scenario_blake3: hash(scenario),
                records: step.0,
                digest: digest.clone(),
            },
            check: None,
        };
        let json = serde_json::to_string_pretty(&checkpoint).map_err(Failure::infrastructure)?;
        fs::write(part.path().join(FILE), json + "\n").map_err(cannot)?;
        part.complete(&target).map_err(cannot)?;
        checkpoints.push(MadeCheckpoint {
            step: step.0,
            time_s: checkpoint.time_s,
            folder,
            check: None,
        });
    }
    Ok(checkpoints)
}

/// Returns the name of the file with the state of a side in the folder of a checkpoint.
pub fn state_file(side: Side) -> String {
    format!("{}.state", side.name())
}

/// Stores the result of a check in the folder of a checkpoint.
///
/// # Errors
/// If the description of the checkpoint cannot be read or written.
pub fn note(folder: &Path, check: &Check) -> Result<(), Failure> {
    let checkpoint = Checkpoint {
        check: Some(check.clone()),
        ..past::read(folder)?
    };
    let json = serde_json::to_string_pretty(&checkpoint).map_err(Failure::infrastructure)?;
    part_file::write_text(&folder.join(FILE), &(json + "\n"))
}

/// Replaces the state of a side in a checkpoint by another that the same program wrote; the checkpoint is then unchecked
/// for this reason.
///
/// # Errors
/// If a file cannot be read or written.
pub fn replace(folder: &Path, side: Side, state: &Path, reason: &str) -> Result<(), Failure> {
    let mut checkpoint = past::read(folder)?;
    let cannot = |error: std::io::Error| {
        let target = folder.display();
        Failure::infrastructure(format!("cannot replace the state in {target}: {error}"))
    };
    let content = fs::read(state).map_err(cannot)?;
    let saved = match side {
        Side::Plant => &mut checkpoint.plant,
        Side::Controller => &mut checkpoint.controller,
    };
    saved.blake3 = blake3::hash(&content).to_hex().to_string();
    fs::write(folder.join(&saved.file), &content).map_err(cannot)?;
    checkpoint.check = Some(Check::missing(reason));
    let json = serde_json::to_string_pretty(&checkpoint).map_err(Failure::infrastructure)?;
    part_file::write_text(&folder.join(FILE), &(json + "\n"))
}

fn hash(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

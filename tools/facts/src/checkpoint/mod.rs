//! Checkpoints: the state of both sides before a step, kept in the folder of a run so that another run
//! goes on from there. Nothing is run or recorded here.
//!
//! A checkpoint is a folder `checkpoint-<step>` beside the `run.mcap` that it belongs to:
//! `plant.state` and `controller.state`, which only the binaries that wrote them can read, and
//! `checkpoint.json`, which says what they are. `hil run --checkpoint-at` makes it:
//!
//! 1. `steps` finds where, `refuse_unsaveable` looks whether everything can be saved.
//! 2. Both sides write their state into the session's folder when they reach the step.
//! 3. `collect` puts both beside the recording, with the digest of the records before the step.
//! 4. `note` adds the check that the state restores exactly, which the run made of it.
//!
//! `hil run --from` reads it with [`Past`](past::Past), which believes nothing that it has not
//! checked; [`branch`] says what of the scenario may differ from there on.

pub mod branch;
pub mod past;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use hil_config::plan::{Clock, Plan};
use hil_console::files::part_file::{self, PartFolder};
use hil_console::terminal::exit::Failure;
use hil_recording::reader::RECORDING;
use serde::{Deserialize, Serialize};
use shared_types::describe::PROTOCOL;
use shared_types::number::{exact, exact_in};
use shared_types::session::SessionInfo;
use shared_types::side::Side;
use shared_types::time::Step;

use crate::programs::binaries::{Binaries, Binary};
use crate::results::restoration::Check;
use crate::results::resumed::MadeCheckpoint;

/// Version of the folder.
const SCHEMA: u32 = 1;
/// Name of the file that describes a checkpoint.
const FILE: &str = "checkpoint.json";

/// Description of a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    schema: u32,
    /// The step before which the state was saved: the first of a run that goes on.
    pub step: u64,
    /// The same in s.
    pub time_s: f64,
    /// The run's scenario and session.
    pub scenario: String,
    /// The session.
    pub session: String,
    protocol: u32,
    hil_version: String,
    hil_commit: String,
    plant: SavedSide,
    controller: SavedSide,
    recording: SavedPast,
    /// Check that the state restores exactly; not there before it was checked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    check: Option<Check>,
}

/// The state of a side.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct SavedSide {
    /// The plant or law.
    of: String,
    /// Hash of the binary that wrote it.
    binary_blake3: String,
    /// File.
    file: String,
    /// Hash of the file.
    blake3: String,
}

/// Recorded past of a checkpoint: the records before its step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct SavedPast {
    /// The recording, from the checkpoint's folder.
    file: String,
    /// Hash of the scenario in it.
    scenario_blake3: String,
    /// Records before the step.
    records: u64,
    /// Their digest.
    digest: String,
}

/// The steps before which the state is to be saved, rising; the run begins at `first`.
///
/// # Errors
/// If there is nothing to save there, or it could not be gone on from.
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
            "--checkpoint-at: in real time the state depends on what came too late; use --clock lockstep or paced",
        ));
    }
    Ok(steps)
}

/// What an FMU must declare to save its state, if the program is one.
fn state_of_fmu(binary: &Binary) -> Option<&'static str> {
    let imported = binary.description.imported.as_ref()?;
    binary.host.as_ref()?;
    Some(match imported.format.starts_with("FMI 2") {
        true => "`canGetAndSetFMUstate` and `canSerializeFMUstate` in its model description",
        false => "`canGetAndSetFMUState` and `canSerializeFMUState` in its model description",
    })
}

/// Refuses a run whose state cannot be saved, or put back, by name.
///
/// # Errors
/// If the plant, the law or a fault cannot save its state; the error names it and the function it needs.
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
    .map(|(binary, own)| state_of_fmu(binary).unwrap_or(own));
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

/// Puts the states that both sides left in the session's folder beside the recording. `digests` are
/// those of the first records, by how many they are.
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
    let mut made = Vec::new();
    for &step in steps {
        let states = Side::ALL.map(|side| session.folder.join(side.file(step)));
        let (true, Some(digest)) = (
            states.iter().all(|state| state.exists()),
            digests.get(&step.0),
        ) else {
            tell!(
                "note: there is no checkpoint before step {step}: the run ended before, or lost records"
            );
            continue;
        };
        let folder = format!("checkpoint-{step}");
        let whole = run_dir.join(&folder);
        let cannot = |error: std::io::Error| {
            let shown = whole.display();
            Failure::infrastructure(format!("cannot write {shown}: {error}"))
        };
        let part = PartFolder::beside(&whole).map_err(cannot)?;
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
        part.complete(&whole).map_err(cannot)?;
        made.push(MadeCheckpoint {
            step: step.0,
            time_s: checkpoint.time_s,
            folder,
            check: None,
        });
    }
    Ok(made)
}

/// Names the file with the state of a side in the folder of a checkpoint.
pub fn state_file(side: Side) -> String {
    format!("{}.state", side.name())
}

/// Notes in the folder of a checkpoint how its check came out.
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

fn hash(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

//! Summary of a run: `summary.json` for programs and a table for the user.

mod recorded;
mod table;

use hil_config::port::counts::Counts;
use std::collections::BTreeMap;

use hil_config::evaluation::MetricValue;
use hil_config::plan::{Clock, Plan};
use hil_session::session::SessionInfo;
use serde::Serialize;
use shared_types::connection::Connection;
use shared_types::describe::PlantDescription;
use shared_types::ignored::Ignored;
use shared_types::origin::Build;
use shared_types::pacer::Streaks;
use shared_types::record::{BusCounts, Mark, Outcome, ValueChange};
use shared_types::time::{Rate, Step};

use crate::programs::binaries::{Binaries, Binary};
use crate::results::company::Company;
use crate::results::ended::{EndedRun, Started};
use crate::results::faults::Fault;
use crate::results::handover::{ActiveController, Laws, active_controllers};
use crate::results::held_commands::HeldCommand;
use crate::results::latency::grade::Graded;
use crate::results::latency::legs::Legs;
use crate::results::latency::spikes::Spike;
use crate::results::requirements::{Requirement, RunVerdict};
use crate::results::resumed::{MadeCheckpoint, Resumed};
use crate::results::settings::Realtime;
use crate::results::target::Target;
pub use table::{of_law, write_metrics};

/// Version of the summary.
const SCHEMA: u32 = 1;

/// Fact of a recording that lists the sides started by hand.
pub const BY_HAND: &str = "started_by_hand";

/// Summary of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    schema: u32,
    /// Name of the scenario.
    pub scenario: String,
    /// Values of the scenario changed on the command line, as `KEY=VALUE`.
    pub set: Vec<String>,
    /// Start time; null if unknown.
    pub started_utc: Option<String>,
    /// Name of the session.
    pub session: String,
    evidence: &'static str,
    /// Target; null if the controller was on this machine.
    pub target: Option<Target>,
    /// Verdict of the run.
    pub verdict: RunVerdict,
    /// Reason for an early end; null if the run reached its last step.
    pub reason: Option<String>,
    clock: &'static str,
    /// Overruns; null in lockstep.
    overruns: Option<Overruns>,
    /// Missed commands; null unless the run was in real time or repeats a real-time run.
    missed_commands: Option<Missed>,
    /// Commands that the plant held without a valid new value; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    held_commands: Vec<HeldCommand>,
    /// Counts of each frame of the bus; absent without one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    bus: Vec<BusCounts>,
    /// Counts of the port at the far end of which the controller is; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub port: Option<Counts>,
    /// Counts of the port at the far end of which the plant is; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant_port: Option<Counts>,
    rate_hz: f64,
    /// Number of recorded steps.
    pub steps: u64,
    sim_time_s: f64,
    /// Time that the run took.
    pub wall_time_s: f64,
    /// Simulated seconds per second of wall time.
    pub realtime_factor: f64,
    /// Digest of the records; null if there is none.
    pub digest: Option<String>,
    /// Metrics in the order of the scenario.
    pub metrics: Vec<Metric>,
    /// Requirements in the order of the scenario.
    pub requirements: Vec<Requirement>,
    faults: Vec<Fault>,
    latency_ns: Legs,
    /// Worst round trips, longest first.
    spikes: Vec<Spike>,
    /// Latest releases, latest first; empty in lockstep.
    late_releases: Vec<Spike>,
    /// Grade of the loop; null if nothing was exchanged.
    grade: Option<Graded>,
    realtime: Realtime,
    /// Contention; null if nothing was run here, or if a side was started by hand.
    pub company: Option<Company>,
    recording: Recording,
    rejected_frames: u64,
    /// Ignored messages and frames of controllers, by reason.
    ignored: Ignored,
    controller: Program,
    /// Sides started by hand.
    pub started_by_hand: Vec<String>,
    /// Signals of the law connected under other names and units; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    connections: Vec<Connection>,
    /// Values changed during the run.
    changes: Vec<ChangeAt>,
    /// Marks set by observers.
    marks: Vec<MarkAt>,
    /// All controllers, if the first one was lost or replaced.
    controllers: Vec<ActiveController>,
    plant: Program,
    seed: u64,
    #[serde(skip)]
    laws: Laws,
    /// Checkpoint from which the run continued; null if the run began at step 0.
    pub resumed: Option<Resumed>,
    /// Checkpoints made by the run.
    pub checkpoints: Vec<MadeCheckpoint>,
}

/// Steps that were due before the preceding step was done.
#[derive(Clone, Debug, Serialize)]
struct Overruns {
    policy: &'static str,
    #[serde(flatten)]
    steps: Missed,
}

/// Affected steps.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Missed {
    count: u64,
    longest_streak: u64,
    first_step: Option<u64>,
}

impl From<Streaks> for Missed {
    fn from(streaks: Streaks) -> Self {
        Self {
            count: streaks.count,
            longest_streak: streaks.longest,
            first_step: streaks.first_step,
        }
    }
}

/// Metric over a window.
#[derive(Clone, Debug, Serialize)]
pub struct Metric {
    /// Name of the metric.
    pub name: String,
    /// Window from begin to end, both included.
    pub window_s: [f64; 2],
    /// Value; null if no record of the window had one.
    pub value: Option<f64>,
    /// Unit of the value.
    pub unit: String,
    /// Number of records in the window that were skipped because they lacked the value.
    #[serde(skip_serializing_if = "is_zero")]
    pub skipped: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
const fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl From<&MetricValue> for Metric {
    fn from(metric: &MetricValue) -> Self {
        Self {
            name: metric.name.clone(),
            window_s: metric.window_s,
            value: metric.value.is_finite().then_some(metric.value),
            unit: metric.unit.clone(),
            skipped: metric.skipped,
        }
    }
}

#[derive(Clone, Debug, Serialize)]
struct Recording {
    file: Option<&'static str>,
    records: u64,
    /// Number of records covered by the digest; 0 without one.
    digested: u64,
    /// Number of records in the file: fewer if only a selection was recorded, or if writing failed.
    kept: u64,
    /// Reason why the file lacks the rest, if it could not be written.
    cut_short: Option<String>,
    lost: u64,
    /// Data not covered by checksums when the file was recovered; null if there is none.
    unvouched: Option<String>,
}

#[derive(Clone, Debug, Serialize)]
struct Program {
    binary: String,
    blake3: String,
    /// Hash of the program that runs the file, if the file is an FMU.
    #[serde(skip_serializing_if = "Option::is_none")]
    host_blake3: Option<String>,
    /// Source from which the binary was built; null if its build recorded none.
    build: Option<Build>,
    /// `port` for a plant behind a port; absent for any other program.
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<&'static str>,
    /// Media of the port that carry something simulated on this machine; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    simulated: Vec<String>,
}

/// Change of values and its time.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ChangeAt {
    #[serde(flatten)]
    change: ValueChange,
    at_s: f64,
    /// Keys of parameters that cannot be read back from the model, so that their change remains unconfirmed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    unconfirmed: Vec<String>,
}

/// Mark with its step and time.
#[derive(Clone, Debug, Serialize)]
pub struct MarkAt {
    #[serde(flatten)]
    mark: Mark,
    at_s: f64,
}

/// Adds times to marks.
pub fn marks(marks: &[Mark], rate: Rate) -> Vec<MarkAt> {
    let at = |mark: &Mark| MarkAt {
        mark: mark.clone(),
        at_s: rate.seconds(Step(mark.step)),
    };
    marks.iter().map(at).collect()
}

/// Origin of a run.
struct Origin {
    session: String,
    evidence: &'static str,
    target: Option<Target>,
    plant: Program,
    controller: Program,
}

impl Program {
    fn of(binary: &Binary) -> Self {
        Self {
            binary: binary.path.display().to_string(),
            blake3: binary.blake3.clone(),
            host_blake3: binary.host.as_ref().map(|host| host.blake3.clone()),
            build: binary.description.build.clone(),
            kind: None,
            simulated: Vec::new(),
        }
    }

    /// Adds the facts about the plant, which may be behind a port.
    fn with_plant(self, plant: Option<&PlantDescription>) -> Self {
        match plant.and_then(|plant| plant.port.as_ref()) {
            Some(port) => Self {
                kind: Some("port"),
                simulated: port.simulated.clone(),
                ..self
            },
            None => self,
        }
    }
}

impl Summary {
    /// Creates the summary of an ended run.
    #[must_use]
    pub fn new(
        plan: &Plan,
        binaries: &Binaries,
        session: &SessionInfo,
        evidence: &'static str,
        recorded_to: Option<&'static str>,
        realtime: Realtime,
        ended: &EndedRun,
    ) -> Self {
        let origin = Origin {
            session: session.name.clone(),
            evidence,
            target: Target::of(&binaries.controller),
            plant: Program::of(&binaries.plant)
                .with_plant(plan.whole_plant_among(&binaries.plant.description.plants)),
            controller: Program::of(&binaries.controller),
        };
        Self::of(plan, origin, recorded_to, realtime, ended)
    }

    fn of(
        plan: &Plan,
        origin: Origin,
        recorded_to: Option<&'static str>,
        realtime: Realtime,
        ended: &EndedRun,
    ) -> Self {
        let recorded = &ended.recorded;
        let end = recorded.end.as_ref();
        // A plant may report more than a run can have.
        let steps = (end
            .map(|end| end.steps)
            .filter(|steps| *steps <= plan.run.steps))
        .unwrap_or(recorded.records);
        let facts = ended.controllers.iter().flat_map(Started::facts);
        let first = ("controller_blake3".into(), origin.controller.blake3.clone());
        let facts: BTreeMap<String, String> = facts.chain([first]).collect();
        let sim_time_s = plan.run.rate.seconds(Step(steps));
        let past_s = plan.run.rate.seconds(Step(recorded.past_records));
        let wall_time_s = recorded.wall_time_s;
        let requirements: Vec<Requirement> = (recorded.requirements.iter())
            .map(Requirement::from)
            .collect();
        Self {
            schema: SCHEMA,
            scenario: plan.name.clone(),
            set: Vec::new(),
            started_utc: None,
            session: origin.session,
            evidence: origin.evidence,
            target: origin.target,
            verdict: match recorded.error {
                None => RunVerdict::of(ended.outcome, &requirements),
                Some(_) => RunVerdict::of(Outcome::Failed, &requirements),
            },
            reason: ended.reason.clone(),
            clock: plan.run.clock.name(),
            overruns: (end.filter(|_| plan.run.clock != Clock::Lockstep)).map(|end| Overruns {
                policy: plan.run.overrun.name(),
                steps: end.overruns.into(),
            }),
            missed_commands: end
                .filter(|end| plan.run.clock == Clock::Realtime || end.missed_commands.count > 0)
                .map(|end| end.missed_commands.into()),
            held_commands: recorded.held_commands.clone(),
            bus: end.map(|end| end.bus.clone()).unwrap_or_default(),
            port: None,
            plant_port: None,
            rate_hz: plan.run.rate.hz(),
            steps,
            sim_time_s,
            wall_time_s,
            realtime_factor: if wall_time_s > 0.0 {
                (sim_time_s - past_s) / wall_time_s
            } else {
                0.0
            },
            digest: recorded.digest.clone(),
            metrics: recorded.metrics.iter().map(Metric::from).collect(),
            requirements,
            faults: recorded.faults.faults(&plan.faults, plan.run.rate),
            latency_ns: recorded.latency.legs,
            spikes: recorded.latency.spikes.clone(),
            late_releases: recorded.latency.late_releases.clone(),
            grade: recorded.latency.grade,
            realtime,
            company: None,
            recording: Recording {
                file: recorded_to,
                records: recorded.records,
                digested: (recorded.digest.as_ref()).map_or(0, |_| recorded.records),
                kept: recorded.written,
                cut_short: recorded.cut_short.clone(),
                lost: recorded.lost,
                unvouched: None,
            },
            rejected_frames: end.map_or(0, |end| end.rejected_frames),
            ignored: end.map(|end| *end.ignored).unwrap_or_default(),
            controller: origin.controller,
            started_by_hand: Vec::new(),
            connections: plan.controller.connections.clone(),
            changes: (recorded.values.iter())
                .map(|change| ChangeAt {
                    change: change.clone(),
                    at_s: plan.run.rate.seconds(Step(change.step)),
                    unconfirmed: recorded.faults.unconfirmed_of(change),
                })
                .collect(),
            marks: marks(&recorded.marks, plan.run.rate),
            controllers: active_controllers(&ended.controllers, &recorded.changes, plan.run.rate),
            plant: origin.plant,
            seed: plan.run.seed,
            laws: Laws::of(&plan.controller.law, &recorded.changes, |name| {
                facts.get(name).cloned()
            }),
            resumed: None,
            checkpoints: Vec::new(),
        }
    }
}

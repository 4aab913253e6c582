//! A plant process with one plant for each false statement about its own run. Not a program of the workspace: the tests
//! of false statements give it to `hil run --plant-bin`.
//!
//! The run itself is correct; only the record stream is false.

#[macro_use]
#[path = "../shared/plant.rs"]
mod plant;
#[path = "../shared/position_and_force.rs"]
mod position_and_force;

use std::path::Path;
use std::process::ExitCode;

use hil_session::link::iceoryx::IceoryxLink;
use hil_session::program::{self, COMPLETED, Program};
use hil_session::session::SessionInfo;
use hil_session::stream::IceoryxSink;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use plant_process::engine::Engine;
use plant_process::faults::kinds;
use plant_process::job::{JOB_FILE, Job};
use plant_process::plant::PlantKind;
use plant_process::program::drive;
use shared_types::describe::Description;
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::link::LinkError;
use shared_types::lockstep::OnLoss;
use shared_types::pacer::Streaks;
use shared_types::record::{
    ControllerChange, ControllerFate, Event, FaultEffectSize, Outcome, RecordLayout, RunEnd,
};
use shared_types::side::Side;
use shared_types::stream::{Backpressure, RecordSink};
use shared_types::table::Empty;
use shared_types::time::Step;
use shared_types::wait::WaitLimit;

use position_and_force::{Force, Position};

/// Step whose record is false.
const WHEN: u64 = 500;
/// Number of a fault that does not exist.
const MADE_UP: u32 = 7;

/// A plant that does nothing.
struct Still;

plant!(
    Still,
    "honest",
    "Stands still.",
    Empty,
    |_| Self,
    |_| 0.0,
    |_| {}
);

/// The false statements, which are also names of plants.
const LIES: [&str; 20] = [
    "honest",
    // Of steps that there are.
    "runs-two-steps",
    "runs-no-step",
    "claims-all-steps",
    "claims-no-step",
    "claims-more-steps",
    "diverges-beyond-the-end",
    // Of records.
    "keeps-one-back",
    "keeps-the-last-back",
    "doubles-one",
    "swaps-two",
    "tells-another-time",
    // Of its controller.
    "has-no-controller",
    "has-no-link",
    "loses-it-against-the-plan",
    "gets-another",
    // Of what else there is to count.
    "misses-commands",
    "makes-up-a-fault",
    "writes-on-the-terminal",
    // Of what its records hold.
    "misnames",
];

/// A record stream that publishes something else than the engine passes to it.
struct LyingSink {
    sink: IceoryxSink,
    lie: String,
    /// A record that was held back.
    held: Option<Vec<u64>>,
    /// Place of the time in a record.
    time_place: usize,
}

impl RecordSink for LyingSink {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.time_place = layout.values_start() + layout.values();
        let mut layout = layout.clone();
        if self.lie == "misnames" {
            layout.truth[0].name = "position_m\nfloat64 other_m".into();
        }
        self.sink.open(&layout)
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        self.sink.has_room()
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        let step = words[0];
        match (self.lie.as_str(), step) {
            ("keeps-one-back", WHEN) => Ok(()),
            ("keeps-the-last-back", WHEN..) => Ok(()),
            ("doubles-one", WHEN) => {
                self.sink.record(words)?;
                self.sink.record(words)
            }
            ("swaps-two", WHEN) => {
                self.held = Some(words.to_vec());
                Ok(())
            }
            ("tells-another-time", WHEN) => {
                let mut words = words.to_vec();
                words[self.time_place] += 1;
                self.sink.record(&words)
            }
            ("loses-it-against-the-plan", WHEN) => {
                self.change(1, WHEN, lost())?;
                self.sink.record(words)
            }
            ("gets-another", WHEN) => {
                let law = "another".into();
                self.change(2, WHEN, ControllerFate::Joined { law })?;
                self.sink.record(words)
            }
            _ => {
                self.sink.record(words)?;
                match self.held.take() {
                    Some(held) => self.sink.record(&held),
                    None => Ok(()),
                }
            }
        }
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        let Event::End(end) = event else {
            return self.sink.event(event);
        };
        let end = end.clone();
        let told = match self.lie.as_str() {
            "claims-all-steps" => completed(RunEnd { steps: 1000, ..end }),
            "claims-no-step" => completed(RunEnd { steps: 0, ..end }),
            "claims-more-steps" => completed(RunEnd {
                steps: u64::MAX,
                ..end
            }),
            "diverges-beyond-the-end" => RunEnd {
                steps: u64::MAX,
                outcome: Outcome::Diverged,
                reason: Some("it flew away".into()),
                ..end
            },
            "misses-commands" => RunEnd {
                missed_commands: {
                    let mut missed = Streaks::default();
                    missed.note(Step(WHEN));
                    missed
                },
                ..end
            },
            "makes-up-a-fault" => RunEnd {
                effects: vec![made_up()],
                ..end
            },
            "writes-on-the-terminal" => RunEnd {
                outcome: Outcome::Failed,
                reason: Some("all is \u{1b}[32mwell\u{7}".into()),
                ..end
            },
            _ => end,
        };
        self.sink.event(&Event::End(told))
    }
}

impl LyingSink {
    fn change(&mut self, epoch: u32, step: u64, change: ControllerFate) -> Result<(), LinkError> {
        self.sink.event(&Event::Controller(ControllerChange {
            epoch,
            step,
            change,
        }))
    }
}

fn completed(end: RunEnd) -> RunEnd {
    RunEnd {
        outcome: Outcome::Completed,
        reason: None,
        ..end
    }
}

fn lost() -> ControllerFate {
    ControllerFate::Lost {
        reason: "it went away".into(),
        policy: OnLoss::Hold,
    }
}

fn made_up() -> FaultEffectSize {
    FaultEffectSize {
        id: MADE_UP,
        effect: 0,
        kind: "bias".into(),
        target: "measured.position_m".into(),
        parameter: "position_m".into(),
        step: Some(1),
        ended_step: None,
        acted_steps: 1,
        max_effect: 1.0,
        unit: "m".into(),
    }
}

/// Publishes all records and the end of a run without a controller.
fn alone(mut sink: LyingSink, job: &Job, lost_at: u64) -> Result<(), LinkError> {
    let plant = PlantKind::of::<Still>().description;
    let command = SignalTable::of(SignalKind::Command, &plant.commands);
    let layout = RecordLayout::of(&plant, vec![], &command);
    sink.open(&layout)?;
    let mut words = vec![0; layout.words()];
    for step in 0..=job.run.steps {
        words[0] = step;
        words[sink.time_place] = job.run.rate.nanoseconds(Step(step));
        while !sink.has_room()? {
            std::thread::yield_now();
        }
        if step == 0 {
            sink.change(1, lost_at, lost())?;
        }
        sink.record(&words)?;
    }
    sink.event(&Event::End(RunEnd::new(job.run.steps, Outcome::Completed)))
}

struct Liar;

impl Program for Liar {
    fn side(&self) -> Side {
        Side::Plant
    }

    fn description(&self) -> Description {
        let mut description = Description::new("lying-plant", "0.1.0");
        let named = |lie: &str| {
            let mut plant = PlantKind::of::<Still>().description;
            plant.name = lie.into();
            plant
        };
        description.plants = LIES.map(named).into();
        description
    }

    fn check(&self, _: &Path) -> Result<(), String> {
        Ok(())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let mut job: Job = program::read_job(&session.folder.join(JOB_FILE))?;
        let lie = std::mem::take(&mut job.plant.model);
        let sink = IceoryxSink::create(session, Backpressure::Always).map_err(|e| e.to_string())?;
        let sink = LyingSink {
            sink,
            held: None,
            time_place: 0,
            lie,
        };
        if sink.lie == "has-no-link" {
            alone(sink, &job, 0).map_err(|e| e.to_string())?;
            return Ok(COMPLETED);
        }
        let link = IceoryxLink::create(session).map_err(|e| e.to_string())?;
        match sink.lie.as_str() {
            "has-no-controller" => {
                alone(sink, &job, WHEN).map_err(|e| e.to_string())?;
                return Ok(COMPLETED);
            }
            "runs-two-steps" | "claims-all-steps" => job.run.steps = 2,
            "runs-no-step" => job.run.steps = 0,
            _ => {}
        }
        let waiter = Waiter::new(WaitLimit::from_seconds(job.wait_limit_s));
        let kind = PlantKind::of::<Still>();
        let engine = Engine::new(&kind, &kinds::all(), job, link, sink);
        let mut engine = engine.map_err(|e| e.to_string())?;
        drive(&mut engine, waiter, supervision).map_err(|e| e.to_string())?;
        Ok(COMPLETED)
    }
}

fn main() -> ExitCode {
    program::run(&Liar)
}

//! The engine against a controller's end of a link that the test drives directly.

use hil_config::plan::{
    FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Move, PlantPlan, Profile, Run,
    Stimulus, Trigger, Waveform,
};
use shared_types::describe::{Operation, Settings};
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::{Control, Hello};
use shared_types::link::FrameSpec;
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::record::Event;
use shared_types::stream::in_process::{InProcessSink, InProcessSource};
use shared_types::stream::{Item, RecordSource};
use shared_types::table::Table;
use shared_types::time::{Interval, Rate};

use super::*;
use crate::faults::kinds;
use crate::plant::Plant as PlantTrait;

mod endings;
mod failures;
mod validity;

shared_types::table! {
    /// Parameters.
    struct Parameters {
        /// Displacement per newton.
        gain_m_per_n: "m/N" = 1.0 in 0.0..=1e9 [faultable],
    }
}

shared_types::table! {
    /// Truth.
    struct Truth {
        /// Position.
        position_m: "m" in (-100.0)..=100.0,
        /// Applied command.
        applied_n: "N",
    }
}

shared_types::table! {
    /// Measured.
    struct Measured {
        /// Position.
        position_m: "m",
    }
}

shared_types::table! {
    /// Command.
    struct Command {
        /// Force.
        force_n: "N",
    }
}

/// Moves by gain times force at each step.
struct Mover {
    gain_m_per_n: f64,
    position_m: f64,
}

impl PlantTrait for Mover {
    const NAME: &'static str = "mover";
    const SUMMARY: &'static str = "Moves by gain times force at each step.";
    type Parameters = Parameters;
    type Truth = Truth;
    type Measured = Measured;
    type Command = Command;

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        Ok(Self {
            gain_m_per_n: parameters.gain_m_per_n,
            position_m: 0.0,
        })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.gain_m_per_n = parameters.gain_m_per_n;
    }

    fn measure(&self) -> Measured {
        Measured {
            position_m: self.position_m,
        }
    }

    fn truth(&self, _: f64, command: &Command) -> Truth {
        Truth {
            position_m: self.position_m,
            applied_n: command.force_n,
        }
    }

    fn advance(&mut self, _: &Interval, command: &Command) {
        self.position_m += self.gain_m_per_n * command.force_n;
    }
}

pub(super) fn kind() -> PlantKind {
    PlantKind::of::<Mover>()
}

pub(super) fn job(steps: u64) -> Job {
    let effect = FaultEffect {
        target: "mover".into(),
        skew_steps: 0,
        profile: Profile::Step,
        action: FaultAction::Move {
            sizes: Settings::default(),
            moves: vec![Move {
                parameter: "gain_m_per_n".into(),
                operation: Operation::Add,
                by: 1.0,
            }],
        },
    };
    let waveform = Waveform::Ramp {
        at_s: 0.0,
        duration_s: 1.0,
        start: 0.0,
        end: 1.0,
    };
    let run = Run {
        rate: Rate::new(10.0).expect("legal"),
        steps,
        seed: 1,
        clock: Clock::Lockstep,
        overrun: OverrunPolicy::CatchUp,
        deadline: 0.8,
        on_controller_loss: OnLoss::Abort,
    };
    let plant = PlantPlan {
        model: "mover".into(),
        substeps: 1,
        parameters: Settings::of(&Parameters::default()),
        limits: vec![],
        safe_command: Settings::default(),
        inputs: Settings::default(),
    };
    Job {
        stimuli: vec![Stimulus {
            aliases: Vec::new(),
            target: "position_m".into(),
            unit: "m".into(),
            range: Stimulus::any_range(),
            is_whole: false,
            waveform,
        }],
        faults: vec![FaultEvent {
            id: 1,
            kind: "gain".into(),
            name: None,
            source: FaultSource::Scenario,
            trigger: Trigger::Step {
                step: Step(2),
                at_s: 0.2,
            },
            end: FaultEnd::default(),
            effects: vec![effect],
        }],
        ..Job::new(5, run, plant, 1.0)
    }
}

type TestEngine = Engine<InProcessLink, InProcessSink>;

/// Creates an engine, the controller's end of its link, and a recorder.
fn started(kind: &PlantKind, job: Job) -> (TestEngine, InProcessLink, InProcessSource) {
    let (link, controller) = pair();
    let (sink, source) = shared_types::stream::in_process::pair();
    let engine = Engine::new(kind, &kinds::all(), job, link, sink).expect("starts");
    (engine, controller, source)
}

/// Sends a hello and returns the plant's answer.
fn greet<L: Link>(
    engine: &mut Engine<L, InProcessSink>,
    controller: &mut InProcessLink,
    hello: Hello,
) -> Control {
    let hello = Control::Hello(hello).to_bytes();
    controller.send_control(&hello).expect("sends");
    engine.poll().expect("polls");
    let answer = controller.receive_control().expect("polls");
    Control::from_bytes(&answer.expect("an answer")).expect("a message")
}

/// Opens the frames of a welcome, with so many values a command, and reports readiness.
fn join(controller: &mut InProcessLink, answer: Control, outgoing: usize) {
    let Control::Welcome(welcome) = answer else {
        panic!("no welcome: {answer:?}");
    };
    let spec = FrameSpec {
        identity: welcome.frame_identity(),
        outgoing,
        incoming: 3,
    };
    controller.open_frames(&spec).expect("opens");
    let ready = Control::Ready { epoch: 1 }.to_bytes();
    controller.send_control(&ready).expect("sends");
}

/// Creates an engine, a controller that has opened its frames, and a recorder.
fn greeted(job: Job) -> (TestEngine, InProcessLink, InProcessSource) {
    greeted_by(&kind(), job)
}

/// Creates the same with a plant that has the tables of [`Mover`].
fn greeted_by(kind: &PlantKind, job: Job) -> (TestEngine, InProcessLink, InProcessSource) {
    let (mut engine, mut controller, source) = started(kind, job);
    let hello = Hello {
        measured: Measured::fields(),
        // In another order than the plant's, with a surplus one.
        commands: Some(vec![
            Field::signal("spare_a", "A", "x"),
            Command::fields().remove(0),
        ]),
        internals: vec![Field::signal("seen_m", "m", "x")],
        ..Hello::new(5, "test")
    };
    let answer = greet(&mut engine, &mut controller, hello);
    join(&mut controller, answer, 3);
    engine.poll().expect("polls");
    (engine, controller, source)
}

/// Polls until the plant waits, and returns its frame.
fn frame(engine: &mut TestEngine, controller: &mut InProcessLink) -> (Header, [f64; 3]) {
    while engine.poll().expect("polls") == Progress::Busy {}
    let mut sample = [0.0; 3];
    let header = controller.receive(&mut sample).expect("polls");
    (header.expect("a frame"), sample)
}

/// Answers every sample with this force until the plant sends another kind of frame, and returns that header.
fn run(engine: &mut TestEngine, controller: &mut InProcessLink, force_n: f64) -> Header {
    loop {
        let (header, sample) = frame(engine, controller);
        if header.kind() != Some(FrameKind::Sample) {
            return header;
        }
        let answer = Header::new(FrameKind::Command, Step(header.step));
        let command = [7.0, force_n, sample[0]];
        controller.send(&answer, &command).expect("sends");
    }
}

/// Returns everything published: values of records, texts of events.
fn published(source: &mut InProcessSource) -> (Vec<Vec<f64>>, Vec<Event>) {
    let (mut records, mut events) = (Vec::new(), Vec::new());
    let mut take = |item: Item<'_>| match item {
        // Step, two words of validity, then: position, applied; measured; reference and slope; command; applied;
        // internal.
        Item::Record(words) => {
            let values = words[3..11].iter().map(|word| f64::from_bits(*word));
            records.push(std::iter::once(words[0] as f64).chain(values).collect());
        }
        Item::Event(event) => events.push(event),
        other => panic!("{other:?}"),
    };
    source.drain(&mut take).expect("drains");
    (records, events)
}

#[test]
fn a_run_records_every_step_and_the_final_truth() {
    let (mut engine, mut controller, mut source) = greeted(job(3));
    let end = run(&mut engine, &mut controller, 1.0);
    assert_eq!((end.kind(), end.step), (Some(FrameKind::End), 3));
    controller
        .send(&Header::new(FrameKind::EndConfirmed, Step(3)), &[])
        .expect("sends");
    while engine.poll().expect("polls") != Progress::Over {}
    let (records, events) = published(&mut source);
    // The gain is 1 until the fault adds 1 to it from step 2 on.
    assert_eq!(records[0], [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0]);
    assert_eq!(records[1], [1.0, 1.0, 1.0, 1.0, 0.1, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(records[2][..2], [2.0, 2.0]);
    assert_eq!(records[3][..2], [3.0, 4.0], "moved by 2 under the fault");
    assert!(
        records[3][6..].iter().all(|value| value.is_nan()),
        "no command answers record N"
    );
    let [Event::Fault(fault), Event::End(run_end)] = &events[..] else {
        panic!("{events:?}");
    };
    assert_eq!(
        (fault.step, run_end.steps, run_end.outcome),
        (2, 3, Outcome::Completed)
    );
    assert_eq!(run_end.effects[0].max_effect, 1.0);
}

#[test]
fn a_fault_event_is_published_between_the_records_around_it() {
    let (mut engine, mut controller, mut source) = greeted(job(4));
    run(&mut engine, &mut controller, 1.0);
    let mut order = Vec::new();
    let mut take = |item: Item<'_>| {
        order.push(match item {
            Item::Record(words) => format!("{}", words[0]),
            Item::Event(Event::Fault(_)) => "fault".into(),
            other => panic!("{other:?}"),
        });
    };
    source.drain(&mut take).expect("drains");
    assert_eq!(order, ["0", "1", "fault", "2", "3", "4"]);
}

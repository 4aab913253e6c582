//! The engine against a controller's end of a link that the test holds in its own hands.

use std::cell::RefCell;
use std::rc::Rc;

use hil_config::plan::{
    FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Limit, Move, PlantPlan, Profile,
    Run, Stimulus, Trigger, Waveform,
};
use shared_types::checkpoint::Checkpoints;
use shared_types::describe::{Operation, PROTOCOL, Settings};
use shared_types::hello::Hello;
use shared_types::ignored::Ignored;
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::link::{FrameSpec, Peer};
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::record::Event;
use shared_types::stream::in_process::{InProcessSink, InProcessSource};
use shared_types::stream::{Item, RecordSource};
use shared_types::supervision::Supervision;
use shared_types::table::Table;
use shared_types::time::{Interval, Rate};
use shared_types::wait::{WaitLimit, Waiter};

use super::*;
use crate::faults::kinds;
use crate::plant::Plant as PlantTrait;

shared_types::table! {
    /// Parameters.
    struct Parameters {
        /// Speed for each newton.
        gain_m_per_n: "m/N" = 1.0 in 0.0..=1e9 [faultable],
    }
}

shared_types::table! {
    /// Truth.
    struct Truth {
        /// Position.
        position_m: "m" in (-100.0)..=100.0,
        /// The command that it meets.
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
    Job {
        protocol: PROTOCOL,
        session: 5,
        run: Run {
            rate: Rate::new(10.0).expect("legal"),
            steps,
            seed: 1,
            clock: Clock::Lockstep,
            overrun: OverrunPolicy::CatchUp,
            deadline: 0.8,
            on_controller_loss: OnLoss::Abort,
        },
        plant: PlantPlan {
            model: "mover".into(),
            substeps: 1,
            parameters: Settings::of(&Parameters::default()),
            limits: vec![],
            safe_command: Settings::default(),
        },
        stimuli: vec![Stimulus {
            target: "position_m".into(),
            unit: "m".into(),
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
        derived: vec![],
        missed: vec![],
        law: None,
        pause_at_s: None,
        observed: true,
        checkpoints: Checkpoints::default(),
        realtime: shared_types::realtime::Settings::default(),
        wait_limit_s: 1.0,
    }
}

type TestEngine = Engine<InProcessLink, InProcessSink>;

/// An engine, a controller that has opened its frames, and a recorder.
fn greeted(job: Job) -> (TestEngine, InProcessLink, InProcessSource) {
    let (link, mut controller) = pair();
    let (sink, source) = shared_types::stream::in_process::pair();
    let mut engine = Engine::new(&kind(), &kinds::all(), job, link, sink).expect("starts");
    let hello = Hello {
        protocol: PROTOCOL,
        session: 5,
        law: "test".into(),
        measured: Measured::fields(),
        reference: vec![],
        // Another order than the plant's, and one too many.
        commands: Some(vec![
            Field::signal("spare_a", "A", "x"),
            Command::fields().remove(0),
        ]),
        internals: vec![Field::signal("seen_m", "m", "x")],
    };
    controller
        .send_control(&Control::Hello(hello).to_bytes())
        .expect("sends");
    engine.poll().expect("polls");
    let bytes = controller
        .receive_control()
        .expect("polls")
        .expect("an answer");
    let Ok(Control::Welcome(welcome)) = Control::from_bytes(&bytes) else {
        panic!("no welcome");
    };
    let spec = FrameSpec {
        seal: welcome.seal(),
        outgoing: 3,
        incoming: 3,
    };
    controller.open_frames(&spec).expect("opens");
    controller
        .send_control(&Control::Ready { epoch: 1 }.to_bytes())
        .expect("sends");
    engine.poll().expect("polls");
    (engine, controller, source)
}

/// Answers every sample with this force until the plant sends something else; gives that header.
fn run(engine: &mut TestEngine, controller: &mut InProcessLink, force_n: f64) -> Header {
    let mut sample = [0.0; 3];
    loop {
        while engine.poll().expect("polls") == Progress::Busy {}
        let header = controller
            .receive(&mut sample)
            .expect("polls")
            .expect("a frame");
        if header.kind() != Some(FrameKind::Sample) {
            return header;
        }
        let answer = Header::new(FrameKind::Command, Step(header.step));
        controller
            .send(&answer, &[7.0, force_n, sample[0]])
            .expect("sends");
    }
}

/// All that was published: values of records, texts of events.
fn published(source: &mut InProcessSource) -> (Vec<Vec<f64>>, Vec<Event>) {
    let (mut records, mut events) = (Vec::new(), Vec::new());
    let mut take = |item: Item<'_>| match item {
        // step, two words of validity, then: position, applied; measured; reference and slope;
        // command; applied; internal
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
fn a_fault_event_stands_between_the_records_around_it() {
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

#[test]
fn a_diverged_plant_ends_at_the_step_with_the_signal_named() {
    let limits = vec![Limit {
        signal: "position_m".into(),
        min: -1.5,
        max: 1.5,
    }];
    let job = job(9);
    let job = Job {
        plant: PlantPlan {
            limits,
            ..job.plant
        },
        ..job
    };
    let (mut engine, mut controller, mut source) = greeted(job);
    let end = run(&mut engine, &mut controller, 1.0);
    assert_eq!(end.kind(), Some(FrameKind::Abort));
    assert_eq!(AbortCode::from_wire(end.directive), AbortCode::Diverged);
    let run_end = engine.end().expect("over");
    let told = "plant diverged at step 2 (0.2 s): position_m = 2 m is outside -1.5 to 1.5 m";
    assert_eq!(
        (run_end.outcome, run_end.reason.as_deref()),
        (Outcome::Diverged, Some(told))
    );
    let (records, _) = published(&mut source);
    assert_eq!(
        records.last().expect("some")[..2],
        [2.0, 2.0],
        "its last record shows it"
    );
}

#[test]
fn a_plant_that_leaves_the_numbers_is_stopped_before_it_sends_one() {
    let (mut engine, mut controller, mut source) = greeted(job(9));
    let end = run(&mut engine, &mut controller, f64::MAX);
    assert_eq!(AbortCode::from_wire(end.directive), AbortCode::Diverged);
    let (records, _) = published(&mut source);
    assert!(records.iter().flatten().all(|value| value.is_finite()));
}

#[test]
fn a_command_that_is_no_number_ends_the_run_and_is_named() {
    for force_n in [f64::NAN, f64::INFINITY] {
        let (mut engine, mut controller, mut source) = greeted(job(9));
        let end = run(&mut engine, &mut controller, force_n);
        assert_eq!(AbortCode::from_wire(end.directive), AbortCode::NotANumber);
        let reason = engine.end().expect("over").reason.clone().expect("told");
        assert!(reason.contains("command of step 0: force_n"), "{reason}");
        assert_eq!(published(&mut source).0.len(), 0);
    }
}

#[test]
fn a_stop_tells_the_controller_and_keeps_what_was_recorded() {
    let (mut engine, mut controller, mut source) = greeted(job(9));
    let mut sample = [0.0; 3];
    for step in 0..2 {
        while engine.poll().expect("polls") == Progress::Busy {}
        controller
            .receive(&mut sample)
            .expect("polls")
            .expect("a sample");
        let answer = Header::new(FrameKind::Command, Step(step));
        controller.send(&answer, &[0.0; 3]).expect("sends");
        engine.poll().expect("polls");
    }
    engine.interrupt(&PlantEvent::Stop).expect("stops");
    let abort = controller
        .receive(&mut sample)
        .expect("polls")
        .expect("a frame");
    assert_eq!(AbortCode::from_wire(abort.directive), AbortCode::Stopped);
    assert_eq!(engine.poll().expect("polls"), Progress::Over);
    let (records, events) = published(&mut source);
    assert_eq!(records.len(), 2);
    assert!(matches!(&events[..], [Event::End(end)] if end.outcome == Outcome::Stopped));
}

#[test]
fn a_controller_that_does_not_fit_is_refused_with_the_reason() {
    let (link, mut controller) = pair();
    let (sink, _source) = shared_types::stream::in_process::pair();
    let mut engine = Engine::new(&kind(), &kinds::all(), job(3), link, sink).expect("starts");
    let hello = Hello {
        protocol: PROTOCOL,
        session: 5,
        law: "test".into(),
        measured: vec![Field::signal("posiition_m", "m", "x")],
        reference: vec![],
        commands: None,
        internals: vec![],
    };
    controller
        .send_control(&Control::Hello(hello).to_bytes())
        .expect("sends");
    engine.poll().expect("polls");
    let bytes = controller
        .receive_control()
        .expect("polls")
        .expect("an answer");
    let Ok(Control::Refusal { reason }) = Control::from_bytes(&bytes) else {
        panic!("no refusal");
    };
    assert!(
        reason.contains("no signal `posiition_m`, nearest: position_m"),
        "{reason}"
    );
    assert_eq!(engine.end().map(|end| end.outcome), Some(Outcome::Failed));
}

/// A link whose other end confirms and ends just after the plant looked and found nothing.
struct LastWord {
    inner: InProcessLink,
    controller: Rc<RefCell<InProcessLink>>,
    supervision: Supervision,
}

impl Link for LastWord {
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.inner.send_control(message)
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        self.inner.receive_control()
    }

    fn expect(&mut self, epoch: u32) -> Result<(), LinkError> {
        self.inner.expect(epoch)
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        self.inner.peer()
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        self.inner.open_frames(spec)
    }

    fn take_over(&mut self) {
        self.inner.take_over();
    }

    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        self.inner.send(header, values)
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let got = self.inner.receive(values)?;
        if got.is_none() {
            let confirmed = Header::new(FrameKind::EndConfirmed, Step(0));
            self.controller.borrow_mut().send(&confirmed, &[])?;
            self.supervision.peer_gone(1);
        }
        Ok(got)
    }

    fn rejected(&self) -> Ignored {
        self.inner.rejected()
    }
}

#[test]
fn what_a_controller_confirmed_before_it_ended_counts() {
    let (inner, controller) = pair();
    let controller = Rc::new(RefCell::new(controller));
    let supervision = Supervision::new();
    let link = LastWord {
        inner,
        controller: Rc::clone(&controller),
        supervision: supervision.clone(),
    };
    let (sink, _source) = shared_types::stream::in_process::pair();
    let mut engine = Engine::new(&kind(), &kinds::all(), job(0), link, sink).expect("starts");
    let hello = Hello {
        protocol: PROTOCOL,
        session: 5,
        law: "test".into(),
        measured: vec![],
        reference: vec![],
        commands: None,
        internals: vec![],
    };
    let say = |message: Control| {
        let sent = controller.borrow_mut().send_control(&message.to_bytes());
        sent.expect("sends");
    };
    say(Control::Hello(hello));
    engine.poll().expect("polls");
    let answer = controller.borrow_mut().receive_control();
    let bytes = answer.expect("polls").expect("an answer");
    let Ok(Control::Welcome(welcome)) = Control::from_bytes(&bytes) else {
        panic!("no welcome");
    };
    let spec = FrameSpec {
        seal: welcome.seal(),
        outgoing: 1,
        incoming: 3,
    };
    controller.borrow_mut().open_frames(&spec).expect("opens");
    say(Control::Ready { epoch: 1 });
    let limit = WaitLimit::from_seconds(60.0);
    crate::program::drive(&mut engine, Waiter::new(limit), &supervision).expect("drives");
    let end = engine.end().expect("over");
    assert_eq!(
        (end.outcome, end.reason.as_deref()),
        (Outcome::Completed, None)
    );
}

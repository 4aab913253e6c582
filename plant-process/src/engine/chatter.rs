//! The engine against controllers that never fall silent: a repeated message is not an answer.

use std::collections::VecDeque;
use std::sync::mpsc;
use std::time::Duration;

use hil_config::plan::Run;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::{Control, Hello};
use shared_types::ignored::{Ignored, Reason};
use shared_types::link::{FrameSpec, Peer};
use shared_types::lockstep::OnLoss;
use shared_types::record::{ControllerFate, Event};
use shared_types::stream::in_process::{InProcessSink, InProcessSource};
use shared_types::stream::{Item, RecordSource};
use shared_types::wait::WaitLimit;

use super::tests::{job, kind};
use super::*;
use crate::faults::kinds;

/// Much longer than any limit here, to allow for a busy machine.
const WATCHDOG: Duration = Duration::from_secs(20);
pub(super) const WAIT_LIMIT_S: f64 = 0.1;

/// Message that a controller repeats at every poll, after the messages that it must send.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Repeats {
    Nothing,
    Hello,
    Welcome,
    Command(Step),
    /// The same command with other values.
    OtherCommand(Step),
}

/// The plant's end of a link to a controller that answers some samples and then repeats itself.
pub(super) struct Parrot {
    controls: VecDeque<Control>,
    repeats: Repeats,
    /// Number of samples that the parrot answers in each epoch.
    answers: u64,
    identity: Option<shared_types::frame::FrameIdentity>,
    welcome: Option<Control>,
    sequence: u64,
    /// Sample to answer.
    due: Option<Step>,
}

impl Parrot {
    pub(super) fn new(answers: u64, repeats: Repeats) -> Self {
        Self {
            controls: VecDeque::from([Control::Hello(hello()), Control::Ready { epoch: 1 }]),
            repeats,
            answers,
            identity: None,
            welcome: None,
            sequence: 0,
            due: None,
        }
    }
}

fn hello() -> Hello {
    Hello::new(5, "parrot")
}

impl Link for Parrot {
    fn send_control(&mut self, message: &[u8]) -> Result<(), LinkError> {
        self.welcome = Control::from_bytes(message).ok();
        Ok(())
    }

    fn tell(&mut self, _: &[u8]) -> Result<(), LinkError> {
        Ok(())
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        let repeated = match self.repeats {
            Repeats::Hello => Some(Control::Hello(hello())),
            Repeats::Welcome => self.welcome.clone(),
            _ => None,
        };
        let next = self.controls.pop_front().or(repeated);
        Ok(next.map(|message| message.to_bytes()))
    }

    fn expect(&mut self, epoch: u32) -> Result<(), LinkError> {
        if self.repeats != Repeats::Hello {
            self.controls = VecDeque::from([Control::Hello(hello()), Control::Ready { epoch }]);
        }
        Ok(())
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        Ok(Peer::Launched)
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        self.identity = Some(spec.identity);
        Ok(())
    }

    fn take_over(&mut self) {}

    fn send(&mut self, header: &Header, _: &[f64]) -> Result<(), LinkError> {
        if header.kind() == Some(FrameKind::Sample) && header.step < self.answers {
            self.due = Some(Step(header.step));
        }
        Ok(())
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let (step, value) = match (self.due.take(), self.repeats) {
            // Keeps the plant within its range.
            (Some(sample), _) if sample.0 >= 10 => (sample, 0.0),
            (Some(sample), _) => (sample, sample.0 as f64),
            (None, Repeats::Command(step)) => (step, step.0 as f64),
            (None, Repeats::OtherCommand(step)) => (step, step.0 as f64 + 0.5),
            (None, _) => return Ok(None),
        };
        self.sequence += 1;
        values.fill(value);
        let identity = self.identity.ok_or(LinkError::NotOpen)?;
        Ok(Some(Header {
            epoch: identity.epoch,
            sequence: self.sequence,
            ..Header::new(FrameKind::Command, step)
        }))
    }

    fn rejected(&self) -> Ignored {
        Ignored::default()
    }
}

type ParrotEngine = Engine<Parrot, InProcessSink>;

/// Creates an engine with a short limit.
pub(super) fn engine_with<S: RecordSink>(job: Job, parrot: Parrot, sink: S) -> Engine<Parrot, S> {
    let job = Job {
        wait_limit_s: WAIT_LIMIT_S,
        ..job
    };
    let engine = Engine::new(&kind(), &kinds::all(), job, parrot, sink);
    engine.expect("starts")
}

fn engine(job: Job, parrot: Parrot) -> (ParrotEngine, InProcessSource) {
    let (sink, source) = shared_types::stream::in_process::pair();
    (engine_with(job, parrot, sink), source)
}

/// Drives a run to its end, or stops it if it does not end; returns the end, the forces applied to the plant, and the
/// reasons for lost controllers.
fn ends(
    (mut engine, mut source): (ParrotEngine, InProcessSource),
) -> (RunEnd, Vec<f64>, Vec<String>) {
    let supervision = Supervision::new();
    let (over, is_over) = mpsc::channel::<()>();
    let watched = supervision.clone();
    let watchdog = std::thread::spawn(move || {
        if is_over.recv_timeout(WATCHDOG) == Err(mpsc::RecvTimeoutError::Timeout) {
            watched.stop("the plant does not end");
        }
    });
    let waiter = Waiter::new(WaitLimit::from_seconds(WAIT_LIMIT_S));
    crate::program::drive(&mut engine, waiter, &supervision).expect("drives");
    drop(over);
    watchdog.join().expect("ends");
    let (mut applied_n, mut lost) = (Vec::new(), Vec::new());
    let mut take = |item: Item<'_>| match item {
        // Step, two words of validity, position, applied force.
        Item::Record(words) => applied_n.push(f64::from_bits(words[4])),
        Item::Event(Event::Controller(told)) => {
            if let ControllerFate::Lost { reason, .. } = told.change {
                lost.push(reason);
            }
        }
        Item::Event(_) => {}
        other => panic!("{other:?}"),
    };
    source.drain(&mut take).expect("drains");
    (engine.end().expect("over").clone(), applied_n, lost)
}

pub(super) fn job_of(steps: u64, on_controller_loss: OnLoss, clock: Clock) -> Job {
    let job = job(steps);
    Job {
        faults: vec![],
        run: Run {
            on_controller_loss,
            clock,
            ..job.run
        },
        ..job
    }
}

#[test]
fn an_endlessly_repeated_old_answer_does_not_extend_the_limit() {
    let late = "controller did not answer step 3 within 0.1 s";
    for policy in [OnLoss::Abort, OnLoss::Hold, OnLoss::SafeCommand] {
        let parrot = Parrot::new(3, Repeats::Command(Step(0)));
        let (end, _, lost) = ends(engine(job_of(9, policy, Clock::Lockstep), parrot));
        assert!(end.ignored.of(Reason::Repeated) > 1, "{:?}", end.ignored);
        if policy == OnLoss::Abort {
            assert_eq!(
                (end.outcome, end.reason.as_deref()),
                (Outcome::Failed, Some(late))
            );
        } else {
            assert_eq!((end.outcome, end.steps), (Outcome::Completed, 9));
            assert_eq!(lost, [late]);
        }
    }
}

#[test]
fn an_old_answer_does_not_extend_the_limit_of_the_end() {
    let parrot = Parrot::new(9, Repeats::Command(Step(8)));
    let job = job_of(9, OnLoss::Abort, Clock::Lockstep);
    let (end, _, _) = ends(engine(job, parrot));
    let late = "controller did not confirm the end after 9 steps within 0.1 s";
    assert_eq!(end.reason.as_deref(), Some(late));
}

#[test]
fn fruitless_messages_do_not_extend_the_limit_of_hello() {
    for repeats in [Repeats::Hello, Repeats::Welcome] {
        let mut parrot = Parrot::new(0, repeats);
        parrot.controls.pop_back();
        let job = job_of(9, OnLoss::Abort, Clock::Lockstep);
        let (end, _, _) = ends(engine(job, parrot));
        assert!(end.ignored.of(Reason::OutOfTurn) > 1, "{:?}", end.ignored);
        let late = "controller did not open its frames within 0.1 s";
        assert_eq!(end.reason.as_deref(), Some(late));
    }
}

#[test]
fn a_chatty_candidate_does_not_extend_the_limit_of_the_active_controller() {
    // With the candidate's limit alone, the active controller would time out no sooner.
    let parrot = Parrot::new(3, Repeats::Hello);
    let (mut engine, _source) = engine(job_of(9, OnLoss::Abort, Clock::Lockstep), parrot);
    while engine.is_greeting() || engine.side.at() < Step(3) || engine.side.unreleased().is_some() {
        engine.poll().expect("polls");
    }
    engine.expect(2).expect("announces");
    for _ in 0..100 {
        let progress = engine.poll().expect("polls");
        assert_eq!(progress, Progress::Controller, "the next one only chats");
    }
}

#[test]
fn a_chatty_candidate_does_not_delay_the_steps() {
    let parrot = Parrot::new(u64::MAX, Repeats::Hello);
    let job = job_of(9, OnLoss::Abort, Clock::Lockstep);
    let (mut engine, _source) = engine(job, parrot);
    while engine.is_greeting() {
        engine.poll().expect("polls");
    }
    engine.expect(2).expect("announces");
    for _ in 0..100 {
        engine.poll().expect("polls");
    }
    assert_eq!(engine.executed, 9);
}

#[test]
fn in_real_time_an_old_answer_neither_counts_nor_replaces_a_newer_one() {
    // A step takes as long as the limit, which ends at the second step without its command.
    let parrot = Parrot::new(3, Repeats::Command(Step(1)));
    let job = job_of(9, OnLoss::Hold, Clock::Realtime);
    let (end, applied_n, lost) = ends(engine(job, parrot));
    assert_eq!((end.outcome, end.steps), (Outcome::Completed, 9));
    let expected_n = [0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0];
    assert_eq!(applied_n[..9], expected_n);
    assert!(
        matches!(&lost[..], [one] if one.starts_with("controller did not answer step ")),
        "{lost:?}"
    );
}

#[test]
fn a_controller_lost_during_a_hold_is_lost_when_the_run_resumes() {
    let job = Job {
        pause_at_s: Some(0.2),
        ..job_of(9, OnLoss::WaitForRestart, Clock::Lockstep)
    };
    let (mut engine, _source) = engine(job, Parrot::new(3, Repeats::Hello));
    let is_held = (0..1000).any(|_| engine.poll().expect("polls") == Progress::Held);
    assert!(is_held, "it never came to its hold");
    std::thread::sleep(Duration::from_millis(5));
    engine.interrupt(&PlantEvent::PeerGone(1)).expect("loses");
    engine.queue().hold_at(NEVER);
    let goes_on = (0..1000).any(|_| {
        engine.poll().expect("polls");
        engine.held.is_none()
    });
    assert!(goes_on, "it stayed held");
    assert!(engine.commands.heard_ns <= monotonic_ns());
}

#[test]
fn a_differing_second_answer_breaks_the_protocol() {
    let twice = "controller broke the protocol at step 3: it answered step 2 twice, with different commands";
    for (policy, repeats, step, why) in [
        (OnLoss::Abort, Repeats::OtherCommand(Step(2)), 3, twice),
        (OnLoss::Hold, Repeats::OtherCommand(Step(2)), 9, twice),
        // Only the newest command is kept: earlier ones cannot be compared.
        (
            OnLoss::Hold,
            Repeats::OtherCommand(Step(1)),
            9,
            "controller did not answer step 3 within 0.1 s",
        ),
    ] {
        let parrot = Parrot::new(3, repeats);
        let (end, applied_n, lost) = ends(engine(job_of(9, policy, Clock::Lockstep), parrot));
        assert_eq!(end.steps, step);
        assert_eq!(applied_n[..3], [0.0, 1.0, 2.0]);
        let reasons = end.reason.into_iter().chain(lost);
        assert_eq!(reasons.collect::<Vec<_>>(), [why]);
    }
}

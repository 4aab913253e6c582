//! The runner against a plant's end of a link that the test drives directly.

use shared_types::hello::{Offer, agree};
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::table::Empty;
use shared_types::time::Rate;

use super::*;
use crate::controller::{Controller, Row, Sample, Setup};
use shared_types::failure::Failure;

shared_types::table! {
    /// Measured.
    struct Measured {
        /// A position.
        position_m: "m",
    }
}

shared_types::table! {
    /// Command.
    struct Command {
        /// Ten times the received position.
        force_n: "N",
    }
}

shared_types::table! {
    /// Internals.
    struct Internals {
        /// Number of calls of the law.
        calls: "1",
        /// Validity of the sample.
        valid: "1",
        /// Simulated time received by the law.
        time_s: "s",
    }
}

/// Exposes all its inputs.
struct Witness {
    calls: f64,
}

impl Controller for Witness {
    const NAME: &'static str = "witness";
    const SUMMARY: &'static str = "Shows everything that it sees.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Measured;
    type Reference = Empty;
    type Command = Command;
    type Internals = Internals;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self { calls: 0.0 })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Internals) {
        self.calls += 1.0;
        let internals = Internals {
            calls: self.calls,
            valid: if sample.valid { 1.0 } else { 0.0 },
            time_s: sample.time_s,
        };
        let force_n = 10.0 * sample.measured.position_m;
        (Command { force_n }, internals)
    }
}

pub(super) fn kind() -> LawKind {
    LawKind::of::<Witness>()
}

pub(super) fn job(rate_divisor: u32, command_delay_steps: u32) -> Job {
    let rate = Rate::new(10.0).expect("legal");
    Job {
        rate_divisor,
        command_delay_steps,
        ..Job::new(5, "any", "witness", rate, 1.0)
    }
}

/// Greets the runner from the plant's end, with a surplus signal in front.
fn greet<L: Link>(runner: &mut Runner<&LawKind, L>, plant: &mut InProcessLink, rate_hz: f64) {
    let measured = [
        Field::signal("spare_pa", "Pa", "x"),
        Field::signal("position_m", "m", "x"),
    ];
    greet_with(runner, plant, rate_hz, &measured);
}

/// Does the same with these two measured signals.
fn greet_with<L: Link>(
    runner: &mut Runner<&LawKind, L>,
    plant: &mut InProcessLink,
    rate_hz: f64,
    measured: &[Field],
) {
    runner.begin().expect("begins");
    let bytes = plant.receive_control().expect("polls").expect("a hello");
    let Ok(Control::Hello(hello)) = Control::from_bytes(&bytes) else {
        panic!("no hello");
    };
    let start = Field {
        default: Some(7.0),
        ..Field::signal("force_n", "N", "x")
    };
    let offer = Offer {
        session: 5,
        epoch: 1,
        rate: Rate::new(rate_hz).expect("legal"),
        steps: 9,
        first: Step(0),
        against_clock: false,
        measured,
        reference: &[],
        commands: &[start],
    };
    let welcome = agree(&hello, &offer).expect("agreed");
    let spec = FrameSpec {
        identity: welcome.frame_identity(),
        outgoing: 2,
        incoming: 4,
    };
    plant.open_frames(&spec).expect("opens");
    let message = Control::Welcome(Box::new(welcome));
    plant.send_control(&message.to_bytes()).expect("sends");
    runner.poll().expect("polls");
}

/// Creates a runner past hello, on a link made from one end of a pair, with the plant at the other end.
pub(super) fn greeted<L: Link>(
    kind: &LawKind,
    job: Job,
    link: impl FnOnce(InProcessLink) -> L,
) -> (InProcessLink, Runner<&LawKind, L>) {
    let (mut plant, inner) = pair();
    let mut runner = Runner::new(kind, job, link(inner)).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    (plant, runner)
}

/// Sends a sample and polls once; returns the answer and its values.
fn answer(
    (plant, runner): &mut (InProcessLink, Runner<&LawKind, InProcessLink>),
    sample: &Header,
    values: [f64; 2],
) -> (Header, [f64; 4]) {
    plant.send(sample, &values).expect("sends");
    runner.poll().expect("polls");
    let mut frame = [0.0; 4];
    let header = plant.receive(&mut frame).expect("polls");
    (header.expect("an answer"), frame)
}

/// Sends positions 1, 2, 3 .. and returns force, calls and age of each answer.
fn answers(job: Job, steps: u64) -> Vec<(f64, f64, u32)> {
    directed(job, steps, |_| Directive::default())
}

/// Sends positions like [`answers`], with a directive in each sample; returns the same values.
fn directed(job: Job, steps: u64, directive: fn(u64) -> Directive) -> Vec<(f64, f64, u32)> {
    let kind = kind();
    let mut ends = greeted(&kind, job, |link| link);
    (0..steps)
        .map(|step| {
            let sample = Header {
                directive: directive(step).to_wire(),
                ..Header::new(FrameKind::Sample, Step(step))
            };
            let (answer, frame) = answer(&mut ends, &sample, [99.0, (step + 1) as f64]);
            assert_eq!(answer.step, step);
            (frame[0], frame[1], answer.age_steps)
        })
        .collect()
}

#[test]
fn each_sample_is_answered_from_its_own_signals() {
    assert_eq!(
        answers(job(1, 0), 3),
        [(10.0, 1.0, 0), (20.0, 2.0, 0), (30.0, 3.0, 0)]
    );
}

#[test]
fn a_delayed_command_is_that_of_the_previous_sample_and_at_first_the_declared_start() {
    assert_eq!(
        answers(job(1, 1), 3),
        [(7.0, 1.0, 1), (10.0, 2.0, 1), (20.0, 3.0, 1)]
    );
}

#[test]
fn a_slow_law_holds_its_command_between_its_samples() {
    let expected = [
        (10.0, 1.0, 0),
        (10.0, 1.0, 1),
        (10.0, 1.0, 2),
        (40.0, 2.0, 0),
    ];
    assert_eq!(answers(job(3, 0), 4), expected);
}

#[test]
fn a_slow_law_with_a_delay_answers_a_step_late() {
    let expected = [
        (7.0, 1.0, 2),
        (10.0, 1.0, 1),
        (10.0, 2.0, 2),
        (30.0, 2.0, 1),
    ];
    assert_eq!(answers(job(2, 1), 4), expected);
}

fn late_by_two_at_one_and_two(step: u64) -> Directive {
    Directive {
        late_steps: if step == 1 || step == 2 { 2 } else { 0 },
        ..Directive::default()
    }
}

#[test]
fn a_late_command_takes_effect_steps_later_and_the_last_is_sent_until_then() {
    // Directed at step 1; at step 2 it is late already and ignores the sample.
    let expected = [
        (10.0, 1.0, 0),
        (10.0, 1.0, 1),
        (10.0, 1.0, 2),
        (20.0, 2.0, 2),
        (50.0, 3.0, 0),
    ];
    assert_eq!(directed(job(1, 0), 5, late_by_two_at_one_and_two), expected);
}

#[test]
fn a_command_that_is_late_from_the_first_step_on_follows_the_declared_start() {
    let late = |step| Directive {
        late_steps: if step == 0 { 2 } else { 0 },
        ..Directive::default()
    };
    let forces = directed(job(1, 0), 3, late)
        .into_iter()
        .map(|(force_n, ..)| force_n);
    assert_eq!(forces.collect::<Vec<_>>(), [7.0, 7.0, 10.0]);
}

#[test]
fn a_late_slow_law_misses_its_turn() {
    // Its sample at step 2 is missed; the command for step 1, made at step 0, is sent at step 3.
    let expected = [
        (10.0, 1.0, 0),
        (10.0, 1.0, 1),
        (10.0, 1.0, 2),
        (10.0, 1.0, 3),
        (50.0, 2.0, 0),
    ];
    assert_eq!(directed(job(2, 0), 5, late_by_two_at_one_and_two), expected);
}

#[test]
fn a_busy_controller_gives_the_same_answer_later() {
    let kind = kind();
    let mut ends = greeted(&kind, job(1, 0), |link| link);
    let busy = Directive {
        busy_ns: 300_000,
        ..Directive::default()
    };
    let sample = Header {
        directive: busy.to_wire(),
        ..Header::new(FrameKind::Sample, Step(0))
    };
    let (answer, frame) = answer(&mut ends, &sample, [99.0, 1.0]);
    assert_eq!((frame[0], answer.age_steps), (10.0, 0));
    assert!(answer.work_ns >= 300_000, "{} ns", answer.work_ns);
}

#[test]
fn a_hold_is_reported_and_the_sample_still_awaited() {
    let kind = kind();
    let mut ends = greeted(&kind, job(1, 0), |link| link);
    let (plant, runner) = &mut ends;
    let hold = Header::new(FrameKind::Hold, Step(0));
    plant.send(&hold, &[]).expect("sends");
    assert_eq!(runner.poll().expect("polls"), Progress::Held);
    assert_eq!(runner.poll().expect("polls"), Progress::Plant);
    let sample = Header::new(FrameKind::Sample, Step(0));
    let (_, frame) = answer(&mut ends, &sample, [99.0, 1.0]);
    assert_eq!(frame[0], 10.0);
}

#[test]
fn a_law_is_informed_of_its_own_invalid_signals_only() {
    let kind = kind();
    let mut ends = greeted(&kind, job(1, 0), |link| link);
    for (step, invalid, valid) in [(0, 0b00, 1.0), (1, 0b01, 1.0), (2, 0b10, 0.0)] {
        let mut sample = Header::new(FrameKind::Sample, Step(step));
        sample.invalid[0] = invalid;
        let (_, frame) = answer(&mut ends, &sample, [0.0, 0.0]);
        assert_eq!(frame[2..], [valid, step as f64 / 10.0], "step {step}");
    }
}

#[test]
fn a_plant_at_another_rate_is_refused() {
    let (mut plant, link) = pair();
    let kind = kind();
    let mut runner = Runner::new(&kind, job(1, 0), link).expect("starts");
    greet(&mut runner, &mut plant, 20.0);
    let Some(End::Aborted(abort)) = runner.end() else {
        panic!("not refused");
    };
    assert!(abort.to_string().contains("20 Hz"), "{abort}");
}

#[test]
fn the_law_that_suits_the_plant_is_selected() {
    let law = |plants: &[&str]| {
        let mut kind = LawKind::of::<Witness>();
        kind.description.plants = plants.iter().map(|&name| name.into()).collect();
        kind
    };
    let laws = [law(&["a"]), law(&["b"])];
    let selected = choose(&laws, "witness", "b").expect("there is one");
    assert_eq!(selected.description.plants, ["b"]);
    assert!(choose(&laws, "witness", "c").is_err());
    assert!(choose(&[law(&[])], "witness", "c").is_ok());
}

#[test]
fn a_law_with_commands_of_its_own_is_started_once() {
    use std::sync::atomic::{AtomicU32, Ordering};
    static STARTS: AtomicU32 = AtomicU32::new(0);
    let counted = LawKind {
        start: Box::new(|setup| {
            STARTS.fetch_add(1, Ordering::Relaxed);
            (kind().start)(setup)
        }),
        ..kind()
    };
    let (_plant, runner) = greeted(&counted, job(1, 0), |link| link);
    assert!(runner.bound.is_some());
    assert_eq!(STARTS.load(Ordering::Relaxed), 1);
}

/// Fails at its second sample.
struct Fails(u32);

impl Law for Fails {
    fn step(&mut self, _: &Row<'_>, command: &mut [f64], _: &mut [f64]) -> Result<(), Failure> {
        self.0 += 1;
        command.fill(1.0);
        if self.0 == 2 {
            return Err(Failure::lost("the library\nis gone"));
        }
        Ok(())
    }
}

#[test]
fn a_failing_law_aborts_at_its_step_with_its_reason() {
    let kind = LawKind::from_tables(kind().description, |_| Ok(Box::new(Fails(0))));
    let kind = kind.expect("sound tables");
    let mut ends = greeted(&kind, job(1, 0), |link| link);
    for (step, expected) in [(0, FrameKind::Command), (1, FrameKind::Abort)] {
        let sample = Header::new(FrameKind::Sample, Step(step));
        let (answer, _) = answer(&mut ends, &sample, [99.0, 1.0]);
        assert_eq!(answer.kind(), Some(expected));
    }
    let (_, mut runner) = ends;
    assert_eq!(runner.poll().expect("polls"), Progress::Over);
    let Some(End::Aborted(abort)) = runner.end() else {
        panic!("it went on");
    };
    let reason = "the law failed at step 1: the library is gone";
    assert_eq!(*abort, Abort::Failed(reason.into()));
}

mod quality;
mod tuning;

//! The runner against a plant's end of a link that the test holds in its own hands.

use shared_types::hello::{Offer, agree};
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::table::Empty;
use shared_types::time::Rate;
use shared_types::tuning::{Course, Tuned};

use super::*;
use crate::controller::{Controller, Sample, Setup, Transition};

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
        /// Ten times the position seen.
        force_n: "N",
    }
}

shared_types::table! {
    /// Internals.
    struct Internals {
        /// Number of times that the law was asked.
        calls: "1",
        /// Validity of the sample.
        valid: "1",
        /// The time it was told.
        time_s: "s",
    }
}

/// Shows everything that it sees.
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
        let valid = if sample.valid { 1.0 } else { 0.0 };
        let internals = Internals {
            calls: self.calls,
            valid,
            time_s: sample.time_s,
        };
        (
            Command {
                force_n: 10.0 * sample.measured.position_m,
            },
            internals,
        )
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

/// The plant's end after hello, which has a signal too many in front.
pub(super) fn greet<L: Link>(runner: &mut Runner<'_, L>, plant: &mut InProcessLink, rate_hz: f64) {
    runner.begin().expect("begins");
    let bytes = plant.receive_control().expect("polls").expect("a hello");
    let Ok(Control::Hello(hello)) = Control::from_bytes(&bytes) else {
        panic!("no hello");
    };
    let measured = [
        Field::signal("spare_pa", "Pa", "x"),
        Field::signal("position_m", "m", "x"),
    ];
    let offer = Offer {
        session: 5,
        epoch: 1,
        rate: Rate::new(rate_hz).expect("legal"),
        steps: 9,
        first: Step(0),
        against_clock: false,
        measured: &measured,
        reference: &[],
        commands: &[Field::signal("force_n", "N", "x")],
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

/// Sends positions 1, 2, 3 .. and gives force, calls and age of each answer.
fn answers(job: Job, steps: u64) -> Vec<(f64, f64, u32)> {
    directed(job, steps, |_| Directive::default())
}

/// Sends positions as [`answers`] does, with a directive in each sample; gives the same.
fn directed(job: Job, steps: u64, directive: fn(u64) -> Directive) -> Vec<(f64, f64, u32)> {
    let (mut plant, link) = pair();
    let kind = kind();
    let mut runner = Runner::new(&kind, job, link).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    let mut frame = [0.0; 4];
    (0..steps)
        .map(|step| {
            let sample = Header {
                directive: directive(step).to_wire(),
                ..Header::new(FrameKind::Sample, Step(step))
            };
            plant
                .send(&sample, &[99.0, (step + 1) as f64])
                .expect("sends");
            runner.poll().expect("polls");
            let answer = plant
                .receive(&mut frame)
                .expect("polls")
                .expect("an answer");
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
fn a_delayed_command_is_that_of_the_sample_before() {
    assert_eq!(
        answers(job(1, 1), 3),
        [(0.0, 1.0, 1), (10.0, 2.0, 1), (20.0, 3.0, 1)]
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
        (0.0, 1.0, 2),
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
    // Told at step 1; at step 2 it is late already and looks at nothing.
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
fn a_late_slow_law_misses_its_turn() {
    // The turn at step 2 is missed; what step 1 would have sent, made at step 0, comes at step 3.
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
fn a_busy_controller_answers_the_same_and_takes_the_time() {
    let (mut plant, link) = pair();
    let kind = kind();
    let mut runner = Runner::new(&kind, job(1, 0), link).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    let busy = Directive {
        busy_ns: 300_000,
        ..Directive::default()
    };
    let sample = Header {
        directive: busy.to_wire(),
        ..Header::new(FrameKind::Sample, Step(0))
    };
    plant.send(&sample, &[99.0, 1.0]).expect("sends");
    runner.poll().expect("polls");
    let mut frame = [0.0; 4];
    let answer = plant.receive(&mut frame).expect("polls").expect("answers");
    assert_eq!((frame[0], answer.age_steps), (10.0, 0));
    assert!(answer.work_ns >= 300_000, "{} ns", answer.work_ns);
}

#[test]
fn a_hold_is_told_and_the_sample_is_still_awaited() {
    let (mut plant, link) = pair();
    let kind = kind();
    let mut runner = Runner::new(&kind, job(1, 0), link).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    let hold = Header::new(FrameKind::Hold, Step(0));
    plant.send(&hold, &[]).expect("sends");
    assert_eq!(runner.poll().expect("polls"), Progress::Held);
    assert_eq!(runner.poll().expect("polls"), Progress::Plant);
    plant
        .send(&Header::new(FrameKind::Sample, Step(0)), &[99.0, 1.0])
        .expect("sends");
    runner.poll().expect("polls");
    let mut frame = [0.0; 4];
    plant.receive(&mut frame).expect("polls").expect("answers");
    assert_eq!(frame[0], 10.0);
}

#[test]
fn a_law_hears_of_an_invalid_signal_and_only_of_its_own() {
    let (mut plant, link) = pair();
    let kind = kind();
    let mut runner = Runner::new(&kind, job(1, 0), link).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    let mut frame = [0.0; 4];
    for (step, invalid, valid) in [(0, 0b00, 1.0), (1, 0b01, 1.0), (2, 0b10, 0.0)] {
        let mut sample = Header::new(FrameKind::Sample, Step(step));
        sample.invalid[0] = invalid;
        plant.send(&sample, &[0.0, 0.0]).expect("sends");
        runner.poll().expect("polls");
        plant
            .receive(&mut frame)
            .expect("polls")
            .expect("an answer");
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
fn the_law_that_suits_the_plant_is_chosen() {
    let law = |plants: &[&str]| {
        let mut kind = LawKind::of::<Witness>();
        kind.description.plants = plants.iter().map(|&name| name.into()).collect();
        kind
    };
    let laws = [law(&["a"]), law(&["b"])];
    let chosen = choose(&laws, "witness", "b").expect("there is one");
    assert_eq!(chosen.description.plants, ["b"]);
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
    let (mut plant, link) = pair();
    let mut runner = Runner::new(&counted, job(1, 0), link).expect("fits");
    greet(&mut runner, &mut plant, 10.0);
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
fn a_law_that_fails_gives_up_at_its_step_with_its_reason() {
    let kind = LawKind::from_tables(kind().description, |_| Ok(Box::new(Fails(0))));
    let kind = kind.expect("sound tables");
    let (mut plant, link) = pair();
    let mut runner = Runner::new(&kind, job(1, 0), link).expect("starts");
    greet(&mut runner, &mut plant, 10.0);
    let mut frame = [0.0; 4];
    for (step, wanted) in [(0, FrameKind::Command), (1, FrameKind::Abort)] {
        let sample = Header::new(FrameKind::Sample, Step(step));
        plant.send(&sample, &[99.0, 1.0]).expect("sends");
        runner.poll().expect("polls");
        let answer = plant.receive(&mut frame).expect("polls");
        assert_eq!(answer.and_then(|header| header.kind()), Some(wanted));
    }
    assert_eq!(runner.poll().expect("polls"), Progress::Over);
    let Some(End::Aborted(abort)) = runner.end() else {
        panic!("it went on");
    };
    let told = "the law failed at step 1: the library is gone";
    assert_eq!(*abort, Abort::Failed(told.into()));
}

shared_types::table! {
    /// Parameters of a law that can be tuned.
    struct Gains {
        /// Gain that is tunable.
        gain_n_per_m: "N/m" = 10.0 in 0.0..=1e3 [tunable],
        /// Force that is not.
        offset_n: "N" = 1.0 in 0.0..=1e3,
        /// Another one that is.
        bias_n: "N" = 0.0 in 0.0..=1e3 [tunable],
    }
}

shared_types::table! {
    /// Internals of a law that can be tuned.
    struct Told {
        /// Number of steps taken.
        jumps: "1",
        /// Number of times that the law was given parameters.
        changes: "1",
        /// Bias.
        bias_n: "N",
    }
}

/// Shows every change of its parameters.
struct Tunable {
    gains: Gains,
    told: Told,
}

impl Controller for Tunable {
    const NAME: &'static str = "witness";
    const SUMMARY: &'static str = "Shows every change of its parameters.";
    type Parameters = Gains;
    type Model = Empty;
    type Measured = Measured;
    type Reference = Empty;
    type Command = Command;
    type Internals = Told;

    fn tuning() -> Option<crate::controller::Tuning<Self>> {
        Some(crate::controller::Tuning {
            does: "Jumps.",
            take: |law, setup, transition| {
                law.gains = setup.parameters;
                law.told.changes += 1.0;
                if transition == Transition::Step {
                    law.told.jumps += 1.0;
                }
            },
        })
    }

    fn state() -> Option<shared_types::state::StateOf<Self>> {
        Some(shared_types::state::StateOf::new(
            |law: &Self| [law.told.jumps, law.told.changes],
            |law, [jumps, changes]| (law.told.jumps, law.told.changes) = (jumps, changes),
        ))
    }

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self {
            gains: setup.parameters,
            told: Told {
                jumps: 0.0,
                changes: 0.0,
                bias_n: 0.0,
            },
        })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Told) {
        self.told.bias_n = self.gains.bias_n;
        let force_n = self.gains.gain_n_per_m * sample.measured.position_m + self.gains.offset_n;
        (Command { force_n }, self.told)
    }
}

/// A run of the law, its plant's end in the test's hands.
struct Bench<'a> {
    plant: InProcessLink,
    runner: Runner<'a, InProcessLink>,
}

impl<'a> Bench<'a> {
    fn new(kind: &'a LawKind, job: Job) -> Self {
        let (mut plant, link) = pair();
        let job = Job {
            parameters: shared_types::describe::Settings::of(&Gains::default()),
            ..job
        };
        let mut runner = Runner::new(kind, job, link).expect("starts");
        greet(&mut runner, &mut plant, 10.0);
        plant.receive_control().expect("a ready");
        Self { plant, runner }
    }

    fn tell(&mut self, number: u64, courses: &[(u32, Course)]) {
        let courses = courses.to_vec();
        let told = Control::Tuned(Tuned { number, courses });
        self.plant.tell(&told.to_bytes()).expect("tells");
    }

    fn sample(&mut self, step: u64, tuning: u64, directive: Directive) {
        let sample = Header {
            tuning,
            directive: directive.to_wire(),
            ..Header::new(FrameKind::Sample, Step(step))
        };
        self.plant.send(&sample, &[99.0, 1.0]).expect("sends");
    }

    /// Polls once; force, jumps, changes and bias of the answer, if there is one.
    fn answer(&mut self) -> Option<[f64; 4]> {
        self.runner.poll().expect("polls");
        let mut frame = [0.0; 4];
        let answered = self.plant.receive(&mut frame).expect("polls");
        answered.map(|_| frame)
    }

    fn step(&mut self, step: u64, tuning: u64) -> [f64; 4] {
        self.sample(step, tuning, Directive::default());
        self.answer().expect("an answer")
    }
}

const fn course(from: f64, to: f64, begin: u64, steps: u64) -> Course {
    Course {
        from,
        to,
        begin: Step(begin),
        steps,
    }
}

#[test]
fn a_law_has_the_parameters_of_the_step_that_it_sees() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    assert_eq!(bench.step(0, 0), [11.0, 0.0, 0.0, 0.0]);
    // A jump of one and a ramp of the other tunable parameter, at one step.
    bench.tell(
        1,
        &[(0, course(10.0, 20.0, 1, 0)), (1, course(0.0, 4.0, 1, 4))],
    );
    assert_eq!(bench.step(1, 1), [21.0, 1.0, 1.0, 0.0]);
    assert_eq!(bench.step(2, 1), [21.0, 1.0, 2.0, 1.0]);
    assert_eq!(bench.step(3, 1), [21.0, 1.0, 3.0, 2.0]);
    assert_eq!(bench.step(4, 1), [21.0, 1.0, 4.0, 3.0]);
    assert_eq!(bench.step(5, 1), [21.0, 1.0, 5.0, 4.0]);
    assert_eq!(
        bench.step(6, 1),
        [21.0, 1.0, 5.0, 4.0],
        "nothing changes any more"
    );
}

#[test]
fn a_sample_waits_for_what_was_said_before_it() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.step(0, 0);
    bench.sample(1, 1, Directive::default());
    for _ in 0..3 {
        assert_eq!(bench.answer(), None);
    }
    assert_eq!(
        bench.runner.poll().expect("polls"),
        Progress::Plant,
        "a wait goes on"
    );
    bench.tell(1, &[(0, course(10.0, 20.0, 1, 0))]);
    assert_eq!(bench.answer(), Some([21.0, 1.0, 1.0, 0.0]));
}

#[test]
fn what_is_said_before_the_first_sample_waits_for_it() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.tell(1, &[(0, course(10.0, 20.0, 0, 0))]);
    for _ in 0..3 {
        assert_eq!(bench.answer(), None);
    }
    assert_eq!(bench.step(0, 1), [21.0, 1.0, 1.0, 0.0]);
}

#[test]
fn a_law_that_missed_the_change_takes_it_at_its_next_sample() {
    let kind = LawKind::of::<Tunable>();
    // A slow law: its samples are 0, 3, 6.
    let mut bench = Bench::new(&kind, job(3, 0));
    bench.step(0, 0);
    bench.tell(
        1,
        &[(0, course(10.0, 20.0, 1, 0)), (1, course(0.0, 8.0, 1, 4))],
    );
    assert_eq!(bench.step(1, 1), [11.0, 0.0, 0.0, 0.0]);
    assert_eq!(bench.step(2, 1), [11.0, 0.0, 0.0, 0.0]);
    assert_eq!(bench.step(3, 1), [21.0, 1.0, 1.0, 4.0]);
    // And one whose samples are not looked at.
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.step(0, 0);
    bench.tell(1, &[(0, course(10.0, 20.0, 1, 0))]);
    let unseen = Directive {
        unseen: true,
        ..Directive::default()
    };
    bench.sample(1, 1, unseen);
    assert_eq!(bench.answer(), Some([11.0, 0.0, 0.0, 0.0]));
    assert_eq!(bench.step(2, 1), [21.0, 1.0, 1.0, 0.0]);
}

#[test]
fn of_messages_that_were_lost_the_newest_counts_at_its_own_sample() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.step(0, 0);
    // The sample of number 2 is still there, its message is not: the next sample is answered.
    bench.sample(1, 2, Directive::default());
    bench.tell(3, &[(0, course(10.0, 30.0, 1, 0))]);
    assert_eq!(bench.answer(), None);
    assert_eq!(bench.answer(), None);
    // Against the clock that would be a later sample; here the plant sends it again, as another one.
    assert_eq!(bench.step(1, 3), [31.0, 1.0, 1.0, 0.0]);
}

#[test]
fn a_message_about_a_parameter_that_the_law_does_not_offer_counts_as_never_come() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.step(0, 0);
    bench.tell(1, &[(2, course(10.0, 20.0, 1, 0))]);
    bench.sample(1, 1, Directive::default());
    assert_eq!(bench.answer(), None);
    bench.tell(1, &[(0, course(10.0, 20.0, 1, 0))]);
    assert_eq!(bench.answer(), Some([21.0, 1.0, 1.0, 0.0]));
}

#[test]
fn a_checkpoint_keeps_the_parameters_in_the_middle_of_a_ramp() {
    let kind = LawKind::of::<Tunable>();
    let mut bench = Bench::new(&kind, job(1, 0));
    bench.tell(1, &[(0, course(10.0, 50.0, 0, 4))]);
    bench.step(0, 1);
    bench.step(1, 1);
    let saved = bench
        .runner
        .bound
        .as_ref()
        .expect("bound")
        .save()
        .expect("saves");
    let straight = [bench.step(2, 1), bench.step(3, 1), bench.step(4, 1)];
    let mut other = Bench::new(&kind, job(1, 0));
    (other.runner.bound.as_mut().expect("bound").restore(saved)).expect("restores");
    let side = &mut other.runner.side;
    for step in 0..2 {
        let header = Header::new(FrameKind::Sample, Step(step));
        side.on(&ControllerEvent::Frame(&header));
    }
    let resumed = [other.step(2, 1), other.step(3, 1), other.step(4, 1)];
    assert_eq!(resumed, straight);
    assert_eq!(straight[2][0], 51.0);
}

#[test]
fn only_a_law_that_says_how_can_be_tuned() {
    let described = LawKind::of::<Tunable>().description;
    let names: Vec<_> = described.tunable().map(|field| &*field.name).collect();
    assert_eq!(
        (names, &*described.tuning),
        (vec!["gain_n_per_m", "bias_n"], "Jumps.")
    );
    assert_eq!(LawKind::of::<Witness>().description.tuning, "");
}

#[test]
fn parameters_that_a_change_will_bring_are_judged_at_the_start() {
    let picky = LawKind {
        start: Box::new(|start| match start.parameters.get("gain_n_per_m") {
            Some(gain) if gain > 100.0 => Err(Invalid("too much".into())),
            _ => (LawKind::of::<Tunable>().start)(start),
        }),
        ..LawKind::of::<Tunable>()
    };
    let settings = shared_types::describe::Settings::of::<Gains>;
    let with = |gain_n_per_m| {
        settings(&Gains {
            gain_n_per_m,
            ..Gains::default()
        })
    };
    for (change, is_right) in [(99.0, true), (101.0, false)] {
        let job = Job {
            parameters: with(1.0),
            changes: vec![with(change)],
            ..job(1, 0)
        };
        assert_eq!(Runner::new(&picky, job, pair().1).is_ok(), is_right);
    }
}

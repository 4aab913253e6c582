//! Parameters that change during a run.

use std::sync::LazyLock;

use shared_types::tuning::{Course, Tuned};

use super::*;
use crate::controller::Transition;

shared_types::table! {
    /// Parameters of a tunable law.
    struct Gains {
        /// Tunable gain.
        gain_n_per_m: "N/m" = 10.0 in 0.0..=1e3 [tunable],
        /// Force that is not tunable.
        offset_n: "N" = 1.0 in 0.0..=1e3,
        /// Another tunable parameter.
        bias_n: "N" = 0.0 in 0.0..=1e3 [tunable],
    }
}

shared_types::table! {
    /// Internals of a tunable law.
    struct Told {
        /// Number of jumps.
        jumps: "1",
        /// Number of times that the law received parameters.
        changes: "1",
        /// Bias.
        bias_n: "N",
    }
}

/// Exposes every change of its parameters.
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

/// A run of the law, with its plant's end driven by the test.
struct Bench {
    plant: InProcessLink,
    runner: Runner<&'static LawKind, InProcessLink>,
}

impl Bench {
    fn new(rate_divisor: u32) -> Self {
        static KIND: LazyLock<LawKind> = LazyLock::new(LawKind::of::<Tunable>);
        let job = Job {
            parameters: shared_types::describe::Settings::of(&Gains::default()),
            ..job(rate_divisor, 0)
        };
        let (mut plant, runner) = greeted(&KIND, job, |link| link);
        plant.receive_control().expect("a ready");
        Self { plant, runner }
    }

    fn tell(&mut self, number: u64, courses: &[(u32, Course)]) {
        let courses = courses.to_vec();
        let message = Control::Tuned(Tuned { number, courses });
        self.plant.tell(&message.to_bytes()).expect("tells");
    }

    fn sample(&mut self, step: u64, tuning: u64, directive: Directive) {
        let sample = Header {
            tuning,
            directive: directive.to_wire(),
            ..Header::new(FrameKind::Sample, Step(step))
        };
        self.plant.send(&sample, &[99.0, 1.0]).expect("sends");
    }

    /// Polls once; returns force, jumps, changes and bias of the answer, if there is one.
    fn answer(&mut self) -> Option<[f64; 4]> {
        self.runner.poll().expect("polls");
        let mut frame = [0.0; 4];
        let header = self.plant.receive(&mut frame).expect("polls");
        header.map(|_| frame)
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
fn a_law_has_the_parameters_of_its_samples_step() {
    let mut bench = Bench::new(1);
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
fn a_sample_waits_for_the_message_that_precedes_it() {
    let mut bench = Bench::new(1);
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
fn a_message_before_the_first_sample_waits_for_it() {
    let mut bench = Bench::new(1);
    bench.tell(1, &[(0, course(10.0, 20.0, 0, 0))]);
    for _ in 0..3 {
        assert_eq!(bench.answer(), None);
    }
    assert_eq!(bench.step(0, 1), [21.0, 1.0, 1.0, 0.0]);
}

#[test]
fn a_law_that_missed_a_change_applies_it_at_its_next_sample() {
    // A slow law: its samples are 0, 3, 6.
    let mut bench = Bench::new(3);
    bench.step(0, 0);
    bench.tell(
        1,
        &[(0, course(10.0, 20.0, 1, 0)), (1, course(0.0, 8.0, 1, 4))],
    );
    assert_eq!(bench.step(1, 1), [11.0, 0.0, 0.0, 0.0]);
    assert_eq!(bench.step(2, 1), [11.0, 0.0, 0.0, 0.0]);
    assert_eq!(bench.step(3, 1), [21.0, 1.0, 1.0, 4.0]);
    // A law whose samples are ignored for a while.
    let mut bench = Bench::new(1);
    bench.step(0, 0);
    bench.tell(1, &[(0, course(10.0, 20.0, 1, 0))]);
    let directive = Directive {
        unseen: true,
        ..Directive::default()
    };
    bench.sample(1, 1, directive);
    assert_eq!(bench.answer(), Some([11.0, 0.0, 0.0, 0.0]));
    assert_eq!(bench.step(2, 1), [21.0, 1.0, 1.0, 0.0]);
}

#[test]
fn the_newest_of_lost_messages_counts_at_its_own_sample() {
    let mut bench = Bench::new(1);
    bench.step(0, 0);
    // The sample of number 2 is still there, its message is not: the next sample is answered.
    bench.sample(1, 2, Directive::default());
    bench.tell(3, &[(0, course(10.0, 30.0, 1, 0))]);
    assert_eq!(bench.answer(), None);
    assert_eq!(bench.answer(), None);
    // In real time that would be a later sample; here the plant sends it again, as another one.
    assert_eq!(bench.step(1, 3), [31.0, 1.0, 1.0, 0.0]);
}

#[test]
fn a_message_about_an_unknown_parameter_is_ignored() {
    let mut bench = Bench::new(1);
    bench.step(0, 0);
    bench.tell(1, &[(2, course(10.0, 20.0, 1, 0))]);
    bench.sample(1, 1, Directive::default());
    assert_eq!(bench.answer(), None);
    bench.tell(1, &[(0, course(10.0, 20.0, 1, 0))]);
    assert_eq!(bench.answer(), Some([21.0, 1.0, 1.0, 0.0]));
}

#[test]
fn a_checkpoint_keeps_the_parameters_in_the_middle_of_a_ramp() {
    let mut bench = Bench::new(1);
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
    let mut other = Bench::new(1);
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
fn only_a_law_with_a_tuning_function_can_be_tuned() {
    let described = LawKind::of::<Tunable>().description;
    let names: Vec<_> = described.tunable().map(|field| &*field.name).collect();
    assert_eq!(
        (names, &*described.tuning),
        (vec!["gain_n_per_m", "bias_n"], "Jumps.")
    );
    assert_eq!(LawKind::of::<Witness>().description.tuning, "");
}

#[test]
fn parameters_of_future_changes_are_validated_at_the_start() {
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

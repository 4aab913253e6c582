//! Validity and age of each signal, as a law sees them, and commands that it does not refresh.

use shared_types::quality::{Quality, SignalSet};

use super::*;
use crate::controller::Answer;

shared_types::table! {
    /// Internals.
    struct Seen {
        /// 1 if the position is valid.
        valid: "1",
        /// Age of the position.
        age: "steps",
        /// 1 if the whole sample is valid.
        all: "1",
    }
}

/// Exposes what it sees of the position; does not refresh a command at the steps 2 and 3.
struct Observer;

impl Controller for Observer {
    const NAME: &'static str = "witness";
    const SUMMARY: &'static str = "Shows the quality of the position.";
    type Parameters = Empty;
    type Model = Empty;
    type Measured = Measured;
    type Reference = Empty;
    type Command = Command;
    type Internals = Seen;

    fn start(_: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self)
    }

    fn step(&mut self, _: &Sample<Self>) -> (Command, Seen) {
        unreachable!("`answer` is called instead")
    }

    fn answer(
        &mut self,
        sample: &Sample<Self>,
        quality: &Quality<'_>,
        held: &mut SignalSet,
    ) -> (Command, Seen) {
        let number = |holds| if holds { 1.0 } else { 0.0 };
        let position = |measured: &Measured| measured.position_m;
        let seen = Seen {
            valid: number(quality.is_valid(position)),
            age: f64::from(quality.age_steps_of(position)),
            all: number(sample.valid),
        };
        let mut force_n = 10.0 * sample.measured.position_m;
        if (0.15..0.35).contains(&sample.time_s) {
            held.insert_in(|command: &Command| command.force_n);
            force_n = f64::NAN;
        }
        (Command { force_n }, seen)
    }
}

/// Returns for samples of a step, invalid bits and message age: validity, age and validity of all, as the law saw them.
/// The position is the second signal of two.
fn seen(job: Job, samples: &[(u64, u64, u32)]) -> Vec<[f64; 3]> {
    let kind = LawKind::of::<Observer>();
    let mut ends = greeted(&kind, job, |link| link);
    let one = |&(step, invalid, age_steps): &(u64, u64, u32)| {
        let mut sample = Header::new(FrameKind::Sample, Step(step));
        (sample.invalid[0], sample.age_steps) = (invalid, age_steps);
        let (_, frame) = answer(&mut ends, &sample, [0.0, 1.0]);
        [frame[1], frame[2], frame[3]]
    };
    samples.iter().map(one).collect()
}

#[test]
fn a_law_sees_how_long_a_signal_has_been_invalid() {
    let samples = [
        (0, 0, 0),
        (1, 0b10, 0),
        (2, 0b11, 0),
        (3, 0b01, 0),
        (4, 0b10, 0),
    ];
    let expected = [
        [1.0, 0.0, 1.0],
        [0.0, 1.0, 0.0],
        [0.0, 2.0, 0.0],
        [1.0, 0.0, 1.0],
        [0.0, 1.0, 0.0],
    ];
    assert_eq!(seen(job(1, 0), &samples), expected);
}

#[test]
fn a_signal_that_never_was_valid_is_as_old_as_the_run() {
    let samples = [(0, 0b10, 0), (1, 0b10, 0), (2, 0, 0)];
    let ages: Vec<f64> = seen(job(1, 0), &samples)
        .iter()
        .map(|seen| seen[1])
        .collect();
    assert_eq!(ages, [1.0, 2.0, 0.0]);
}

#[test]
fn the_age_of_a_message_counts_for_each_of_its_signals() {
    let samples = [(0, 0, 0), (1, 0, 3), (2, 0b10, 3), (3, 0, 1), (4, 0, 0)];
    let ages: Vec<f64> = seen(job(1, 0), &samples)
        .iter()
        .map(|seen| seen[1])
        .collect();
    assert_eq!(ages, [0.0, 3.0, 4.0, 1.0, 0.0]);
}

#[test]
fn ages_count_steps_between_the_samples_of_a_slow_law_too() {
    // The law runs at the steps 0, 3 and 6; the position is valid at 4, and never after.
    let samples: Vec<(u64, u64, u32)> = (0..7)
        .map(|step| (step, if step == 4 || step == 0 { 0 } else { 0b10 }, 0))
        .collect();
    let seen = seen(job(3, 0), &samples);
    assert_eq!([seen[0][1], seen[3][1], seen[6][1]], [0.0, 3.0, 2.0]);
}

#[test]
fn a_command_that_is_not_refreshed_keeps_its_last_value_and_is_marked() {
    for (delay_steps, expected) in [
        (0, [(10.0, 0), (20.0, 0), (20.0, 1), (20.0, 1), (50.0, 0)]),
        (1, [(7.0, 0), (10.0, 0), (20.0, 0), (20.0, 1), (20.0, 1)]),
    ] {
        let kind = LawKind::of::<Observer>();
        let mut ends = greeted(&kind, job(1, delay_steps), |link| link);
        for (step, expected) in (0..).zip(expected) {
            let sample = Header::new(FrameKind::Sample, Step(step));
            let (header, frame) = answer(&mut ends, &sample, [0.0, (step + 1) as f64]);
            assert_eq!((frame[0], header.invalid[0]), expected, "step {step}");
        }
    }
}

/// The quality as a law on rows sees it.
struct OnRows;

impl Law for OnRows {
    fn step(&mut self, _: &Row<'_>, _: &mut [f64], _: &mut [f64]) -> Result<(), Failure> {
        unreachable!("`answer` is called instead")
    }

    fn answer(
        &mut self,
        _: &Row<'_>,
        quality: &Quality<'_>,
        answer: Answer<'_>,
    ) -> Result<(), Failure> {
        answer.command[0] = quality.age_steps[0].into();
        answer.internals.fill(0.0);
        Ok(())
    }
}

#[test]
fn a_plant_may_send_the_age_of_a_signal() {
    let kind = LawKind::from_tables(LawKind::of::<Observer>().description, |_| {
        Ok(Box::new(OnRows))
    });
    let kind = kind.expect("sound tables");
    let (mut plant, inner) = pair();
    let mut runner = Runner::new(&kind, job(1, 0), inner).expect("starts");
    let measured = [
        Field::signal("position_m_age_steps", "steps", "x"),
        Field::signal("position_m", "m", "x"),
    ];
    greet_with(&mut runner, &mut plant, 10.0, &measured);
    let mut ends = (plant, runner);
    // Given age, invalid bits, age of the message, age for the law.
    for (step, (given, invalid, message, age)) in (0..).zip([
        (3.0, 0b00, 0, 3.0),
        (4.0, 0b00, 2, 6.0),
        (9.0, 0b10, 0, 9.0),
        (0.0, 0b11, 0, 10.0),
        (0.0, 0b00, 0, 0.0),
        (-1.0, 0b00, 0, 0.0),
    ]) {
        let mut sample = Header::new(FrameKind::Sample, Step(step));
        (sample.invalid[0], sample.age_steps) = (invalid, message);
        let (_, frame) = answer(&mut ends, &sample, [given, 1.0]);
        assert_eq!(frame[0], age, "step {step}");
    }
}

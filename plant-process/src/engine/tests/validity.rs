//! Plants that mark readings as invalid, and controllers that do not refresh a command.

use shared_types::failure::Failure;
use shared_types::frame::VALIDITY_WORDS;
use shared_types::quality::SignalSet;

use super::*;
use crate::plant::Model;

/// Word of a record with the sensed position.
const SENSED: usize = 11;

/// A [`Mover`] whose sensor gives this value at some steps, marked or not.
struct Patchy {
    mover: Mover,
    value: f64,
    is_gap: fn(u64) -> bool,
    is_marked: bool,
    step: u64,
}

impl Model for Patchy {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        Model::retune(&mut self.mover, parameters)
    }

    fn measure(&mut self, _: &mut [f64]) -> Result<(), Failure> {
        unreachable!("`read` is called instead")
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        assert!(!invalid.any(), "no mark is left from the step before");
        Model::measure(&mut self.mover, measured)?;
        if (self.is_gap)(self.step) {
            measured[0] = self.value;
            if self.is_marked {
                invalid.insert(0);
            }
        }
        Ok(())
    }

    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        Model::truth(&mut self.mover, time_s, command, truth)
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        self.step += 1;
        Model::advance(&mut self.mover, interval, command)
    }
}

fn patchy(value: f64, is_gap: fn(u64) -> bool, is_marked: bool) -> PlantKind {
    let start = move |_: &[f64]| -> Result<Box<dyn Model>, Invalid> {
        Ok(Box::new(Patchy {
            mover: Mover::start(&Parameters::default())?,
            value,
            is_gap,
            is_marked,
            step: 0,
        }))
    };
    PlantKind::from_tables(kind().description, start).expect("sound tables")
}

fn healthy(steps: u64) -> Job {
    Job {
        faults: vec![],
        ..job(steps)
    }
}

/// Returns, for each record, the invalid bit of the measured position and the measured, sensed and true positions.
fn positions(source: &mut InProcessSource) -> Vec<(u64, f64, f64, f64)> {
    let mut positions = Vec::new();
    let mut take = |item: Item<'_>| {
        if let Item::Record(words) = item {
            let [truth, measured, sensed] = [3, 5, SENSED].map(|word| f64::from_bits(words[word]));
            positions.push((words[1], measured, sensed, truth));
        }
    };
    source.drain(&mut take).expect("drains");
    positions
}

#[test]
fn an_invalid_reading_is_marked_and_replaced_by_the_last_valid_one() {
    for value in [f64::NAN, f64::INFINITY, 1e300, -7.0] {
        let is_gap = |step| step == 0 || (2..4).contains(&step);
        let kind = patchy(value, is_gap, true);
        let (mut engine, mut controller, mut source) = greeted_by(&kind, healthy(5));
        let end = run(&mut engine, &mut controller, 1.0);
        assert_eq!((end.kind(), end.step), (Some(FrameKind::End), 5));
        // The force of 1 N moves it by 1 m in each step.
        let expected = [
            (1, 0.0, 0.0, 0.0),
            (0, 1.0, 1.0, 1.0),
            (1, 1.0, 1.0, 2.0),
            (1, 1.0, 1.0, 3.0),
            (0, 4.0, 4.0, 4.0),
            (0, 5.0, 5.0, 5.0),
        ];
        assert_eq!(positions(&mut source), expected, "{value}");
    }
}

#[test]
fn a_reading_that_is_no_number_and_not_marked_ends_the_run() {
    let kind = patchy(f64::NAN, |step| step == 2, false);
    let (mut engine, mut controller, _source) = greeted_by(&kind, healthy(5));
    let end = run(&mut engine, &mut controller, 1.0);
    assert_eq!(end.kind(), Some(FrameKind::Abort));
    let reason = engine.end().expect("over").reason.clone();
    let expected =
        "plant diverged at step 2 (0.2 s): measured position_m = NaN is not a finite number";
    assert_eq!(reason.as_deref(), Some(expected));
}

#[test]
fn a_command_that_is_not_refreshed_leaves_the_applied_one_in_force() {
    let (mut engine, mut controller, mut source) = greeted_by(&kind(), healthy(5));
    let mut sample = [0.0; 3];
    for step in 0..5 {
        while engine.poll().expect("polls") == Progress::Busy {}
        controller
            .receive(&mut sample)
            .expect("polls")
            .expect("a sample");
        let is_refreshed = !(step == 0 || (2..4).contains(&step));
        let mut answer = Header::new(FrameKind::Command, Step(step));
        let mut force_n = (step + 1) as f64;
        if !is_refreshed {
            // Second among the controller's commands.
            answer.invalid[0] = 0b10;
            force_n = f64::NAN;
        }
        controller
            .send(&answer, &[7.0, force_n, 0.0])
            .expect("sends");
    }
    while engine.poll().expect("polls") == Progress::Busy {}
    let mut applied = Vec::new();
    let mut take = |item: Item<'_>| {
        if let Item::Record(words) = item {
            applied.push((words[2] >> 1 & 1, f64::from_bits(words[4])));
        }
    };
    source.drain(&mut take).expect("drains");
    let expected = [(1, 0.0), (0, 2.0), (1, 2.0), (1, 2.0), (0, 5.0)];
    assert_eq!(applied[..5], expected);
}

#[test]
fn the_marks_of_a_reading_reach_the_controller() {
    let kind = patchy(f64::NAN, |step| step == 1, true);
    let (mut engine, mut controller, _source) = greeted_by(&kind, healthy(3));
    let mut sample = [0.0; 3];
    for step in 0..3 {
        while engine.poll().expect("polls") == Progress::Busy {}
        let header = controller
            .receive(&mut sample)
            .expect("polls")
            .expect("a sample");
        let mut expected = [0; VALIDITY_WORDS];
        expected[0] = u64::from(step == 1);
        assert_eq!(header.invalid, expected, "step {step}");
        let answer = Header::new(FrameKind::Command, Step(step));
        controller.send(&answer, &[7.0, 1.0, 0.0]).expect("sends");
    }
}

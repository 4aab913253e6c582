//! Plants that fail with a reason, in each of their calls.

use shared_types::failure::Failure;

use super::*;
use crate::plant::Model;

/// A [`Mover`] that fails in one of its calls, from step 2 on.
struct Fails {
    mover: Mover,
    call: &'static str,
    failure: Failure,
    advanced: u32,
}

impl Fails {
    fn at(&self, call: &str) -> Result<(), Failure> {
        if self.advanced >= 2 && call == self.call {
            Err(self.failure.clone())
        } else {
            Ok(())
        }
    }
}

impl Model for Fails {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        self.at("retune")?;
        Model::retune(&mut self.mover, parameters)
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        self.at("measure")?;
        Model::measure(&mut self.mover, measured)
    }

    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        self.at("truth")?;
        Model::truth(&mut self.mover, time_s, command, truth)
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        self.at("advance")?;
        self.advanced += 1;
        Model::advance(&mut self.mover, interval, command)
    }
}

fn fails(call: &'static str, failure: &Failure) -> PlantKind {
    let failure = failure.clone();
    let start = move |_: &[f64]| -> Result<Box<dyn Model>, Invalid> {
        Ok(Box::new(Fails {
            mover: Mover::start(&Parameters::default())?,
            call,
            failure: failure.clone(),
            advanced: 0,
        }))
    };
    PlantKind::from_tables(kind().description, start).expect("sound tables")
}

/// Runs a failing plant; returns the code for the controller, the end and the number of records.
fn end_of(kind: &PlantKind, steps: u64) -> (AbortCode, RunEnd, usize) {
    let (mut engine, mut controller, mut source) = greeted_by(kind, job(steps));
    let end = run(&mut engine, &mut controller, 1.0);
    assert_eq!(end.kind(), Some(FrameKind::Abort));
    let run_end = engine.end().expect("over").clone();
    let records = published(&mut source).0.len();
    (AbortCode::from_wire(end.directive), run_end, records)
}

#[test]
fn a_failure_in_any_call_ends_the_run_at_its_step_with_its_reason() {
    let (diverged, lost) = (
        Failure::diverged("the rod\nbroke"),
        Failure::lost("the library is gone"),
    );
    let [broke, gone] = [
        "plant diverged at step 2 (0.2 s): the rod broke",
        "plant failed at step 2 (0.2 s): the library is gone",
    ];
    for (call, records) in [("retune", 2), ("measure", 2), ("truth", 2), ("advance", 3)] {
        for (failure, reason, code, outcome) in [
            (&diverged, broke, AbortCode::Diverged, Outcome::Diverged),
            (&lost, gone, AbortCode::Other, Outcome::Failed),
        ] {
            let (sent, end, count) = end_of(&fails(call, failure), 9);
            assert_eq!(end.reason.as_deref(), Some(reason), "{call}");
            let actual = (sent, end.outcome, end.steps, count);
            assert_eq!(actual, (code, outcome, 2, records), "{call}");
        }
    }
}

#[test]
fn a_failure_after_the_last_step_ends_the_run_too() {
    for call in ["measure", "truth"] {
        let (_, end, came) = end_of(&fails(call, &Failure::lost("the library is gone")), 2);
        let actual = (end.outcome, end.steps, came);
        assert_eq!(actual, (Outcome::Failed, 2, 2), "{call}");
    }
}

#[test]
fn a_missing_parameter_is_named_before_the_plant_starts() {
    let kind = fails("none", &Failure::lost("never"));
    let Err(missing) = (kind.start)(&Settings::default()) else {
        panic!("started");
    };
    let text = missing.to_string();
    assert!(text.contains("`plant.parameters.gain_m_per_n`"), "{text}");
}

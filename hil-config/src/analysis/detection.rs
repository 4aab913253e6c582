//! Detection and accommodation: the time until a fault is detected and overcome.

use shared_types::time::{Rate, Step};

use super::Figure;
use crate::plan::DetectionPlan;

/// Performance of an alarm.
///
/// An alarm is raised once its expression has held for the hold time: V_3 exceeds V_r for an instant even without a
/// fault (paper, remark 16).
///
/// - time to detect: from the step at which the fault takes effect to the first alarm that begins then or later,
///   including its hold time;
/// - missed: 1 if there was no such alarm, 0 otherwise;
/// - false alarms: number of alarms that began before the fault, including one still active when it takes effect;
/// - time to recover: from the fault to the step from which `recovered` holds until the end;
/// - peak and RMS of the effect: its largest magnitude and its root mean square, from the fault on.
///
/// Without the fault only the false alarms are defined.
#[derive(Clone, Debug)]
pub(super) struct Detection {
    rate: Rate,
    fault: Option<u32>,
    records: u64,
    tells_recovery: bool,
    effect_unit: Option<String>,
    onset: Option<Step>,
    /// Consecutive records at which the alarm held.
    held: u64,
    /// `true` if the first of these records was before the fault.
    is_older: bool,
    false_alarms: u64,
    detected: Option<Step>,
    /// Step after the last step without recovery.
    recovered: Option<Step>,
    is_recovered: bool,
    peak: f64,
    squares: f64,
    rows: u64,
}

impl Detection {
    pub(super) fn new(plan: &DetectionPlan, rate: Rate) -> Self {
        Self {
            rate,
            fault: plan.fault,
            records: plan.records,
            tells_recovery: plan.recovered.is_some(),
            effect_unit: plan.effect.as_ref().map(|(_, unit)| unit.clone()),
            onset: None,
            held: 0,
            is_older: true,
            false_alarms: 0,
            detected: None,
            recovered: None,
            is_recovered: false,
            peak: 0.0,
            squares: 0.0,
            rows: 0,
        }
    }

    /// Records that an event takes effect at a step whose row is still to come.
    pub(super) fn fault(&mut self, event: u32, step: Step) {
        if self.onset.is_none() && self.fault.is_none_or(|target| target == event) {
            (self.onset, self.recovered) = (Some(step), Some(step));
            self.is_older = self.held > 0;
        }
    }

    /// Processes a row. Missing values (NaN) are skipped.
    pub(super) fn take(&mut self, step: Step, alarm: f64, recovered: f64, effect: f64) {
        let mut is_given = false;
        if !alarm.is_nan() {
            self.held = if alarm == 0.0 { 0 } else { self.held + 1 };
            is_given = self.held == self.records;
        }
        self.false_alarms += u64::from(is_given && self.is_older);
        if self.onset.is_none() {
            return;
        }
        if self.held == 0 {
            self.is_older = false;
        }
        if is_given && !self.is_older && self.detected.is_none() {
            self.detected = Some(step);
        }
        if !recovered.is_nan() {
            self.is_recovered = recovered != 0.0;
            if !self.is_recovered {
                self.recovered = Some(step.next());
            }
        }
        if effect.is_finite() {
            let size = effect.abs();
            if size > self.peak {
                self.peak = size;
            }
            self.squares += size * size;
            self.rows += 1;
        }
    }

    pub(super) fn figures(&self) -> Vec<Figure> {
        let since_s = |step: Option<Step>| match (self.onset, step) {
            (Some(onset), Some(step)) => self.rate.seconds(Step(step.0 - onset.0)),
            _ => f64::NAN,
        };
        let missed = match (self.onset, self.detected) {
            (None, _) => f64::NAN,
            (Some(_), Some(_)) => 0.0,
            (Some(_), None) => 1.0,
        };
        let mut figures = vec![
            Figure::new("time_to_detect_s", "s", since_s(self.detected)),
            Figure::new("missed", "1", missed),
            Figure::new("false_alarms", "1", self.false_alarms as f64),
        ];
        if self.tells_recovery {
            let recovered = self.recovered.filter(|_| self.is_recovered);
            figures.push(Figure::new("time_to_recover_s", "s", since_s(recovered)));
        }
        if let Some(unit) = &self.effect_unit {
            let exists = |value: f64| if self.rows > 0 { value } else { f64::NAN };
            let rms = (self.squares / self.rows as f64).sqrt();
            figures.push(Figure::new("peak_effect", unit, exists(self.peak)));
            figures.push(Figure::new("rms_effect", unit, exists(rms)));
        }
        figures
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::Expression;

    /// Figures of a run at 10 Hz in which event 2 takes effect at step 20 of 100; an alarm must hold for 3 records.
    fn figures(
        fault: Option<u32>,
        alarm: impl Fn(u64) -> bool,
        recovered: impl Fn(u64) -> bool,
    ) -> Vec<f64> {
        let any = || Expression::parse("y").expect("an expression");
        let plan = DetectionPlan {
            alarm: any(),
            records: 3,
            fault,
            recovered: Some(any()),
            effect: Some((any(), "N".into())),
        };
        let mut detection = Detection::new(&plan, Rate::new(10.0).expect("a rate"));
        for step in 0..=100 {
            if step == 20 {
                detection.fault(2, Step(20));
            }
            // The effect is 9 before the fault, then alternates between 1 and -7.
            let effect = if step < 20 {
                9.0
            } else {
                [1.0, -7.0][step as usize % 2]
            };
            let truth = |holds: bool| f64::from(u8::from(holds));
            detection.take(
                Step(step),
                truth(alarm(step)),
                truth(recovered(step)),
                effect,
            );
        }
        detection
            .figures()
            .iter()
            .map(|figure| figure.value)
            .collect()
    }

    #[test]
    fn a_fault_is_detected_by_the_first_alarm_that_begins_after_it() {
        type Alarm = fn(u64) -> bool;
        let cases: [(Alarm, f64, f64, f64); 8] = [
            // Two records are too few; then steps 32 to 34.
            (|step| [25, 26].contains(&step) || step >= 32, 1.4, 0.0, 0.0),
            (|_| false, f64::NAN, 1.0, 0.0),
            // Two false alarms and one that is too short; the second never ends.
            (
                |step| [3, 4].contains(&step) || (7..12).contains(&step) || step > 15,
                f64::NAN,
                1.0,
                2.0,
            ),
            // It ends at step 40 and begins anew at step 50.
            (|step| (10..40).contains(&step) || step >= 50, 3.2, 0.0, 1.0),
            // Begun before the fault and raised at it.
            (|step| (18..=20).contains(&step), f64::NAN, 1.0, 1.0),
            // Begun before the fault and too short to be raised.
            (|step| step == 19 || step == 20, f64::NAN, 1.0, 0.0),
            // Begun with the fault.
            (|step| (20..=22).contains(&step), 0.2, 0.0, 0.0),
            (|step| step == 100, f64::NAN, 1.0, 0.0),
        ];
        for (alarm, time_s, missed, false_alarms) in cases {
            let actual = figures(Some(2), alarm, |_| true);
            assert_eq!(actual[0].to_bits(), time_s.to_bits(), "{actual:?}");
            assert_eq!(actual[1..3], [missed, false_alarms]);
        }
    }

    #[test]
    fn recovery_counts_from_the_fault_and_must_persist() {
        let recovers = |recovered: fn(u64) -> bool| figures(None, |_| false, recovered)[3];
        assert_eq!(recovers(|_| true), 0.0);
        assert_eq!(recovers(|step| step >= 30), 1.0);
        assert_eq!(recovers(|step| !(40..50).contains(&step)), 3.0);
        assert!(recovers(|step| step < 100).is_nan());
    }

    #[test]
    fn the_effect_counts_from_the_fault_on() {
        let actual = figures(Some(2), |_| false, |_| true);
        // Steps 20 to 100: 41 times 1 and 40 times 49.
        assert_eq!(actual[4..], [7.0, ((41.0 + 40.0 * 49.0) / 81.0_f64).sqrt()]);
    }

    #[test]
    fn without_the_fault_there_are_only_false_alarms() {
        let actual = figures(Some(1), |step| step % 10 < 3, |_| true);
        let mut exist = actual.iter().map(|value| !value.is_nan());
        assert!(exist.by_ref().eq([false, false, true, false, false, false]));
        assert_eq!(actual[2], 10.0);
    }
}

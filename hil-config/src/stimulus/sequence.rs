//! Waveforms one after the other, each on its own clock.

use serde::{Deserialize, Serialize};
use shared_types::number::exact as number;
use shared_types::time::{Rate, Step};

use super::{Waveform, evaluate};

/// Share of a derivative's largest value by which two parts may differ where they meet.
const TOLERANCE: f64 = 1e-9;
/// Instants at which a part is looked at for the largest value of a derivative.
const INSTANTS: u32 = 33;

/// Waveforms one after the other; after the last one its last value is held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sequence {
    /// Parts, at least one.
    pub parts: Vec<Part>,
    /// Rate of the run, on whose steps the parts begin.
    rate: Rate,
    /// Number of steps of the run.
    steps: u64,
    /// Number of derivatives that exist at every step, to the right.
    derivatives: usize,
}

/// Part of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Length in s, rounded up to whole steps.
    pub length_s: f64,
    /// First step.
    begin: Step,
    /// Waveform; its time is 0 at the first step.
    pub waveform: Waveform,
}

impl Sequence {
    /// Joins waveforms of these lengths for a run of this rate and number of steps.
    pub(crate) fn new(waveforms: Vec<(f64, Waveform)>, rate: Rate, steps: u64) -> Self {
        let mut begin = Step(0);
        let part = |(length_s, waveform): (f64, Waveform)| {
            let part = Part {
                length_s,
                begin,
                waveform,
            };
            begin = Step(begin.0.saturating_add(rate.step_at_or_after(length_s).0));
            part
        };
        let mut sequence = Self {
            parts: waveforms.into_iter().map(part).collect(),
            rate,
            steps,
            derivatives: 0,
        };
        sequence.derivatives = sequence.limit().0;
        sequence
    }

    /// Returns the number of derivatives.
    #[must_use]
    pub const fn derivatives(&self) -> usize {
        self.derivatives
    }

    /// Returns the time at which a part begins, in s.
    pub(crate) fn begin_s(&self, number: usize) -> f64 {
        self.rate.seconds(self.parts[number].begin)
    }

    /// Returns the number of derivatives and what limits it.
    ///
    /// A derivative exists to the right of every step if all parts have it and all lower ones are continuous where two
    /// parts meet.
    pub(crate) fn limit(&self) -> (usize, String) {
        let orders = self.parts.iter().map(|part| part.waveform.derivatives());
        let (place, mut most) = { orders.enumerate() }
            .min_by_key(|(_, order)| *order)
            .unwrap_or_default();
        let mut reason = match most {
            0 => format!("its part {} has none", place + 1),
            _ => format!("its part {} has {most}", place + 1),
        };
        for (place, part) in self.parts.iter().enumerate() {
            let length = self.rate.step_at_or_after(part.length_s).0;
            let end = part.begin.0.saturating_add(length);
            if end >= self.steps {
                break;
            }
            let before = row(&part.waveform, self.rate.seconds(Step(length)));
            let (after, next) = match self.parts.get(place + 1) {
                Some(next) => (row(&next.waveform, 0.0), Some(next)),
                None => {
                    let mut held = vec![0.0; before.len()];
                    held[0] = before[0];
                    (held, None)
                }
            };
            let orders = 0..most;
            for order in orders {
                let mut scale = largest(&part.waveform, part.length_s, order);
                if let Some(next) = next {
                    let other = largest(&next.waveform, next.length_s, order);
                    scale = if other > scale { other } else { scale };
                }
                if (before[order] - after[order]).abs() > TOLERANCE * scale {
                    let what = match order {
                        0 => "value".to_owned(),
                        1 => "slope".to_owned(),
                        order => format!("derivative {order}"),
                    };
                    let (end_s, from, to) =
                        (self.rate.seconds(Step(end)), before[order], after[order]);
                    most = order;
                    reason = format!(
                        "its {what} jumps from {} to {} at {} s, the end of part {}",
                        number(from),
                        number(to),
                        number(end_s),
                        place + 1
                    );
                    break;
                }
            }
        }
        (most, reason)
    }

    pub(super) fn evaluate(&self, time_s: f64, row: &mut [f64]) {
        let rate = self.rate;
        let after = self
            .parts
            .partition_point(|part| rate.seconds(part.begin) <= time_s);
        let Some(part) = self.parts.get(after.saturating_sub(1)) else {
            return;
        };
        // On the grid of the run, so that an edge of the part stays on its step.
        let step = (time_s * rate.hz()).round() as u64 - part.begin.0;
        let length = rate.step_at_or_after(part.length_s).0;
        let is_over = step >= length;
        let step = if is_over { length } else { step };
        let mut values = [0.0; 1 + Waveform::MOST_DERIVATIVES];
        let own = &mut values[..=part.waveform.derivatives()];
        evaluate(&part.waveform, rate.seconds(Step(step)), own);
        if is_over {
            own[1..].fill(0.0);
        }
        row.copy_from_slice(&values[..row.len()]);
    }
}

fn row(waveform: &Waveform, time_s: f64) -> Vec<f64> {
    let mut row = vec![0.0; 1 + waveform.derivatives()];
    evaluate(waveform, time_s, &mut row);
    row
}

/// Returns the largest magnitude of a derivative over a part, at instants that no period repeats.
fn largest(waveform: &Waveform, length_s: f64, order: usize) -> f64 {
    let at = |instant: u32| length_s * (f64::from(instant) + 0.37) / f64::from(INSTANTS);
    let values = (0..INSTANTS).map(|instant| row(waveform, at(instant))[order].abs());
    values.fold(0.0, |most, value| if value > most { value } else { most })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate() -> Rate {
        Rate::new(100.0).expect("legal")
    }

    fn sine(frequency_hz: f64, amplitude: f64) -> Waveform {
        Waveform::Sine {
            amplitude,
            frequency_hz,
            phase_rad: 0.0,
            offset: 0.0,
        }
    }

    fn ramp(start: f64, end: f64) -> Waveform {
        Waveform::Ramp {
            at_s: 0.0,
            duration_s: 0.3,
            start,
            end,
        }
    }

    fn value(sequence: &Sequence, k: u32) -> Vec<f64> {
        let mut row = vec![f64::NAN; 1 + sequence.derivatives()];
        sequence.evaluate(f64::from(k) / 100.0, &mut row);
        row
    }

    #[test]
    fn parts_follow_each_other_on_their_own_clocks_and_the_last_value_is_held() {
        let parts = vec![
            (0.1, sine(10.0, 2.0)),
            (0.3, ramp(0.0, 3.0)),
            (0.2, sine(5.0, 1.0)),
        ];
        let sequence = Sequence::new(parts, rate(), 1000);
        for k in 0..10 {
            let expected = row(&sine(10.0, 2.0), f64::from(k) / 100.0)[0];
            assert_eq!(value(&sequence, k)[0], expected, "step {k}");
        }
        for k in 10..40 {
            let expected = 10.0 * (f64::from(k - 10) / 100.0);
            assert!(
                (value(&sequence, k)[0] - expected).abs() < 1e-12,
                "step {k}"
            );
        }
        // 5 Hz for 0.2 s is one whole period.
        for k in [60, 61, 999] {
            assert!(value(&sequence, k)[0].abs() < 1e-12, "step {k}");
        }
    }

    #[test]
    fn a_sequence_has_the_derivatives_that_exist_where_its_parts_meet() {
        // Two whole periods: value and all even derivatives meet; the slopes, 20 pi a f, do too if a f is the same.
        let smooth = vec![(0.2, sine(10.0, 1.0)), (0.2, sine(5.0, 2.0))];
        let (count, reason) = Sequence::new(smooth.clone(), rate(), 40).limit();
        assert_eq!(count, 3, "{reason}");
        assert!(reason.contains("its derivative 3 jumps"), "{reason}");
        // Held after its end, a sine stops at once.
        assert_eq!(Sequence::new(smooth, rate(), 41).derivatives(), 1);
        let same = vec![(0.2, sine(10.0, 1.0)), (0.1, sine(10.0, 1.0))];
        assert_eq!(Sequence::new(same, rate(), 30).derivatives(), 5);
        let kinked = vec![(0.3, ramp(0.0, 1.0)), (0.3, ramp(1.0, 0.0))];
        assert_eq!(Sequence::new(kinked, rate(), 60).derivatives(), 1);
        let jumps = vec![(0.3, ramp(0.0, 1.0)), (0.3, ramp(0.0, 1.0))];
        let sequence = Sequence::new(jumps, rate(), 60);
        let (count, reason) = sequence.limit();
        assert_eq!(count, 0);
        assert_eq!(
            reason,
            "its value jumps from 1 to 0 at 0.3 s, the end of part 1"
        );
        assert_eq!(value(&sequence, 29).len(), 1);
    }

    #[test]
    fn lengths_that_are_inexact_in_binary_keep_to_their_steps() {
        let step = |after: f64| Waveform::Step {
            at_s: 0.1,
            before: 0.0,
            after,
        };
        let parts = (1..=100).map(|n| (0.3, step(f64::from(n))));
        let sequence = Sequence::new(parts.collect(), rate(), 3000);
        for k in 0..3000 {
            let expected = if k % 30 < 10 {
                0.0
            } else {
                f64::from(1 + k / 30)
            };
            assert_eq!(value(&sequence, k), [expected], "step {k}");
        }
    }
}

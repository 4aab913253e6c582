//! Step response: rise, overshoot and settling of a signal.

use super::Figure;
use crate::plan::StepResponsePlan;

/// Beginning and end of the rise, as fractions of the step.
const RISE: [f64; 2] = [0.1, 0.9];

/// Response to a step from `y_0` to `y_1`, as `p(t) = (y(t) - y_0) / (y_1 - y_0)`, which goes from 0 to 1. The signal
/// is interpolated linearly between samples.
///
/// - rise time: from the first `p = 0.1` to the first `p = 0.9`;
/// - overshoot: `max p - 1`, 0 if `p` never exceeds 1, and the time of that peak since the step;
/// - settling time: from the step until `|p - 1|` stays within the band;
/// - steady-state error: `y - y_1` at the end.
#[derive(Clone, Debug)]
pub(super) struct StepResponse {
    unit: String,
    at_s: f64,
    initial: f64,
    wanted: f64,
    band: f64,
    /// Time and value of the last sample.
    last: Option<(f64, f64)>,
    /// Times at which the rise began and ended.
    risen_s: [Option<f64>; 2],
    /// Largest value and its time.
    peak: (f64, f64),
    settling: Settling,
}

#[derive(Clone, Copy, Debug)]
enum Settling {
    Outside,
    /// Within the band since this time.
    Since(f64),
}

impl StepResponse {
    pub(super) fn new(plan: &StepResponsePlan) -> Self {
        Self {
            unit: plan.unit.clone(),
            at_s: plan.at_s,
            initial: plan.initial,
            wanted: plan.wanted,
            band: plan.band,
            last: None,
            risen_s: [None; 2],
            peak: (f64::NEG_INFINITY, f64::NAN),
            settling: Settling::Outside,
        }
    }

    /// Processes a sample; a missing one, or one before the step, is skipped.
    pub(super) fn take(&mut self, time_s: f64, value: f64) {
        let part = (value - self.initial) / (self.wanted - self.initial);
        if time_s < self.at_s || !part.is_finite() {
            return;
        }
        let before = self.last.replace((time_s, part));
        // Time at which a level between the last two samples was crossed.
        let crossed_s = |level: f64| match before {
            Some((before_s, before)) if before != part => {
                before_s + (level - before) / (part - before) * (time_s - before_s)
            }
            _ => time_s,
        };
        for (risen_s, level) in self.risen_s.iter_mut().zip(RISE) {
            if risen_s.is_none() && part >= level {
                *risen_s = Some(crossed_s(level));
            }
        }
        if part > self.peak.0 {
            self.peak = (part, time_s);
        }
        let is_inside = |part: f64| (part - 1.0).abs() <= self.band;
        self.settling = match (self.settling, is_inside(part)) {
            (_, false) => Settling::Outside,
            (Settling::Since(since_s), true) => Settling::Since(since_s),
            (Settling::Outside, true) => Settling::Since(match before {
                Some((_, before)) if before > 1.0 => crossed_s(1.0 + self.band),
                Some(_) => crossed_s(1.0 - self.band),
                None => time_s,
            }),
        };
    }

    pub(super) fn figures(&self) -> Vec<Figure> {
        let rise_s = match self.risen_s {
            [Some(begun_s), Some(ended_s)] => ended_s - begun_s,
            _ => f64::NAN,
        };
        let (overshoot, peak_s) = match self.peak {
            (part, at_s) if part > 1.0 => (part - 1.0, at_s - self.at_s),
            _ if self.last.is_some() => (0.0, f64::NAN),
            _ => (f64::NAN, f64::NAN),
        };
        let settling_s = match self.settling {
            Settling::Since(since_s) => since_s - self.at_s,
            Settling::Outside => f64::NAN,
        };
        let height = self.wanted - self.initial;
        let error = (self.last).map_or(f64::NAN, |(_, part)| (part - 1.0) * height);
        vec![
            Figure::new("rise_time_s", "s", rise_s),
            Figure::new("overshoot", "1", overshoot),
            Figure::new("peak_time_s", "s", peak_s),
            Figure::new("settling_time_s", "s", settling_s),
            Figure::new("steady_state_error", &self.unit, error),
        ]
    }
}

#[cfg(test)]
mod tests {
    use shared_types::time::Step;

    use super::*;
    use crate::expression::Expression;

    /// Figures of a signal sampled at 10 kHz for 10 s, with its step at 1 s.
    fn figures(initial: f64, target: f64, signal: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut response = StepResponse::new(&StepResponsePlan {
            signal: Expression::parse("y").expect("an expression"),
            unit: "m".into(),
            stimulus: "r".into(),
            at_s: 1.0,
            initial,
            wanted: target,
            band: 0.02,
            last: Step(100_000),
        });
        for k in 0..=100_000 {
            let time_s = f64::from(k) / 1e4;
            response.take(time_s, signal(time_s - 1.0));
        }
        let values = response.figures();
        values.iter().map(|figure| figure.value).collect()
    }

    fn close(actual: f64, expected: f64, within: f64) {
        assert!(
            (actual - expected).abs() < within,
            "{actual}, not {expected}"
        );
    }

    #[test]
    fn a_first_order_lag_rises_in_ln_9_time_constants_and_settles_in_ln_50() {
        let actual = figures(3.0, -1.0, |t| 3.0 - 4.0 * (1.0 - libm::exp(-t / 0.5)));
        close(actual[0], 0.5 * libm::log(9.0), 1e-8);
        assert_eq!(actual[1], 0.0);
        assert!(actual[2].is_nan());
        close(actual[3], 0.5 * libm::log(50.0), 1e-8);
        close(actual[4], 4.0 * libm::exp(-18.0), 1e-12);
    }

    #[test]
    fn an_underdamped_second_order_lag_overshoots_by_the_textbook_value() {
        // y = 1 - exp(-z w t) (cos(w_d t) + z w / w_d sin(w_d t)).
        let (z, w) = (0.5, 4.0);
        let w_d = w * (1.0_f64 - z * z).sqrt();
        let actual = figures(0.0, 1.0, |t| {
            let (sin, cos) = (libm::sin(w_d * t), libm::cos(w_d * t));
            1.0 - libm::exp(-z * w * t) * (cos + z * w / w_d * sin)
        });
        let pi = std::f64::consts::PI;
        close(actual[1], libm::exp(-pi * z / (1.0 - z * z).sqrt()), 1e-7);
        close(actual[2], pi / w_d, 1e-4); // the nearest sample
        // y(t w) reaches 0.1, 0.9 and for the last time 0.98 or 1.02 there, by scipy.optimize.brentq.
        let [begin, ended, settled] = [0.4882292958073818, 2.1258022431357295, 8.076348973927997];
        close(actual[0], (ended - begin) / w, 1e-7);
        close(actual[3], settled / w, 1e-7);
    }

    #[test]
    fn a_signal_that_never_approaches_has_no_rise_and_does_not_settle() {
        let actual = figures(0.0, 1.0, |_| 0.5);
        assert!(actual[0].is_nan() && actual[3].is_nan());
        assert_eq!((actual[1], actual[4]), (0.0, -0.5));
        assert!(
            figures(0.0, 1.0, |_| f64::NAN)
                .iter()
                .all(|figure| figure.is_nan())
        );
    }

    #[test]
    fn a_signal_that_leaves_the_band_again_is_not_settled() {
        let actual = figures(0.0, 1.0, |t| if t > 8.0 { 1.03 } else { 1.0 });
        assert!(actual[3].is_nan());
        let actual = figures(0.0, 1.0, |t| if t < 8.0 { 1.03 } else { 1.0 });
        close(actual[3], 8.0, 1e-4);
    }
}

//! Turns and frequencies of a chirp, as functions of each other.

use std::f64::consts::PI;

use crate::plan::{FrequencyResponsePlan, Sweep};

/// Rising chirp. Turns count from its beginning; [`Sweep`] has the formulas.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chirp {
    start_hz: f64,
    duration_s: f64,
    course: Course,
}

/// Course of the frequency over the sweep.
#[derive(Clone, Copy, Debug)]
enum Course {
    /// Rises by N Hz per second.
    Linear(f64),
    /// Rises by a factor of `e^k` per second.
    Logarithmic(f64),
}

impl Chirp {
    pub(super) fn new(plan: &FrequencyResponsePlan) -> Self {
        let (f_0, f_1, d) = (plan.start_hz, plan.end_hz, plan.duration_s);
        Self {
            start_hz: f_0,
            duration_s: d,
            course: match plan.sweep {
                Sweep::Linear => Course::Linear((f_1 - f_0) / d),
                Sweep::Logarithmic => Course::Logarithmic(libm::log(f_1 / f_0) / d),
            },
        }
    }

    /// Returns the initial frequency.
    pub(super) const fn start_hz(&self) -> f64 {
        self.start_hz
    }

    /// Returns `true` during the sweep.
    pub(super) fn wants(&self, time_s: f64) -> bool {
        time_s <= self.duration_s
    }

    /// Returns the total number of turns.
    pub(super) fn turns(&self) -> f64 {
        self.turns_at(self.duration_s)
    }

    /// Returns the number of turns up to a time.
    pub(super) fn turns_at(&self, time_s: f64) -> f64 {
        let (f_0, t) = (self.start_hz, time_s);
        match self.course {
            Course::Linear(slope) => f_0 * t + 0.5 * slope * t * t,
            Course::Logarithmic(k) => f_0 * libm::expm1(k * t) / k,
        }
    }

    /// Returns the number of turns up to a frequency.
    pub(super) fn turns_to(&self, frequency_hz: f64) -> f64 {
        let (f_0, f) = (self.start_hz, frequency_hz);
        match self.course {
            Course::Linear(slope) => 0.5 * (f * f - f_0 * f_0) / slope,
            Course::Logarithmic(k) => (f - f_0) / k,
        }
    }

    /// Returns the frequency after a number of turns.
    pub(super) fn frequency_hz(&self, turns: f64) -> f64 {
        let f_0 = self.start_hz;
        match self.course {
            Course::Linear(slope) => (f_0 * f_0 + 2.0 * slope * turns).sqrt(),
            Course::Logarithmic(k) => f_0 + k * turns,
        }
    }

    /// Returns the mean frequency between two numbers of turns.
    pub(super) fn mean_frequency_hz(&self, from_turns: f64, until_turns: f64) -> f64 {
        let (from, until) = (
            self.frequency_hz(from_turns),
            self.frequency_hz(until_turns),
        );
        match self.course {
            Course::Linear(_) => 0.5 * (from + until),
            Course::Logarithmic(_) => (until - from) / libm::log(until / from),
        }
    }

    /// Returns the angular frequency at a time in rad/s, and its first three derivatives.
    pub(super) fn angular(&self, time_s: f64) -> [f64; 4] {
        match self.course {
            Course::Linear(slope) => [self.start_hz + slope * time_s, slope, 0.0, 0.0],
            Course::Logarithmic(k) => {
                let f = self.start_hz * libm::exp(k * time_s);
                [f, k * f, k * k * f, k * k * k * f]
            }
        }
        .map(|f| 2.0 * PI * f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::Expression;

    #[test]
    fn turns_are_the_integral_of_the_frequency() {
        for sweep in Sweep::ALL {
            let y = || Expression::parse("y").expect("an expression");
            let chirp = Chirp::new(&FrequencyResponsePlan {
                input: y(),
                output: y(),
                stimulus: "r".into(),
                start_hz: 0.5,
                end_hz: 20.0,
                duration_s: 8.0,
                sweep,
            });
            let mut turns = 0.0;
            for k in 0..8000 {
                let t = (f64::from(k) + 0.5) / 1e3;
                let (now, later) = (chirp.angular(t), chirp.angular(t + 1e-4));
                turns += now[0] / (2.0 * PI) / 1e3;
                for n in 0..3 {
                    let slope = (later[n] - now[n]) / 1e-4;
                    assert!(
                        (slope - now[n + 1]).abs() < 1e-3 * (1.0 + slope.abs()),
                        "{n}"
                    );
                }
            }
            assert!((turns - chirp.turns()).abs() < 1e-4, "{turns}");
            let n = chirp.turns_to(3.0);
            assert!((chirp.frequency_hz(n) - 3.0).abs() < 1e-12);
            assert!((chirp.frequency_hz(turns) - 20.0).abs() < 1e-3);
            // Simpson's rule over the time between 2 and 5 Hz.
            let time_s = |f: f64| match sweep {
                Sweep::Linear => (f - 0.5) / 19.5 * 8.0,
                Sweep::Logarithmic => libm::log(f / 0.5) / libm::log(40.0) * 8.0,
            };
            let (a, b) = (time_s(2.0), time_s(5.0));
            let f = |t: f64| chirp.angular(t)[0] / (2.0 * PI);
            let mean = (f(a) + 4.0 * f(0.5 * (a + b)) + f(b)) / 6.0;
            let actual = chirp.mean_frequency_hz(chirp.turns_to(2.0), chirp.turns_to(5.0));
            assert!((actual / mean - 1.0).abs() < 1e-3, "{actual}, not {mean}");
        }
    }
}

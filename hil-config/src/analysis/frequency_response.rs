//! How a signal follows a chirp: gain, bandwidth, phase lag.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI};

use super::Figure;
use crate::plan::FrequencyResponsePlan;

/// Points at most between the first and the last frequency.
const POINTS: f64 = 512.0;

/// The answer to a linear sweep from `f_0` to `f_1` in `d`, whose phase is
/// `phi(t) = 2 pi (f_0 t + (f_1 - f_0) t^2 / (2 d))`.
///
/// Over a whole number of its turns input and output are each fitted by least squares with
/// `a sin(phi) + b cos(phi) + c`; the ratio of their `a + j b` is the response at the mean
/// frequency of these turns. Exact for a sweep so slow that the signals are in the steady state of
/// each frequency: a resonance must have died away before the sweep has left it.
///
/// - low-frequency gain: that of the first point;
/// - bandwidth: where the gain first falls below `1 / sqrt(2)` of that (-3 dB);
/// - peak gain, as a multiple of the low-frequency gain, and its frequency;
/// - the frequency at which the output first lags by 90 degrees.
///
/// Between points the logarithms of gain and frequency, and the phase over frequency, are straight
/// lines.
#[derive(Clone, Debug)]
pub(super) struct FrequencyResponse {
    start_hz: f64,
    slope_hz_per_s: f64,
    duration_s: f64,
    /// Turns of a point.
    turns: f64,
    points: Vec<Point>,
}

/// The sums of the fits over one point's turns.
#[derive(Clone, Debug, Default)]
struct Point {
    rows: f64,
    sin: f64,
    cos: f64,
    sin_sin: f64,
    sin_cos: f64,
    cos_cos: f64,
    input: Sums,
    output: Sums,
}

#[derive(Clone, Debug, Default)]
struct Sums {
    value: f64,
    value_sin: f64,
    value_cos: f64,
}

/// The response at a frequency.
#[derive(Clone, Copy, Debug)]
struct Response {
    frequency_hz: f64,
    gain: f64,
    /// In rad, without jumps from point to point; negative where the output lags.
    phase_rad: f64,
}

impl FrequencyResponse {
    pub(super) fn new(plan: &FrequencyResponsePlan) -> Self {
        let all = 0.5 * (plan.start_hz + plan.end_hz) * plan.duration_s;
        let turns = libm::ceil(all / POINTS);
        Self {
            start_hz: plan.start_hz,
            slope_hz_per_s: (plan.end_hz - plan.start_hz) / plan.duration_s,
            duration_s: plan.duration_s,
            turns,
            // Points of whole turns only; the check sees to it that there are some.
            points: vec![Point::default(); libm::floor(all / turns) as usize],
        }
    }

    /// Whether a time lies in the sweep.
    pub(super) fn wants(&self, time_s: f64) -> bool {
        time_s <= self.duration_s
    }

    /// Takes a sample of the sweep; one that does not exist is passed over.
    pub(super) fn take(&mut self, time_s: f64, input: f64, output: f64) {
        let turned = self.start_hz * time_s + 0.5 * self.slope_hz_per_s * time_s * time_s;
        let point = libm::floor(turned / self.turns) as usize;
        if let Some(point) = self.points.get_mut(point)
            && input.is_finite()
            && output.is_finite()
        {
            let (sin, cos) = libm::sincos(2.0 * PI * (turned - libm::floor(turned)));
            point.take(sin, cos, input, output);
        }
    }

    /// The mean frequency of a point's turns.
    fn frequency_hz(&self, point: usize) -> f64 {
        // f^2 = f_0^2 + 2 slope turns.
        let at = |turns: f64| {
            let square = self.start_hz * self.start_hz + 2.0 * self.slope_hz_per_s * turns;
            square.sqrt()
        };
        let first = point as f64 * self.turns;
        0.5 * (at(first) + at(first + self.turns))
    }

    fn responses(&self) -> impl Iterator<Item = Response> {
        let mut before_rad = 0.0;
        (self.points.iter().enumerate()).filter_map(move |(index, point)| {
            let (gain, turned_rad) = point.response()?;
            let jumped = libm::round((turned_rad - before_rad) / (2.0 * PI));
            before_rad = turned_rad - 2.0 * PI * jumped;
            Some(Response {
                frequency_hz: self.frequency_hz(index),
                gain,
                phase_rad: before_rad,
            })
        })
    }

    pub(super) fn figures(&self) -> Vec<Figure> {
        let (mut low, mut peak) = (f64::NAN, (f64::NAN, f64::NAN));
        let (mut bandwidth_hz, mut lagging_hz) = (f64::NAN, f64::NAN);
        let mut before: Option<Response> = None;
        for now in self.responses() {
            let first = *before.get_or_insert(now);
            if low.is_nan() {
                low = now.gain;
            }
            if peak.0.is_nan() || now.gain / low > peak.0 {
                peak = (now.gain / low, now.frequency_hz);
            }
            let level = low * FRAC_1_SQRT_2;
            if bandwidth_hz.is_nan() && now.gain < level {
                let part = libm::log(level / first.gain) / libm::log(now.gain / first.gain);
                bandwidth_hz =
                    first.frequency_hz * libm::pow(now.frequency_hz / first.frequency_hz, part);
            }
            if lagging_hz.is_nan() && now.phase_rad <= -FRAC_PI_2 {
                let part = if now.phase_rad < first.phase_rad {
                    (-FRAC_PI_2 - first.phase_rad) / (now.phase_rad - first.phase_rad)
                } else {
                    0.0 // the first point
                };
                lagging_hz = first.frequency_hz + part * (now.frequency_hz - first.frequency_hz);
            }
            before = Some(now);
        }
        vec![
            Figure::new("low_frequency_gain", "1", low),
            Figure::new("bandwidth_hz", "Hz", bandwidth_hz),
            Figure::new("peak_gain", "1", peak.0),
            Figure::new("peak_frequency_hz", "Hz", peak.1),
            Figure::new("phase_lag_90_frequency_hz", "Hz", lagging_hz),
        ]
    }
}

impl Point {
    fn take(&mut self, sin: f64, cos: f64, input: f64, output: f64) {
        self.rows += 1.0;
        self.sin += sin;
        self.cos += cos;
        self.sin_sin += sin * sin;
        self.sin_cos += sin * cos;
        self.cos_cos += cos * cos;
        for (sums, value) in [(&mut self.input, input), (&mut self.output, output)] {
            sums.value += value;
            sums.value_sin += value * sin;
            sums.value_cos += value * cos;
        }
    }

    /// Gain and phase; `None` if there was too little to fit.
    fn response(&self) -> Option<(f64, f64)> {
        let (a, b) = self.fit(&self.input)?;
        let (c, d) = self.fit(&self.output)?;
        let square = a * a + b * b;
        // (c + j d) / (a + j b)
        let (real, imaginary) = ((c * a + d * b) / square, (d * a - c * b) / square);
        let gain = libm::hypot(real, imaginary);
        (square > 0.0 && gain.is_finite()).then(|| (gain, libm::atan2(imaginary, real)))
    }

    /// a and b of `a sin + b cos + c`, by the normal equations without their means.
    fn fit(&self, sums: &Sums) -> Option<(f64, f64)> {
        let n = self.rows;
        let without_mean = |products: f64, one: f64, other: f64| products - one * other / n;
        let ss = without_mean(self.sin_sin, self.sin, self.sin);
        let sc = without_mean(self.sin_cos, self.sin, self.cos);
        let cc = without_mean(self.cos_cos, self.cos, self.cos);
        let vs = without_mean(sums.value_sin, sums.value, self.sin);
        let vc = without_mean(sums.value_cos, sums.value, self.cos);
        let determinant = ss * cc - sc * sc;
        // Far from it for the eight samples and more of a turn.
        (n >= 4.0 && determinant > 1e-6 * n * n).then(|| {
            (
                (vs * cc - vc * sc) / determinant,
                (vc * ss - vs * sc) / determinant,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::Expression;

    const SWEEP: (f64, f64, f64) = (0.05, 6.0, 600.0);

    /// Figures of a linear system under a slow sweep: in its steady state at each frequency.
    fn figures(offset: f64, system: impl Fn(f64) -> (f64, f64)) -> Vec<f64> {
        let (start_hz, end_hz, duration_s) = SWEEP;
        let y = || Expression::parse("y").expect("an expression");
        let mut response = FrequencyResponse::new(&FrequencyResponsePlan {
            input: y(),
            output: y(),
            stimulus: "r".into(),
            start_hz,
            end_hz,
            duration_s,
        });
        for k in 0..=600_000 {
            let t = f64::from(k) / 1e3;
            let frequency_hz = start_hz + (end_hz - start_hz) * t / duration_s;
            let turned = start_hz * t + 0.5 * (end_hz - start_hz) * t * t / duration_s;
            let (gain, phase_rad) = system(2.0 * PI * frequency_hz);
            let angle = 2.0 * PI * turned;
            let (input, output) = (libm::sin(angle), gain * libm::sin(angle + phase_rad));
            response.take(t, 0.3 * input + 7.0, 0.3 * output - offset);
        }
        response
            .figures()
            .iter()
            .map(|figure| figure.value)
            .collect()
    }

    fn near(found: f64, expected: f64) {
        let off = (found / expected - 1.0).abs();
        assert!(off < 5e-3, "{found}, not {expected}");
    }

    #[test]
    fn a_first_order_lag_has_its_bandwidth_at_one_over_its_time_constant() {
        let w_c = 2.0 * PI * 3.0;
        let found = figures(5.0, |w| {
            let ratio = w / w_c;
            (2.0 / libm::hypot(1.0, ratio), -libm::atan(ratio))
        });
        near(found[0], 2.0);
        near(found[1], 3.0);
        near(found[2], 1.0);
        assert!(found[4].is_nan(), "it never lags by 90 degrees");
    }

    #[test]
    fn a_resonance_peaks_and_lags_by_90_degrees_at_its_natural_frequency() {
        // H = 1 / (1 - r^2 + 2 j z r): peak 1 / (2 z sqrt(1 - z^2)) at r = sqrt(1 - 2 z^2).
        let (z, f_n): (f64, f64) = (0.2, 3.0);
        let found = figures(-2.0, |w| {
            let r = w / (2.0 * PI * f_n);
            let (real, imaginary) = (1.0 - r * r, 2.0 * z * r);
            (
                1.0 / libm::hypot(real, imaginary),
                -libm::atan2(imaginary, real),
            )
        });
        near(found[0], 1.0);
        // |H| = 1 / sqrt(2): r^2 = 1 - 2 z^2 + sqrt((1 - 2 z^2)^2 + 1).
        let q = 1.0 - 2.0 * z * z;
        near(found[1], f_n * (q + (q * q + 1.0).sqrt()).sqrt());
        near(found[2], 1.0 / (2.0 * z * (1.0 - z * z).sqrt()));
        near(found[3], f_n * q.sqrt());
        near(found[4], f_n);
    }

    #[test]
    fn a_pure_delay_turns_its_phase_without_end() {
        // Lags by 90 degrees where the delay is a quarter of a period.
        let found = figures(0.0, |w| (1.0, -w * 0.5));
        near(found[4], 0.5);
        assert!(found[1].is_nan(), "its gain never falls");
    }

    #[test]
    fn a_signal_that_does_not_exist_has_no_figures() {
        let found = figures(f64::NAN, |_| (1.0, 0.0));
        assert!(found.iter().all(|figure| figure.is_nan()));
    }
}

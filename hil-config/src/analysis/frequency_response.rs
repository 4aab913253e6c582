//! Frequency response: gain, bandwidth and phase lag of a signal that follows a chirp.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI};

use super::Figure;
use super::chirp::Chirp;
use super::low_end::LowEnd;
use super::sine_fit::SineFit;
use crate::plan::FrequencyResponsePlan;

/// Ratio of the last to the first frequency of a point, if a whole number of turns allows it.
const RATIO: f64 = 1.01;

/// Response to a chirp of phase `phi(t)`.
///
/// Over whole turns, at least one and as many as raise the frequency by a hundredth, input and output are each fitted
/// by least squares with `a sin(phi) + b cos(phi) + c`; the ratio of their `a + j b` is the response at the mean
/// frequency of these turns. The result is accurate if the signals are in the steady state of each frequency: a
/// resonance must have decayed before the sweep has left it. The response at the first frequency comes from the [low
/// end](LowEnd).
///
/// - low-frequency gain: the gain at the first frequency;
/// - bandwidth: the frequency at which the gain first falls below the low-frequency gain times `1 / sqrt(2)` (-3 dB);
/// - peak gain, as a multiple of the low-frequency gain, and its frequency, from the parabola through the largest gain
///   and its neighbours;
/// - the frequency at which the output first lags by 90 degrees.
///
/// Between points the logarithm of the gain, and the phase, are interpolated linearly over frequency.
#[derive(Clone, Debug)]
pub(super) struct FrequencyResponse {
    chirp: Chirp,
    low_end: LowEnd,
    points: Vec<Point>,
    /// Index of the last sample's point.
    at: usize,
}

/// Fit over the turns of one point.
#[derive(Clone, Debug, Default)]
struct Point {
    /// First and last turn.
    turns: [f64; 2],
    fit: SineFit,
}

/// Response at a frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Frequency.
    pub frequency_hz: f64,
    /// Ratio of the amplitudes of output and input.
    pub gain: f64,
    /// Unwrapped phase in rad; negative where the output lags.
    pub phase_rad: f64,
}

impl FrequencyResponse {
    pub(super) fn new(plan: &FrequencyResponsePlan) -> Self {
        let chirp = Chirp::new(plan);
        let (all, mut points) = (chirp.turns(), Vec::new());
        let mut first = 0.0;
        loop {
            let last = match libm::floor(chirp.turns_to(RATIO * chirp.frequency_hz(first))) {
                turns if turns > first + 1.0 => turns,
                _ => first + 1.0,
            };
            if last > all {
                break;
            }
            points.push(Point {
                turns: [first, last],
                ..Point::default()
            });
            first = last;
        }
        Self {
            chirp,
            low_end: LowEnd::new(chirp),
            points,
            at: 0,
        }
    }

    /// Returns `true` if a time lies in the sweep.
    pub(super) fn wants(&self, time_s: f64) -> bool {
        self.chirp.wants(time_s)
    }

    /// Processes a sample of the sweep; times ascend. A missing sample is skipped.
    pub(super) fn take(&mut self, time_s: f64, input: f64, output: f64) {
        if !(input.is_finite() && output.is_finite()) {
            return;
        }
        let turns = self.chirp.turns_at(time_s);
        let (sin, cos) = libm::sincos(2.0 * PI * (turns - libm::floor(turns)));
        (self.low_end).take(time_s, (turns, sin, cos), input, output);
        while (self.points.get(self.at)).is_some_and(|point| turns >= point.turns[1]) {
            self.at += 1;
        }
        if let Some(point) = self.points.get_mut(self.at) {
            point.fit.take(sin, cos, [input, output]);
        }
    }

    /// Returns the response at the first frequency, followed by that of each point.
    pub(super) fn responses(&self) -> Vec<Response> {
        let low = self.low_end.response().map(|(real, imaginary)| Response {
            frequency_hz: self.chirp.start_hz(),
            gain: libm::hypot(real, imaginary),
            phase_rad: libm::atan2(imaginary, real),
        });
        let points = self.points.iter().filter_map(|point| {
            let (gain, phase_rad) = point.fit.response()?;
            let [from, until] = point.turns;
            Some(Response {
                frequency_hz: self.chirp.mean_frequency_hz(from, until),
                gain,
                phase_rad,
            })
        });
        let mut responses: Vec<Response> = low.into_iter().chain(points).collect();
        let mut before_rad = 0.0;
        for response in &mut responses {
            let jumped = libm::round((response.phase_rad - before_rad) / (2.0 * PI));
            response.phase_rad -= 2.0 * PI * jumped;
            before_rad = response.phase_rad;
        }
        responses
    }

    pub(super) fn figures(&self) -> Vec<Figure> {
        let responses = self.responses();
        let low = responses.first().map_or(f64::NAN, |first| first.gain);
        let level = low * FRAC_1_SQRT_2;
        let bandwidth_hz = first_hz(
            &responses,
            |now| now.gain < level,
            |[before, now]| libm::log(level / before.gain) / libm::log(now.gain / before.gain),
        );
        let lagging_hz = first_hz(
            &responses,
            |now| now.phase_rad <= -FRAC_PI_2,
            |[before, now]| (-FRAC_PI_2 - before.phase_rad) / (now.phase_rad - before.phase_rad),
        );
        let (peak, peak_hz) = peak(&responses);
        vec![
            Figure::new("low_frequency_gain", "1", low),
            Figure::new("bandwidth_hz", "Hz", bandwidth_hz),
            Figure::new("peak_gain", "1", peak / low),
            Figure::new("peak_frequency_hz", "Hz", peak_hz),
            Figure::new("phase_lag_90_frequency_hz", "Hz", lagging_hz),
        ]
    }
}

/// Interpolates the frequency at which a condition first holds, which is the fraction `part` of the way from the
/// preceding response; NaN if the condition never holds.
fn first_hz(
    responses: &[Response],
    holds: impl Fn(&Response) -> bool,
    part: impl Fn([&Response; 2]) -> f64,
) -> f64 {
    match responses.iter().position(holds) {
        None => f64::NAN,
        Some(0) => responses[0].frequency_hz,
        Some(place) => {
            let (before, now) = (&responses[place - 1], &responses[place]);
            let way_hz = now.frequency_hz - before.frequency_hz;
            before.frequency_hz + part([before, now]) * way_hz
        }
    }
}

/// Returns the largest gain and its frequency; NaN for no responses.
fn peak(responses: &[Response]) -> (f64, f64) {
    let more = |best: usize, now: usize| {
        let is_more = responses[now].gain > responses[best].gain;
        if is_more { now } else { best }
    };
    let Some(largest) = (0..responses.len()).reduce(more) else {
        return (f64::NAN, f64::NAN);
    };
    let Response {
        frequency_hz, gain, ..
    } = responses[largest];
    if largest == 0 || largest + 1 == responses.len() {
        return (gain, frequency_hz);
    }
    // z = c x + d x^2, with x and z relative to the largest.
    let from_largest = |of: &Response| (of.frequency_hz - frequency_hz, of.gain - gain);
    let (a, z_a) = from_largest(&responses[largest - 1]);
    let (b, z_b) = from_largest(&responses[largest + 1]);
    let d = (z_b / b - z_a / a) / (b - a);
    let c = z_a / a - d * a;
    if d < 0.0 {
        let x = -0.5 * c / d;
        (gain + 0.5 * c * x, frequency_hz + x)
    } else {
        (gain, frequency_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::Expression;
    use crate::plan::Sweep;

    fn plan(sweep: Sweep, [start_hz, end_hz]: [f64; 2], duration_s: f64) -> FrequencyResponsePlan {
        let y = || Expression::parse("y").expect("an expression");
        FrequencyResponsePlan {
            input: y(),
            output: y(),
            stimulus: "r".into(),
            start_hz,
            end_hz,
            duration_s,
            sweep,
        }
    }

    fn values(response: &FrequencyResponse) -> Vec<f64> {
        let figures = response.figures();
        figures.iter().map(|figure| figure.value).collect()
    }

    /// Figures of a linear system under a slow sweep, in its steady state at each frequency.
    fn figures(offset: f64, system: impl Fn(f64) -> (f64, f64)) -> Vec<f64> {
        let (start_hz, end_hz, duration_s) = (0.05, 6.0, 600.0);
        let plan = plan(Sweep::Linear, [start_hz, end_hz], duration_s);
        let mut response = FrequencyResponse::new(&plan);
        for k in 0..=600_000 {
            let t = f64::from(k) / 1e3;
            let frequency_hz = start_hz + (end_hz - start_hz) * t / duration_s;
            let turned = start_hz * t + 0.5 * (end_hz - start_hz) * t * t / duration_s;
            let (gain, phase_rad) = system(2.0 * PI * frequency_hz);
            let angle = 2.0 * PI * turned;
            let (input, output) = (libm::sin(angle), gain * libm::sin(angle + phase_rad));
            response.take(t, 0.3 * input + 7.0, 0.3 * output - offset);
        }
        values(&response)
    }

    /// Value of the chirp at a time, by an independent formula.
    fn wave(sweep: Sweep, [f_0, f_1]: [f64; 2], d: f64, t: f64) -> f64 {
        let turns = match sweep {
            Sweep::Linear => f_0 * t + 0.5 * (f_1 - f_0) * t * t / d,
            Sweep::Logarithmic => {
                let l = d / libm::log(f_1 / f_0);
                f_0 * l * (libm::exp(t / l) - 1.0)
            }
        };
        libm::sin(2.0 * PI * turns)
    }

    /// Closed loop of the teaching plant, `m = 1`, `c = 2`, `k = 100`, under its `pid` with 300, 2000 and 30:
    /// `(k_d s^2 + k_p s + k_i) / (m s^3 + (c + k_d) s^2 + (k + k_p) s + k_i)`, lowest power first.
    const NUMERATOR: [f64; 3] = [2000.0, 300.0, 30.0];
    const DENOMINATOR: [f64; 4] = [2000.0, 400.0, 32.0, 1.0];

    fn loop_gain(frequency_hz: f64) -> f64 {
        let w = 2.0 * PI * frequency_hz;
        let size = |of: &[f64]| {
            let at = |n: usize| of.get(n).copied().unwrap_or(0.0);
            libm::hypot(at(0) - at(2) * w * w, at(1) * w - at(3) * w * w * w)
        };
        size(&NUMERATOR) / size(&DENOMINATOR)
    }

    /// Computes low-frequency gain, bandwidth, peak and frequency of the peak from the formula alone.
    fn loop_figures(start_hz: f64) -> [f64; 4] {
        let low = loop_gain(start_hz);
        let grid = || (0..100_000).map(|k| start_hz + 1e-4 * f64::from(k));
        let bandwidth_hz = grid().find(|f| loop_gain(*f) < low * FRAC_1_SQRT_2);
        let more = |best: f64, f: f64| {
            if loop_gain(f) > loop_gain(best) {
                f
            } else {
                best
            }
        };
        let (bandwidth_hz, peak_hz) = (bandwidth_hz.unwrap(), grid().reduce(more).unwrap());
        [low, bandwidth_hz, loop_gain(peak_hz) / low, peak_hz]
    }

    /// Figures of a sweep of the loop from rest, integrated in steps of 1 ms by the classic Runge-Kutta method; its
    /// state is the input filtered by `1 / DENOMINATOR`, and two derivatives of that.
    fn swept(sweep: Sweep, span_hz: [f64; 2], duration_s: f64) -> Vec<f64> {
        let rates = |x: [f64; 3], r: f64| {
            let [a, b, c, _] = DENOMINATOR;
            [x[1], x[2], r - c * x[2] - b * x[1] - a * x[0]]
        };
        let moved = |x: [f64; 3], by: [f64; 3], h: f64| std::array::from_fn(|i| x[i] + h * by[i]);
        let mut response = FrequencyResponse::new(&plan(sweep, span_hz, duration_s));
        let (h, mut x) = (1e-3, [0.0; 3]);
        for k in 0..=(1e3 * duration_s) as u32 {
            let t = f64::from(k) * h;
            let r = |t| wave(sweep, span_hz, duration_s, t);
            let y: f64 = x.iter().zip(NUMERATOR).map(|(x, n)| x * n).sum();
            response.take(t, r(t), y);
            let middle = r(t + 0.5 * h);
            let k_1 = rates(x, r(t));
            let k_2 = rates(moved(x, k_1, 0.5 * h), middle);
            let k_3 = rates(moved(x, k_2, 0.5 * h), middle);
            let k_4 = rates(moved(x, k_3, h), r(t + h));
            for i in 0..3 {
                x[i] += h / 6.0 * (k_1[i] + 2.0 * (k_2[i] + k_3[i]) + k_4[i]);
            }
        }
        values(&response)
    }

    /// Relative errors of the first four figures.
    fn errors(sweep: Sweep, span_hz: [f64; 2], duration_s: f64) -> Vec<f64> {
        let actual = swept(sweep, span_hz, duration_s);
        let pairs = actual.iter().zip(loop_figures(span_hz[0]));
        pairs
            .map(|(actual, expected)| actual / expected - 1.0)
            .collect()
    }

    #[test]
    fn a_sweep_of_400_s_identifies_the_loop_of_the_teaching_plant_within_half_a_percent() {
        for span_hz in [
            [0.05, 10.0],
            [0.1, 20.0],
            [0.2, 20.0],
            [0.2, 40.0],
            [0.1, 40.0],
        ] {
            for sweep in Sweep::ALL {
                let errors = errors(sweep, span_hz, 400.0);
                let is_near = errors.iter().all(|error| error.abs() < 5e-3);
                assert!(is_near, "{sweep:?} {span_hz:?}: {errors:?}");
            }
        }
    }

    #[test]
    fn a_shorter_sweep_errs_no_more_than_documented() {
        for (sweep, duration_s, largest) in [
            (Sweep::Linear, 25.0, 0.04),
            (Sweep::Linear, 100.0, 0.007),
            (Sweep::Logarithmic, 25.0, 0.025),
            (Sweep::Logarithmic, 100.0, 0.006),
        ] {
            let errors = errors(sweep, [0.1, 20.0], duration_s);
            let are_so = errors.iter().all(|error| error.abs() < largest)
                && errors.iter().any(|error| error.abs() > 0.5 * largest);
            assert!(are_so, "{sweep:?} {duration_s}: {errors:?}");
        }
    }

    fn near(actual: f64, expected: f64) {
        let off = (actual / expected - 1.0).abs();
        assert!(off < 5e-3, "{actual}, not {expected}");
    }

    #[test]
    fn a_first_order_lag_has_its_bandwidth_at_one_over_its_time_constant() {
        let w_c = 2.0 * PI * 3.0;
        let actual = figures(5.0, |w| {
            let ratio = w / w_c;
            (2.0 / libm::hypot(1.0, ratio), -libm::atan(ratio))
        });
        near(actual[0], 2.0);
        near(actual[1], 3.0);
        near(actual[2], 1.0);
        assert!(actual[4].is_nan(), "it never lags by 90 degrees");
    }

    #[test]
    fn a_resonance_peaks_and_lags_by_90_degrees_at_its_natural_frequency() {
        // H = 1 / (1 - r^2 + 2 j z r): peak 1 / (2 z sqrt(1 - z^2)) at r = sqrt(1 - 2 z^2).
        let (z, f_n): (f64, f64) = (0.2, 3.0);
        let actual = figures(-2.0, |w| {
            let r = w / (2.0 * PI * f_n);
            let (real, imaginary) = (1.0 - r * r, 2.0 * z * r);
            (
                1.0 / libm::hypot(real, imaginary),
                -libm::atan2(imaginary, real),
            )
        });
        near(actual[0], 1.0);
        // |H| = 1 / sqrt(2): r^2 = 1 - 2 z^2 + sqrt((1 - 2 z^2)^2 + 1).
        let q = 1.0 - 2.0 * z * z;
        near(actual[1], f_n * (q + (q * q + 1.0).sqrt()).sqrt());
        near(actual[2], 1.0 / (2.0 * z * (1.0 - z * z).sqrt()));
        near(actual[3], f_n * q.sqrt());
        near(actual[4], f_n);
    }

    #[test]
    fn a_pure_delay_turns_its_phase_without_end() {
        // Lags by 90 degrees where the delay is a quarter of a period.
        let actual = figures(0.0, |w| (1.0, -w * 0.5));
        near(actual[4], 0.5);
        assert!(actual[1].is_nan(), "its gain never falls");
    }

    #[test]
    fn a_missing_signal_has_no_figures() {
        let actual = figures(f64::NAN, |_| (1.0, 0.0));
        assert!(actual.iter().all(|figure| figure.is_nan()));
    }
}

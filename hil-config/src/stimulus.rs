//! Stimuli: reference signals and driven inputs as functions of time.
//!
//! Called by the engine at every step for every stimulus of the scenario. A stimulus depends on time alone; it has no
//! access to the plant, keeps no state and never allocates. Derivatives are exact: truncated Taylor arithmetic, no
//! differences.

mod multisine;
mod prbs;
mod pulse;
mod sequence;
mod taylor;

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use self::taylor::Taylor;
use crate::table::Table;

pub use self::multisine::Multisine;
pub(crate) use self::multisine::schroeder;
pub use self::prbs::Prbs;
pub use self::pulse::{Pulse, Square};
pub use self::sequence::{Part, Sequence};

/// Waveform of a reference signal. Sizes are in the target's unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Waveform {
    /// `atan(a sin(2 pi f t)) (1 - exp(-c t^3))`, section 4 of the paper with a = 0.2, f = 1, c = 0.1.
    Paper {
        /// a.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// c in 1/s^3.
        onset_per_s3: f64,
    },
    /// `before` until `at_s`, then `after`.
    Step {
        /// Time of the step in s.
        at_s: f64,
        /// Value before.
        before: f64,
        /// Value after.
        after: f64,
    },
    /// `start` until `at_s`, then a constant slope up to `end`, then `end`.
    Ramp {
        /// Beginning in s.
        at_s: f64,
        /// Length in s, above 0.
        duration_s: f64,
        /// Value before.
        start: f64,
        /// Value after.
        end: f64,
    },
    /// `offset + amplitude sin(2 pi f t + phase)`.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// Phase in rad.
        phase_rad: f64,
        /// Offset.
        offset: f64,
    },
    /// `offset + amplitude sin(2 pi n(t))`: a sweep from f0 to f1 in `duration_s`, then constant f1 without a phase
    /// jump. [`Sweep`] has the turns n.
    Chirp {
        /// Amplitude.
        amplitude: f64,
        /// f0 in Hz.
        start_hz: f64,
        /// f1 in Hz.
        end_hz: f64,
        /// d in s, above 0.
        duration_s: f64,
        /// Offset.
        offset: f64,
        /// Course of the frequency from f0 to f1.
        #[serde(default, skip_serializing_if = "Sweep::is_linear")]
        sweep: Sweep,
    },
    /// Two levels in a fixed rhythm.
    Square(Square),
    /// Single pulse, or a train of pulses.
    Pulse(Pulse),
    /// Binary sequence of maximal length.
    Prbs(Prbs),
    /// Sum of sines.
    Multisine(Multisine),
    /// Waveforms one after the other.
    Sequence(Sequence),
    /// Rows over time and the course between them.
    Table(Table),
}

/// Course of a chirp's frequency from f0 to f1 in d, and the number of turns at time t.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// `f0 + (f1 - f0) t / d`; `n = f0 t + (f1 - f0) t^2 / (2 d)`.
    #[default]
    Linear,
    /// `f0 e^(k t)` with `k = ln(f1 / f0) / d`; `n = f0 (e^(k t) - 1) / k`. Both frequencies are above 0 and differ.
    Logarithmic,
}

impl Sweep {
    /// Every sweep.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Logarithmic];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Logarithmic => "logarithmic",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
    fn is_linear(&self) -> bool {
        *self == Self::Linear
    }
}

impl Waveform {
    /// Returns its table over time, or those of its parts.
    pub(crate) fn tables_mut(&mut self) -> Vec<&mut Table> {
        match self {
            Self::Table(table) => vec![table],
            Self::Sequence(sequence) => (sequence.parts.iter_mut())
                .flat_map(|part| part.waveform.tables_mut())
                .collect(),
            _ => Vec::new(),
        }
    }

    /// Highest derivative of any waveform.
    pub const MOST_DERIVATIVES: usize = 5;

    /// Returns the number of time derivatives that are sent with the signal: those that exist everywhere, and for
    /// a table those to the right.
    #[must_use]
    pub fn derivatives(&self) -> usize {
        match self {
            Self::Paper { .. } | Self::Sine { .. } | Self::Chirp { .. } | Self::Multisine(_) => 5,
            Self::Table(table) => table.derivatives(),
            Self::Ramp { .. } => 1,
            Self::Step { .. } | Self::Square(_) | Self::Pulse(_) | Self::Prbs(_) => 0,
            Self::Sequence(sequence) => sequence.derivatives(),
        }
    }
}

/// Writes the value and the time derivatives of a waveform in ascending order.
///
/// # Panics
/// If the row does not have `1 + waveform.derivatives()` numbers.
pub fn evaluate(waveform: &Waveform, time_s: f64, row: &mut [f64]) {
    match waveform {
        Waveform::Paper {
            amplitude,
            frequency_hz,
            onset_per_s3,
        } => {
            let t = Taylor::time(time_s);
            let deflection = sine(t * *frequency_hz, 0.0, *amplitude).atan();
            let onset = -(t * t * t * -onset_per_s3).exp_m1();
            row.copy_from_slice(&(deflection * onset).derivatives());
        }
        Waveform::Sine {
            amplitude,
            frequency_hz,
            phase_rad,
            offset,
        } => {
            let turns = Taylor::time(time_s) * *frequency_hz;
            let wave = sine(turns, *phase_rad, *amplitude) + *offset;
            row.copy_from_slice(&wave.derivatives());
        }
        Waveform::Chirp {
            amplitude,
            start_hz,
            end_hz,
            duration_s,
            sweep,
            offset,
        } => {
            let turns = chirp_turns(time_s, *sweep, [*start_hz, *end_hz], *duration_s);
            let wave = sine(turns, 0.0, *amplitude) + *offset;
            row.copy_from_slice(&wave.derivatives());
        }
        Waveform::Step {
            at_s,
            before,
            after,
        } => row.copy_from_slice(&[if time_s < *at_s { *before } else { *after }]),
        Waveform::Ramp {
            at_s,
            duration_s,
            start,
            end,
        } => row.copy_from_slice(&ramp(time_s - at_s, *duration_s, *start, *end)),
        Waveform::Square(square) => row.copy_from_slice(&[square.at(time_s)]),
        Waveform::Pulse(pulse) => row.copy_from_slice(&[pulse.at(time_s)]),
        Waveform::Prbs(prbs) => row.copy_from_slice(&[prbs.at(time_s)]),
        Waveform::Multisine(sum) => row.copy_from_slice(&sum.at(time_s).derivatives()),
        Waveform::Sequence(sequence) => sequence.evaluate(time_s, row),
        Waveform::Table(table) => table.evaluate(time_s, row),
    }
}

/// Computes `amplitude sin(2 pi turns + phase)`.
///
/// Whole turns are removed before the multiplication by 2 pi, which would otherwise round the angle of a long run ever
/// more coarsely.
fn sine(turns: Taylor, phase_rad: f64, amplitude: f64) -> Taylor {
    let whole = turns.value().floor();
    ((turns + -whole) * TAU + phase_rad).sin() * amplitude
}

/// Returns the turns of a [`Sweep`] up to `d`, followed by a constant `f1`.
fn chirp_turns(time_s: f64, sweep: Sweep, [f_0, f_1]: [f64; 2], duration_s: f64) -> Taylor {
    let d = duration_s;
    let t = Taylor::time(time_s);
    match sweep {
        Sweep::Linear if time_s < d => t * f_0 + t * t * ((f_1 - f_0) / (2.0 * d)),
        // The sweep ends at (f0 + f1) d / 2 turns; f1 (t - d) more.
        Sweep::Linear => t * f_1 + 0.5 * (f_0 - f_1) * d,
        Sweep::Logarithmic => {
            let k = libm::log(f_1 / f_0) / d;
            if time_s < d {
                (t * k).exp_m1() * (f_0 / k)
            } else {
                // The sweep ends at (f1 - f0) / k turns.
                t * f_1 + ((f_1 - f_0) / k - f_1 * d)
            }
        }
    }
}

/// Returns value and slope to the right of a ramp, `since_s` after its beginning.
fn ramp(since_s: f64, duration_s: f64, start: f64, end: f64) -> [f64; 2] {
    if since_s < 0.0 {
        [start, 0.0]
    } else if since_s < duration_s {
        let slope = (end - start) / duration_s;
        [start + slope * since_s, slope]
    } else {
        [end, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(waveform: &Waveform, time_s: f64) -> Vec<f64> {
        let mut row = vec![f64::NAN; 1 + waveform.derivatives()];
        evaluate(waveform, time_s, &mut row);
        row
    }

    /// Compares with 50-digit numbers; the n-th derivative may deviate by the rounding of a quantity of size `amplitude
    /// (2 pi f)^n`.
    fn assert_close(row: &[f64], expected: &[f64; 6], amplitude: f64, frequency_hz: f64) {
        let mut scale = amplitude;
        for (n, (actual, want)) in row.iter().zip(expected).enumerate() {
            let error = (actual - want).abs();
            assert!(error < 1e-14 * scale, "order {n}: {actual} is not {want}");
            scale *= TAU * frequency_hz;
        }
    }

    const PAPER: Waveform = Waveform::Paper {
        amplitude: 0.2,
        frequency_hz: 1.0,
        onset_per_s3: 0.1,
    };

    // mpmath 1.3, mp.dps = 60, [diff(f, t, n) for n in range(6)] with
    // f = lambda t: atan(mpf(0.2) * sin(2 * pi * t)) * (1 - exp(-mpf(0.1) * t**3))
    #[test]
    fn the_papers_command_has_exact_derivatives() {
        #[rustfmt::skip]
        let expected = [
            (0.375, [0.000738913641758171, 0.0013138544991796563, -0.07183956671650436,
                -1.0504208716213228, -2.854548989062207, 94.98773533743531]),
            (1.5625, [-0.02422583967853021, -0.4042572584755465, -0.15810583523197633,
                18.82492575631993, 40.24040385392312, -1120.807822003715]),
            (7.0, [0.0, 1.2566370614359157, 4.6909031360259986e-14,
                -53.57884610355904, 1.5094775140055598e-11, 3600.5541664590833]),
            (19.984375, [-0.01960091748227915, 1.250105601939104, 0.8348860876912019,
                -53.14117560578409, -55.785833926573325, 3510.0957723377387]),
        ];
        for (time_s, expected) in &expected {
            assert_close(&row(&PAPER, *time_s), expected, 0.2, 1.0);
        }
    }

    #[test]
    fn the_papers_command_stays_accurate_at_the_onset() {
        // The same expression at t = 2^-10 s, where 1 - exp(-c t^3) is 9e-11.
        #[rustfmt::skip]
        let expected = [1.1428970040255548e-13, 4.681290265901886e-10, 1.4380826237158157e-06,
            0.0029451433140580173, 3.015622366498821, -0.627873424330592];
        for (actual, want) in row(&PAPER, 0.0009765625).iter().zip(&expected) {
            assert!(
                (actual / want - 1.0).abs() < 1e-13,
                "{actual} is not {want}"
            );
        }
        assert_eq!(row(&PAPER, 0.0)[..4], [0.0; 4]);
    }

    // f = lambda t: atan(mpf(2.5) * sin(2*pi*mpf(3.5)*t)) * (1 - exp(-mpf(0.75) * t**3))
    #[test]
    fn a_steep_paper_command_has_exact_derivatives() {
        let waveform = Waveform::Paper {
            amplitude: 2.5,
            frequency_hz: 3.5,
            onset_per_s3: 0.75,
        };
        #[rustfmt::skip]
        let expected = [-0.3717490165483958, 0.7862879749168574, 118.26495980481701,
            6053.898271335933, 447480.2139752133, 34764440.31519431];
        assert_close(&row(&waveform, 0.8125), &expected, 2.5, 3.5);
    }

    #[test]
    fn the_papers_command_matches_50_digits_on_the_grid_of_a_run() {
        let file = include_str!("../../tests/golden/stimulus_paper.json");
        let file: serde_json::Value = serde_json::from_str(file).unwrap();
        let points = file["points"].as_array().unwrap();
        assert!(points.len() >= 30);
        for point in points {
            let row = row(&PAPER, point["t_s"].as_f64().unwrap());
            // A time that is not a binary fraction is rounded, and so is f t.
            let mut allowed = 1e-14;
            for (n, actual) in row.iter().enumerate() {
                let want = point["derivatives"][n].as_f64().unwrap();
                assert!(
                    (actual - want).abs() < allowed,
                    "order {n}: {actual} is not {want}"
                );
                allowed *= TAU;
            }
        }
    }

    // f = lambda t: mpf(0.25) + mpf(1.5) * sin(2*pi*mpf(2.5)*t + mpf(0.75))
    #[test]
    fn a_sine_has_exact_derivatives() {
        let waveform = Waveform::Sine {
            amplitude: 1.5,
            frequency_hz: 2.5,
            phase_rad: 0.75,
            offset: 0.25,
        };
        #[rustfmt::skip]
        let expected = [1.5970778189337096, -10.364653498205502, -332.37812925894985,
            2557.375744541381, 82011.01618399948, -631007.1725891198];
        assert_close(&row(&waveform, 3.28125), &expected, 1.5, 2.5);
    }

    #[test]
    fn a_sine_is_as_exact_after_a_month_as_at_the_beginning() {
        let waveform = Waveform::Sine {
            amplitude: 1.0,
            frequency_hz: 2.0,
            phase_rad: 0.0,
            offset: 0.0,
        };
        let month_s = 2_592_000.0;
        assert_eq!(row(&waveform, month_s + 0.0625), row(&waveform, 0.0625));
    }

    const CHIRP: Waveform = Waveform::Chirp {
        amplitude: 2.0,
        start_hz: 0.5,
        end_hz: 20.0,
        duration_s: 8.0,
        sweep: Sweep::Linear,
        offset: -0.5,
    };

    // f = lambda t: mpf(-0.5) + 2*sin(2*pi*(t/2 + mpf(19.5) * t**2 / 16))
    #[test]
    fn a_chirp_has_exact_derivatives_during_its_sweep() {
        #[rustfmt::skip]
        let expected = [1.4932764843365667, -13.885705106199074, -14317.056775897183,
            91958.01078524668, 102905444.24372615, -530291406.40593946];
        assert_close(&row(&CHIRP, 5.328125), &expected, 2.0, 20.0);
    }

    // f = lambda t: mpf(-0.5) + 2*sin(2*pi*(4 + mpf(19.5) * 64 / 16 + 20*(t - 8)))
    #[test]
    fn a_chirp_continues_at_its_end_frequency() {
        #[rustfmt::skip]
        let expected = [1.1629392246050905, 139.63002900860414, -26260.08366385044,
            -2204949.038124087, 414682619.6827409, 34819159569.355576];
        assert_close(&row(&CHIRP, 9.0078125), &expected, 2.0, 20.0);
    }

    const LOGARITHMIC_CHIRP: Waveform = Waveform::Chirp {
        amplitude: 2.0,
        start_hz: 0.5,
        end_hz: 20.0,
        duration_s: 8.0,
        sweep: Sweep::Logarithmic,
        offset: -0.5,
    };

    // k = log(mpf(20) / 0.5) / 8, f = lambda t: mpf(-0.5) + 2*sin(2*pi * mpf(0.5) * (exp(k*t) - 1) / k)
    #[test]
    fn a_logarithmic_chirp_has_exact_derivatives_during_its_sweep() {
        #[rustfmt::skip]
        let expected = [-1.3259701237866164, -66.76828429760836, 1079.0465615831736,
            91235.83737761217, -1241399.0232440592, -126945155.3560124];
        // The exponent is rounded, and with it some thirty turns.
        assert_close(&row(&LOGARITHMIC_CHIRP, 5.328125), &expected, 10.0, 20.0);
    }

    // f = lambda t: mpf(-0.5) + 2*sin(2*pi*(mpf(19.5) / k + 20*(t - 8)))
    #[test]
    fn a_logarithmic_chirp_continues_at_its_end_frequency() {
        #[rustfmt::skip]
        let expected = [0.171385753090683, -236.7432576521893, -10602.098853651996,
            3738499.676243647, 167421634.4108611, -59036020573.0007];
        assert_close(&row(&LOGARITHMIC_CHIRP, 9.0078125), &expected, 2.0, 20.0);
    }

    #[test]
    fn a_chirp_is_continuous_at_the_end_of_its_sweep() {
        for chirp in [CHIRP, LOGARITHMIC_CHIRP] {
            let (before, at) = (row(&chirp, 8.0 - 1e-9), row(&chirp, 8.0));
            assert!((before[0] - at[0]).abs() < 1e-6);
            assert!((before[1] - at[1]).abs() < 1e-4);
        }
    }

    #[test]
    fn a_step_changes_at_its_time() {
        let waveform = Waveform::Step {
            at_s: 2.0,
            before: -1.0,
            after: 3.0,
        };
        assert_eq!(row(&waveform, 1.9999), [-1.0]);
        assert_eq!(row(&waveform, 2.0), [3.0]);
    }

    #[test]
    fn a_ramp_has_the_slope_to_the_right() {
        let waveform = Waveform::Ramp {
            at_s: 2.0,
            duration_s: 4.0,
            start: 1.0,
            end: -1.0,
        };
        assert_eq!(row(&waveform, 1.5), [1.0, 0.0]);
        assert_eq!(row(&waveform, 2.0), [1.0, -0.5]);
        assert_eq!(row(&waveform, 5.0), [-0.5, -0.5]);
        assert_eq!(row(&waveform, 6.0), [-1.0, 0.0]);
        assert_eq!(row(&waveform, 7.0), [-1.0, 0.0]);
    }
}

//! Spectrum of a signal: amplitudes, or the amplitude spectral density, by the method of Welch (1967).
//!
//! Segments of equal length overlap by half; each loses its mean and is multiplied by the window, and the squares of
//! their transforms are averaged. Missing values at both ends are left out, as the command of the last record. Never
//! fills a gap: a signal with one has no spectrum.

use std::f64::consts::PI;

use hil_config::plan::{SpectralWindow, SpectrumPlan};

use super::fourier::transform;

/// Number of segment lengths in the time shown, for a density without a resolution.
const LENGTHS: f64 = 8.0;
/// Weights of the cosines of the flat-top window (D'Antona and Ferrero, 2006).
const FLAT_TOP: [f64; 5] = [
    0.215_578_95,
    0.416_631_58,
    0.277_263_158,
    0.083_578_947,
    0.006_947_368,
];

/// Spectrum of a signal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spectrum {
    /// Distance of frequencies.
    pub(super) resolution_hz: f64,
    /// Number of averaged segments.
    pub(super) segments: usize,
    /// Frequencies from 0, each with its amplitude or its density.
    pub(super) lines: Vec<[f64; 2]>,
}

/// Returns the spectrum of values at this rate, or the reason why there is none.
pub(super) fn spectrum(
    values: &[f64],
    rate_hz: f64,
    plan: &SpectrumPlan,
) -> Result<Spectrum, String> {
    let first = values.iter().position(|value| value.is_finite());
    let last = values.iter().rposition(|value| value.is_finite());
    let values = match (first, last) {
        (Some(first), Some(last)) => &values[first..=last],
        _ => values,
    };
    let missing = values.iter().filter(|value| !value.is_finite()).count();
    if missing > 0 {
        return Err(format!(
            "{missing} of {} values are missing, and a spectrum needs all",
            values.len()
        ));
    }
    let all = values.len() as f64;
    let usual = if plan.is_density { all / LENGTHS } else { all };
    let length = plan.resolution_hz.map_or(usual, |hz| rate_hz / hz);
    let length = libm::floor(length + 1e-6);
    if length > all || length < 4.0 {
        return Err(format!(
            "a segment would have {length} of {all} records; a spectrum needs at least 4 and at most all"
        ));
    }
    let length = length as usize;
    let weights: Vec<f64> = (0..length)
        .map(|k| weight(plan.window, k, length))
        .collect();
    let hop = length - length / 2;
    let mut squares = vec![0.0; length / 2 + 1];
    let mut segments = 0;
    let mut start = 0;
    while start + length <= values.len() {
        let segment = &values[start..start + length];
        let mean = segment.iter().sum::<f64>() / length as f64;
        let windowed = segment.iter().zip(&weights);
        let windowed: Vec<_> = windowed
            .map(|(value, weight)| [(value - mean) * weight, 0.0])
            .collect();
        let lines = transform(&windowed);
        for (square, [re, im]) in squares.iter_mut().zip(lines) {
            *square += re * re + im * im;
        }
        segments += 1;
        start += hop;
    }
    let sum: f64 = weights.iter().sum();
    let power: f64 = weights.iter().map(|weight| weight * weight).sum();
    let resolution_hz = rate_hz / length as f64;
    let line = |(k, square): (usize, f64)| {
        let mean = square / segments as f64;
        // The line at 0 and the one at half the rate have no twin at a negative frequency.
        let is_single = k == 0 || 2 * k == length;
        let size = match (plan.is_density, is_single) {
            (true, true) => (mean / (rate_hz * power)).sqrt(),
            (true, false) => (2.0 * mean / (rate_hz * power)).sqrt(),
            (false, true) => mean.sqrt() / sum,
            (false, false) => 2.0 * mean.sqrt() / sum,
        };
        [k as f64 * resolution_hz, size]
    };
    Ok(Spectrum {
        resolution_hz,
        segments,
        lines: squares.into_iter().enumerate().map(line).collect(),
    })
}

fn weight(window: SpectralWindow, k: usize, length: usize) -> f64 {
    let angle = 2.0 * PI * k as f64 / length as f64;
    match window {
        SpectralWindow::Rectangular => 1.0,
        SpectralWindow::Hann => 0.5 - 0.5 * libm::cos(angle),
        SpectralWindow::FlatTop => {
            let terms = (0_u8..).zip(FLAT_TOP).map(|(n, weight)| {
                let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
                sign * weight * libm::cos(f64::from(n) * angle)
            });
            terms.sum()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [SpectralWindow; 3] = SpectralWindow::ALL;

    fn sine(amplitude: f64, frequency_hz: f64, records: u32) -> Vec<f64> {
        let value =
            |k| amplitude * libm::sin(2.0 * PI * frequency_hz * f64::from(k) / 1000.0 + 0.3);
        (0..records).map(|k| 5.0 + value(k)).collect()
    }

    #[test]
    fn a_sine_of_amplitude_a_has_a_line_of_height_a() {
        for window in ALL {
            let plan = SpectrumPlan {
                window,
                is_density: false,
                resolution_hz: None,
            };
            let spectrum = spectrum(&sine(0.7, 50.0, 5000), 1000.0, &plan).expect("a spectrum");
            assert_eq!((spectrum.resolution_hz, spectrum.segments), (0.2, 1));
            let [frequency_hz, height] = spectrum.lines[250];
            assert!((frequency_hz - 50.0).abs() < 1e-9);
            assert!((height - 0.7).abs() < 1e-9, "{window:?}: {height}");
            assert!(spectrum.lines[0][1].abs() < 1e-9, "the mean is left out");
            assert!(spectrum.lines[300][1].abs() < 1e-9);
        }
    }

    #[test]
    fn a_flat_top_window_shows_the_amplitude_of_a_sine_between_two_lines() {
        let height = |window| {
            let plan = SpectrumPlan {
                window,
                is_density: false,
                resolution_hz: Some(1.0),
            };
            let spectrum = spectrum(&sine(1.0, 50.5, 5000), 1000.0, &plan).expect("a spectrum");
            assert_eq!(spectrum.segments, 9);
            spectrum.lines[50][1]
        };
        assert!((height(SpectralWindow::FlatTop) - 1.0).abs() < 2e-3);
        // sinc(1/2) of the rectangle, and 8 / (3 pi) of the raised cosine.
        assert!((height(SpectralWindow::Rectangular) - 2.0 / PI).abs() < 1e-2);
        assert!((height(SpectralWindow::Hann) - 8.0 / (3.0 * PI)).abs() < 1e-2);
    }

    #[test]
    fn a_density_has_the_power_of_the_signal() {
        // A sum over all lines of density squared times their distance is the mean square: a^2 / 2.
        for window in ALL {
            let plan = SpectrumPlan {
                window,
                is_density: true,
                resolution_hz: None,
            };
            let spectrum = spectrum(&sine(3.0, 50.0, 8000), 1000.0, &plan).expect("a spectrum");
            assert_eq!((spectrum.resolution_hz, spectrum.segments), (1.0, 15));
            let squares = spectrum.lines.iter().map(|[_, density]| density * density);
            let power = squares.sum::<f64>() * spectrum.resolution_hz;
            assert!((power - 4.5).abs() < 1e-9, "{window:?}: {power}");
        }
    }

    #[test]
    fn a_gap_and_too_fine_a_resolution_are_refused() {
        let plan = SpectrumPlan {
            window: SpectralWindow::Hann,
            is_density: false,
            resolution_hz: Some(0.1),
        };
        let refused = |values: &[f64]| spectrum(values, 1000.0, &plan).expect_err("refused");
        assert!(refused(&[0.0; 100]).contains("10000 of 100 records"));
        assert!(refused(&[0.0, f64::NAN, 0.0]).contains("1 of 3 values are missing"));
        assert!(refused(&[f64::NAN; 2]).contains("2 of 2 values are missing"));
    }

    #[test]
    fn missing_values_at_both_ends_are_left_out() {
        let plan = SpectrumPlan {
            window: SpectralWindow::Hann,
            is_density: false,
            resolution_hz: None,
        };
        let values = sine(0.7, 50.0, 5000);
        let expected = spectrum(&values, 1000.0, &plan);
        let padded = [vec![f64::NAN], values, vec![f64::NAN]].concat();
        assert_eq!(spectrum(&padded, 1000.0, &plan), expected);
        assert!(expected.is_ok());
    }
}

//! Figures of an instrument that follow from its keys and the rate of the run: noise, delay, phase.
//!
//! Used by `hil config show --instruments`. The figures of a lag follow from the impulse response of the stage that
//! runs. Nonlinear stages (rate limit, dead band, backlash, the ends of the range) have no figure here.

use hil_config::plan::{Instrument, Stage};
use shared_types::describe::Invalid;
use shared_types::time::Rate;

use super::started;
use crate::faults::kind::{Moment, Reading};
use crate::faults::kinds;

/// Maximum length of an impulse response, in steps.
const LONGEST: u64 = 1 << 20;

/// Figures of an instrument.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// Standard deviation of the noise in a sample, without quantisation.
    pub noise_sigma: f64,
    /// Standard deviation added by quantisation: a step over the root of 12.
    pub quantisation_sigma: f64,
    /// Delay or dead time in s.
    pub dead_s: f64,
    /// Mean age of a held value in s.
    pub hold_s: f64,
    /// Delay of slow signals by the lag in s.
    pub lag_s: f64,
    period_s: f64,
    /// Impulse response of the lag; one value without a lag.
    impulse: Vec<f64>,
}

impl Figures {
    /// Computes the figures of a sensor or actuator at a rate.
    ///
    /// # Errors
    /// If the keys are inconsistent.
    pub fn of(instrument: &Instrument, rate: Rate) -> Result<Self, Invalid> {
        let period_s = rate.period_s();
        let is_lag = |stage: &&Stage| ["lag", "second-order-lag"].contains(&stage.kind.as_str());
        let stages = instrument.actuator_stages(rate);
        let impulse = match stages.iter().find(is_lag) {
            Some(stage) => impulse(stage, rate)?,
            None => vec![1.0],
        };
        let passed: f64 = impulse.iter().map(|value| value * value).sum();
        let sum: f64 = impulse.iter().sum();
        let moment: f64 = (0_u32..)
            .zip(&impulse)
            .map(|(step, value)| f64::from(step) * value)
            .sum();
        let density = instrument.density_sigma(rate).unwrap_or(0.0);
        let sample = instrument.get("noise_sigma").unwrap_or(0.0);
        let dead = ["delay_s", "dead_time_s"];
        Ok(Self {
            noise_sigma: (density * density * passed + sample * sample).sqrt(),
            quantisation_sigma: instrument.resolution().unwrap_or(0.0) / 12.0_f64.sqrt(),
            dead_s: (dead.iter().find_map(|key| instrument.get(key))).unwrap_or(0.0),
            hold_s: (instrument.divisor(rate) - 1.0) / 2.0 * period_s,
            lag_s: moment / sum * period_s,
            period_s,
            impulse,
        })
    }

    /// Computes the phase loss at a frequency, in degrees.
    #[must_use]
    pub fn phase_loss_deg(&self, frequency_hz: f64) -> f64 {
        let per_step = std::f64::consts::TAU * frequency_hz * self.period_s;
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (step, value) in (0_u32..).zip(&self.impulse) {
            let angle = per_step * f64::from(step);
            real += value * libm::cos(angle);
            imaginary += value * libm::sin(angle);
        }
        libm::atan2(imaginary, real).to_degrees()
            + 360.0 * frequency_hz * (self.dead_s + self.hold_s)
    }
}

/// Computes the impulse response of a lag until it has faded.
fn impulse(stage: &Stage, rate: Rate) -> Result<Vec<f64>, Invalid> {
    let mut lag = started(&kinds::all(), stage, (rate, 0), (0, "", 0))?;
    let mut answer = |step: u64, value| {
        let at = Moment {
            step,
            since_steps: step,
            since_s: rate.seconds(shared_types::time::Step(step)),
            gain: 1.0,
        };
        lag.number(&at, Reading { value, valid: true }).value
    };
    answer(0, 0.0);
    let mut values = vec![answer(1, 1.0)];
    let (mut largest, mut faded) = (values[0].abs(), 0_usize);
    for step in 2..LONGEST {
        let value = answer(step, 0.0);
        values.push(value);
        if value.abs() > largest {
            largest = value.abs();
        }
        // As long again as it took to fade: a resonance passes through 0.
        faded = if value.abs() < 1e-12 * largest {
            faded + 1
        } else {
            0
        };
        if 2 * faded > values.len() {
            break;
        }
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use shared_types::describe::Settings;

    use super::*;

    fn figures(values: &[(&str, f64)]) -> Figures {
        let mut settings = Settings::default();
        for (key, value) in values {
            settings.set(key, *value);
        }
        let instrument = Instrument {
            values: settings,
            ..Instrument::default()
        };
        Figures::of(&instrument, Rate::new(10_000.0).expect("legal")).expect("right")
    }

    fn assert_near(value: f64, expected: f64, tolerance: f64) {
        assert!(
            (value / expected - 1.0).abs() < tolerance,
            "{value} {expected}"
        );
    }

    #[test]
    fn a_lag_of_first_order_has_the_phase_and_the_noise_band_of_its_closed_form() {
        let figures = figures(&[("lag_hz", 100.0), ("noise_density", 0.01)]);
        assert_near(figures.lag_s, 1.0 / (std::f64::consts::TAU * 100.0), 1e-6);
        for frequency_hz in [1.0, 10.0, 100.0] {
            let expected = libm::atan(frequency_hz / 100.0).to_degrees();
            assert_near(figures.phase_loss_deg(frequency_hz), expected, 1e-3);
        }
        // The noise band of a first-order lag is pi / 2 times its corner; sampling folds back what is above.
        let band_hz = std::f64::consts::FRAC_PI_2 * 100.0;
        assert_near(figures.noise_sigma, 0.01 * band_hz.sqrt(), 0.02);
    }

    #[test]
    fn a_lag_of_second_order_loses_90_degrees_at_its_frequency() {
        let figures = figures(&[("lag_hz", 50.0), ("lag_damping", 0.3)]);
        assert_near(figures.phase_loss_deg(50.0), 90.0, 1e-3);
        assert_near(
            figures.lag_s,
            2.0 * 0.3 / (std::f64::consts::TAU * 50.0),
            1e-6,
        );
    }

    #[test]
    fn dead_time_and_hold_lose_phase_in_proportion() {
        let figures = figures(&[("delay_s", 0.003), ("rate_hz", 1000.0), ("resolution", 0.5)]);
        assert_near(figures.hold_s, 0.000_45, 1e-12);
        assert_near(figures.phase_loss_deg(10.0), 360.0 * 10.0 * 0.003_45, 1e-12);
        assert_near(figures.quantisation_sigma, 0.5 / 12.0_f64.sqrt(), 1e-12);
        assert_eq!(figures.noise_sigma, 0.0);
    }
}

//! Figures of an instrument that follow from its keys and the rate of the run: noise, delay, phase.
//!
//! Used by `hil config show --instruments`. The figures of a lag follow from the transfer function of the stage that
//! runs. Nonlinear stages (rate limit, dead band, backlash, the ends of the range) have no figure here.

use hil_config::plan::Instrument;
use shared_types::time::Rate;

use crate::faults::kinds::lag::Response;

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
    rate: Rate,
    lag: Option<Response>,
}

impl Figures {
    /// Computes the figures of a sensor or actuator at a rate.
    #[must_use]
    pub fn of(instrument: &Instrument, rate: Rate) -> Self {
        let damping = instrument.get("lag_damping");
        let lag = instrument.get("lag_hz").map(|lag_hz| match damping {
            None => Response::first_order(lag_hz, rate),
            Some(damping) => Response::second_order(lag_hz, damping, rate),
        });
        let density = instrument.density_sigma(rate).unwrap_or(0.0);
        let sample = instrument.get("noise_sigma").unwrap_or(0.0);
        let passed = lag.map_or(1.0, |lag| lag.power);
        let dead = ["delay_s", "dead_time_s"];
        Self {
            noise_sigma: (density * density * passed + sample * sample).sqrt(),
            quantisation_sigma: instrument.resolution().unwrap_or(0.0) / 12.0_f64.sqrt(),
            dead_s: (dead.iter().find_map(|key| instrument.get(key))).unwrap_or(0.0),
            hold_s: (instrument.divisor(rate) - 1.0) / 2.0 * rate.period_s(),
            lag_s: lag.map_or(0.0, |lag| lag.delay_s),
            rate,
            lag,
        }
    }

    /// Computes the phase loss at a frequency, in degrees.
    #[must_use]
    pub fn phase_loss_deg(&self, frequency_hz: f64) -> f64 {
        let lag = self
            .lag
            .map(|lag| lag.phase_loss_rad(frequency_hz, self.rate));
        lag.unwrap_or(0.0).to_degrees() + 360.0 * frequency_hz * (self.dead_s + self.hold_s)
    }
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
        Figures::of(&instrument, Rate::new(10_000.0).expect("legal"))
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
    fn a_slow_and_a_barely_damped_lag_have_the_figures_of_their_closed_form() {
        let slow = figures(&[("lag_hz", 0.002_65)]);
        assert_near(slow.lag_s, 60.058_5, 1e-5);
        assert_near(slow.phase_loss_deg(1.0), 89.848_2, 1e-5);
        let resonant = figures(&[("lag_hz", 1.0), ("lag_damping", 0.001)]);
        assert_near(resonant.lag_s, 0.000_318_31, 1e-5);
        assert_near(resonant.phase_loss_deg(1.0), 90.0, 1e-4);
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

//! Waveforms that jump between two levels: square waves and pulses. They have no derivative.

use serde::{Deserialize, Serialize};

/// Time that an edge may be early, in s: an edge belongs to its step, although neither is exact in binary.
pub(super) const EDGE_S: f64 = 1e-9;

/// Square wave: `offset + amplitude` in the first `duty` of each period, then `offset - amplitude`.
///
/// The period is counted by `n = f t + phase / (2 pi)`, as in a sine of the same keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Square {
    /// Amplitude.
    pub amplitude: f64,
    /// f in Hz.
    pub frequency_hz: f64,
    /// Share of the period at the upper level.
    pub duty: f64,
    /// Phase in rad.
    pub phase_rad: f64,
    /// Mean of both levels.
    pub offset: f64,
}

impl Square {
    pub(super) fn at(&self, time_s: f64) -> f64 {
        let edge = EDGE_S * self.frequency_hz;
        let turns = self.frequency_hz * time_s + self.phase_rad / std::f64::consts::TAU;
        let share = turns - (turns + edge).floor();
        match share + edge < self.duty {
            true => self.offset + self.amplitude,
            false => self.offset - self.amplitude,
        }
    }
}

/// Pulse: `high` for `width_s` from `at_s` on, else `low`; repeated every `period_s` if given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pulse {
    /// Beginning in s.
    pub at_s: f64,
    /// Length in s.
    pub width_s: f64,
    /// Time from one pulse to the next in s; longer than the width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<f64>,
    /// Value outside a pulse.
    pub low: f64,
    /// Value of a pulse.
    pub high: f64,
}

impl Pulse {
    pub(super) fn at(&self, time_s: f64) -> f64 {
        let mut since_s = time_s - self.at_s + EDGE_S;
        if let Some(period_s) = self.period_s
            && since_s > 0.0
        {
            since_s -= (since_s / period_s).floor() * period_s;
        }
        match (0.0..self.width_s).contains(&since_s) {
            true => self.high,
            false => self.low,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_wave_is_high_for_its_share_of_each_period_to_the_step() {
        let square = Square {
            amplitude: 2.0,
            frequency_hz: 10.0,
            duty: 0.3,
            phase_rad: 0.0,
            offset: 1.0,
        };
        // 100 steps a period: 30 of them are high, whatever the rounding of k / 1000.
        for k in 0..100_000_u32 {
            let expected = if k % 100 < 30 { 3.0 } else { -1.0 };
            assert_eq!(square.at(f64::from(k) / 1000.0), expected, "step {k}");
        }
        let shifted = Square {
            phase_rad: std::f64::consts::PI,
            ..square
        };
        // Half a period later: high from 50 to 80 steps.
        for k in 0..1000_u32 {
            let expected = if (50..80).contains(&(k % 100)) {
                3.0
            } else {
                -1.0
            };
            assert_eq!(shifted.at(f64::from(k) / 1000.0), expected, "step {k}");
        }
    }

    #[test]
    fn a_pulse_is_as_many_steps_long_as_it_says_once_or_every_period() {
        let once = Pulse {
            at_s: 0.3,
            width_s: 0.1,
            period_s: None,
            low: -1.0,
            high: 5.0,
        };
        let train = Pulse {
            period_s: Some(0.7),
            ..once.clone()
        };
        for k in 0..100_000_u32 {
            let time_s = f64::from(k) / 100.0;
            let value = |is_high| if is_high { 5.0 } else { -1.0 };
            assert_eq!(once.at(time_s), value((30..40).contains(&k)), "step {k}");
            let is_high = k >= 30 && (k - 30) % 70 < 10;
            assert_eq!(train.at(time_s), value(is_high), "step {k}");
        }
    }
}

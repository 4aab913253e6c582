//! Range of frequencies, and the tones that cover it.

use hil_console::terminal::exit::Failure;

use super::extremes::larger;

/// Turns of the lowest frequency in the common period of all tones.
const TURNS: f64 = 2.0;
/// Least number of frequencies of the common period in the range.
const TONES: f64 = 16.0;
/// Ratio of neighbouring frequencies of the survey.
const DENSE: f64 = 1.015;
/// Number of the first frequencies.
const COUNT: usize = 60;
/// Longest common period in steps, which limits the memory of a measurement.
const LONGEST_STEPS: u64 = 2_000_000;

/// Range of frequencies of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    pub(super) low_hz: f64,
    pub(super) high_hz: f64,
    count: usize,
    rate_hz: f64,
}

impl Span {
    /// Parses `LO..HI/COUNT`; without a text, returns the default for this rate.
    pub(super) fn new(text: Option<&str>, rate_hz: f64) -> Result<Self, Failure> {
        let mut span = Self {
            low_hz: 0.2,
            high_hz: 0.45 * rate_hz,
            count: COUNT,
            rate_hz,
        };
        if let Some(text) = text {
            let (range, count) = text.split_once('/').unwrap_or((text, ""));
            let ends = range.split_once("..").and_then(|(low, high)| {
                Some((low.trim().parse().ok()?, high.trim().parse().ok()?))
            });
            let count = match count {
                "" => Some(COUNT),
                count => count.trim().parse().ok(),
            };
            let (Some((low_hz, high_hz)), Some(count)) = (ends, count) else {
                return Err(Failure::usage(format!(
                    "--frequencies {text}: write LO..HI in Hz, or LO..HI/COUNT, such as 0.5..100/40"
                )));
            };
            (span.low_hz, span.high_hz, span.count) = (low_hz, high_hz, count);
        }
        let is_range = span.low_hz >= 1e-3 && span.low_hz < span.high_hz;
        if !(is_range && span.high_hz <= 0.45 * rate_hz && (4..=1000).contains(&span.count)) {
            return Err(Failure::usage(format!(
                "--frequencies: from at least 0.001 Hz to at most 0.45 times the rate, {} Hz, and 4 to 1000 of them",
                0.45 * rate_hz
            )));
        }
        if span.period_steps() > LONGEST_STEPS {
            return Err(Failure::usage(format!(
                "--frequencies: from at least {} Hz at this rate, and at least {} Hz wide",
                TURNS * rate_hz / LONGEST_STEPS as f64,
                TONES * rate_hz / LONGEST_STEPS as f64
            )));
        }
        Ok(span)
    }

    /// Returns the common period of all tones in steps.
    pub(super) fn period_steps(&self) -> u64 {
        let turns = TURNS * self.rate_hz / self.low_hz;
        let narrow = TONES * self.rate_hz / (self.high_hz - self.low_hz);
        larger(turns, narrow).ceil() as u64
    }

    /// Returns the frequency of a tone with these turns in the common period.
    pub(super) fn hz(&self, turns: u64) -> f64 {
        turns as f64 * self.rate_hz / self.period_steps() as f64
    }

    /// Lists the turns of the first tones, spaced evenly in the logarithm of the frequency.
    pub(super) fn tones(&self) -> Vec<u64> {
        self.spaced(self.count)
    }

    /// Lists the turns of tones 1.5 % apart, or as near as the period allows.
    pub(super) fn dense(&self) -> Vec<u64> {
        let ratio = libm::log(self.high_hz / self.low_hz) / libm::log(DENSE);
        self.spaced(2 + ratio as usize)
    }

    fn spaced(&self, count: usize) -> Vec<u64> {
        let ratio = self.high_hz / self.low_hz;
        let last = (count - 1) as f64;
        let tones = (0..count).map(|n| {
            let frequency_hz = self.low_hz * libm::pow(ratio, n as f64 / last);
            self.turns(frequency_hz)
        });
        let mut tones: Vec<u64> = tones.collect();
        tones.dedup();
        tones
    }

    /// Lists the turns of tones around a frequency, each 1 % from the next, or as near as the period allows.
    pub(super) fn around(&self, frequency_hz: f64) -> Vec<u64> {
        let middle = self.turns(frequency_hz);
        let step = (middle / 100).max(1);
        let (low, high) = (self.turns(self.low_hz), self.turns(self.high_hz));
        let tones = (0..=8).filter_map(|n| (middle + n * step).checked_sub(4 * step));
        tones.filter(|tone| (low..=high).contains(tone)).collect()
    }

    fn turns(&self, frequency_hz: f64) -> u64 {
        let turns = frequency_hz * self.period_steps() as f64 / self.rate_hz;
        (turns.round() as u64).max(1)
    }
}

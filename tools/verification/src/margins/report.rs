//! Report of measured margins: JSON, text, and the responses as CSV.

use std::fmt::Write;

use serde::Serialize;

use super::extremes::{extended, larger, smaller};
use super::locus::Margins;
use super::measurement::Measured;
use super::point::Point;
use super::together::Together;

/// Times of a measurement in s.
#[derive(Clone, Copy, Debug)]
pub(super) struct Time {
    /// Beginning of the probe.
    pub(super) at_s: f64,
    /// Beginning and end of the measured periods.
    pub(super) measured_s: [f64; 2],
}

/// Margins of all loops.
#[derive(Debug, Default, Serialize)]
pub(super) struct Report {
    inputs: Vec<Input>,
    /// Margin of all commands together at each time, if there are several.
    together: Vec<Joint>,
}

/// Margin of all loops together, in JSON.
#[derive(Debug, Serialize)]
struct Joint {
    at_s: f64,
    /// Beginning and end of the measured periods.
    measured_s: [f64; 2],
    /// Reason, if the margin was refused; the figures are then null.
    refused: Option<String>,
    /// Least singular value of `I + L` after balancing, which the units of the commands do not affect.
    margin: Option<f64>,
    margin_interval: Option<[f64; 2]>,
    frequency_hz: Option<f64>,
    /// Least singular value of `I + L` in the units of the commands.
    least_singular_value: Option<f64>,
    /// Gains between which every command may change at once; null for no limit.
    gains_db: [Option<f64>; 2],
    /// Phase by which every command may change at once.
    phase_deg: Option<f64>,
}

/// Margins of the loop that is cut at one command.
#[derive(Debug, Serialize)]
pub(super) struct Input {
    command: String,
    unit: String,
    at_s: f64,
    /// Beginning and end of the measured periods.
    measured_s: [f64; 2],
    /// Reason, if the margins were refused; the figures are then null.
    refused: Option<String>,
    amplitude: Option<f64>,
    gain_margin_db: Option<f64>,
    phase_margin_deg: Option<f64>,
    delay_margin_s: Option<f64>,
    /// Least `|1 + L|`.
    disc_margin: Option<f64>,
    crossover_hz: Option<f64>,
    phase_crossover_hz: Option<f64>,
    disc_hz: Option<f64>,
    /// Frequencies with `|L| = 1`, each with its phase margin in degrees.
    crossovers: Vec<[f64; 2]>,
    /// Frequencies with a phase of -180 degrees, each with its gain margin in dB.
    phase_crossovers: Vec<[f64; 2]>,
    /// Reason, if phase and delay margin alone were refused.
    crossover_refused: Option<String>,
    /// Reason, if the gain margin alone was refused.
    gain_refused: Option<String>,
    /// Reason, if the least `|1 + L|` alone was refused.
    disc_refused: Option<String>,
    /// Least and largest value of each figure among single periods, half the amplitude and a coarser interpolation.
    intervals: Intervals,
    /// Least coherence of all frequencies.
    coherence: Option<f64>,
    responses: Vec<Answer>,
}

/// Response of the open loop at one frequency.
#[derive(Debug, Serialize)]
struct Answer {
    frequency_hz: f64,
    /// Real and imaginary part of L.
    l: [f64; 2],
    gain_db: f64,
    phase_deg: f64,
    /// Amplitude at the probe's output in the unit of the command.
    amplitude: f64,
    coherence: f64,
    /// Largest relative change of L among single periods and half the amplitude.
    change: f64,
}

impl Answer {
    fn of(point: &Point) -> Self {
        let (re, im) = point.l;
        Self {
            frequency_hz: point.frequency_hz,
            l: [re, im],
            gain_db: 20.0 * libm::log10(libm::hypot(re, im)),
            phase_deg: libm::atan2(im, re).to_degrees(),
            amplitude: point.amplitude,
            coherence: point.coherence,
            change: larger(point.unsteadiness(), point.nonlinearity()),
        }
    }
}

#[derive(Debug, Default, Serialize)]
struct Intervals {
    gain_margin_db: Option<[f64; 2]>,
    phase_margin_deg: Option<[f64; 2]>,
    delay_margin_s: Option<[f64; 2]>,
    disc_margin: Option<[f64; 2]>,
    crossover_hz: Option<[f64; 2]>,
}

type Figure = fn(&Margins) -> Option<f64>;

const GAIN: Figure = |margins| margins.phase_crossover().map(|[_, db]| db);
const PHASE: Figure = |margins| margins.crossover().map(|[_, deg]| deg);
const DELAY: Figure = Margins::delay_margin_s;
const DISC: Figure = |margins| Some(margins.disc[1]);
const CROSSOVER: Figure = |margins| margins.crossover().map(|[hz, _]| hz);

impl Report {
    /// Adds a loop.
    pub(super) fn add(
        &mut self,
        command: &str,
        unit: &str,
        time: Time,
        result: Result<&Measured, String>,
    ) {
        let (measured, refused) = match result {
            Ok(measured) => (Some(measured), None),
            Err(reason) => (None, Some(reason)),
        };
        let figure = |of: Figure| measured.as_ref().and_then(|one| of(&one.margins));
        let interval = |of: Figure| {
            let all = measured.as_ref()?.others.iter().filter_map(of);
            let mut all = all.skip_while(|value| value.is_nan());
            all.next().map(|first| all.fold([first; 2], extended))
        };
        let gain_refused = measured.and_then(|one| one.gain_refused.clone());
        let disc_refused = measured.and_then(|one| one.disc_refused.clone());
        let gain = |value| if gain_refused.is_some() { None } else { value };
        let disc = |value| if disc_refused.is_some() { None } else { value };
        self.inputs.push(Input {
            command: command.into(),
            unit: unit.into(),
            at_s: time.at_s,
            measured_s: time.measured_s,
            refused,
            amplitude: measured.as_ref().map(|one| one.amplitude),
            gain_margin_db: gain(figure(GAIN)),
            phase_margin_deg: figure(PHASE),
            delay_margin_s: figure(DELAY),
            disc_margin: disc(figure(DISC)),
            crossover_hz: figure(CROSSOVER),
            phase_crossover_hz: figure(|one| one.phase_crossover().map(|[hz, _]| hz)),
            disc_hz: figure(|one| Some(one.disc[0])),
            crossovers: (measured.as_ref())
                .map_or_else(Vec::new, |one| one.margins.crossovers.clone()),
            phase_crossovers: (measured.as_ref())
                .map_or_else(Vec::new, |one| one.margins.phase_crossovers.clone()),
            intervals: Intervals {
                gain_margin_db: interval(GAIN),
                phase_margin_deg: interval(PHASE),
                delay_margin_s: interval(DELAY),
                disc_margin: interval(DISC),
                crossover_hz: interval(CROSSOVER),
            },
            coherence: (measured.as_ref()).and_then(|one| {
                one.points
                    .iter()
                    .map(|point| point.coherence)
                    .reduce(smaller)
            }),
            crossover_refused: measured.and_then(|one| one.crossover_refused.clone()),
            gain_refused,
            disc_refused,
            responses: (measured.iter().flat_map(|one| &one.points))
                .map(Answer::of)
                .collect(),
        });
    }

    /// Adds the margin of all loops together.
    pub(super) fn add_together(&mut self, time: Time, result: Result<Together, String>) {
        let (margin, refused) = match result {
            Ok(margin) => (Some(margin), None),
            Err(reason) => (None, Some(reason)),
        };
        let margin = margin.as_ref();
        self.together.push(Joint {
            at_s: time.at_s,
            measured_s: time.measured_s,
            refused,
            margin: margin.map(|one| one.margin),
            margin_interval: margin.map(|one| one.interval),
            frequency_hz: margin.map(|one| one.frequency_hz),
            least_singular_value: margin.map(|one| one.least_singular_value),
            gains_db: margin.map_or([None; 2], Together::gains_db),
            phase_deg: margin.map(Together::phase_deg),
        });
    }

    /// Returns `true` if no loop was refused.
    pub(super) fn is_complete(&self) -> bool {
        let inputs = self.inputs.iter().flat_map(|input| {
            [
                &input.refused,
                &input.crossover_refused,
                &input.gain_refused,
                &input.disc_refused,
            ]
        });
        let mut all = inputs.chain(self.together.iter().map(|joint| &joint.refused));
        all.all(Option::is_none)
    }

    /// Formats the responses of all loops as CSV.
    pub(super) fn csv(&self) -> String {
        let mut text = String::from(
            "command,at_s,frequency_hz,real,imaginary,gain_db,phase_deg,amplitude,coherence,change\n",
        );
        for input in &self.inputs {
            for answer in &input.responses {
                let Answer {
                    frequency_hz,
                    l: [re, im],
                    gain_db,
                    phase_deg,
                    amplitude,
                    coherence,
                    change,
                } = answer;
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{},{},{frequency_hz},{re},{im},{gain_db},{phase_deg},{amplitude},{coherence},{change}",
                    input.command, input.at_s
                );
            }
        }
        text
    }

    /// Formats the margins for a person.
    pub(super) fn describe(&self) -> String {
        let mut text = String::new();
        for input in &self.inputs {
            let _ = input.write(&mut text); // writing to a string cannot fail
        }
        for joint in &self.together {
            let _ = joint.write(&mut text); // as above
        }
        text
    }
}

impl Joint {
    fn write(&self, text: &mut String) -> std::fmt::Result {
        let [from_s, until_s] = self.measured_s;
        writeln!(
            text,
            "all commands together at {} s, measured from {from_s} s to {until_s} s",
            self.at_s
        )?;
        if let Some(reason) = &self.refused {
            return writeln!(text, "  refused: {reason}");
        }
        let value = |value: Option<f64>| value.unwrap_or(f64::NAN);
        writeln!(
            text,
            "  least singular value of I + L, balanced: {:.5} at {:.5} Hz ({:.5} as the units are)",
            value(self.margin),
            value(self.frequency_hz),
            value(self.least_singular_value)
        )?;
        let [least, most] = self.gains_db;
        let most = most.map_or_else(|| "any gain".into(), |db| format!("{db:.3} dB"));
        writeln!(
            text,
            "  every command at once may change by {:.3} dB to {most}, or by {:.3} deg",
            value(least),
            value(self.phase_deg)
        )
    }
}

impl Input {
    fn write(&self, text: &mut String) -> std::fmt::Result {
        let [from_s, until_s] = self.measured_s;
        writeln!(
            text,
            "command.{} at {} s, measured from {from_s} s to {until_s} s",
            self.command, self.at_s
        )?;
        if let Some(reason) = &self.refused {
            return writeln!(text, "  refused: {reason}");
        }
        let ranges = &self.intervals;
        let mut line =
            |name: &str, value: Option<f64>, range: Option<[f64; 2]>, unit: &str, at_hz| {
                let refused = match name {
                    "gain margin" => &self.gain_refused,
                    "phase margin" | "delay margin" => &self.crossover_refused,
                    "least |1 + L|" => &self.disc_refused,
                    _ => &None,
                };
                if let Some(reason) = refused {
                    return writeln!(text, "  {name:<14}refused: {reason}");
                }
                let Some(value) = value else {
                    return writeln!(text, "  {name:<14}none in this range");
                };
                let decimals = decimals(range);
                write!(text, "  {name:<14}{value:.decimals$} {unit}")?;
                if let Some([low, high]) = range {
                    write!(text, " ({low:.decimals$} to {high:.decimals$})")?;
                }
                match at_hz {
                    Some(hz) => writeln!(text, " at {hz:.5} Hz"),
                    None => writeln!(text),
                }
            };
        let crossover = self.crossover_hz;
        let (gain, phase) = (self.gain_margin_db, self.phase_margin_deg);
        line(
            "gain margin",
            gain,
            ranges.gain_margin_db,
            "dB",
            self.phase_crossover_hz,
        )?;
        line(
            "phase margin",
            phase,
            ranges.phase_margin_deg,
            "deg",
            crossover,
        )?;
        line(
            "delay margin",
            self.delay_margin_s,
            ranges.delay_margin_s,
            "s",
            None,
        )?;
        line(
            "least |1 + L|",
            self.disc_margin,
            ranges.disc_margin,
            "",
            self.disc_hz,
        )?;
        let (amplitude, coherence) = (self.amplitude, self.coherence);
        writeln!(
            text,
            "  amplitude {:.4} {}, {} frequencies, least coherence {:.6}",
            amplitude.unwrap_or(f64::NAN),
            self.unit,
            self.responses.len(),
            coherence.unwrap_or(f64::NAN)
        )
    }
}

/// Returns the number of decimals that a figure of this range has: those down to the leading digit of its width.
fn decimals(range: Option<[f64; 2]>) -> usize {
    let units = [1.0, 0.1, 0.01, 1e-3, 1e-4];
    let width = range.map_or(0.0, |[low, high]| high - low);
    (units.iter().position(|unit| width >= *unit)).unwrap_or(units.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_has_no_more_decimals_than_its_range_supports() {
        for (range, expected) in [
            (None, 5),
            (Some([36.402_62, 36.402_62]), 5),
            (Some([73.968_3, 73.968_5]), 4),
            (Some([73.95, 73.98]), 2),
            (Some([0.1, 0.7]), 1),
            (Some([-3.0, 2.0]), 0),
        ] {
            assert_eq!(decimals(range), expected, "{range:?}");
        }
    }
}

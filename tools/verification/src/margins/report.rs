//! Report of measured margins: JSON, text, and the responses as CSV.

use std::fmt::Write;

use serde::Serialize;

use super::locus::Margins;
use super::measurement::{Measured, Point};

/// Margins of all loops.
#[derive(Debug, Default, Serialize)]
pub(super) struct Report {
    inputs: Vec<Input>,
}

/// Margins of the loop that is cut at one command.
#[derive(Debug, Serialize)]
pub(super) struct Input {
    command: String,
    unit: String,
    at_s: f64,
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
    /// Least and largest value of each figure among single periods and half the amplitude.
    intervals: Intervals,
    /// Least coherence of all frequencies.
    coherence: Option<f64>,
    #[serde(skip)]
    points: Vec<Point>,
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
        at_s: f64,
        result: Result<Measured, String>,
    ) {
        let (measured, refused) = match result {
            Ok(measured) => (Some(measured), None),
            Err(reason) => (None, Some(reason)),
        };
        let figure = |of: Figure| measured.as_ref().and_then(|one| of(&one.margins));
        let interval = |of: Figure| {
            let all = measured.as_ref()?.others.iter().filter_map(of);
            let ends = all.map(|value| [value; 2]);
            ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
        };
        self.inputs.push(Input {
            command: command.into(),
            unit: unit.into(),
            at_s,
            refused,
            amplitude: measured.as_ref().map(|one| one.amplitude),
            gain_margin_db: figure(GAIN),
            phase_margin_deg: figure(PHASE),
            delay_margin_s: figure(DELAY),
            disc_margin: figure(DISC),
            crossover_hz: figure(CROSSOVER),
            phase_crossover_hz: figure(|one| one.phase_crossover().map(|[hz, _]| hz)),
            disc_hz: figure(|one| Some(one.disc[0])),
            crossovers: (measured.as_ref())
                .map_or_else(Vec::new, |one| one.margins.crossovers.clone()),
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
                    .reduce(f64::min)
            }),
            points: measured.map_or_else(Vec::new, |one| one.points),
        });
    }

    /// Returns `true` if no loop was refused.
    pub(super) fn is_complete(&self) -> bool {
        self.inputs.iter().all(|input| input.refused.is_none())
    }

    /// Formats the responses of all loops as CSV.
    pub(super) fn csv(&self) -> String {
        let mut text = String::from(
            "command,at_s,frequency_hz,real,imaginary,gain_db,phase_deg,amplitude,coherence\n",
        );
        for input in &self.inputs {
            for point in &input.points {
                let (re, im) = point.l;
                let gain_db = 20.0 * libm::log10(libm::hypot(re, im));
                let phase_deg = libm::atan2(im, re).to_degrees();
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "{},{},{},{re},{im},{gain_db},{phase_deg},{},{}",
                    input.command, input.at_s, point.frequency_hz, point.amplitude, point.coherence
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
        text
    }
}

impl Input {
    fn write(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "command.{} at {} s", self.command, self.at_s)?;
        if let Some(reason) = &self.refused {
            return writeln!(text, "  refused: {reason}");
        }
        let ranges = &self.intervals;
        let mut line =
            |name: &str, value: Option<f64>, range: Option<[f64; 2]>, unit: &str, at_hz| {
                let Some(value) = value else {
                    return writeln!(text, "  {name:<14}none in this range");
                };
                write!(text, "  {name:<14}{value:.5} {unit}")?;
                if let Some([low, high]) = range {
                    write!(text, " ({low:.5} to {high:.5})")?;
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
            self.points.len(),
            coherence.unwrap_or(f64::NAN)
        )
    }
}

//! A run with a probe at every command, and the fits of the probes' inputs and outputs.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use hil_config::SineFit;
use hil_config::plan::{Plan, Probe, Tone};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use shared_types::link::LinkError;
use shared_types::record::{Event, Outcome, RecordLayout};
use shared_types::stream::RecordSink;

use super::extremes::{extended, larger, smaller};
use super::growth;
use super::rig::Rig;

/// Windows in which the response is fitted, one after another.
pub(super) const WINDOWS: usize = 3;

/// Share of a motion below which its changes are rounding.
const ROUNDING: f64 = 1e-7;

/// Least number of steps for which a command at a limit has the same value.
const STANDING: usize = 3;

/// Real and imaginary part.
pub(super) type Complex = (f64, f64);

/// `a + j b` of the input and of the output of each command's probe, in each window.
pub(super) type Fitted = [Vec<[Complex; 2]>; WINDOWS];

/// Reason why a measurement ends without margins.
pub(super) enum Stop {
    /// Margins are refused.
    Refused(String),
    /// A run failed or was interrupted.
    Failed(Failure),
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

/// Times of a probe in steps: a period to settle, then the windows, each one period.
#[derive(Clone, Copy, Debug)]
pub(super) struct Course {
    pub(super) first_step: u64,
    pub(super) period_steps: u64,
}

impl Course {
    /// Returns the first step after the measurement.
    pub(super) const fn end_step(self) -> u64 {
        self.first_step + (1 + WINDOWS as u64) * self.period_steps
    }

    /// Returns the first step of the windows.
    pub(super) const fn measured_step(self) -> u64 {
        self.first_step + self.period_steps
    }
}

/// Loops of a plan, all of which are cut at a probe.
pub(super) struct Loops<'a> {
    pub(super) rig: &'a Rig,
    pub(super) plan: &'a Plan,
    /// Every command of the plant that the law drives.
    pub(super) commands: &'a [String],
    pub(super) course: Course,
    pub(super) interruption: &'a Interruption,
}

/// Tones at one command.
#[derive(Clone, Copy)]
pub(super) struct Excitation<'a> {
    /// Place of the command.
    pub(super) command: usize,
    /// Amplitude, of which all tones together have the power.
    pub(super) amplitude: f64,
    /// Turns of each tone in the common period.
    pub(super) turns: &'a [u64],
}

/// Motion of a run with probes.
pub(super) struct Motion {
    course: Course,
    excited: Option<usize>,
    /// Inputs of the probes in all windows, by command.
    inputs: Vec<Vec<f64>>,
    /// Output of the excited probe in all windows.
    output: Vec<f64>,
    /// `true` at the steps of all windows at which the law's inputs differ from those of the step before.
    moves: Vec<bool>,
    /// Largest size of each command.
    pub(super) largest: Vec<f64>,
    /// Number of steps of the probe at which an actuator stood at the end of its range, by command.
    pub(super) limited: Vec<u64>,
    /// Faults and changes of the run.
    pub(super) events: Vec<Event>,
}

/// Largest or smallest value of a command, at which it stands for several steps.
pub(super) struct Clipped {
    pub(super) value: f64,
    /// Share of the steps at which it stands there while the law's inputs move.
    pub(super) share: f64,
    /// `true` if it has no other value.
    pub(super) is_throughout: bool,
}

impl Loops<'_> {
    /// Runs the loops, with tones at a command if there are any.
    pub(super) fn run(&self, excitation: Option<Excitation<'_>>) -> Result<Motion, Stop> {
        let mut plan = self.plan.clone();
        plan.run.steps = self.course.end_step();
        plan.probes = (self.commands.iter().enumerate())
            .map(|(place, command)| Probe {
                command: command.clone(),
                first_step: self.course.first_step,
                period_steps: self.course.period_steps,
                tones: (excitation.filter(|one| one.command == place)).map_or_else(Vec::new, tones),
            })
            .collect();
        let excited = excitation.map(|one| one.command);
        let limits: Vec<_> = (self.commands.iter())
            .map(|name| {
                let own = (plan.actuators.iter()).find(|one| one.signal == *name)?;
                own.range()
            })
            .collect();
        let sink = |layout: &RecordLayout| Series::new(layout, self, excited, &limits);
        let (end, series) = self.rig.observe(&plan, sink, self.interruption)?;
        let reason = end.reason.as_deref().unwrap_or("it did not complete");
        let with = match excited {
            Some(_) => "with the probe",
            None => "without the probe",
        };
        match end.outcome {
            Outcome::Completed => Ok(series.motion),
            Outcome::Diverged => Err(Stop::Refused(match excited {
                None => format!("the loop is unstable: the run {with} diverges: {reason}"),
                Some(_) => format!(
                    "the loop is unstable, or the probe too large: the run {with} diverges: {reason}; lower --amplitude if the loop is stable"
                ),
            })),
            _ if end.is_of_invalid_command() => Err(Stop::Refused(format!(
                "the law gives no usable command: the run {with} ends with {reason}; a loop has margins where its commands are finite and in range, so choose another --at or a smaller --amplitude, or mend the law"
            ))),
            _ => Err(Stop::Refused(format!(
                "the run {with} ends early: {reason}"
            ))),
        }
    }
}

/// Returns tones of equal amplitude, with phases after Schroeder, which keep the peak of their sum low.
fn tones(excitation: Excitation<'_>) -> Vec<Tone> {
    let count = excitation.turns.len() as f64;
    let tones = (excitation.turns.iter().enumerate()).map(|(index, turns)| Tone {
        turns: *turns,
        amplitude: excitation.amplitude / count.sqrt(),
        phase_rad: PI * ((index * index) as f64) / count,
    });
    tones.collect()
}

impl Motion {
    /// Fits the input and the output of every probe at these tones.
    pub(super) fn fits(&self, tones: &[u64]) -> Result<Vec<Fitted>, Stop> {
        let period = self.course.period_steps;
        let part = |k: u64| libm::sincos(TAU * k as f64 / period as f64);
        let table: Vec<(f64, f64)> = (0..period).map(part).collect();
        let fit = |command: usize, turns: u64, window: usize| {
            let mut fit = SineFit::default();
            let first = window * period as usize;
            let of_window = first..first + period as usize;
            let inputs = self.inputs[command].get(of_window.clone())?;
            let outputs = match self.excited == Some(command) {
                true => self.output.get(of_window)?,
                false => inputs,
            };
            let mut place = 0;
            for (input, output) in inputs.iter().zip(outputs) {
                let (sin, cos) = table[place as usize];
                fit.take(sin, cos, [*input, *output]);
                place = (place + turns) % period;
            }
            fit.phasors()
        };
        let all = tones.iter().map(|turns| {
            let mut fitted = Fitted::default();
            for (window, to) in fitted.iter_mut().enumerate() {
                let commands = 0..self.inputs.len();
                *to = commands
                    .map(|command| fit(command, *turns, window))
                    .collect::<Option<_>>()?;
            }
            Some(fitted)
        });
        let all: Option<Vec<Fitted>> = all.collect();
        all.ok_or_else(|| Stop::Refused("a tone has too few samples in a turn".into()))
    }

    /// Returns the least factor by which the range of a command's values grows from one window to the next.
    pub(super) fn growth(&self, command: usize) -> f64 {
        let windows = self.inputs[command].chunks(self.course.period_steps as usize);
        // A command that stands still moves by rounding, of which no ratio means anything.
        let least = ROUNDING * self.largest[command];
        let ranges: Vec<f64> = windows
            .map(|values| {
                let [low, high] = ends(values);
                larger(high - low, least)
            })
            .collect();
        let ratios = ranges.windows(2).map(|pair| pair[1] / pair[0]);
        let least = ratios.fold(f64::INFINITY, smaller);
        if least.is_finite() { least } else { 1.0 } // a command that stood still does not grow
    }

    /// Returns the growth per period of the motion of any command, if it grows steadily.
    pub(super) fn steady_growth(&self) -> Option<f64> {
        let all = self.inputs.iter().zip(&self.largest);
        all.filter_map(|(values, largest)| {
            growth::of(
                values,
                self.course.period_steps as usize,
                ROUNDING * largest,
            )
        })
        .reduce(larger)
    }

    /// Returns the growth per period of the response of any command to the tones, if it grows steadily; noise of the
    /// same seed is no part of it.
    pub(super) fn steady_growth_over(&self, own: &Self) -> Option<f64> {
        let all = self.inputs.iter().zip(&own.inputs).zip(&self.largest);
        let growths = all.filter_map(|((values, own), largest)| {
            let response: Vec<f64> = values.iter().zip(own).map(|(a, b)| a - b).collect();
            let [low, high] = ends(&response);
            let rounding = 1e-12 * largest;
            growth::of(
                &response,
                self.course.period_steps as usize,
                larger(ROUNDING * (high - low), rounding),
            )
        });
        growths.reduce(larger)
    }

    /// Returns the largest or smallest value of a command if it stands there for several steps, and the one at which it
    /// stands longer.
    pub(super) fn clipped(&self, command: usize) -> Option<Clipped> {
        let values = &self.inputs[command];
        let [low, high] = ends(values);
        let all = [high, low].map(|end| {
            let (mut stands, mut moving, mut first) = (false, 0, 0);
            for streak in values.chunk_by(|a, b| a == b) {
                let after = first + streak.len();
                if streak[0] == end && streak.len() >= STANDING {
                    stands = true;
                    moving += { self.moves[first + 1..after].iter() }
                        .filter(|moves| **moves)
                        .count();
                }
                first = after;
            }
            stands.then(|| Clipped {
                value: end,
                share: moving as f64 / values.len() as f64,
                is_throughout: low == high,
            })
        });
        let all = all.into_iter().flatten();
        all.reduce(|a, b| if b.share > a.share { b } else { a })
    }

    /// Returns `true` if a command stands at a value for several steps, up to rounding.
    pub(super) fn stands_at(&self, command: usize, value: f64) -> bool {
        let at = |one: &f64| (one - value).abs() <= ROUNDING * value.abs();
        let mut all = self.inputs[command].windows(STANDING);
        all.any(|steps| steps.iter().all(at))
    }
}

/// Returns the smallest and the largest value.
fn ends(values: &[f64]) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    values.iter().copied().fold(none, extended)
}

/// Sink that keeps the motion of the probes.
struct Series {
    layout: RecordLayout,
    /// Place of each applied command among the values of a record, and the range of its actuator.
    applied: Vec<(usize, Option<(f64, f64)>)>,
    /// Places of the law's inputs, and their last values.
    law: Range<usize>,
    last: Vec<f64>,
    motion: Motion,
}

impl Series {
    fn new(
        layout: &RecordLayout,
        loops: &Loops<'_>,
        excited: Option<usize>,
        limits: &[Option<(f64, f64)>],
    ) -> Self {
        let [truth, measured, reference, command, ..] = layout.groups().map(<[_]>::len);
        let first = truth + measured + reference + command;
        let places = loops.commands.iter().zip(limits).map(|(name, limit)| {
            let place = (layout.command.iter()).position(|field| field.name == *name);
            (first + place.unwrap_or_default(), *limit)
        });
        let count = loops.commands.len();
        Self {
            layout: layout.clone(),
            applied: places.collect(),
            law: truth..truth + measured + reference,
            last: Vec::new(),
            motion: Motion {
                course: loops.course,
                excited,
                inputs: vec![Vec::new(); count],
                output: Vec::new(),
                moves: Vec::new(),
                largest: vec![0.0; count],
                limited: vec![0; count],
                events: Vec::new(),
            },
        }
    }
}

impl RecordSink for Series {
    fn open(&mut self, _: &RecordLayout) -> Result<(), LinkError> {
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        let view = self.layout.view(words);
        let (motion, count) = (&mut self.motion, self.applied.len());
        let (_, cut) = view.values.split_at(view.values.len() - 2 * count);
        let (inputs, outputs) = cut.split_at(count);
        if inputs.iter().any(|input| !input.is_finite()) {
            return Ok(()); // the last record has no command
        }
        for (largest, input) in motion.largest.iter_mut().zip(inputs) {
            *largest = larger(*largest, input.abs());
        }
        let Some(since) = view.step.checked_sub(motion.course.first_step) else {
            return Ok(());
        };
        for (count, (place, limit)) in motion.limited.iter_mut().zip(&self.applied) {
            let value = view.values[*place];
            *count += u64::from(limit.is_some_and(|(low, high)| value <= low || value >= high));
        }
        if since >= motion.course.period_steps {
            let of_law = &view.values[self.law.clone()];
            // A value that stands still may change by rounding.
            let moved = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-12 * b.abs();
            motion.moves.push(of_law.iter().zip(&self.last).any(moved));
            self.last.clear();
            self.last.extend_from_slice(of_law);
            for (series, input) in motion.inputs.iter_mut().zip(inputs) {
                series.push(*input);
            }
            motion
                .output
                .extend(motion.excited.map(|place| outputs[place]));
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.motion.events.push(event.clone());
        Ok(())
    }
}

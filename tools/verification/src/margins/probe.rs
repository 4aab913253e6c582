//! A run with a probe, and the fits of the probe's input and output.

use std::f64::consts::{PI, TAU};

use hil_config::SineFit;
use hil_config::plan::{Plan, Probe, Tone};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_run::alone;
use shared_types::describe::Description;
use shared_types::link::LinkError;
use shared_types::record::{Event, Outcome, RecordLayout};
use shared_types::stream::RecordSink;

/// Windows in which the response is fitted, one after another.
pub(super) const WINDOWS: usize = 3;

/// Times of a probe in steps: a period to settle, then the windows, each one period.
#[derive(Clone, Copy, Debug)]
pub(super) struct Course {
    pub(super) first_step: u64,
    pub(super) period_steps: u64,
}

/// Result of a run with a probe.
pub(super) struct Probed {
    /// `a + j b` of the probe's input and output, for each tone and window.
    pub(super) phasors: Vec<[[(f64, f64); 2]; WINDOWS]>,
    /// Largest size of the probe's input.
    pub(super) largest: f64,
}

/// Runs a plan with tones of this total amplitude added to a command. Returns the reason if the run does not complete.
pub(super) fn run(
    plan: &Plan,
    described: &[Description; 2],
    (command, amplitude): (&str, f64),
    course: Course,
    turns: &[u64],
    interruption: &Interruption,
) -> Result<Result<Probed, String>, Failure> {
    let mut plan = plan.clone();
    let size = amplitude / (turns.len() as f64).sqrt();
    // Phases after Schroeder, which keep the peak of the sum low.
    let tones = turns.iter().enumerate().map(|(index, turns_of)| Tone {
        turns: *turns_of,
        amplitude: size,
        phase_rad: PI * ((index * index) as f64) / turns.len() as f64,
    });
    plan.run.steps = course.first_step + (1 + WINDOWS as u64) * course.period_steps;
    plan.probes = vec![Probe {
        command: command.into(),
        first_step: course.first_step,
        period_steps: course.period_steps,
        tones: tones.collect(),
    }];
    let sink = |layout: &RecordLayout| Fits::new(layout.clone(), course, turns);
    let (end, fits) = alone::observe(&plan, described, sink, interruption)?;
    if end.outcome != Outcome::Completed {
        let reason = end.reason.unwrap_or_else(|| "it did not complete".into());
        return Ok(Err(format!("the run with the probe ended early: {reason}")));
    }
    Ok(fits.finish())
}

/// Sink that fits the probe's input and output.
struct Fits {
    layout: RecordLayout,
    course: Course,
    /// Sine and cosine of each part of the period.
    table: Vec<(f64, f64)>,
    tones: Vec<(u64, [SineFit; WINDOWS])>,
    largest: f64,
}

impl Fits {
    fn new(layout: RecordLayout, course: Course, turns: &[u64]) -> Self {
        let part = |k: u64| libm::sincos(TAU * k as f64 / course.period_steps as f64);
        Self {
            layout,
            course,
            table: (0..course.period_steps).map(part).collect(),
            tones: (turns.iter())
                .map(|turns| (*turns, Default::default()))
                .collect(),
            largest: 0.0,
        }
    }

    fn finish(self) -> Result<Probed, String> {
        let phasors = self.tones.iter().map(|(_, fits)| {
            let mut all = [[(0.0, 0.0); 2]; WINDOWS];
            for (to, fit) in all.iter_mut().zip(fits) {
                *to = fit.phasors()?;
            }
            Some(all)
        });
        let phasors: Option<Vec<_>> = phasors.collect();
        Ok(Probed {
            phasors: phasors.ok_or("a tone has too few samples in a turn")?,
            largest: self.largest,
        })
    }
}

impl RecordSink for Fits {
    fn open(&mut self, _: &RecordLayout) -> Result<(), LinkError> {
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        let view = self.layout.view(words);
        let [.., input, output] = view.values else {
            return Ok(());
        };
        if !input.is_finite() {
            return Ok(()); // the last record has no command
        }
        self.largest = self.largest.max(input.abs());
        let Course {
            first_step,
            period_steps,
        } = self.course;
        let since = view.step.checked_sub(first_step + period_steps);
        let Some(since) = since else {
            return Ok(());
        };
        let window = (since / period_steps) as usize;
        for (turns, fits) in &mut self.tones {
            let (sin, cos) = self.table[(*turns * (since % period_steps) % period_steps) as usize];
            if let Some(fit) = fits.get_mut(window) {
                fit.take(sin, cos, [*input, *output]);
            }
        }
        Ok(())
    }

    fn event(&mut self, _: &Event) -> Result<(), LinkError> {
        Ok(())
    }
}

//! Measurement of one loop: its responses, its margins, and the reasons to refuse them.

use std::collections::BTreeMap;

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use shared_types::describe::Description;

use super::locus::{Margins, Response, margins};
use super::probe::{self, Course, Probed, WINDOWS};
use super::span::Span;

/// Share of the largest command that the probe has by default.
const SHARE: f64 = 0.01;
/// Largest share of the loop's own motion in the response.
const OWN_MOTION: f64 = 0.1;
/// Largest relative change of L at half the amplitude, and from one window to another.
const CHANGE: f64 = 0.02;
/// Gains at which the response decides about margins.
const DECISIVE: std::ops::RangeInclusive<f64> = 0.1..=10.0;
/// Largest number of runs that add frequencies.
const REFINEMENTS: usize = 4;

/// Loop to be measured.
pub(super) struct Measurement<'a> {
    pub(super) plan: &'a Plan,
    pub(super) described: &'a [Description; 2],
    pub(super) command: &'a str,
    pub(super) at_s: f64,
    pub(super) amplitude: Option<f64>,
    pub(super) span: Span,
    pub(super) interruption: &'a Interruption,
}

/// Measured response at one frequency.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) frequency_hz: f64,
    pub(super) l: (f64, f64),
    /// Response in each window.
    windows: [(f64, f64); WINDOWS],
    /// Response at half the amplitude.
    half: (f64, f64),
    /// Amplitude of the response at the probe's output.
    pub(super) amplitude: f64,
    pub(super) coherence: f64,
    /// Amplitude of the loop's own motion, as a share of the response.
    own: f64,
}

/// Measured loop.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub(super) amplitude: f64,
    pub(super) points: Vec<Point>,
    pub(super) margins: Margins,
    /// Margins from each window, and from half the amplitude.
    pub(super) others: Vec<Margins>,
}

impl Measurement<'_> {
    /// Measures the loop; returns the reason if that is refused.
    pub(super) fn run(&self) -> Result<Result<Measured, String>, Failure> {
        let first = self.span.tones();
        let rest = self.probed(0.0, &first)?;
        let own = match rest {
            Ok(own) => own,
            Err(reason) => return Ok(Err(reason)),
        };
        let amplitude = self.amplitude.unwrap_or(SHARE * own.largest);
        if amplitude == 0.0 {
            return Ok(Err(
                "the command is 0 throughout, so no amplitude follows from it; give --amplitude"
                    .into(),
            ));
        }
        let mut points = BTreeMap::new();
        if let Err(reason) = self.add(&mut points, amplitude, &first, &own)? {
            return Ok(Err(reason));
        }
        for _ in 0..REFINEMENTS {
            let current = margins(&locus(&points, |point| point.l));
            let mut further: Vec<u64> = (current.places_hz().into_iter())
                .filter(|hz| hz.is_finite())
                .flat_map(|hz| self.span.around(hz))
                .filter(|turns| !points.contains_key(turns))
                .collect();
            further.sort_unstable();
            further.dedup();
            if further.is_empty() {
                break;
            }
            let own = match self.probed(0.0, &further)? {
                Ok(own) => own,
                Err(reason) => return Ok(Err(reason)),
            };
            if let Err(reason) = self.add(&mut points, amplitude, &further, &own)? {
                return Ok(Err(reason));
            }
        }
        let all: Vec<Point> = points.values().cloned().collect();
        if let Some(reason) = refusal(&all) {
            return Ok(Err(reason));
        }
        let result = margins(&locus(&points, |point| point.l));
        if result.crossovers.is_empty() {
            let gain = |point: Option<&Point>| point.map_or(f64::NAN, |one| size(one.l));
            return Ok(Err(format!(
                "no crossover: |L| is {:.4} at {:.4} Hz and {:.4} at {:.4} Hz, and never 1 between",
                gain(all.first()),
                self.span.low_hz,
                gain(all.last()),
                self.span.high_hz
            )));
        }
        let mut others: Vec<Margins> = (0..WINDOWS)
            .map(|window| margins(&locus(&points, |point| point.windows[window])))
            .collect();
        others.push(margins(&locus(&points, |point| point.half)));
        Ok(Ok(Measured {
            amplitude,
            points: all,
            margins: result,
            others,
        }))
    }

    /// Runs the loop with these tones.
    fn probed(&self, amplitude: f64, turns: &[u64]) -> Result<Result<Probed, String>, Failure> {
        let course = Course {
            first_step: self.plan.run.rate.step_at_or_after(self.at_s).0,
            period_steps: self.span.period_steps(),
        };
        let probe = (self.command, amplitude);
        probe::run(
            self.plan,
            self.described,
            probe,
            course,
            turns,
            self.interruption,
        )
    }

    /// Measures the response at these tones, with the whole and with half the amplitude.
    fn add(
        &self,
        points: &mut BTreeMap<u64, Point>,
        amplitude: f64,
        turns: &[u64],
        own: &Probed,
    ) -> Result<Result<(), String>, Failure> {
        let whole = match self.probed(amplitude, turns)? {
            Ok(whole) => whole,
            Err(reason) => return Ok(Err(reason)),
        };
        let half = match self.probed(0.5 * amplitude, turns)? {
            Ok(half) => half,
            Err(reason) => return Ok(Err(reason)),
        };
        for (index, turns) in turns.iter().enumerate() {
            let own = &own.phasors[index];
            let with = |probed: &Probed| without(&probed.phasors[index], own);
            let (whole, half) = (with(&whole), with(&half));
            let output =
                (whole.iter().map(|[_, output]| size(*output))).sum::<f64>() / WINDOWS as f64;
            let own = own
                .iter()
                .map(|[_, output]| size(*output))
                .fold(0.0, f64::max);
            let (l, coherence) = response(&whole);
            let point = Point {
                frequency_hz: self.span.hz(*turns),
                l,
                windows: whole.map(|window| response(&[window]).0),
                half: response(&half).0,
                amplitude: output,
                coherence,
                own: own / output,
            };
            points.insert(*turns, point);
        }
        Ok(Ok(()))
    }
}

type Phasors = [(f64, f64); 2];

/// Subtracts the loop's own motion.
fn without(phasors: &[Phasors; WINDOWS], own: &[Phasors; WINDOWS]) -> [Phasors; WINDOWS] {
    std::array::from_fn(|window| {
        std::array::from_fn(|side| {
            let (a, b) = (phasors[window][side], own[window][side]);
            (a.0 - b.0, a.1 - b.1)
        })
    })
}

/// Computes `L = -sum(in conj(out)) / sum(|out|^2)`, and the coherence of input and output.
fn response(windows: &[Phasors]) -> ((f64, f64), f64) {
    let (mut re, mut im, mut inputs, mut outputs) = (0.0, 0.0, 0.0, 0.0);
    for [(a, b), (c, d)] in windows {
        re += a * c + b * d;
        im += b * c - a * d;
        inputs += a * a + b * b;
        outputs += c * c + d * d;
    }
    let coherence = (re * re + im * im) / (inputs * outputs);
    ((-re / outputs, -im / outputs), coherence)
}

fn locus(points: &BTreeMap<u64, Point>, l: impl Fn(&Point) -> (f64, f64)) -> Vec<Response> {
    let of = |point: &Point| Response {
        frequency_hz: point.frequency_hz,
        l: l(point),
    };
    points.values().map(of).collect()
}

fn size((re, im): (f64, f64)) -> f64 {
    libm::hypot(re, im)
}

/// Returns the relative difference of two responses.
fn change(a: (f64, f64), b: (f64, f64)) -> f64 {
    size((a.0 - b.0, a.1 - b.1)) / size(b)
}

/// Returns the reason why a response supports no margin, if there is one.
fn refusal(points: &[Point]) -> Option<String> {
    if let Some(point) = points.iter().find(|point| !size(point.l).is_finite()) {
        return Some(format!(
            "there is no response at {:.4} Hz",
            point.frequency_hz
        ));
    }
    let decisive = || {
        points
            .iter()
            .filter(|point| DECISIVE.contains(&size(point.l)))
    };
    let worst = |of: &dyn Fn(&Point) -> f64| {
        let all = decisive().map(|point| (of(point), point.frequency_hz));
        all.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    if let Some((own, hz)) = worst(&|point| point.own).filter(|(own, _)| *own > OWN_MOTION) {
        return Some(format!(
            "the loop moves by itself: at {hz:.4} Hz its own motion is {:.1} % of the response; raise --amplitude, or choose another --at",
            100.0 * own
        ));
    }
    let spread = |point: &Point| {
        let all = point.windows.iter().map(|window| change(*window, point.l));
        all.fold(0.0, f64::max)
    };
    if let Some((share, hz)) = worst(&spread).filter(|(share, _)| *share > CHANGE) {
        return Some(format!(
            "the response is not steady: at {hz:.4} Hz it changes by {:.1} % from one period to another, so the loop is unstable, still settling or disturbed",
            100.0 * share
        ));
    }
    let halved = |point: &Point| change(point.half, point.l);
    let (share, hz) = worst(&halved).filter(|(share, _)| *share > CHANGE)?;
    Some(format!(
        "the response depends on the amplitude: at {hz:.4} Hz L changes by {:.1} % at half the amplitude, as from saturation or friction; choose another --amplitude",
        100.0 * share
    ))
}

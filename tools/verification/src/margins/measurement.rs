//! Measurement of one loop: its responses and its margins.

use std::collections::BTreeMap;

use shared_types::time::Step;

use super::extremes::larger;
use super::locus::{Margins, Response, margins, margins_of_less_order};
use super::point::{Point, change, size};
use super::probe::{Complex, Excitation, Fitted, Loops, Motion, Stop, WINDOWS};
use super::refusal;
use super::resolution::{Resolution, Surveyed};
use super::span::Span;

/// Share of the largest command that the probe has by default.
const SHARE: f64 = 0.01;
/// Largest number of runs that add frequencies.
const REFINEMENTS: usize = 12;

/// Loop to be measured, while the loops of all other commands stay closed.
pub(super) struct Measurement<'a> {
    pub(super) loops: &'a Loops<'a>,
    /// Motion without tones.
    pub(super) own: &'a Motion,
    /// Place of the command.
    pub(super) command: usize,
    pub(super) amplitude: Option<f64>,
    pub(super) span: Span,
}

/// Measured loop.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub(super) amplitude: f64,
    pub(super) points: Vec<Point>,
    pub(super) margins: Margins,
    /// Margins from each window, from half the amplitude, and from a coarser interpolation.
    pub(super) others: Vec<Margins>,
    /// Reason to refuse phase and delay margin alone.
    pub(super) crossover_refused: Option<String>,
    /// Reason to refuse the gain margin alone.
    pub(super) gain_refused: Option<String>,
    /// Reason to refuse the least distance from -1 alone.
    pub(super) disc_refused: Option<String>,
    /// Responses of all probes at the tones of the survey, without the loop's own motion.
    pub(super) survey: Vec<Fitted>,
}

impl Measurement<'_> {
    /// Measures the loop.
    pub(super) fn run(&self) -> Result<Measured, Stop> {
        let tones = self.span.tones();
        let amplitude = (self.amplitude).unwrap_or(SHARE * self.own.largest[self.command]);
        if amplitude == 0.0 {
            return Err(Stop::Refused(
                "the command is 0 throughout, so no amplitude follows from it; give --amplitude"
                    .into(),
            ));
        }
        if let Some(reason) = refusal::rounded(amplitude, self.own.largest[self.command]) {
            return Err(Stop::Refused(reason));
        }
        let mut points = BTreeMap::new();
        self.add(&mut points, amplitude, &tones)?;
        self.support(&points)?;
        let dense = self.span.dense();
        let fits = self.survey(amplitude, &dense)?;
        let survey = { dense.iter().copied() }.zip(fits.iter().map(|fits| self.surveyed(fits)));
        let survey: BTreeMap<u64, Surveyed> = survey.collect();
        let resolution = |points: &BTreeMap<u64, Complex>| {
            let resolution = Resolution {
                points,
                survey: &survey,
                span: self.span,
            };
            (resolution.further(), resolution.refusal())
        };
        let all = |points: &BTreeMap<u64, Point>| -> BTreeMap<u64, Complex> {
            points
                .iter()
                .map(|(turns, point)| (*turns, point.l))
                .collect()
        };
        for _ in 0..REFINEMENTS {
            let current = margins(&locus(&points, |point| point.l));
            let mut further: Vec<u64> = (current.places_hz().into_iter())
                .filter(|hz| hz.is_finite())
                .flat_map(|hz| self.span.around(hz))
                .chain(resolution(&all(&points)).0)
                .filter(|turns| !points.contains_key(turns))
                .collect();
            further.sort_unstable();
            further.dedup();
            if further.is_empty() {
                break;
            }
            self.add(&mut points, amplitude, &further)?;
        }
        self.support(&points)?;
        let unresolved = resolution(&all(&points)).1;
        let all: Vec<Point> = points.values().cloned().collect();
        let result = margins(&locus(&points, |point| point.l));
        let crossover_refused = refusal::without_crossover(&all, &result);
        // A loop that does not answer at all has no locus.
        let without = crossover_refused
            .clone()
            .filter(|_| !result.disc[1].is_finite());
        if let Some(reason) = unresolved.or(without) {
            return Err(Stop::Refused(reason));
        }
        let mut others: Vec<Margins> = (0..WINDOWS)
            .map(|window| margins(&locus(&points, |point| point.windows[window])))
            .collect();
        others.push(margins(&locus(&points, |point| point.half)));
        others.push(margins_of_less_order(&locus(&points, |point| point.l)));
        let [gain_refused, disc_refused] = refusal::figures(&all, &result);
        Ok(Measured {
            amplitude,
            crossover_refused,
            points: all,
            margins: result,
            others,
            gain_refused,
            disc_refused,
            survey: fits,
        })
    }

    /// Refuses responses that support no margins.
    fn support(&self, points: &BTreeMap<u64, Point>) -> Result<(), Stop> {
        let all: Vec<Point> = points.values().cloned().collect();
        match refusal::of(&all, self.own.growth(self.command)) {
            Some(reason) => Err(Stop::Refused(reason)),
            None => Ok(()),
        }
    }

    /// Measures the responses of all probes to the whole amplitude at many tones.
    fn survey(&self, amplitude: f64, tones: &[u64]) -> Result<Vec<Fitted>, Stop> {
        let motion = self.probed(amplitude, tones)?;
        Ok(response_to(motion.fits(tones)?, &self.own.fits(tones)?))
    }

    /// Returns the response of this loop among those of all probes.
    fn surveyed(&self, fits: &Fitted) -> Surveyed {
        let windows = fits.each_ref().map(|all| all[self.command]);
        let l = open_loop(&windows).0;
        let changes = windows.map(|window| change(open_loop(&[window]).0, l));
        Surveyed {
            l,
            unsteadiness: changes.into_iter().fold(0.0, larger),
        }
    }

    /// Runs the loops with these tones.
    fn probed(&self, amplitude: f64, tones: &[u64]) -> Result<Motion, Stop> {
        let motion = self.loops.run(Some(Excitation {
            command: self.command,
            amplitude,
            turns: tones,
        }))?;
        let rate = self.loops.plan.run.rate;
        let refused = refusal::limited(self.loops.commands, &motion.limited, &self.own.limited)
            .or_else(|| {
                let growth = motion.steady_growth_over(self.own)?;
                let period_s = rate.seconds(Step(self.loops.course.period_steps));
                Some(refusal::growing(growth, period_s, "with the probe"))
            });
        match refused {
            Some(reason) => Err(Stop::Refused(reason)),
            None => Ok(motion),
        }
    }

    /// Measures the response at these tones, with the whole and with half the amplitude.
    fn add(
        &self,
        points: &mut BTreeMap<u64, Point>,
        amplitude: f64,
        tones: &[u64],
    ) -> Result<(), Stop> {
        let own = self.own.fits(tones)?;
        let (whole, half) = (
            self.probed(amplitude, tones)?,
            self.probed(0.5 * amplitude, tones)?,
        );
        let clipped = whole.clipped(self.command);
        let (whole, half) = (
            response_to(whole.fits(tones)?, &own),
            response_to(half.fits(tones)?, &own),
        );
        for (index, turns) in tones.iter().enumerate() {
            let of = |fits: &[Fitted]| fits[index].each_ref().map(|all| all[self.command]);
            let (whole, half, own) = (of(&whole), of(&half), of(&own));
            let output = whole.iter().map(|[_, output]| size(*output));
            let output = output.sum::<f64>() / WINDOWS as f64;
            let own = own.iter().map(|[_, output]| size(*output));
            let (l, coherence) = open_loop(&whole);
            let point = Point {
                frequency_hz: self.span.hz(*turns),
                l,
                windows: whole.map(|window| open_loop(&[window]).0),
                half: open_loop(&half).0,
                amplitude: output,
                coherence,
                own: own.fold(0.0, larger) / output,
            };
            points.insert(*turns, point);
        }
        let depends = || (points.values()).any(|point| point.nonlinearity() > refusal::CHANGE);
        match clipped.filter(|one| one.share > refusal::CHANGE || depends()) {
            Some(one) => {
                let own = self.own.stands_at(self.command, one.value);
                Err(Stop::Refused(refusal::clipped(&one, own)))
            }
            None => Ok(()),
        }
    }
}

/// Subtracts the loop's own motion.
pub(super) fn response_to(mut fits: Vec<Fitted>, own: &[Fitted]) -> Vec<Fitted> {
    let values = |fits: &mut Fitted, own: &Fitted| {
        let all = fits.iter_mut().flatten().flatten();
        for (value, own) in all.zip(own.iter().flatten().flatten()) {
            *value = (value.0 - own.0, value.1 - own.1);
        }
    };
    for (fits, own) in fits.iter_mut().zip(own) {
        values(fits, own);
    }
    fits
}

/// Computes `L = -sum(in conj(out)) / sum(|out|^2)`, and the coherence of input and output.
fn open_loop(windows: &[[Complex; 2]]) -> (Complex, f64) {
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

fn locus(points: &BTreeMap<u64, Point>, l: impl Fn(&Point) -> Complex) -> Vec<Response> {
    let of = |point: &Point| Response {
        frequency_hz: point.frequency_hz,
        l: l(point),
    };
    points.values().map(of).collect()
}

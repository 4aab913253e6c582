//! Points of a search, judged: which requirement they break, and how near the others are to breaking.
//!
//! Points are in units of the ranges, so that 0 is the smallest and 1 the largest value of each. Margins are shares of
//! the margin at the nominal point, so that requirements in different units can be compared.

use std::collections::BTreeSet;

use hil_config::problem::Problems;
use hil_console::terminal::exit::Failure;
use hil_facts::results::requirements::VACUOUS;

use super::super::answers;
use super::super::evaluator::{Evaluation, Evaluator};

/// Reason for which a search ends without a result.
pub(super) enum Stop {
    /// The question has no answer; states what was tried and what to do.
    Refused(String),
    /// The command failed.
    Failed(Failure),
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

/// Point with its result.
#[derive(Clone, Debug)]
pub(super) struct Trial {
    /// Point in units of the ranges.
    pub(super) unit: Vec<f64>,
    /// Result, with the values of the point.
    pub(super) evaluation: Evaluation,
    /// Set if the searched requirement does not hold.
    pub(super) is_failed: bool,
    /// Least margin of a searched requirement, as a share of that at the nominal point.
    pub(super) share: f64,
    /// Index of the requirement with the least margin.
    pub(super) requirement: usize,
}

/// All points tried so far.
pub(super) struct Trials {
    evaluator: Evaluator,
    /// Indices of the searched requirements.
    requirements: Vec<usize>,
    /// Margins at the nominal point; empty until it was tried.
    scales: Vec<f64>,
    all: Vec<Trial>,
    /// Values of all points, by their bits.
    known: BTreeSet<Vec<u64>>,
}

impl Trials {
    /// Begins without a trial.
    ///
    /// # Errors
    /// If the scenario lacks the requirement that the study names, or has none at all.
    pub(super) fn new(evaluator: Evaluator) -> Result<Self, Failure> {
        let names: Vec<&str> = { evaluator.requirements().iter() }
            .map(|(name, _)| &**name)
            .collect();
        let study = evaluator.study();
        if names.is_empty() {
            return Err(Failure::usage(format!(
                "{} has no [[requirements]], so no case can fail one; add the requirement that the search is about",
                study.scenario.display()
            )));
        }
        let requirements = match &study.search.requirement {
            None => (0..names.len()).collect(),
            Some(name) => {
                let place = names.iter().position(|one| one == name).ok_or_else(|| {
                    let message = format!("the scenario has no requirement `{name}`");
                    let advice = format!("its requirements: {}", names.join(", "));
                    Problems(vec![study.problem_of(
                        "search.requirement",
                        &message,
                        &advice,
                    )])
                })?;
                vec![place]
            }
        };
        Ok(Self {
            requirements,
            evaluator,
            scales: Vec::new(),
            all: Vec::new(),
            known: BTreeSet::new(),
        })
    }

    pub(super) const fn evaluator(&self) -> &Evaluator {
        &self.evaluator
    }

    /// Returns all trials in the order in which they were made.
    pub(super) fn all(&self) -> &[Trial] {
        &self.all
    }

    /// Returns the number of runs that the search took, including those of interrupted commands.
    pub(super) fn runs(&self) -> u64 {
        self.known.len() as u64
    }

    /// Returns the number of runs that are left.
    pub(super) fn left(&self) -> u64 {
        let most = self.evaluator.study().search.runs;
        most.saturating_sub(self.runs())
    }

    /// Returns the name and unit of the requirement with the least margin.
    pub(super) fn requirement(&self, trial: &Trial) -> (&str, &str) {
        let (name, unit) = &self.evaluator.requirements()[trial.requirement];
        (name, unit)
    }

    /// Returns the least margin in the unit of its requirement.
    pub(super) fn margin(trial: &Trial) -> f64 {
        let evaluation = &trial.evaluation;
        let one = &evaluation.margins[trial.requirement];
        answers::margin(&one.verdict, &evaluation.class, one.robustness)
    }

    /// Returns the nominal point, in units of the ranges.
    pub(super) fn nominal(&self) -> Vec<f64> {
        let dimensions = self.evaluator.dimensions().iter();
        dimensions
            .map(|one| (one.nominal - one.min) / (one.max - one.min))
            .collect()
    }

    /// Converts a point in units of the ranges to values.
    pub(super) fn values(&self, unit: &[f64]) -> Vec<f64> {
        let dimensions = self.evaluator.dimensions().iter();
        let value = dimensions.zip(unit).map(|(one, share)| {
            let value = match *share {
                1.0 => one.max,
                share => one.min + (one.max - one.min) * share,
            };
            if one.is_whole {
                libm::round(value) + 0.0
            } else {
                value
            }
        });
        value.collect()
    }

    /// Returns the distance of a trial from the nominal point, in units of the ranges.
    pub(super) fn distance(&self, trial: &Trial) -> f64 {
        let dimensions = self.evaluator.dimensions().iter();
        let squares = dimensions.zip(&trial.evaluation.point).map(|(one, value)| {
            let part = (value - one.nominal) / (one.max - one.min);
            part * part
        });
        squares.sum::<f64>().sqrt()
    }

    /// Runs and judges points. The first point of the first call must be the nominal one.
    ///
    /// # Errors
    /// If a point is invalid or has no result, or if a verdict is undecided or vacuous.
    pub(super) fn attempt(&mut self, units: &[Vec<f64>]) -> Result<Vec<Trial>, Stop> {
        let points: Vec<Vec<f64>> = units.iter().map(|unit| self.values(unit)).collect();
        let evaluations = self.evaluator.evaluate(&points)?;
        let mut trials = Vec::new();
        for (unit, evaluation) in units.iter().zip(evaluations) {
            if self.scales.is_empty() {
                let scale = |robustness: f64| match robustness.abs() {
                    size if size.is_normal() => size,
                    _ => 1.0,
                };
                let margins = evaluation.margins.iter();
                self.scales = margins.map(|one| scale(one.robustness)).collect();
            }
            let trial = self.judged(unit, evaluation)?;
            let bits = trial.evaluation.point.iter().map(|value| value.to_bits());
            if self.known.insert(bits.collect()) {
                self.all.push(trial.clone());
            }
            trials.push(trial);
        }
        Ok(trials)
    }

    fn judged(&self, unit: &[f64], evaluation: Evaluation) -> Result<Trial, Stop> {
        let has_diverged = evaluation.class == "diverged";
        let verdict = |place: &usize| &*evaluation.margins[*place].verdict;
        let is_failed = has_diverged || self.requirements.iter().any(|one| verdict(one) == "fail");
        let mut undecided = self.requirements.iter();
        if let Some(place) = undecided.find(|one| verdict(one) == "undecided")
            && !is_failed
        {
            return Err(Stop::Refused(format!(
                "`{}` is undecided at {}, because the run ends before the formula can be judged; raise run.duration_s, or search another requirement",
                self.evaluator.requirements()[*place].0,
                self.evaluator.describe(&evaluation.point)
            )));
        }
        let mut vacuous = self.requirements.iter();
        if let Some(place) = vacuous.find(|one| verdict(one) == VACUOUS)
            && !is_failed
        {
            return Err(Stop::Refused(format!(
                "`{}` is vacuous at {}, because the premise of an `implies` never called for its conclusion, and that is no pass; search where the premise holds, write `not p or c` if it may stay unused, or search another requirement",
                self.evaluator.requirements()[*place].0,
                self.evaluator.describe(&evaluation.point)
            )));
        }
        let shares = self.requirements.iter().map(|place| {
            let one = &evaluation.margins[*place];
            let margin = answers::margin(&one.verdict, &evaluation.class, one.robustness);
            (margin / self.scales[*place], *place)
        });
        let least = shares.min_by(|a, b| a.0.total_cmp(&b.0));
        let (share, requirement) = least.unwrap_or((f64::INFINITY, 0));
        Ok(Trial {
            unit: unit.to_owned(),
            is_failed,
            share,
            requirement,
            evaluation,
        })
    }
}

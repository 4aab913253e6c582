//! Evaluator of a study at chosen points: runs the scenario with these values, and keeps every result in a journal.
//!
//! Built-in plants and laws run in this process, one case on each core; external programs run in processes that are
//! kept from case to case. A point that was evaluated earlier in the same folder, with the same scenario and programs,
//! is not run again, so an interrupted command continues when it is repeated. Searches call it; it never decides which
//! point comes next.

mod kept_results;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::study::{Spread, Study};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use hil_run::alone;
use hil_run::kept::Kept;
use shared_types::number::short;
use shared_types::record::RunEnd;

use super::cases::Cases;
use super::plan::ineffective;
use super::result::CaseResult;
use super::runner::{Case, Runner, Watchdog};
use crate::folder::Conflict;
use crate::table::{Cell, Column, ColumnKind, Row};
use kept_results::KeptResults;

/// Range of a study in which points lie.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// Name of the varied value.
    pub name: String,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Value from which distances are measured.
    pub nominal: f64,
    /// Set if only whole numbers are valid.
    pub is_whole: bool,
}

/// Verdict on a requirement at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Margin {
    /// `pass`, `fail` or `undecided`.
    pub verdict: String,
    /// Margin in the unit of the requirement, negative for a failed one; NaN if there is none.
    pub robustness: f64,
}

/// Result of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Value of each dimension.
    pub point: Vec<f64>,
    /// `pass`, `fail`, `diverged` or `undecided`.
    pub class: String,
    /// Verdict on each requirement, in the order of the scenario.
    pub margins: Vec<Margin>,
    /// Digest of the run.
    pub digest: String,
    /// Reason for which the run ended early; empty if it did not.
    pub reason: String,
}

/// Parts of a range at whose ends its effect is looked for.
const PLACES: u32 = 16;

/// Evaluator of one variant of a study.
pub struct Evaluator {
    cases: Cases,
    variant: usize,
    dimensions: Vec<Dimension>,
    /// Requirements by name and unit.
    requirements: Vec<(String, String)>,
    kept: KeptResults,
    processes: RefCell<Kept>,
    watchdog: Watchdog,
    interruption: Interruption,
}

/// Number of a point in the journal: a hash of its flags.
type Number = u64;

impl Evaluator {
    /// Prepares the evaluation of a study's variant, with the results that a folder already holds.
    ///
    /// # Errors
    /// If the study or its scenario is invalid, or the folder cannot be written.
    pub fn open(
        study: Study,
        variant: usize,
        binaries: &BinaryArguments,
        folder: &Path,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let dimensions = dimensions(&study)?;
        let cases = Cases::of_study(study, binaries, interruption)?;
        let (case_limit_s, wait_limit_s) = {
            let study = cases.study();
            (study.case_limit_s, study.wait_limit_s)
        };
        let mut evaluator = Self {
            variant,
            requirements: Vec::new(),
            kept: KeptResults::open(folder, &cases)?,
            processes: RefCell::new(Kept::new(wait_limit_s)),
            watchdog: Watchdog::begin(case_limit_s, "hil; the same command continues"),
            interruption: interruption.clone(),
            cases,
            dimensions,
        };
        let nominal: Vec<f64> = evaluator.dimensions.iter().map(|one| one.nominal).collect();
        let plan = evaluator.check(&nominal)?;
        evaluator.refuse_ineffective(&nominal)?;
        let requirements = plan.requirements.into_iter();
        evaluator.requirements = requirements.map(|one| (one.name, one.unit)).collect();
        Ok(evaluator)
    }

    /// Refuses ranges without an effect on the scenario.
    fn refuse_ineffective(&self, nominal: &[f64]) -> Result<(), Failure> {
        let before = self.scenario(nominal)?;
        for (place, one) in self.dimensions.iter().enumerate() {
            // An expression may have the same value at both ends and another between.
            let between = (1..PLACES)
                .map(|n| one.min + (one.max - one.min) * f64::from(n) / f64::from(PLACES));
            let ends = if one.nominal < one.max {
                [one.max, one.min]
            } else {
                [one.min, one.max]
            };
            let mut is_effective = false;
            for value in ends.into_iter().chain(between) {
                let mut point = nominal.to_vec();
                point[place] = value;
                if self.scenario(&point)? != before {
                    is_effective = true;
                    break;
                }
            }
            if !is_effective {
                let mut varied = self.study().varied.iter();
                let key = varied.find(|varied| varied.name == one.name);
                let key = key.and_then(|varied| varied.key.as_ref());
                return Err(ineffective(self.study(), key.unwrap_or(&one.name)));
            }
        }
        Ok(())
    }

    /// Returns the study.
    #[must_use]
    pub const fn study(&self) -> &Study {
        self.cases.study()
    }

    /// Returns the ranges of the points.
    #[must_use]
    pub fn dimensions(&self) -> &[Dimension] {
        &self.dimensions
    }

    /// Returns name and unit of each requirement.
    #[must_use]
    pub fn requirements(&self) -> &[(String, String)] {
        &self.requirements
    }

    /// Describes a point by the names and values of its dimensions.
    #[must_use]
    pub fn describe(&self, point: &[f64]) -> String {
        let values = self.dimensions.iter().zip(point);
        let values = values.map(|(one, value)| format!("{} {}", one.name, short(*value)));
        values.collect::<Vec<String>>().join(", ")
    }

    /// Checks the plan of a point, as far as that starts no process.
    ///
    /// # Errors
    /// All errors of the case, located at the entries of the study that cause them.
    pub fn check(&self, point: &[f64]) -> Result<Plan, Failure> {
        let checked = self.cases.checked(self.flags(point));
        checked.map_err(|failure| match failure {
            Failure::Usage(why) => {
                Failure::Usage(format!("{why}\nin the case {}", self.describe(point)))
            }
            other => other,
        })
    }

    /// Formats the case of a point as a complete scenario.
    ///
    /// # Errors
    /// If the case is invalid.
    pub fn scenario(&self, point: &[f64]) -> Result<String, Failure> {
        self.cases.scenario_text(&self.check(point)?)
    }

    /// Returns the result of each point, in their order; runs those that have none yet.
    ///
    /// # Errors
    /// If a point is invalid, a run does not end by itself three times, the journal cannot be written, or the command
    /// is interrupted.
    pub fn evaluate(&mut self, points: &[Vec<f64>]) -> Result<Vec<Evaluation>, Failure> {
        let mut missing: BTreeMap<Number, &Vec<f64>> = BTreeMap::new();
        for point in points {
            let number = self.number(point);
            if self.kept.row(number).is_none() && !missing.contains_key(&number) {
                // Before any run: an invalid point is a mistake in the study.
                self.check(point)?;
                missing.insert(number, point);
            }
        }
        let missing: Vec<(Number, &Vec<f64>)> = missing.into_iter().collect();
        let rows = self.run(&missing)?;
        self.kept.add(rows)?;
        let evaluations = points.iter().map(|point| {
            let row = self.kept.row(self.number(point));
            let row = row.and_then(|row| self.evaluation(point, row));
            row.ok_or_else(|| Failure::infrastructure("the journal has an incomplete row"))
        });
        evaluations.collect()
    }

    /// Runs points and returns their rows. After a failure no further point is begun.
    fn run(&self, points: &[(Number, &Vec<f64>)]) -> Result<Vec<Row>, Failure> {
        let next = AtomicUsize::new(0);
        let ended: Mutex<(Vec<Row>, Option<Failure>)> = Mutex::default();
        let locked = || ended.lock().unwrap_or_else(PoisonError::into_inner);
        let runner = Runner {
            cases: &self.cases,
            watchdog: &self.watchdog,
            interruption: &self.interruption,
        };
        let kept = &self.kept;
        let work = |evaluator: &PointRunner<'_>, processes: &mut Kept| {
            while let Some((number, point)) = points.get(next.fetch_add(1, Ordering::Relaxed)) {
                if locked().1.is_some() {
                    return;
                }
                match evaluator.run(*number, point, processes) {
                    Ok(row) => locked().0.push(row),
                    Err(failure) => locked().1 = Some(failure),
                }
            }
        };
        let of_points = PointRunner {
            runner,
            kept,
            variant: self.variant,
            dimensions: &self.dimensions,
        };
        if self.cases.binaries().is_some() {
            // Plant and controller of one case already use two cores.
            work(&of_points, &mut self.processes.borrow_mut());
        } else {
            let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
            std::thread::scope(|scope| {
                for _ in 0..cores.min(points.len()) {
                    // Cases that run in this process need no others.
                    scope.spawn(|| work(&of_points, &mut Kept::new(f64::INFINITY)));
                }
            });
        }
        let (rows, failure) = ended.into_inner().unwrap_or_else(PoisonError::into_inner);
        match failure {
            None => Ok(rows),
            Some(failure) => Err(failure),
        }
    }

    fn flags(&self, point: &[f64]) -> Vec<String> {
        let values = self.cases.draws.at(point);
        self.cases.draws.flags_with(self.variant, &values)
    }

    fn number(&self, point: &[f64]) -> Number {
        number_of(&self.flags(point))
    }

    /// Reads the row of a point.
    fn evaluation(&self, point: &[f64], row: &Row) -> Option<Evaluation> {
        let (margins, rest) = row
            .get(3..)?
            .split_at_checked(2 * self.requirements.len())?;
        let [.., digest, reason] = rest else {
            return None;
        };
        let margins = margins.chunks_exact(2).map(|pair| Margin {
            verdict: pair[0].as_text().to_owned(),
            robustness: pair[1].as_number().unwrap_or(f64::NAN),
        });
        Some(Evaluation {
            point: point.to_owned(),
            class: row[1].as_text().to_owned(),
            margins: margins.collect(),
            digest: digest.as_text().to_owned(),
            reason: reason.as_text().to_owned(),
        })
    }
}

/// Returns the ranges of a study.
///
/// # Errors
/// If a varied value is neither computed nor has a range, or if nothing varies.
fn dimensions(study: &Study) -> Result<Vec<Dimension>, Failure> {
    let mut dimensions = Vec::new();
    for one in &study.varied {
        if matches!(one.spread, Spread::Expression(_)) {
            continue;
        }
        let Some(([min, max], nominal)) = one.range() else {
            let key = one.key.clone().unwrap_or_default();
            let message = format!(
                "`{}` has no range, so no size of it can be searched",
                one.name
            );
            let advice = "make it uniform, or give a normal or lognormal value `min` and `max`; one value of a list can be set with `set` or in a variant";
            return Err(Problems(vec![study.problem_of(&key, &message, advice)]).into());
        };
        dimensions.push(Dimension {
            name: one.name.clone(),
            min,
            max,
            nominal,
            is_whole: one.is_whole,
        });
    }
    if dimensions.is_empty() {
        return Err(Failure::usage(format!(
            "{}: nothing varies; add a [[vary]] with kind = \"uniform\" for the size that is searched",
            study.name
        )));
    }
    Ok(dimensions)
}

/// Numbers a point by its flags.
fn number_of(flags: &[String]) -> Number {
    let mut hasher = blake3::Hasher::new();
    for flag in flags {
        hasher.update(&(flag.len() as u64).to_le_bytes());
        hasher.update(flag.as_bytes());
    }
    let hash = hasher.finalize();
    hash.as_bytes()[..8]
        .iter()
        .fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// Runner of points on one thread.
struct PointRunner<'a> {
    runner: Runner<'a>,
    kept: &'a KeptResults,
    variant: usize,
    dimensions: &'a [Dimension],
}

impl PointRunner<'_> {
    fn run(&self, number: Number, point: &[f64], processes: &mut Kept) -> Result<Row, Failure> {
        let values = self.dimensions.iter().zip(point);
        let values = values.map(|(one, value)| format!("{} {}", one.name, short(*value)));
        let draws = &self.runner.cases.draws;
        let mut case = Point {
            number,
            label: format!("the case {}", values.collect::<Vec<String>>().join(", ")),
            flags: draws.flags_with(self.variant, &draws.at(point)),
            cases: self.runner.cases,
            kept: self.kept,
        };
        let began = Instant::now();
        match self.runner.run(&mut case, processes)? {
            Ok((row, _)) => {
                let wall_s = began.elapsed().as_secs_f64();
                self.kept.write(|journal| journal.row(&row, wall_s, None))?;
                Ok(row)
            }
            Err(why) => {
                let advice = match why.contains(RunEnd::INVALID_COMMAND) {
                    true => {
                        "; the law gives no usable command there: narrow the range in [[vary]] to values at which it does, or mend the law; finished runs are kept"
                    }
                    false => "",
                };
                let label = case.label;
                Err(Failure::infrastructure(format!(
                    "{label} has no result: {why}{advice}"
                )))
            }
        }
    }
}

/// Point as a case of the runner.
struct Point<'a> {
    number: Number,
    label: String,
    flags: Vec<String>,
    cases: &'a Cases,
    kept: &'a KeptResults,
}

impl Case for Point<'_> {
    fn label(&self) -> String {
        self.label.clone()
    }

    fn tries(&self) -> u64 {
        self.kept.tries(self.number)
    }

    fn plan(&self) -> Result<Plan, Failure> {
        let plan = self.cases.planned(self.flags.clone())?;
        alone::refuse_clock(&plan)?;
        Ok(plan)
    }

    fn row(&self, result: &CaseResult) -> Row {
        let mut row = vec![Cell::Count(self.number)];
        row.extend(result.cells());
        row
    }

    fn columns(&self, result: &CaseResult) -> Vec<Column> {
        let mut columns = vec![Column::new("case", ColumnKind::Count)];
        columns.extend(result.columns());
        columns
    }

    fn start(&mut self) -> Result<(), Failure> {
        self.kept.write(|journal| journal.start(self.number))
    }

    fn leave(&mut self) -> Result<(), Failure> {
        self.kept.write(|journal| journal.leave(self.number))
    }

    fn differs(&mut self, _: &Conflict) -> Result<(), Failure> {
        Ok(()) // the failure that follows names it
    }

    fn ends(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}

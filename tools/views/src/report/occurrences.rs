//! Times at which a formula of requirements holds in a recorded run.
//!
//! Evaluated at every step by the code that judges requirements.

use hil_config::expression::{Columns, ExpressionError, Group};
use hil_config::formula::Formula;
use hil_config::monitor::{EveryStep, FormulaContext};
use hil_config::plan::Plan;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_recording::reader::SpanReader;
use shared_types::time::Step;

use super::run::Run;

/// Maximum number of intervals in an answer.
const MOST: usize = 1000;

/// Occurrences of a formula.
#[derive(Debug, Default)]
pub(crate) struct Occurrences {
    /// First and last step of each interval, as many as an answer has.
    pub(crate) intervals: Vec<[u64; 2]>,
    /// Number of all intervals.
    pub(crate) count: u64,
    /// Number of steps at which the formula holds.
    pub(crate) steps: u64,
    /// Number of steps at which it can be judged.
    pub(crate) judged: u64,
}

/// Search of a run by formulas.
pub(crate) struct Search {
    plan: Plan,
    /// Signals of a record, with the derived ones behind them.
    columns: Columns,
    /// Evaluation before the first record.
    evaluation: RecordEvaluation,
}

impl Search {
    /// Prepares the search of a run.
    ///
    /// # Errors
    /// If the scenario of the run is invalid, or the recording is an excerpt.
    pub(crate) fn of(run: &Run) -> Result<Self, String> {
        let reader = &run.outcome.reader;
        let recorded = run.recorded_run();
        let recorded =
            recorded.ok_or("the scenario of the run is invalid, so nothing can be evaluated")?;
        if reader.is_excerpt() {
            return Err("an excerpt lacks signals or steps, so it is not searched".into());
        }
        let plan = recorded.plan.clone().without_judgement();
        let (mut columns, _) = recorded.columns(reader)?;
        for one in &plan.derived {
            columns.push_with_unit(Group::Derived, &one.name, &one.unit);
        }
        Ok(Self {
            evaluation: recorded.evaluation(reader, &plan)?,
            plan,
            columns,
        })
    }

    /// Finds the intervals in which a formula holds.
    ///
    /// # Errors
    /// If the formula is invalid, or the recording cannot be read any more.
    pub(crate) fn occurrences(
        &self,
        text: &str,
        spans: &SpanReader,
        last: Step,
    ) -> Result<Occurrences, String> {
        let mut every_step = self.formula(text).map_err(|error| error.to_string())?;
        let mut evaluation = self.evaluation.clone();
        let missing = vec![f64::NAN; self.columns.len()];
        let mut result = Occurrences::default();
        let mut since = None;
        let mut next = 0;
        let read = spans.read(Step(0), last, |words| {
            // A lost record counts as one without values.
            for step in next..words[0] {
                result.take(every_step.observe(Step(step), &missing), &mut since);
            }
            evaluation.record(words);
            let decided = every_step.observe(Step(words[0]), evaluation.row());
            result.take(decided, &mut since);
            next = words[0] + 1;
        });
        read.map_err(|error| error.to_string())?;
        // An interval that lasts to the end of what can be judged.
        if let Some(begin) = since {
            result.close(begin, result.judged - 1);
        }
        Ok(result)
    }

    /// Prepares a formula.
    fn formula(&self, text: &str) -> Result<EveryStep, ExpressionError> {
        let formula = Formula::parse(text)?;
        if let Some(error) = formula.unknown_names(&self.columns).into_iter().next() {
            return Err(error);
        }
        formula.unit(&self.columns)?;
        let (run, derived) = (self.plan.run, &self.plan.derived);
        let context = FormulaContext::new(&self.columns, derived, run.rate, run.steps);
        EveryStep::new(&formula, &context)
    }
}

impl Occurrences {
    /// Adds a decided step; `since` is the first step of the interval that goes on.
    fn take(&mut self, decided: Option<(Step, bool)>, since: &mut Option<u64>) {
        let Some((step, holds)) = decided else { return };
        self.judged += 1;
        self.steps += u64::from(holds);
        match (*since, holds) {
            (None, true) => *since = Some(step.0),
            (Some(begin), false) => {
                self.close(begin, step.0 - 1);
                *since = None;
            }
            _ => {}
        }
    }

    fn close(&mut self, begin: u64, end: u64) {
        self.count += 1;
        if self.intervals.len() < MOST {
            self.intervals.push([begin, end]);
        }
    }
}

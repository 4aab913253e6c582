//! Steps at which a formula of requirements holds, evaluated at every step by the code that judges requirements.
//!
//! Of a recorded run for reports and panels, or of a session, step by step.

use std::collections::VecDeque;

use hil_config::expression::{Columns, ExpressionError, Group};
use hil_config::formula::Formula;
use hil_config::monitor::{EveryStep, FormulaContext};
use hil_config::plan::Plan;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_recording::reader::SpanReader;
use shared_types::record::RecordLayout;
use shared_types::time::Step;

use super::run::Run;

/// Maximum number of intervals that are kept and listed.
pub(crate) const MOST: usize = 1000;

/// Occurrences of a formula.
#[derive(Debug, Default)]
pub(crate) struct Occurrences {
    /// First and last step of each interval that has ended, as many as are kept.
    pub intervals: VecDeque<[u64; 2]>,
    /// Number of all intervals that have ended.
    pub count: u64,
    /// First step of the interval that goes on.
    pub since: Option<u64>,
    /// Number of steps at which the formula holds.
    pub steps: u64,
    /// Number of steps at which it was judged, and the last of them.
    pub judged: u64,
    pub last: u64,
    keeps_newest: bool,
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
    /// Prepares the search of a recorded run.
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
        let (columns, _) = recorded.columns(reader)?;
        let evaluation = recorded.evaluation(reader, &plan)?;
        Ok(Self::new(plan, columns, evaluation))
    }

    /// Prepares the search of a session whose records have this layout.
    ///
    /// # Errors
    /// If the plan does not fit the layout.
    pub(crate) fn of_layout(plan: &Plan, layout: &RecordLayout) -> Result<Self, ExpressionError> {
        let plan = plan.clone().without_judgement();
        let evaluation = RecordEvaluation::of_layout(&plan, layout)?;
        Ok(Self::new(plan, Columns::from(layout), evaluation))
    }

    fn new(plan: Plan, mut columns: Columns, evaluation: RecordEvaluation) -> Self {
        for one in &plan.derived {
            columns.push_with_unit(Group::Derived, &one.name, &one.unit);
        }
        Self {
            plan,
            columns,
            evaluation,
        }
    }

    /// Returns the evaluation before the first record.
    pub(crate) fn evaluation(&self) -> RecordEvaluation {
        self.evaluation.clone()
    }

    /// Returns the row of a record that was lost.
    pub(crate) fn missing(&self) -> Vec<f64> {
        vec![f64::NAN; self.columns.len()]
    }

    /// Prepares a formula for the records from a step on, which counts as the beginning of the run.
    ///
    /// # Errors
    /// If the formula is invalid, or no step is left at which it could be judged.
    pub(crate) fn formula(&self, text: &str, first: Step) -> Result<EveryStep, String> {
        let (formula, every_step) = self.checked(text).map_err(|error| {
            let names: Vec<_> = error
                .nearest
                .iter()
                .map(|name| format!("`{name}`"))
                .collect();
            match names.is_empty() {
                true => error.to_string(),
                false => format!("{error}; nearest: {}", names.join(", ")),
            }
        })?;
        if first == Step(0) {
            return Ok(every_step);
        }
        self.bind(&formula, first).map_err(|_| {
            format!(
                "the formula looks further ahead than the run goes on after step {first}, the first one that was kept"
            )
        })
    }

    /// Checks a formula against the whole run.
    fn checked(&self, text: &str) -> Result<(Formula, EveryStep), ExpressionError> {
        let formula = Formula::parse(text)?;
        if let Some(error) = formula.unknown_names(&self.columns).into_iter().next() {
            return Err(error);
        }
        formula.unit(&self.columns)?;
        let every_step = self.bind(&formula, Step(0))?;
        Ok((formula, every_step))
    }

    fn bind(&self, formula: &Formula, first: Step) -> Result<EveryStep, ExpressionError> {
        let (run, derived) = (self.plan.run, &self.plan.derived);
        let steps = run.steps.saturating_sub(first.0);
        let context = FormulaContext::new(&self.columns, derived, run.rate, steps);
        EveryStep::new(formula, &context)
    }

    /// Finds the intervals in which a formula holds in a recorded run.
    ///
    /// # Errors
    /// If the formula is invalid, or the recording cannot be read any more.
    pub(crate) fn occurrences(
        &self,
        text: &str,
        spans: &SpanReader,
        last: Step,
    ) -> Result<Occurrences, String> {
        let mut every_step = self.formula(text, Step(0))?;
        let mut evaluation = self.evaluation();
        let missing = self.missing();
        let mut result = Occurrences::default();
        let mut next = 0;
        let read = spans.read(Step(0), last, |words| {
            // A lost record counts as one without values.
            for step in next..words[0] {
                result.take(every_step.observe(Step(step), &missing));
            }
            evaluation.record(words);
            result.take(every_step.observe(Step(words[0]), evaluation.row()));
            next = words[0] + 1;
        });
        read.map_err(|error| error.to_string())?;
        // An interval that lasts to the end of what can be judged.
        if let Some(begin) = result.since {
            result.close(begin, result.last);
        }
        Ok(result)
    }
}

impl Occurrences {
    /// Creates occurrences that keep the newest intervals, not the first ones.
    pub(crate) fn newest() -> Self {
        Self {
            keeps_newest: true,
            ..Self::default()
        }
    }

    /// Adds a decided step.
    pub(crate) fn take(&mut self, decided: Option<(Step, bool)>) {
        let Some((step, holds)) = decided else { return };
        self.judged += 1;
        self.last = step.0;
        self.steps += u64::from(holds);
        match (self.since, holds) {
            (None, true) => self.since = Some(step.0),
            (Some(begin), false) => {
                self.close(begin, step.0 - 1);
                self.since = None;
            }
            _ => {}
        }
    }

    fn close(&mut self, begin: u64, end: u64) {
        self.count += 1;
        let is_full = self.intervals.len() == MOST;
        if is_full && !self.keeps_newest {
            return;
        }
        if is_full {
            self.intervals.pop_front();
        }
        self.intervals.push_back([begin, end]);
    }
}

//! All requirements of a run, evaluated as records arrive.
//!
//! Part of an [`Evaluation`](crate::evaluation::Evaluation). A missing record counts as a row of missing values, for
//! which no comparison holds.

use serde::Serialize;
use shared_types::time::{Rate, Step};

use crate::expression::{Columns, ExpressionError};
use crate::monitor::{FormulaContext, Monitors, Verdict};
use crate::plan::{Plan, Trace};

/// Requirements of a run.
#[derive(Clone, Debug)]
pub(crate) struct Requirements {
    rate: Rate,
    /// Last step of the run.
    steps: u64,
    /// Step of the next row.
    next: u64,
    missing: Vec<f64>,
    stated: Vec<Stated>,
    monitors: Monitors,
}

/// Name, formula, unit and identifiers of a requirement.
#[derive(Clone, Debug)]
struct Stated {
    name: String,
    formula: String,
    unit: String,
    trace: Trace,
}

/// Result of a requirement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RequirementValue {
    /// Name.
    pub name: String,
    /// Formula.
    pub formula: String,
    /// Verdict on the requirement.
    pub verdict: Verdict,
    /// Margin in `unit`; its sign bit is the verdict. `None` if the run ended before all steps on which the formula
    /// depends; infinite if the formula depends on a missing value.
    pub robustness: Option<f64>,
    /// Unit of the robustness.
    pub unit: String,
    /// Identifiers by which other documents know the requirement.
    #[serde(flatten)]
    pub trace: Trace,
    /// Time in s of the step that determines the robustness.
    pub at_s: Option<f64>,
    /// Time in s of the step that made the verdict certain.
    pub decided_at_s: Option<f64>,
    /// Premise that never called for its conclusion: the requirement would pass if the conclusion were false. `None`
    /// unless it passed.
    pub vacuous: Option<String>,
}

impl Requirements {
    /// Creates the requirements of a plan before the first row, whose columns include the derived signals.
    pub(crate) fn new(plan: &Plan, columns: &Columns) -> Result<Self, ExpressionError> {
        let context = FormulaContext::new(columns, &plan.derived, plan.run.rate, plan.run.steps);
        let stated = plan.requirements.iter().map(|requirement| Stated {
            name: requirement.name.clone(),
            formula: requirement.formula.to_string(),
            unit: requirement.unit.clone(),
            trace: requirement.trace.clone(),
        });
        let formulas = plan.requirements.iter().map(|one| &one.formula);
        Ok(Self {
            rate: plan.run.rate,
            steps: plan.run.steps,
            next: 0,
            missing: vec![f64::NAN; columns.len()],
            stated: stated.collect(),
            monitors: Monitors::new(formulas, &context)?,
        })
    }

    /// Processes the row of a step. Steps must ascend.
    pub(crate) fn observe(&mut self, step: Step, row: &[f64]) {
        while self.next < step.0 && self.next <= self.steps {
            self.monitors.observe(Step(self.next), &self.missing);
            self.next += 1;
        }
        self.monitors.observe(step, row);
        self.next = step.0.saturating_add(1);
    }

    /// Returns bounds on the final robustness of each requirement.
    pub(crate) fn bounds(&self) -> Vec<[f64; 2]> {
        self.monitors.bounds()
    }

    /// Returns the result of each requirement, in the plan's order.
    pub(crate) fn values(&self) -> Vec<RequirementValue> {
        let seconds = |step: Option<Step>| step.map(|step| self.rate.seconds(step));
        let judged = self.stated.iter().zip(self.monitors.judgements());
        let values = judged.enumerate().map(|(number, (stated, judgement))| {
            let Stated {
                name,
                formula,
                unit,
                trace,
            } = stated.clone();
            RequirementValue {
                name,
                formula,
                verdict: judgement.verdict(),
                robustness: judgement.robustness(),
                unit,
                trace,
                at_s: seconds(judgement.judged_by()),
                decided_at_s: seconds(judgement.decided_at()),
                vacuous: self.monitors.vacuous(number).map(Into::into),
            }
        });
        values.collect()
    }
}

//! Derived signals, metrics and requirements, computed as records arrive.
//!
//! Used by readers of a run's records, live or from a file: created once from the plan and the columns of a record,
//! then fed one row per step. Feeding allocates nothing, and memory use does not grow with the run.

use serde::Serialize;
use shared_types::table::canonical;
use shared_types::time::{Rate, Step};

use crate::analysis::{Response, RunningAnalysis};
use crate::expression::{Accumulator, Columns, ExpressionError, Group, Program, Reduction};
use crate::plan::{BoundSource, Metric, Plan, Window};
use crate::requirements::{RequirementValue, Requirements};

/// The derived signals, metrics and requirements of a run.
#[derive(Clone, Debug)]
pub struct Evaluation {
    rate: Rate,
    /// Row of a record followed by the derived signals.
    row: Vec<f64>,
    signals: usize,
    derived: Vec<BoundSource>,
    metrics: Vec<RunningMetric>,
    analyses: Vec<RunningAnalysis>,
    requirements: Requirements,
    /// Time span of the whole run.
    whole_s: [f64; 2],
}

#[derive(Clone, Debug)]
struct RunningMetric {
    name: String,
    unit: String,
    reductions: Vec<Reduction>,
    result: Program,
    /// Values of the reductions in the current row.
    values: Vec<f64>,
    windows: Vec<RunningWindow>,
}

#[derive(Clone, Debug)]
struct RunningWindow {
    window: Window,
    accumulators: Vec<Accumulator>,
}

/// Value of a metric over a window.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MetricValue {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// The window in s.
    pub window_s: [f64; 2],
    /// The value; NaN if it does not exist.
    pub value: f64,
    /// Rows of the window that a reduction skipped because its value was missing; the maximum over all its reductions.
    pub skipped: u64,
}

impl Evaluation {
    /// Creates the evaluation before the first row; `columns` are the columns of the rows to come.
    ///
    /// # Errors
    /// If an expression names a signal that no column has, or a requirement looks beyond the run.
    pub fn new(plan: &Plan, columns: &Columns) -> Result<Self, ExpressionError> {
        let mut all = columns.clone();
        let mut derived = Vec::new();
        for signal in &plan.derived {
            derived.push(signal.source.bind(&all)?);
            all.push(Group::Derived, &signal.name);
        }
        let whole = Window {
            start_s: 0.0,
            end_s: plan.run.rate.seconds(Step(plan.run.steps)),
            first: Step(0),
            last: Step(plan.run.steps),
        };
        let metrics = plan
            .metrics
            .iter()
            .map(|metric| RunningMetric::new(metric, whole, &all))
            .collect::<Result<_, _>>()?;
        let analyses = (plan.analyses.iter())
            .map(|analysis| RunningAnalysis::new(analysis, plan.run.rate, &all))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            rate: plan.run.rate,
            row: vec![f64::NAN; all.len()],
            signals: columns.len(),
            derived,
            metrics,
            analyses,
            requirements: Requirements::new(plan, &all)?,
            whole_s: [whole.start_s, whole.end_s],
        })
    }

    /// Processes the row of a step. Steps must ascend. Signals at the indices `invalid`, which the record marks as such
    /// ([`Validity`](shared_types::record::Validity)), count as missing, whatever value the row contains.
    ///
    /// # Panics
    /// If the row does not have as many numbers as there are columns, or lacks such an index.
    pub fn observe(&mut self, step: Step, row: &[f64], invalid: impl IntoIterator<Item = usize>) {
        self.row[..self.signals].copy_from_slice(row);
        for place in invalid {
            self.row[place] = f64::NAN;
        }
        for (index, source) in self.derived.iter().enumerate() {
            self.row[self.signals + index] = canonical(source.evaluate(step, self.rate, &self.row));
        }
        for metric in &mut self.metrics {
            metric.observe(step, self.rate, &self.row);
        }
        for analysis in &mut self.analyses {
            analysis.observe(step, self.rate, &self.row);
        }
        self.requirements.observe(step, &self.row);
    }

    /// Returns the responses of the rows so far, each with the name of its metric.
    pub fn responses(&self) -> impl Iterator<Item = (&str, Vec<Response>)> {
        let analyses = self.analyses.iter();
        analyses.filter_map(|analysis| Some((analysis.name(), analysis.responses()?)))
    }

    /// Records that a fault event takes effect at a step whose row is still to come.
    pub fn fault(&mut self, event: u32, step: Step) {
        for analysis in &mut self.analyses {
            analysis.fault(event, step);
        }
    }

    /// Returns the result of each requirement for the rows so far, in the plan's order.
    #[must_use]
    pub fn requirements(&self) -> Vec<RequirementValue> {
        self.requirements.values()
    }

    /// Returns bounds on the final robustness of each requirement, given the rows so far, in the plan's order; infinite
    /// if unknown.
    #[must_use]
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        self.requirements.bounds()
    }

    /// Returns the derived signals of the last row, in the plan's order.
    #[must_use]
    pub fn derived(&self) -> &[f64] {
        &self.row[self.signals..]
    }

    /// Returns the last row with the derived signals behind it; NaN for missing values.
    #[must_use]
    pub fn row(&self) -> &[f64] {
        &self.row
    }

    /// Returns every metric over every window, then the figures of every analysis, in the plan's order, for the rows so
    /// far.
    #[must_use]
    pub fn results(&self) -> Vec<MetricValue> {
        let figures = self.analyses.iter().flat_map(|analysis| {
            let figures = analysis.figures().into_iter();
            figures.map(|figure| MetricValue {
                name: format!("{}.{}", analysis.name(), figure.name),
                unit: figure.unit,
                window_s: self.whole_s,
                value: canonical(figure.value),
                skipped: 0,
            })
        });
        let metrics = self.metrics.iter().flat_map(RunningMetric::results);
        metrics.chain(figures).collect()
    }
}

impl RunningMetric {
    fn new(metric: &Metric, whole: Window, columns: &Columns) -> Result<Self, ExpressionError> {
        let (reductions, result) = metric.expression.compile_metric(columns)?;
        let windows = match metric.windows.as_slice() {
            [] => vec![whole],
            windows => windows.to_vec(),
        };
        let running = |window| RunningWindow {
            window,
            accumulators: reductions
                .iter()
                .map(|reduction| Accumulator::new(reduction.kind))
                .collect(),
        };
        Ok(Self {
            name: metric.name.clone(),
            unit: metric.unit.clone(),
            windows: windows.into_iter().map(running).collect(),
            values: vec![f64::NAN; reductions.len()],
            reductions,
            result,
        })
    }

    fn observe(&mut self, step: Step, rate: Rate, row: &[f64]) {
        let inside = |running: &RunningWindow| {
            let Window { first, last, .. } = running.window;
            (first..=last).contains(&step)
        };
        if !self.windows.iter().any(inside) {
            return;
        }
        for (value, reduction) in self.values.iter_mut().zip(&self.reductions) {
            *value = reduction.program.evaluate(row);
        }
        for running in self.windows.iter_mut().filter(|window| inside(window)) {
            for (accumulator, value) in running.accumulators.iter_mut().zip(&self.values) {
                accumulator.take(step, rate, *value);
            }
        }
    }

    fn results(&self) -> impl Iterator<Item = MetricValue> {
        self.windows.iter().map(|running| {
            let reduced: Vec<f64> = running
                .accumulators
                .iter()
                .map(Accumulator::result)
                .collect();
            MetricValue {
                name: self.name.clone(),
                unit: self.unit.clone(),
                window_s: [running.window.start_s, running.window.end_s],
                value: canonical(self.result.evaluate(&reduced)),
                skipped: running
                    .accumulators
                    .iter()
                    .map(Accumulator::skipped)
                    .max()
                    .unwrap_or_default(),
            }
        })
    }
}

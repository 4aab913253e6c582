//! Analyses of a run while its records arrive: a signal's response to a step or a chirp, and the time to detect and
//! overcome a fault.
//!
//! Used by an [`Evaluation`](crate::evaluation::Evaluation). Processing a row allocates nothing, and memory use does
//! not grow with the run.

mod chirp;
mod detection;
mod frequency_response;
mod low_end;
mod sine_fit;
mod step_response;

pub use frequency_response::Response;
pub use sine_fit::SineFit;

use shared_types::time::{Rate, Step};

use crate::expression::{Columns, Expression, ExpressionError, Program};
use crate::plan::{Analysis, AnalysisKind};
use detection::Detection;
use frequency_response::FrequencyResponse;
use step_response::StepResponse;

/// Analysis in progress.
#[derive(Clone, Debug)]
pub(crate) struct RunningAnalysis {
    name: String,
    work: AnalysisState,
}

#[derive(Clone, Debug)]
enum AnalysisState {
    Step {
        signal: Program,
        last: Step,
        response: StepResponse,
    },
    Frequency {
        input: Program,
        output: Program,
        response: Box<FrequencyResponse>,
    },
    Detection {
        alarm: Program,
        recovered: Option<Program>,
        effect: Option<Program>,
        detection: Detection,
    },
}

/// Result of an analysis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Figure {
    /// Name, with a unit suffix if the figure has a unit of its own.
    pub name: &'static str,
    /// Unit.
    pub unit: String,
    /// The value; NaN if it does not exist.
    pub value: f64,
}

impl Figure {
    fn new(name: &'static str, unit: impl Into<String>, value: f64) -> Self {
        Self {
            name,
            unit: unit.into(),
            value,
        }
    }
}

impl RunningAnalysis {
    /// Creates an analysis that has not seen any rows yet.
    ///
    /// # Errors
    /// If an expression names a signal that no column has.
    pub(crate) fn new(
        analysis: &Analysis,
        rate: Rate,
        columns: &Columns,
    ) -> Result<Self, ExpressionError> {
        let bind = |expression: &Expression| expression.compile_signal(columns);
        let work = match &analysis.kind {
            AnalysisKind::StepResponse(plan) => AnalysisState::Step {
                signal: bind(&plan.signal)?,
                last: plan.last,
                response: StepResponse::new(plan),
            },
            AnalysisKind::FrequencyResponse(plan) => AnalysisState::Frequency {
                input: bind(&plan.input)?,
                output: bind(&plan.output)?,
                response: Box::new(FrequencyResponse::new(plan)),
            },
            AnalysisKind::Detection(plan) => AnalysisState::Detection {
                alarm: bind(&plan.alarm)?,
                recovered: plan.recovered.as_ref().map(bind).transpose()?,
                effect: (plan.effect.as_ref())
                    .map(|(effect, _)| bind(effect))
                    .transpose()?,
                detection: Detection::new(plan, rate),
            },
        };
        Ok(Self {
            name: analysis.name.clone(),
            work,
        })
    }

    /// Processes the row of a step. Steps must ascend.
    pub(crate) fn observe(&mut self, step: Step, rate: Rate, row: &[f64]) {
        match &mut self.work {
            AnalysisState::Step {
                signal,
                last,
                response,
            } => {
                if step <= *last {
                    response.take(rate.seconds(step), signal.evaluate(row));
                }
            }
            AnalysisState::Frequency {
                input,
                output,
                response,
            } => {
                let time_s = rate.seconds(step);
                if response.wants(time_s) {
                    response.take(time_s, input.evaluate(row), output.evaluate(row));
                }
            }
            AnalysisState::Detection {
                alarm,
                recovered,
                effect,
                detection,
            } => {
                let value = |program: &Option<Program>| {
                    (program.as_ref()).map_or(f64::NAN, |program| program.evaluate(row))
                };
                let (recovered, effect) = (value(recovered), value(effect));
                detection.take(step, alarm.evaluate(row), recovered, effect);
            }
        }
    }

    /// Records that a fault takes effect at a step whose row is still to come.
    pub(crate) fn fault(&mut self, event: u32, step: Step) {
        if let AnalysisState::Detection { detection, .. } = &mut self.work {
            detection.fault(event, step);
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns the response of the rows so far, if the analysis is a frequency response.
    pub(crate) fn responses(&self) -> Option<Vec<Response>> {
        match &self.work {
            AnalysisState::Frequency { response, .. } => Some(response.responses()),
            AnalysisState::Step { .. } | AnalysisState::Detection { .. } => None,
        }
    }

    /// Returns the figures of the rows so far.
    pub(crate) fn figures(&self) -> Vec<Figure> {
        match &self.work {
            AnalysisState::Step { response, .. } => response.figures(),
            AnalysisState::Frequency { response, .. } => response.figures(),
            AnalysisState::Detection { detection, .. } => detection.figures(),
        }
    }
}

//! Predefined analyses: several figures that no single reduction can compute.

use shared_types::time::Step;

use super::Sweep;
use crate::expression::Expression;

/// Analysis; each of its figures is a metric `name.figure`.
#[derive(Clone, Debug, PartialEq)]
pub struct Analysis {
    /// Name.
    pub name: String,
    /// Kind of analysis.
    pub kind: AnalysisKind,
}

/// Kind of analysis.
#[derive(Clone, Debug, PartialEq)]
pub enum AnalysisKind {
    /// Response of a signal to a step.
    StepResponse(StepResponsePlan),
    /// Response of a signal to a chirp.
    FrequencyResponse(FrequencyResponsePlan),
    /// Times until a fault is detected and overcome.
    Detection(DetectionPlan),
}

impl AnalysisKind {
    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::StepResponse(_) => "step-response",
            Self::FrequencyResponse(_) => "frequency-response",
            Self::Detection(_) => "detection",
        }
    }
}

/// Response of a signal to a step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepResponsePlan {
    /// Signal under analysis.
    pub signal: Expression,
    /// Unit.
    pub unit: String,
    /// Name of the stimulus, which is of kind `step`.
    pub stimulus: String,
    /// Time at which the stimulus steps, in s.
    pub at_s: f64,
    /// Value of the signal before the step.
    pub initial: f64,
    /// Final value of the signal.
    pub wanted: f64,
    /// Half-width of the settling band, as a fraction of the step.
    pub band: f64,
    /// Last analysed step.
    pub last: Step,
}

/// Response of a signal to a chirp.
#[derive(Clone, Debug, PartialEq)]
pub struct FrequencyResponsePlan {
    /// Input signal.
    pub input: Expression,
    /// Output signal.
    pub output: Expression,
    /// Stimulus of kind chirp.
    pub stimulus: String,
    /// Frequency at the beginning of the run in Hz.
    pub start_hz: f64,
    /// Frequency at the end of the sweep in Hz, above the first.
    pub end_hz: f64,
    /// Length of the sweep in s.
    pub duration_s: f64,
    /// Course of the frequency.
    pub sweep: Sweep,
}

/// Times until a fault is detected and overcome.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPlan {
    /// Expression that holds while the law sees a fault.
    pub alarm: Expression,
    /// Number of consecutive records at which the alarm's expression must hold, at least 1.
    pub records: u64,
    /// Event to detect; if none is named, the first event that takes effect.
    pub fault: Option<u32>,
    /// Expression that holds while the fault is overcome.
    pub recovered: Option<Expression>,
    /// Expression of the fault's effect, and its unit.
    pub effect: Option<(Expression, String)>,
}

//! Ready-made analyses: several figures of one thing that no single reduction gives.

use shared_types::time::Step;

use super::Sweep;
use crate::expression::Expression;

/// An analysis; each of its figures is a metric `name.figure`.
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
    /// Times until a fault is found and overcome.
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
    /// The signal.
    pub signal: Expression,
    /// Unit.
    pub unit: String,
    /// The stimulus that steps.
    pub stimulus: String,
    /// Time at which the stimulus steps, in s.
    pub at_s: f64,
    /// The signal's value before it.
    pub initial: f64,
    /// The value that the signal is to settle at.
    pub wanted: f64,
    /// Half the width of the band in which it counts as settled, as a part of the step.
    pub band: f64,
    /// The last step that is looked at.
    pub last: Step,
}

/// Response of a signal to a chirp.
#[derive(Clone, Debug, PartialEq)]
pub struct FrequencyResponsePlan {
    /// The signal that is followed.
    pub input: Expression,
    /// The signal that follows.
    pub output: Expression,
    /// The stimulus that sweeps.
    pub stimulus: String,
    /// Frequency at the beginning of the run in Hz.
    pub start_hz: f64,
    /// Frequency at the end of the sweep in Hz, above the first.
    pub end_hz: f64,
    /// Length of the sweep in s.
    pub duration_s: f64,
    /// Course of the frequency's rise.
    pub sweep: Sweep,
}

/// Times until a fault is found and overcome.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPlan {
    /// Expression that holds while the law sees a fault.
    pub alarm: Expression,
    /// For how many records in a row it must hold to count as an alarm, at least 1.
    pub records: u64,
    /// The event that is to be found; the first that takes hold, if none is named.
    pub fault: Option<u32>,
    /// Expression that holds while the fault is overcome.
    pub recovered: Option<Expression>,
    /// Expression of the fault's effect, and its unit.
    pub effect: Option<(Expression, String)>,
}

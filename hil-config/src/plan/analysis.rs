//! Ready-made analyses: several figures of one thing that no single reduction gives.

use shared_types::time::Step;

use super::Sweep;
use crate::expression::Expression;

/// An analysis; each of its figures is a metric `name.figure`.
#[derive(Clone, Debug, PartialEq)]
pub struct Analysis {
    /// Name.
    pub name: String,
    /// What is analysed.
    pub kind: AnalysisKind,
}

/// What is analysed.
#[derive(Clone, Debug, PartialEq)]
pub enum AnalysisKind {
    /// How a signal answers a step.
    StepResponse(StepResponsePlan),
    /// How a signal follows a chirp.
    FrequencyResponse(FrequencyResponsePlan),
    /// How soon a fault is found and overcome.
    Detection(DetectionPlan),
}

impl AnalysisKind {
    /// As it is written in a scenario.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::StepResponse(_) => "step-response",
            Self::FrequencyResponse(_) => "frequency-response",
            Self::Detection(_) => "detection",
        }
    }
}

/// How a signal answers a step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepResponsePlan {
    /// The signal.
    pub signal: Expression,
    /// Its unit.
    pub unit: String,
    /// The stimulus that steps.
    pub stimulus: String,
    /// When it does, in s.
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

/// How a signal follows a chirp.
#[derive(Clone, Debug, PartialEq)]
pub struct FrequencyResponsePlan {
    /// The signal that is followed.
    pub input: Expression,
    /// The signal that follows.
    pub output: Expression,
    /// The stimulus that sweeps.
    pub stimulus: String,
    /// Frequency at the begin of the run in Hz.
    pub start_hz: f64,
    /// Frequency at the end of the sweep in Hz, above the first.
    pub end_hz: f64,
    /// Length of the sweep in s.
    pub duration_s: f64,
    /// How the frequency rises.
    pub sweep: Sweep,
}

/// How soon a fault is found and overcome.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectionPlan {
    /// What holds while the law sees a fault.
    pub alarm: Expression,
    /// For how many records in a row it must hold to count as an alarm, at least 1.
    pub records: u64,
    /// The event that is to be found; the first that takes hold, if none is named.
    pub fault: Option<u32>,
    /// What holds while the fault is overcome.
    pub recovered: Option<Expression>,
    /// What the fault does, and its unit.
    pub effect: Option<(Expression, String)>,
}

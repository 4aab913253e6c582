//! Findings of checks: a grade, an observation, and the command that remedies it.

use serde::Serialize;
use serde_json::Value;

use super::tree::Unread;

/// Fitness for claims about timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// Suitable for claims about limits and medians.
    Good,
    /// Suitable for claims about medians, and about limits with care.
    Fair,
    /// Unsuitable: measurements reflect this problem rather than the program.
    Poor,
    /// Could not be determined.
    Unknown,
}

impl Grade {
    /// Returns the grade as a word.
    #[must_use]
    pub(crate) const fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::Unknown => "unknown",
        }
    }
}

/// Check of one aspect of the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Check {
    name: &'static str,
    why: &'static str,
}

/// Result of a check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Name of the check, unique in a report.
    pub check: &'static str,
    /// Fitness.
    pub grade: Grade,
    /// Observation in a few words.
    pub found: String,
    /// Reason why the observation matters.
    pub why: &'static str,
    /// Command that remedies the problem, or that shows the value that could not be read; never run by `hil`.
    pub mend: Option<String>,
    /// Measured figures, if any.
    pub measured: Option<Value>,
}

impl Check {
    /// Creates a check with its name and the reason why it matters.
    pub(crate) const fn new(name: &'static str, why: &'static str) -> Self {
        Self { name, why }
    }

    /// Creates a finding with this grade.
    #[must_use]
    pub(crate) fn graded(self, grade: Grade, text: impl Into<String>) -> Finding {
        Finding {
            check: self.name,
            grade,
            found: text.into(),
            why: self.why,
            mend: None,
            measured: None,
        }
    }

    /// Creates a good finding.
    #[must_use]
    pub(crate) fn good(self, text: impl Into<String>) -> Finding {
        self.graded(Grade::Good, text)
    }

    /// Creates a fair finding.
    #[must_use]
    pub(crate) fn fair(self, text: impl Into<String>) -> Finding {
        self.graded(Grade::Fair, text)
    }

    /// Creates a poor finding.
    #[must_use]
    pub(crate) fn poor(self, text: impl Into<String>) -> Finding {
        self.graded(Grade::Poor, text)
    }

    /// Creates a finding that could not be determined.
    #[must_use]
    pub(crate) fn unknown(self, text: impl Into<String>) -> Finding {
        self.graded(Grade::Unknown, text)
    }

    /// Creates the finding for a source that could not be read.
    #[must_use]
    pub(crate) fn unread(self, unread: &Unread) -> Finding {
        self.unknown(unread.to_string())
    }
}

/// Unwraps the input of a check; if it could not be read, returns an unknown finding from the check.
macro_rules! known {
    ($check:ident, $read:expr) => {
        match $read {
            Ok(known) => known,
            Err(unread) => return $check.unread(&unread),
        }
    };
}
pub(crate) use known;

impl Finding {
    /// Adds the command that remedies the problem.
    #[must_use]
    pub(crate) fn mend(self, command: impl Into<String>) -> Self {
        self.mend_if(Some(command.into()))
    }

    /// Adds the command that remedies the problem, if there is one.
    #[must_use]
    pub(crate) fn mend_if(mut self, command: Option<String>) -> Self {
        self.mend = command;
        self
    }

    /// Adds the figures behind the finding.
    #[must_use]
    pub(crate) fn measured(mut self, figures: Value) -> Self {
        self.measured = Some(figures);
        self
    }
}

//! Findings of checks: grade, text, and the command that mends.

use serde::Serialize;
use serde_json::Value;

use super::tree::Unread;

/// Fitness of something for claims about timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// Fit for limits and medians.
    Good,
    /// Medians can be claimed, limits with care.
    Fair,
    /// Measurements on this machine say more about this than about the program.
    Poor,
    /// Not found out.
    Unknown,
}

impl Grade {
    /// The word for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::Unknown => "unknown",
        }
    }
}

/// Something to look at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Check {
    name: &'static str,
    why: &'static str,
}

/// Result of a check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The check's name, of which there is one in a report.
    pub check: &'static str,
    /// Fitness.
    pub grade: Grade,
    /// Observation in a few words.
    pub found: String,
    /// Reason for which the observation matters.
    pub why: &'static str,
    /// The command that mends it, or that shows what could not be read; never run by `hil`.
    pub mend: Option<String>,
    /// The figures, if something was measured.
    pub measured: Option<Value>,
}

impl Check {
    /// A check by its name and why it matters.
    #[must_use]
    pub(crate) const fn new(name: &'static str, why: &'static str) -> Self {
        Self { name, why }
    }

    /// Makes a finding of any grade.
    #[must_use]
    pub(crate) fn graded(self, grade: Grade, found: impl Into<String>) -> Finding {
        Finding {
            check: self.name,
            grade,
            found: found.into(),
            why: self.why,
            mend: None,
            measured: None,
        }
    }

    /// Makes a good finding.
    #[must_use]
    pub(crate) fn good(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Good, found)
    }

    /// Makes a fair finding.
    #[must_use]
    pub(crate) fn fair(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Fair, found)
    }

    /// Makes a poor finding.
    #[must_use]
    pub(crate) fn poor(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Poor, found)
    }

    /// Not found out.
    #[must_use]
    pub(crate) fn unknown(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Unknown, found)
    }

    /// Makes a finding of a source that could not be read.
    #[must_use]
    pub(crate) fn unread(self, unread: &Unread) -> Finding {
        self.unknown(unread.to_string())
    }
}

/// Gives what a check looked at; returns from the check with that as its finding where it cannot be read.
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
    /// With the command that mends it.
    #[must_use]
    pub fn mend(self, command: impl Into<String>) -> Self {
        self.mend_if(Some(command.into()))
    }

    /// With the command that mends it, if there is one.
    #[must_use]
    pub fn mend_if(mut self, command: Option<String>) -> Self {
        self.mend = command;
        self
    }

    /// With the figures behind it.
    #[must_use]
    pub fn measured(mut self, figures: Value) -> Self {
        self.measured = Some(figures);
        self
    }
}

//! What a check found, how good that is, and what mends it.

use serde::Serialize;
use serde_json::Value;

use super::tree::Unread;

/// How well something suits claims about timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// As it should be.
    Good,
    /// Medians can be claimed, limits with care.
    Fair,
    /// What is measured on this machine says more about this than about the program.
    Poor,
    /// It could not be found out.
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
pub struct Check {
    name: &'static str,
    why: &'static str,
}

/// What a look at it showed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The check's name, of which there is one in a report.
    pub check: &'static str,
    /// How good it is.
    pub grade: Grade,
    /// What was found, in a few words.
    pub found: String,
    /// Why it matters.
    pub why: &'static str,
    /// The command that mends it, or that shows what could not be read; never run by `hil`.
    pub mend: Option<String>,
    /// The figures, if something was measured.
    pub measured: Option<Value>,
}

impl Check {
    /// A check by its name and why it matters.
    #[must_use]
    pub const fn new(name: &'static str, why: &'static str) -> Self {
        Self { name, why }
    }

    /// It was graded.
    #[must_use]
    pub fn graded(self, grade: Grade, found: impl Into<String>) -> Finding {
        Finding {
            check: self.name,
            grade,
            found: found.into(),
            why: self.why,
            mend: None,
            measured: None,
        }
    }

    /// It is as it should be.
    #[must_use]
    pub fn good(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Good, found)
    }

    /// It is fair.
    #[must_use]
    pub fn fair(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Fair, found)
    }

    /// It is poor.
    #[must_use]
    pub fn poor(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Poor, found)
    }

    /// It could not be found out.
    #[must_use]
    pub fn unknown(self, found: impl Into<String>) -> Finding {
        self.graded(Grade::Unknown, found)
    }

    /// Its source could not be read.
    #[must_use]
    pub fn unread(self, unread: &Unread) -> Finding {
        self.unknown(unread.to_string())
    }
}

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

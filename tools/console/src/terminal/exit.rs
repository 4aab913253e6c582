//! Exit codes and the failures that cause them.

use std::any::Any;
use std::fmt::Display;
use std::process::ExitCode;

use hil_config::problem::Problems;

/// Exit code of `hil`, ordered by severity: the largest of several runs determines the overall code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Success.
    Pass = 0,
    // Differs from the code of `Outcome::Failed`, which is `Infrastructure`.
    /// A requirement failed, a run diverged, runs differ, or the machine is unfit.
    Failed = 1,
    /// Wrong usage or configuration; nothing was started.
    Usage = 2,
    /// A process died, a wait timed out, a disk is full, or shared memory is missing.
    Infrastructure = 3,
    /// Interrupted by the user.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Reason why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Wrong usage or configuration; nothing was started.
    #[error("{0}")]
    Usage(String),
    /// Runs that must be equal differ, or the requested figure does not exist.
    #[error("error: {0}")]
    Differ(String),
    /// The user interrupted the command.
    #[error("interrupted")]
    Interrupted,
    /// The machine or a process failed.
    #[error("error: {0}")]
    Infrastructure(String),
}

impl From<Problems> for Failure {
    fn from(problems: Problems) -> Self {
        Self::Usage(problems.to_string())
    }
}

impl Failure {
    /// Creates a usage failure with the prefix `error: `.
    pub fn usage(message: impl Display) -> Self {
        Self::Usage(format!("error: {message}"))
    }

    /// Creates an infrastructure failure.
    pub fn infrastructure(message: impl Display) -> Self {
        Self::Infrastructure(message.to_string())
    }

    /// Converts a panic to an infrastructure failure with the panic's message.
    pub fn panicked(who: &str, panic: &(dyn Any + Send)) -> Self {
        let message = panic.downcast_ref::<String>().map(String::as_str);
        let message = message.or_else(|| panic.downcast_ref::<&str>().copied());
        let message = message.unwrap_or("no reason given");
        Self::infrastructure(format!("{who} panicked: {message}"))
    }

    /// Returns the message without the prefix `error: `.
    pub fn reason(&self) -> String {
        self.to_string().trim_start_matches("error: ").to_owned()
    }

    /// Returns the exit code.
    #[must_use]
    pub const fn exit(&self) -> Exit {
        match self {
            Self::Usage(_) => Exit::Usage,
            Self::Differ(_) => Exit::Failed,
            Self::Interrupted => Exit::Interrupted,
            Self::Infrastructure(_) => Exit::Infrastructure,
        }
    }
}

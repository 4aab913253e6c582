//! Exit codes and the failures behind them.

use std::any::Any;
use std::fmt::Display;
use std::process::ExitCode;

use hil_config::problem::Problems;

/// Exit code of `hil`, by severity: of several runs the largest stands for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// All as it should be.
    Pass = 0,
    // Not the code of `Outcome::Failed`, which is `Infrastructure`.
    /// A requirement failed, a run diverged, runs differ, or a machine is unfit.
    Failed = 1,
    /// Wrong usage or configuration; nothing was started.
    Usage = 2,
    /// A process died, a wait ran out, a disk is full, there is no shared memory.
    Infrastructure = 3,
    /// Interrupted by the user.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Reason for which a command could not do its work.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Wrong usage or configuration; nothing was started.
    #[error("{0}")]
    Usage(String),
    /// Runs that must be the same are not.
    #[error("error: {0}")]
    Differ(String),
    /// The user did not want it any more.
    #[error("interrupted")]
    Interrupted,
    /// The machine or a process let it down.
    #[error("error: {0}")]
    Infrastructure(String),
}

impl From<Problems> for Failure {
    fn from(problems: Problems) -> Self {
        Self::Usage(problems.to_string())
    }
}

impl Failure {
    /// A usage failure with the word `error` in front.
    pub fn usage(message: impl Display) -> Self {
        Self::Usage(format!("error: {message}"))
    }

    /// An infrastructure failure.
    pub fn infrastructure(message: impl Display) -> Self {
        Self::Infrastructure(message.to_string())
    }

    /// Makes an infrastructure failure of a panic, with what the panic said.
    pub fn panicked(who: &str, panic: &(dyn Any + Send)) -> Self {
        let said = panic.downcast_ref::<String>().map(String::as_str);
        let said = said.or_else(|| panic.downcast_ref::<&str>().copied());
        let said = said.unwrap_or("no reason given");
        Self::infrastructure(format!("{who} panicked: {said}"))
    }

    /// Says what is wrong, without the word `error` in front.
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

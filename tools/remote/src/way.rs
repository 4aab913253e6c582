//! The way to a target: its name, its agent and its key, and the errors that name it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use shared_types::text;

use crate::machine::{built_for, triple};
use crate::name::Target;

/// A target cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// Mended where it was typed or configured.
    #[error("target {target}: {reason}")]
    Usage {
        /// Name of the target.
        target: String,
        /// Reason for it.
        reason: String,
    },
    /// The machine or the way to it is in the way.
    #[error("target {target}: {reason}")]
    Infrastructure {
        /// Name of the target.
        target: String,
        /// Reason for it.
        reason: String,
    },
    /// Somebody interrupted it.
    #[error("interrupted")]
    Interrupted,
}

/// The way to a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Way {
    /// The target.
    pub target: Target,
    /// The agent that was named, if one was.
    pub agent: Option<PathBuf>,
    /// File of the key, of an agent that listens.
    pub key_file: Option<PathBuf>,
    /// Longest silence of the agent. One that works on an answer gives signs of life.
    pub silence: Duration,
}

/// The static agent for a type of machine in the same build folder as a program of this build, and the agent beside that.
fn agents(own: &Path, machine: &str) -> (Option<PathBuf>, PathBuf) {
    let beside = own.with_file_name("hil-target");
    let profile = own.parent().and_then(Path::file_name);
    let folder = own.parent().and_then(Path::parent);
    let built = folder.zip(profile).zip(triple(machine));
    let built = built
        .map(|((folder, profile), triple)| folder.join(triple).join(profile).join("hil-target"));
    (built, beside)
}

/// Checks that a file is a program for a type of machine.
fn is_for(file: &Path, machine: &str) -> bool {
    built_for(file).is_ok_and(|built| built.as_deref() == Some(machine))
}

impl Way {
    /// Longest silence where no wait limit is given.
    pub const SILENCE: Duration = Duration::from_secs(15);
    /// Least limit of a silence: some signs of life may be late.
    const LEAST_SILENCE: Duration = Duration::from_secs(1);

    /// Takes the wait limit of a run, in s, as the longest silence of the agent.
    #[must_use]
    pub fn with_silence(mut self, wait_limit_s: f64) -> Self {
        let limit = Duration::try_from_secs_f64(wait_limit_s).unwrap_or(Self::SILENCE);
        self.silence = limit.clamp(Self::LEAST_SILENCE, Self::SILENCE);
        self
    }

    /// The agent for a type of machine, if nobody named it and it is older than the one beside this program, with
    /// that: a part of this build that was not built anew.
    #[must_use]
    pub fn stale_agent(&self, machine: &str) -> Option<(PathBuf, PathBuf)> {
        if self.agent.is_some() {
            return None;
        }
        let own = std::env::current_exe().ok()?;
        let (built, beside) = agents(&own, machine);
        let changed = |file: &Path| {
            std::fs::metadata(file)
                .and_then(|found| found.modified())
                .ok()
        };
        let built = built.filter(|file| is_for(file, machine))?;
        (changed(&built)? < changed(&beside)?).then_some((built, beside))
    }

    pub(crate) fn usage(&self, reason: impl std::fmt::Display) -> TargetError {
        TargetError::Usage {
            target: self.target.to_string(),
            reason: text::line(&reason.to_string()),
        }
    }

    pub(crate) fn infrastructure(&self, reason: impl std::fmt::Display) -> TargetError {
        TargetError::Infrastructure {
            target: self.target.to_string(),
            reason: text::line(&reason.to_string()),
        }
    }

    /// Finds the agent for a type of machine: the one that was named, else a static build beside this program's folder,
    /// else the one beside this program.
    ///
    /// # Errors
    /// If there is none for this machine; the error says how to build one.
    pub fn agent_for(&self, machine: &str) -> Result<PathBuf, TargetError> {
        if let Some(named) = &self.agent {
            let built = built_for(named)
                .map_err(|error| self.usage(format!("cannot read {}: {error}", named.display())))?;
            if built.as_deref() == Some(machine) {
                return Ok(named.clone());
            }
            return Err(self.usage(format!(
                "{} is built for {}, the target is {machine}",
                named.display(),
                built.as_deref().unwrap_or("no machine")
            )));
        }
        let own = std::env::current_exe().map_err(|error| self.infrastructure(error))?;
        let (built, beside) = agents(&own, machine);
        let mut agents = built.into_iter().chain([beside]);
        let found = agents.find(|file| is_for(file, machine));
        found.ok_or_else(|| {
            self.usage(match triple(machine) {
                Some(triple) => format!(
                    "no agent for its machine, {machine}: build one with `cargo build --release -p hil-target --target {triple}`, or name one with --target-agent"
                ),
                None => format!("no agent for its machine, {machine}: name one with --target-agent"),
            })
        })
    }
}

//! Route to a target: its name, its agent and its key, and errors that include the name.

use std::path::{Path, PathBuf};
use std::time::Duration;

use shared_types::text;

use crate::machine::{built_for, triple};
use crate::name::Target;

/// Error of a target.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// Error that the user can fix on the command line or in the configuration.
    #[error("target {target}: {reason}")]
    Usage {
        /// Name of the target.
        target: String,
        /// Reason.
        reason: String,
    },
    /// Failure of the machine or of the connection to it.
    #[error("target {target}: {reason}")]
    Infrastructure {
        /// Name of the target.
        target: String,
        /// Reason.
        reason: String,
    },
    /// The operation was interrupted.
    #[error("interrupted")]
    Interrupted,
}

/// Route to a target.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Way {
    /// Target.
    pub target: Target,
    /// Path of the agent, if it was named.
    pub agent: Option<PathBuf>,
    /// Path of the key file of a listening agent.
    pub key_file: Option<PathBuf>,
    /// Maximum silence of the agent. An agent that is working on an answer sends signs of life.
    pub silence: Duration,
}

/// Returns the static agent for a machine type in the build folder of this program, and the agent next to this program.
fn agents(own: &Path, machine: &str) -> (Option<PathBuf>, PathBuf) {
    let beside = own.with_file_name("hil-target");
    let profile = own.parent().and_then(Path::file_name);
    let folder = own.parent().and_then(Path::parent);
    let built = folder.zip(profile).zip(triple(machine));
    let built = built
        .map(|((folder, profile), triple)| folder.join(triple).join(profile).join("hil-target"));
    (built, beside)
}

/// Returns `true` if a file is a program for a machine type.
fn is_for(file: &Path, machine: &str) -> bool {
    built_for(file).is_ok_and(|built| built.as_deref() == Some(machine))
}

impl Way {
    /// Maximum silence without a wait limit.
    pub const SILENCE: Duration = Duration::from_secs(15);
    /// Lower bound of the maximum silence, because some signs of life may be late.
    const LEAST_SILENCE: Duration = Duration::from_secs(1);

    /// Sets the maximum silence of the agent to the wait limit of a run in s.
    #[must_use]
    pub fn with_silence(mut self, wait_limit_s: f64) -> Self {
        let limit = Duration::try_from_secs_f64(wait_limit_s).unwrap_or(Self::SILENCE);
        self.silence = limit.clamp(Self::LEAST_SILENCE, Self::SILENCE);
        self
    }

    /// Returns the agent for a machine type and the program next to this one, if the agent was not named and is older,
    /// which means that it was not rebuilt with this program.
    #[must_use]
    pub fn stale_agent(&self, machine: &str) -> Option<(PathBuf, PathBuf)> {
        if self.agent.is_some() {
            return None;
        }
        let own = std::env::current_exe().ok()?;
        let (built, beside) = agents(&own, machine);
        let changed = |file: &Path| {
            std::fs::metadata(file)
                .and_then(|metadata| metadata.modified())
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

    /// Finds the agent for a machine type: the named agent, or else a static build in the folder of this build, or else
    /// the agent next to this program.
    ///
    /// # Errors
    /// If there is no agent for this machine; the error states how to build one.
    pub fn agent_for(&self, machine: &str) -> Result<PathBuf, TargetError> {
        if let Some(named) = &self.agent {
            let built = built_for(named)
                .map_err(|error| self.usage(format!("cannot read {}: {error}", named.display())))?;
            if built.as_deref() == Some(machine) {
                return Ok(named.clone());
            }
            return Err(self.usage(format!(
                "{} is built for {}, but the target is {machine}",
                named.display(),
                built.as_deref().unwrap_or("no machine")
            )));
        }
        let own = std::env::current_exe().map_err(|error| self.infrastructure(error))?;
        let (built, beside) = agents(&own, machine);
        let mut agents = built.into_iter().chain([beside]);
        let agent = agents.find(|file| is_for(file, machine));
        agent.ok_or_else(|| {
            self.usage(match triple(machine) {
                Some(triple) => format!(
                    "no agent for its machine, {machine}: build one with `cargo build --release -p hil-target --target {triple}`, or name one with --target-agent"
                ),
                None => format!("no agent for its machine, {machine}: name one with --target-agent"),
            })
        })
    }
}

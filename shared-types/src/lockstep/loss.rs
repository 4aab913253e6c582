//! Policies for a run whose controller is lost.

use serde::{Deserialize, Serialize};

/// Policy of the plant when its controller died, stopped answering, gave up or broke the protocol.
///
/// Before the first step there is nothing to go on with: a controller that is lost then ends the
/// run whatever the policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnLoss {
    /// The run ends and says why.
    #[default]
    Abort,
    /// The run goes on with the last command, zeros if there was none.
    Hold,
    /// The run goes on with the scenario's safe command.
    SafeCommand,
    /// The run waits for another controller: the launcher starts the same binary anew. Against the
    /// clock, which waits for nobody, it goes on with the last command until then.
    WaitForRestart,
}

impl OnLoss {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Abort,
        Self::Hold,
        Self::SafeCommand,
        Self::WaitForRestart,
    ];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Abort => "abort",
            Self::Hold => "hold",
            Self::SafeCommand => "safe-command",
            Self::WaitForRestart => "wait-for-restart",
        }
    }
}

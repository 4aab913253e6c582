//! Policies for a run whose controller is lost.

use serde::{Deserialize, Serialize};

/// Policy of the plant when its controller died, stopped answering, aborted or violated the protocol.
///
/// Before the first step no run can continue: losing the controller then ends the run under every policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnLoss {
    /// End the run with a reason.
    #[default]
    Abort,
    /// Continue with the last command, or zeros if there was none.
    Hold,
    /// Continue with the scenario's safe command.
    SafeCommand,
    /// Wait for another controller: the launcher restarts the same binary. In real time the run cannot wait and
    /// meanwhile continues with the last command.
    WaitForRestart,
}

impl OnLoss {
    /// All policies.
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

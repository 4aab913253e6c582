//! Sides of a run: one plant and one controller, each a process of its own as a rule.
//!
//! Named by whoever must tell them apart: links, checkpoints, starts by hand, faults of timing. Holds nothing of a
//! side, which the [lockstep machines](crate::lockstep) do.

use crate::time::Step;

/// A side of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The plant, with its faults.
    Plant,
    /// The controller.
    Controller,
}

impl Side {
    /// Both sides.
    pub const ALL: [Self; 2] = [Self::Plant, Self::Controller];

    /// In one word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Controller => "controller",
        }
    }

    /// Name of the side's [checkpoint](crate::checkpoint) in the session's folder.
    #[must_use]
    pub fn file(self, step: Step) -> String {
        format!("checkpoint-{step}-{}.state", self.name())
    }
}

//! Sides of a run: one plant and one controller, normally in a process each.
//!
//! Used wherever the two must be distinguished: links, checkpoints, manual starts, timing faults. A mere label; the
//! [lockstep machines](crate::lockstep) implement the sides.

use crate::time::Step;

/// A side of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Plant, with its faults.
    Plant,
    /// The controller.
    Controller,
}

impl Side {
    /// Both sides.
    pub const ALL: [Self; 2] = [Self::Plant, Self::Controller];

    /// Returns the side's name in one word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Controller => "controller",
        }
    }

    /// Returns the name of the side's [checkpoint](crate::checkpoint) file in the session's folder.
    #[must_use]
    pub fn file(self, step: Step) -> String {
        format!("checkpoint-{step}-{}.state", self.name())
    }
}

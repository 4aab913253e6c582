//! Ignored messages and frames, counted by reason.
//!
//! [Links](crate::link) count frames that fail a check; the plant's [lockstep machine](crate::lockstep) and its engine
//! count unexpected messages. The counts help to diagnose a peer afterwards and never influence a run.

use std::collections::BTreeMap;
use std::ops::Add;

use serde::{Deserialize, Serialize};

use crate::frame::FrameError;

/// Reason why a message or frame is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Frame with a wrong checksum.
    Corrupt,
    /// Frame of another session.
    Session,
    /// Frame or message of another epoch.
    Epoch,
    /// Frame with another signal layout.
    Layout,
    /// Frame whose number of values differs from the agreed one.
    Count,
    /// Frame of an unknown kind.
    Kind,
    /// Command no newer than an already accepted one.
    Repeated,
    /// Command for a step that was already executed without it, too late to be kept.
    Late,
    /// Frame of a controller that counts as lost.
    Lost,
    /// Unsolicited control message.
    OutOfTurn,
    /// Control message that cannot be decoded.
    Unreadable,
    /// Control message from a process that was not launched as the controller.
    Impostor,
}

impl Reason {
    const ALL: [Self; 12] = [
        Self::Corrupt,
        Self::Session,
        Self::Epoch,
        Self::Layout,
        Self::Count,
        Self::Kind,
        Self::Repeated,
        Self::Late,
        Self::Lost,
        Self::OutOfTurn,
        Self::Unreadable,
        Self::Impostor,
    ];
}

impl From<FrameError> for Reason {
    fn from(error: FrameError) -> Self {
        match error {
            FrameError::Corrupt => Self::Corrupt,
            FrameError::Session => Self::Session,
            FrameError::Epoch => Self::Epoch,
            FrameError::Layout => Self::Layout,
            FrameError::Count => Self::Count,
            FrameError::Kind => Self::Kind,
        }
    }
}

/// Number of ignored messages and frames for each [`Reason`].
///
/// Serialised as a table of the reasons that occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "BTreeMap<Reason, u64>", into = "BTreeMap<Reason, u64>")]
pub struct Ignored([u64; Reason::ALL.len()]);

impl Ignored {
    /// Increments the count of a reason.
    pub fn count(&mut self, reason: impl Into<Reason>) {
        self.0[reason.into() as usize] += 1;
    }

    /// Returns the count of one reason.
    #[must_use]
    pub const fn of(&self, reason: Reason) -> u64 {
        self.0[reason as usize]
    }

    /// Returns the total over all reasons.
    #[must_use]
    pub const fn total(&self) -> u64 {
        let (mut total, mut index) = (0_u64, 0);
        while index < self.0.len() {
            total = total.saturating_add(self.0[index]);
            index += 1;
        }
        total
    }

    /// Returns `true` if nothing was ignored.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.total() == 0
    }
}

impl Add for Ignored {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|index| self.0[index] + other.0[index]))
    }
}

impl From<BTreeMap<Reason, u64>> for Ignored {
    fn from(counts: BTreeMap<Reason, u64>) -> Self {
        Self(Reason::ALL.map(|reason| counts.get(&reason).copied().unwrap_or_default()))
    }
}

impl From<Ignored> for BTreeMap<Reason, u64> {
    fn from(ignored: Ignored) -> Self {
        let counts = Reason::ALL.map(|reason| (reason, ignored.of(reason)));
        counts.into_iter().filter(|(_, count)| *count > 0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_the_reasons_that_occurred_survive_json() {
        let mut ignored = Ignored::default();
        for reason in Reason::ALL {
            assert_eq!(ignored.of(reason), 0);
        }
        ignored.count(Reason::OutOfTurn);
        ignored.count(FrameError::Session);
        let ignored = ignored + ignored;
        let text = serde_json::to_string(&ignored).expect("serialises");
        assert_eq!(text, r#"{"session":2,"out_of_turn":2}"#);
        assert_eq!(
            serde_json::from_str::<Ignored>(&text).expect("parses"),
            ignored
        );
        assert_eq!((ignored.total(), ignored.of(Reason::Session)), (4, 2));
    }

    #[test]
    fn every_reason_has_a_place() {
        for (index, reason) in Reason::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, index);
        }
    }
}

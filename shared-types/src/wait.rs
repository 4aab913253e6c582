//! Contract of a wait: its strategy, its limit, and the place where a waiter sleeps. Uses no clock and no system call.
//!
//! A scenario or `--wait` requests a strategy; `hil-session` picks the one in force (`realtime::apply`: no spinning where
//! both sides share their only core) and waits by it (`waiter`).

use std::fmt;

use serde::{Deserialize, Serialize};

/// Strategy between two polls. Affects timing and the processor time left to other programs, never a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WaitStrategy {
    /// Poll, then yield the core or sleep, as learned from previous waits.
    #[default]
    Hybrid,
    /// Never yield the core: for a core that nobody else needs.
    Spin,
    /// Yield the core after each poll: for a core that both sides have to themselves.
    Yield,
    /// Sleep until the other side sends: for more simultaneous runs than cores.
    Sleep,
}

impl WaitStrategy {
    /// All strategies.
    pub const ALL: [Self; 4] = [Self::Hybrid, Self::Spin, Self::Yield, Self::Sleep];

    /// Name in scenarios, on command lines and in summaries.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Spin => "spin",
            Self::Yield => "yield",
            Self::Sleep => "sleep",
        }
    }
}

/// Time allowed to a live peer: `wait_limit` in scenarios and on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitLimit {
    ns: u64,
}

impl WaitLimit {
    /// Creates a limit in seconds; infinity for no limit.
    #[must_use]
    pub fn from_seconds(limit_s: f64) -> Self {
        // The cast saturates: beyond 584 years is for ever.
        Self {
            ns: (limit_s * 1e9) as u64,
        }
    }

    /// Returns the limit in ns.
    #[must_use]
    #[inline]
    pub const fn ns(self) -> u64 {
        self.ns
    }

    /// Returns the limit in ms.
    #[must_use]
    #[inline]
    pub const fn ms(self) -> u64 {
        self.ns / 1_000_000
    }
}

/// Sleeper that is woken when the other side sends.
pub trait Sleeper: fmt::Debug {
    /// Announces a sleep: any later send ends the sleep or prevents it. An earlier send does not, so the waiter polls
    /// once more in between. Returns the argument for `sleep`.
    fn announce(&self) -> u32;

    /// Sleeps until the other side sends, for at most `ns`; may wake spuriously.
    fn sleep(&self, announced: u32, ns: u64);

    /// Cancels the announcement: this side is awake.
    fn retire(&self);
}

//! Contract of a wait: its strategy, its limit, and the place where a waiter sleeps. It knows no clock and no system
//! call; the waiter itself is not part of the contract.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Strategy between two polls. Moves times and the share of others, never a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WaitStrategy {
    /// Poll, then give the core away or sleep, by what the waits before have shown.
    #[default]
    Hybrid,
    /// Never give the core away: for a core that nobody else needs.
    Spin,
    /// Give the core away after each poll: for a core that both sides have to themselves.
    Yield,
    /// Sleep until the other side sends: for more runs at a time than cores.
    Sleep,
}

impl WaitStrategy {
    /// All of them.
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

/// Time that a peer that lives may take, the scenario's and command line's `wait_limit`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitLimit {
    ns: u64,
}

impl WaitLimit {
    /// A limit in seconds; infinity for no limit.
    #[must_use]
    pub fn from_seconds(limit_s: f64) -> Self {
        // The cast saturates: beyond 584 years is for ever.
        Self {
            ns: (limit_s * 1e9) as u64,
        }
    }

    /// The limit in ns.
    #[must_use]
    #[inline]
    pub const fn ns(self) -> u64 {
        self.ns
    }

    /// The limit in ms.
    #[must_use]
    #[inline]
    pub const fn ms(self) -> u64 {
        self.ns / 1_000_000
    }
}

/// Place where a waiter sleeps until the other side's send wakes it.
pub trait Sleeper: fmt::Debug {
    /// Says that this side is about to sleep: a send after this ends the sleep or keeps it from beginning. A
    /// send before does not, so the waiter looks once more in between. Returns the argument of `sleep`.
    fn announce(&self) -> u32;

    /// Sleeps until the other side sends, `ns` at most; may end for no reason.
    fn sleep(&self, announced: u32, ns: u64);

    /// Says that this side is awake.
    fn retire(&self);
}

//! Answers to "is it the same?" and "is it right?": runs compared, repeated, replayed, judged once more, held against
//! named ones, and put together as suites and audits. Runs through the room below, and draws nothing.

pub(crate) mod audit;
pub mod baseline;
pub mod compare;
#[cfg(test)]
mod damage;
pub mod judge;
pub mod repetition;
pub mod replay;
pub mod rerun;
pub(crate) mod suite;

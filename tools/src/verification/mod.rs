//! Answers to "is it the same?" and "is it right?": runs compared, repeated, replayed, judged once
//! more, compared with baselines, and put together as suites and audits; a single `hil run` is a suite
//! of one. Scenarios are run by [`run`](hil_run); no plot is made here.

pub(crate) mod baseline;
pub(crate) mod compare;
#[cfg(test)]
mod damage;
pub(crate) mod judge;
pub(crate) mod repetition;
pub(crate) mod replay;
pub(crate) mod rerun;
pub(crate) mod suite;

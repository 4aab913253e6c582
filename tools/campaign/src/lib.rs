//! Campaigns: large numbers of runs of one scenario with varied values, organised as a folder that all workers share.
//!
//! The folder is the protocol. Workers may be started by any means on any machine: a case without a result is
//! missing, and any worker may compute it.
//!
//! 1. [`Draws`](draws::Draws) computes the values of each case, a pure function of the study and the case number.
//! 2. A [`Manifest`](manifest::Manifest) identifies the campaign: study, scenario and programs by their hashes.
//! 3. A worker claims a [`Shard`](shard::Shard), a block of consecutive cases, appends every [`Row`](table::Row) to
//!    the journal of its attempt, and publishes the finished shard once. The first result counts; a later one is
//!    compared with it.
//! 4. [`collect`] joins the published parts into one [table] and computes the campaign's digest.
//! 5. [`curves`] over time are stored next to the table and used only for the plots of the report.
//! 6. The statistics are [`binomial`] bounds of probabilities, bounds of quantiles ([`order`]), [`rank`] correlation,
//!    [`sensitivity`] indices and [`mcnemar`]'s test.
//! 7. [`cmaes`] proposes points for searches.
//! 8. [`command`] implements the verbs `hil campaign` and `hil search` on top of these; only this module knows scenarios,
//!    programs and runs.
//!
//! Runs themselves are executed by [`hil_run`]. Apart from [`command`], the modules use only the studies and
//! expressions of `hil-config`; they check no scenario and know no plant.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub mod binomial;
mod cmaes;
pub(crate) mod collect;
pub mod command;
pub(crate) mod curves;
pub(crate) mod draws;
pub mod folder;
pub(crate) mod journal;
pub mod manifest;
pub(crate) mod mcnemar;
pub(crate) mod normal;
pub(crate) mod order;
mod permutation;
pub mod rank;
pub(crate) mod sensitivity;
pub mod shard;
mod sobol;
pub mod table;
mod tail;
pub(crate) mod truncated;

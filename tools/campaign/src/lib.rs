//! Campaigns: very many runs of one scenario whose values vary, as the folder that all workers share.
//!
//! The folder is the protocol. Whoever starts workers, and on which machine, is nobody's business here; what has
//! no result is missing, and any worker may compute it.
//!
//! 1. [`Draws`](draws::Draws) gives the values of each case, a pure function of study and case number.
//! 2. A [`Manifest`](manifest::Manifest) says what a folder is for: study, scenario and programs by their hashes.
//! 3. A worker claims a [`Shard`](shard::Shard), some cases in a row, notes every [`Row`](table::Row) in the journal
//!    of its attempt, and publishes the whole once: the first result counts, and a second one is compared.
//! 4. [`collect`] joins the parts into one [table] and gives the campaign's digest.
//! 5. [`curves`] over time are pictures beside it, for the report alone.
//! 6. Statistics say what follows: [`binomial`] bounds of probabilities, bounds of quantiles ([`order`]), [`rank`]
//!    correlation, [`mcnemar`]'s test.
//! 7. [`command`] is the verb, `hil campaign`, above all of these: it alone knows scenarios, programs and runs.
//!
//! No run is made here: that is [`hil_run`]. Below [`command`], of `hil-config` only studies and their expressions are
//! used; no scenario is checked and no plant is known.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub mod binomial;
pub mod collect;
pub mod command;
pub mod curves;
pub mod draws;
pub mod folder;
pub mod journal;
pub mod manifest;
pub mod mcnemar;
pub mod normal;
pub mod order;
mod permutation;
pub mod rank;
pub mod shard;
mod sobol;
pub mod table;
mod tail;
pub mod truncated;

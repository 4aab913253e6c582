//! The way to and from the person at the terminal, and files that appear whole or not at all. Nearly every package of
//! `hil` uses it; it runs nothing and judges nothing.
//!
//! | Room | What lives there |
//! |---|---|
//! | [`files`] | whole files, the folder of a run, runs found by name |
//! | [`terminal`] | exit codes and failures, advice on them, output, tables, progress, interruption, lengths of time |

#![expect(
    missing_docs,
    reason = "fields and variants whose names say what they are"
)]

// First, because its macro `tell!` is used everywhere.
#[macro_use]
pub mod terminal;

pub mod files;

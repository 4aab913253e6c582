//! The way to and from the person at the terminal: exit codes and failures, advice on them, standard output, tables,
//! progress, interruption, lengths of time as they are typed. Of a run it knows steps and time for the progress bar,
//! nothing else, and it opens no file of a run.

// First, because its macro `tell!` is used everywhere.
#[macro_use]
pub(crate) mod output;

pub(crate) mod advice;
pub(crate) mod duration;
pub(crate) mod exit;
pub(crate) mod ignored;
pub(crate) mod interruption;
pub(crate) mod progress;
pub(crate) mod table;

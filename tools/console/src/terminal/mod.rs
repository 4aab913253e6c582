//! The way to and from the person at the terminal: exit codes and failures, advice on them, standard output, tables,
//! progress, interruption, lengths of time as they are typed. Of a run it knows steps and time for the progress bar,
//! nothing else, and it opens no file of a run.

// First, because its macro `tell!` is used everywhere.
#[macro_use]
pub mod output;

pub mod advice;
pub mod duration;
pub mod exit;
pub mod ignored;
pub mod interruption;
pub mod progress;
pub mod table;

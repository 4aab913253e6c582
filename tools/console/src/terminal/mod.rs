//! Terminal input and output: exit codes and failures, advice on them, standard output, tables, progress, interruption,
//! and parsing of durations. The only facts about a run used here are its steps and time, for the progress bar; files
//! of a run are never opened.

// Declared first because its macro `tell!` is used everywhere.
#[macro_use]
pub mod output;

pub mod advice;
pub mod duration;
pub mod exit;
pub mod ignored;
pub mod interruption;
pub mod progress;
pub mod table;

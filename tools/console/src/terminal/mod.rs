//! Terminal input and output: exit codes and failures, advice on them, standard output, tables, progress,
//! interruption, and parsing of durations. It knows only the steps and time of a run, for the progress bar, and never
//! opens files of a run.

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

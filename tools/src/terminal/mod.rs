//! The way to and from the person at the terminal: exit codes and failures, standard output, progress,
//! interruption, times and names as they are typed and shown. Knows nothing of runs, and reads no file
//! but the terminal.

// First, because its macro `tell!` is used everywhere.
#[macro_use]
pub mod output;

pub mod advice;
pub mod duration;
pub mod exit;
pub mod interruption;
pub mod names;
pub mod progress;

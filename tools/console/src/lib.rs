//! Terminal input and output, and atomically written files. Used by nearly every package of `hil`; runs nothing and
//! judges nothing.
//!
//! | Module | Content |
//! |---|---|
//! | [`files`] | atomic files, the folder of a run, finding runs by name |
//! | [`terminal`] | exit codes and failures, advice on them, output, tables, progress, interruption, durations |

// Declared first because its macro `tell!` is used everywhere.
#[macro_use]
pub mod terminal;

pub mod files;

//! Bad input for every reader of the project, for libFuzzer.
//!
//! What must hold is in [`targets`], which the workspace's own tests run too; `fuzz_targets` hands it
//! to libFuzzer. `docs/fuzzing.md` says how to run it.

#![forbid(unsafe_code)]

pub mod targets;

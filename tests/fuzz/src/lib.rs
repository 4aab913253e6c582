//! Bad input for every reader of the project, for libFuzzer.
//!
//! The checked properties are in [`targets`], which the workspace's own tests also run; `fuzz_targets` passes them to
//! libFuzzer. `docs/fuzzing.md` describes how to run them.

#![forbid(unsafe_code)]

pub mod targets;

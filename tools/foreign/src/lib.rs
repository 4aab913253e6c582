//! Plants and controllers that are not written in Rust.
//!
//! 1. A C program ([`c`]) describes itself by tables that are known at its start; for an FMU, [`fmi`] derives the
//!    tables from its model description.
//! 2. The tables become a `PlantKind` or a `LawKind`, with the checks that the compiler makes for Rust.
//! 3. The common program of plants and controllers runs the plant or law: each step is a call with rows of numbers.
//!    After each call `float_modes` restores the rounding mode of the processor.
//!
//! This is the only package with `unsafe`. It is independent of `hil`, scenarios and recordings.

#![deny(unsafe_op_in_unsafe_fn)]

pub mod c;
mod crash;
mod float_modes;
pub mod fmi;

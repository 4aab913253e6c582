//! Plants and controllers that are not written in Rust.
//!
//! 1. A program in [`c`] describes itself in tables that are known when it starts; for an FMU, [`fmi`] makes them of
//!    its model description.
//! 2. They become a `PlantKind` or a `LawKind`, checked as the compiler checks those of Rust.
//! 3. The program of every plant or controller runs it: each step is a call over rows of numbers. After each call
//!    `float_modes` puts back how the processor rounds.
//!
//! It is the one package with `unsafe`. Nothing here knows `hil`, a scenario or a recording.

#![deny(unsafe_op_in_unsafe_fn)]

pub mod c;
mod crash;
mod float_modes;
pub mod fmi;

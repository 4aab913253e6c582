//! Operating points: linear models and equilibria of plants, laws and their loops. Differentiates nothing itself: both
//! programs answer questions about their own maps.
//!
//! 1. `point` runs a scenario up to a time; it has the checkpoint and the signals of that step.
//! 2. `question` asks a program for its map there ([`shared_types::local_map`]).
//! 3. `model` turns the answer into matrices, without rows on which nothing depends; `closed_loop` joins two of them.
//! 4. `solver` finds the equilibrium of a map, and [`trim`] writes it into the checkpoint; `limits` and `later` are what
//!    ends a run that begins there, and `equilibrium` is the result; `acting` finds the faults between plant and law,
//!    with which neither a loop nor an equilibrium is computed.
//! 5. `continuous` and `modes` derive the continuous matrices and the eigenvalues; `file` is the result as JSON.

mod acting;
pub mod arguments;
mod closed_loop;
mod continuous;
mod equilibrium;
mod file;
mod later;
mod limits;
pub mod linearise;
mod model;
mod modes;
mod point;
mod question;
mod solver;
pub mod trim;

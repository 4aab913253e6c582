//! The programs of both sides and the scenario that they run: found, asked what they are, trusted or refused;
//! the scenario read, checked against them and shown complete. Starts no run.

pub mod binaries;
pub mod checked;
pub mod instruments;
pub mod own;
pub mod scenario;

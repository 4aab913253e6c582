//! Programs of both sides and their scenario: programs are found, described, and trusted or refused; the scenario is
//! read, checked against the programs and shown complete. Starts no run.

pub mod binaries;
pub mod checked;
pub mod instruments;
pub mod own;
pub mod scenario;

//! The programs of both sides and the scenario that they run: found, asked what they are, trusted or refused;
//! the scenario read, checked against them and shown complete. Starts no run.

pub(crate) mod binaries;
pub(crate) mod checked;
#[cfg(test)]
pub(crate) mod rig;
pub(crate) mod scenario;

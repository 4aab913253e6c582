//! Facts about a plant behind a port: real hardware, or a program that nobody here wrote. No truth is known of it.

use serde::{Deserialize, Serialize};

/// Plant behind a port, which is not simulated by its program.
///
/// Its readings arrive on a wire and its commands leave on one, so it has no truth, cannot wait and cannot be repeated.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct PortPlant {
    /// Media whose other end is on this machine, and a peer that is started here: what they carry is simulated.
    pub simulated: Vec<String>,
}

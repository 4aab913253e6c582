//! Bus in simulation.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Frames between plant and controller, as texts that the plant reads again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BusPlan {
    /// Text of the port file.
    pub text: String,
    /// Texts of its DBC files, by name.
    pub dbc: BTreeMap<String, String>,
    /// Number of networks.
    pub networks: u8,
    /// Time in steps for which a received frame suppresses older ones of the other network; `None` for the period of
    /// each frame.
    pub skew_limit_steps: Option<u64>,
}

impl BusPlan {
    /// Largest number of networks.
    pub const MOST_NETWORKS: u8 = 2;
}

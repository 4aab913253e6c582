//! The smallest tables of signals, with which programs of tests fit the teaching plant and its laws.

use shared_types::table;

table! {
    /// Measurement of the teaching plant.
    pub(crate) struct Position {
        /// Position.
        position_m: "m",
    }
}

table! {
    /// Command to the teaching plant.
    pub(crate) struct Force {
        /// Force.
        force_n: "N",
    }
}

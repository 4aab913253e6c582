//! The plant emulator. (Map follows below.)
pub mod integrate;
pub mod models;
pub mod plant;
pub mod stimulus;

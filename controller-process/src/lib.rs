//! The controller. (Map follows below.)
pub mod controller;
pub mod laws;

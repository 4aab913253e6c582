//! Contracts shared by both sides. (Map follows below.)
extern crate self as shared_types; // the names that `table!` writes must hold here too

pub mod describe;
pub mod table;
pub mod time;

pub use zerocopy;

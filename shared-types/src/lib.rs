//! Contracts shared by both sides. (Map follows below.)
extern crate self as shared_types; // the names that `table!` writes must hold here too

pub mod describe;
pub mod frame;
pub mod hello;
pub mod layout;
pub mod link;
pub mod lockstep;
pub mod session;
pub mod table;
pub mod time;

pub use zerocopy;

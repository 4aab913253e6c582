//! What asks the operating system for what the contract names.

pub mod live;
pub mod realtime;
pub mod thread;
pub mod waiter;

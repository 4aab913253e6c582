//! A running session as another terminal sees it: which one is meant, its records, its requests and faults.
//! Talks to sockets and streams of others; never starts or ends a run.

pub mod clock;
pub mod inject;
pub mod live;
pub mod observer;
pub mod standing;

//! A running session as seen from other terminals: selection, records, margins and account, and requests to it.
//! Refuses only requests that cannot be expressed in the plant's terms; the plant decides whether to accept a fault or
//! a change (`plant_process::live`). Starts and ends no run.

pub mod clock;
pub mod happening;
pub mod inject;
pub mod live;
pub mod mark;
pub mod observer;
pub mod set;
pub mod standing;
pub mod writing;

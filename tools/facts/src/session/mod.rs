//! A running session as other terminals have it: which one is meant, its records, margins and account, requests to
//! it. Refuses only a request that cannot be put into the plant's words; whether a fault or a change is taken the
//! plant decides (`plant_process::live`). Starts and ends no run.

pub mod clock;
pub mod happening;
pub mod inject;
pub mod live;
pub mod mark;
pub mod observer;
pub mod set;
pub mod standing;

//! A running session as other terminals have it: which one is meant, its records, margins and account, requests to
//! it. Refuses only a request that cannot be put into the plant's words; whether a fault or a change is taken the
//! plant decides (`plant_process::live`). Starts and ends no run.

pub(crate) mod clock;
pub(crate) mod happening;
pub mod inject;
pub(crate) mod live;
pub(crate) mod mark;
pub(crate) mod observer;
pub(crate) mod set;
pub(crate) mod standing;

//! Between a running session and other terminals: the choice of a session, its records, requests and
//! faults, and the margins of its requirements, which the `hil` that runs it answers from here. Only
//! a request that cannot be put into the plant's words is refused here; whether a fault is taken the plant
//! decides (`plant_process::live`). No run is started or ended here.

pub(crate) mod clock;
pub(crate) mod happening;
pub mod inject;
pub(crate) mod live;
pub(crate) mod mark;
pub(crate) mod observer;
pub(crate) mod set;
pub(crate) mod standing;

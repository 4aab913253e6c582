//! A side of a run behind a wire: the far end of a port is a program, board or bus that knows nothing of `hil`.
//!
//! 1. [`hil_config::port`] reads the port file, which `hil` has recognised by its first key.
//! 2. [`far_end`] opens the [`medium`]s, and has a [`peer`] started if the file says how; [`wire`] packs and unpacks the
//!    frames.
//! 3. [`law`] makes a control law of it, and [`rig`] a plant.
//! 4. [`keeper`], a second process in front of a plant, sends the safe values at every end.
//!
//! The package's program is to a port file what `hil-fmu` is to an FMU.

pub mod far_end;
pub mod keeper;
pub mod law;
pub mod medium;
pub mod peer;
pub mod rig;
pub mod wire;

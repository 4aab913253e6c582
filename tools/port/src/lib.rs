//! A side of a run behind a wire: the far end of a port is a program, board or bus that knows nothing of `hil`.
//!
//! 1. [`hil_config::port`] reads the port file, which `hil` has recognised by its first key.
//! 2. [`peer`] starts the far end if the file says how, and waits until it is ready.
//! 3. [`medium`] opens the media; [`wire`] packs and unpacks the frames on them.
//! 4. [`law`] turns all of this into a control law of the program `hil-port`.
//!
//! The package's program is to a port file what `hil-fmu` is to an FMU.

pub mod law;
pub mod medium;
pub mod peer;
pub mod wire;

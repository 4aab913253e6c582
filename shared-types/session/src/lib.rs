//! Sessions: what plant, controller and `hil` ask of the operating system, for the contract of `shared-types`.
//!
//! - Sessions: a [`session`] is the private place where a run happens and which leaves nothing behind.
//!   [`mod@shared_memory`] names what keeps shared memory from being used. A [`private_folder`] has the files that a
//!   process unpacks, and goes with it.
//! - Processes: each [`process`] is known by more than its number, its program by the hash of its
//!   [`mod@file`]; [`asking`] runs one for a short answer. [`supervision`] is what the processes of a session
//!   hear from the one that started them, [`manual_start`] the way in for one that somebody else starts. [`program`] is
//!   what they have in common.
//! - Transport: the [`link`] and the record [`stream`] over iceoryx2 shared memory.
//! - Loops: a [`waiter`] waits for the other side. [`realtime`] applies what a loop is to run with, [`thread`] looks at
//!   the loop's thread, and [`clock`] is the meters' clock.
//! - Requests: [`live`] has the sockets by which another terminal talks to a session while it runs.
//!
//! No model, law, scenario or file of a recording is known here, and no rule of the lockstep.

pub mod asking;
pub mod clock;
pub mod file;
pub mod link;
pub mod live;
pub mod manual_start;
pub mod private_folder;
pub mod process;
pub mod program;
pub mod realtime;
pub mod session;
pub mod shared_memory;
pub mod stream;
pub mod supervision;
pub mod thread;
pub mod waiter;

#[cfg(test)]
mod conformance;

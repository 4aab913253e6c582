//! Sessions: services of the operating system that plant, controller and `hil` use under the contract of
//! `shared-types`.
//!
//! - Sessions: a [`session`] is the private place of a run, which leaves nothing behind. [`mod@shared_memory`]
//!   diagnoses obstacles to using shared memory. A [`private_folder`] holds the files that a process unpacks, and is
//!   removed with that process.
//! - Processes: a [`process`] is identified by its number and start time, and its program by the hash of its
//!   [`mod@file`]; [`asking`] runs a program for a short answer. [`supervision`] carries messages from the launcher to
//!   the processes of a session, [`manual_start`] admits a process that was started by hand, and [`program`] is the
//!   part that all of them share.
//! - Transport: the [`link`] and the record [`stream`] over iceoryx2 shared memory.
//! - Loops: a [`waiter`] waits for the other side. [`realtime`] applies the settings of a loop, [`thread`] samples the
//!   loop's thread, and [`clock`] is the clock of the meters.
//! - Requests: [`live`] has the sockets through which another terminal talks to a session while it runs.
//!
//! Models, laws, scenarios, recording files and the rules of lockstep are unknown here.

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

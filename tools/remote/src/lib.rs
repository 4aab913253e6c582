//! The controller of a run on another machine, a *target*: everything between the desk's shared memory and the
//! target's.
//!
//! The controller's file knows nothing of it. On the target an [`agent`] owns a session, starts the file in it and
//! speaks as the plant; at the desk a [`bridge`] has the controller's place in the run's session and speaks as the
//! controller. What one hears the other says, so the plant, the controller, and everything of `hil` that deals with
//! controllers work as on one machine.
//!
//! ```text
//!   plant <- iceoryx2 -> bridge <- wire -> agent <- iceoryx2 -> controller
//!          desk                                    target
//! ```
//!
//! The wire is two things: a [`channel`], which is the leash too (when it closes, the other end stops), for
//! everything that happens once or seldom; and datagrams for the frames, each [sealed](seal) by itself, which
//! [`exchange`] repeats until they are answered. Where no datagram gets through, the frames go through the channel.
//!
//! At the desk, [`contact`], [`way`], [`name`] and `ssh` reach a target. There, [`programs`] holds what an agent may run
//! and checks the hash of each program at every use, [`machine`] describes what it
//! runs on and `leash` ends the agent. [`serve`] and [`key`] are for an agent that listens, and `connection` reaches one.
//! [`message`] and [`packet`] are the forms of the wire, `path` carries the datagrams, and `sleep` waits for them.
//!
//! Scenarios, recordings and verdicts are never known here.

pub mod agent;
pub mod bridge;
pub mod channel;
mod connection;
pub mod contact;
pub mod exchange;
pub mod key;
mod leash;
pub mod machine;
pub mod message;
pub mod name;
pub mod packet;
mod path;
pub mod programs;
pub mod route;
pub mod seal;
pub mod serve;
mod sleep;
mod ssh;
pub mod way;

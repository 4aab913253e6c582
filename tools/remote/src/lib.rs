//! Controller of a run on another machine, the *target*: everything between the desk's shared memory and the
//! target's.
//!
//! The controller program is unaware of it. On the target an [`agent`] owns a session, starts the program in it and
//! acts as the plant; at the desk a [`bridge`] takes the controller's place in the run's session. Each repeats what
//! the other receives, so the plant, the controller, and all parts of `hil` that deal with controllers work as on
//! one machine.
//!
//! ```text
//!   plant <- iceoryx2 -> bridge <- wire -> agent <- iceoryx2 -> controller
//!          desk                                    target
//! ```
//!
//! The wire consists of a [`channel`] for rare messages, which also serves as a lifeline (when it closes, the other end
//! stops), and of datagrams for the frames, each [encrypted and authenticated](seal) by itself, which [`exchange`]
//! repeats until they are answered. Where no datagrams get through, the frames go through the channel.
//!
//! At the desk, [`contact`], [`way`], [`name`] and `ssh` reach a target. On the target, [`programs`] holds the programs
//! that an agent may run and checks the hash of each at every use, [`machine`] describes the machine, and `leash` ends
//! the agent. [`serve`] and [`key`] are for a listening agent, and `connection` connects to one. [`message`] and
//! [`packet`] define the wire format, `path` carries the datagrams, and `sleep` waits for them. Scenarios, recordings
//! and verdicts are unknown here.

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
pub(crate) mod route;
pub mod seal;
pub mod serve;
mod sleep;
mod ssh;
pub mod way;

//! The contracts of the framework, used by both sides and by every tool.
//!
//! One step, and where its parts live:
//!
//! 1. A plant's signals are a [`mod@table`]; what it can be asked is its [`describe`] answer.
//! 2. Before step 0 both sides say [`hello`] and agree on a [`layout`].
//! 3. The [`pacer`] releases step `k` of [`time`].
//! 4. The sample crosses the [`link`] as a [`frame`]; the command comes back the same way. Who may
//!    send what and when is decided by the [`lockstep`] machines; how to wait, by [`wait`].
//! 5. The plant publishes the [`record`] of the step on the [`stream`], from which the [`digest`]
//!    is made.
//!
//! Around the step:
//!
//! - Sessions: a [`session`] is the private place where all this happens and which leaves nothing behind.
//!   [`mod@shared_memory`] names what keeps shared memory from being used. A [`private_folder`] has the files that a
//!   process unpacks, and goes with it.
//! - Processes: each [`process`] is known by more than its number. [`supervision`] is what the processes of a session
//!   hear from the one that started them, [`by_hand`] the way in for one that somebody else starts. [`program`] is
//!   what they have in common, with the [`mod@origin`] that each tells.
//! - Loops: a [`side`] is the plant's or the controller's. [`realtime`] is what a process can ask of the system for
//!   its loop, [`thread`] keeps statistics of the loop's thread, and [`clock`] is the meters' clock.
//! - Requests: [`live`] is how another terminal talks to a session while it runs. [`tuning`] is how values change on
//!   the way, and [`directive`] what a fault of timing tells a runner.
//! - State: a [`checkpoint`] keeps the [`state`] of both sides before a step, so that a run can go on from there.
//!   [`random`] gives each consumer of random numbers a stream of its own.
//! - Names and numbers: [`spelling`] gives foreign names, such as `der(x)`, the one name that they have here.
//!   [`units`] reads units as text and converts between those of one dimension. A [`connection`] binds a law's signal
//!   to a plant's of another name and unit. [`number`] writes numbers with their units, and [`text`] makes what others
//!   say fit to be shown.
//! - Mistakes: [`ignored`] counts what peers said in vain. A [`failure`] ends a plant or a law that is not written in
//!   Rust.
//! - Tests: [`conformance`](mod@conformance) is for whoever writes another link or record stream.
//!
//! No model, law, scenario or file of a recording is known here.

extern crate self as shared_types; // the names that `table!` writes must hold in here too

pub mod by_hand;
pub mod checkpoint;
pub mod clock;
pub mod conformance;
pub mod connection;
pub mod describe;
pub mod digest;
pub mod directive;
pub mod failure;
pub mod frame;
pub mod hello;
pub mod ignored;
pub mod layout;
pub mod link;
pub mod live;
pub mod lockstep;
pub mod number;
pub mod origin;
pub mod pacer;
pub mod private_folder;
pub mod process;
pub mod program;
pub mod random;
pub mod realtime;
pub mod record;
pub mod session;
pub mod shared_memory;
pub mod side;
pub mod spelling;
pub mod state;
pub mod stream;
pub mod supervision;
pub mod system;
pub mod table;
pub mod text;
pub mod thread;
pub mod time;
pub mod tuning;
pub mod units;
pub mod wait;

pub use zerocopy;

//! The contracts of the framework, used by both sides and by every tool.
//!
//! One step, and where its parts live:
//!
//! 1. A plant's signals are a [`mod@table`]; what it can be asked is its [`describe`] answer.
//! 2. Before step 0 both sides say [`hello`] and agree on a [`layout`].
//! 3. The [`pacer`] releases step `k` of [`time`].
//! 4. The sample crosses the [`link`] as a [`frame`]; the command comes back the same way. Who may
//!    send what and when is decided by the [`lockstep`] machines. [`wait`] has the strategies and limits of waits.
//! 5. The plant publishes the [`record`] of the step on the [`stream`], from which the [`digest`]
//!    is made.
//!
//! Around the step:
//!
//! - Sides: a [`side`] is the plant's or the controller's. Each tells the [`mod@origin`] of its program. [`realtime`] is
//!   what a loop can be asked to run with and what it was granted, [`thread`] what was seen of its thread.
//! - Requests: [`live`] has what another terminal asks of a running plant, and the answers. [`tuning`] is how values
//!   change on the way, and [`directive`] what a fault of timing tells a runner.
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
//! No model, law, scenario or file of a recording is known here, and nothing asks the operating system for more than a
//! file: sessions, processes, clocks, waits and shared memory are in `hil-session`.

extern crate self as shared_types; // the names that `table!` writes must hold in here too

pub mod checkpoint;
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
pub mod random;
pub mod realtime;
pub mod record;
pub mod side;
pub mod spelling;
pub mod state;
pub mod stream;
pub mod table;
pub mod text;
pub mod thread;
pub mod time;
pub mod tuning;
pub mod units;
pub mod wait;

pub use zerocopy;

//! The contracts of the framework, used by both sides and by every tool.
//!
//! One step, and where its parts live:
//!
//! 1. A plant's signals are a [`mod@table`]; its [`describe`] answer lists its parameters and faults.
//! 2. Before step 0 both sides exchange a [`hello`] and agree on a [`layout`].
//! 3. The [`pacer`] releases step `k` of [`time`].
//! 4. The sample crosses the [`link`] as a [`frame`]; the command comes back the same way. The [`lockstep`] machines
//!    decide which side may send what and when; [`wait`] has the strategies and limits of waits. [`quality`] says which
//!    signals of a row are invalid.
//! 5. The plant publishes the [`record`] of the step on the [`stream`]; the [`digest`] is computed from it.
//!
//! Around the step:
//!
//! - Sides: a [`side`] is the plant's or the controller's; each program prints its [`mod@origin`]. [`realtime`] has the
//!   requested and granted settings of a loop, [`thread`] the statistics of its thread.
//! - Requests: [`live`] lets another terminal talk to a session while it runs. [`tuning`] changes values during a run,
//!   and [`directive`] carries the instructions of a timing fault to a runner.
//! - State: a [`checkpoint`] keeps the [`state`] of both sides before a step, so that a run can resume there.
//!   [`random`] gives each consumer of random numbers a stream of its own. A [`local_map`] is a side's map of its named
//!   state over one period and its derivatives, which [`difference`] computes.
//! - Names and numbers: [`spelling`] maps foreign names, such as `der(x)`, to valid ones. [`units`] parses units and
//!   converts between those of one dimension. A [`connection`] binds a law's signal to a plant's signal of another name
//!   and unit. [`number`] formats numbers with their units, and [`text`] makes foreign text safe to display.
//! - Failures: [`ignored`] counts rejected messages of peers. A [`failure`] ends a plant or a law that is not written
//!   in Rust.
//! - Tests: [`conformance`](mod@conformance) checks new implementations of links and record streams.
//!
//! Models, laws, scenarios and recording files are unknown here, and nothing here calls the operating system except to
//! read and write files: sessions, processes, clocks, waits and shared memory are in `hil-session`.

extern crate self as shared_types; // the names that `table!` writes must hold in here too

pub mod checkpoint;
pub mod conformance;
pub mod connection;
pub mod describe;
pub mod difference;
pub mod digest;
pub mod directive;
pub mod extremes;
pub mod failure;
pub mod frame;
pub mod hello;
pub mod ignored;
pub mod layout;
pub mod link;
pub mod live;
pub mod local_map;
pub mod lockstep;
pub mod number;
pub mod origin;
pub mod pacer;
pub mod quality;
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

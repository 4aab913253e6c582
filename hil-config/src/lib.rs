//! Scenarios: from text to validated values that plant and controller can use directly.
//!
//! Used by the launcher, which knows plants and laws only by their binaries' descriptions ([`shared_types::describe`]),
//! and by the plant, which receives its part of a [`Plan`](plan::Plan). Starts nothing, and reads no file but
//! scenarios, studies, port files, and the tables, lists and DBC files that these name; [readers](table_file::Format) of
//! formats other than CSV are passed in.
//!
//! 1. [`Scenario::read`](scenario::Scenario::read): parses the text into a tree whose values remember their places;
//!    [`set`](scenario::Scenario::set) applies `--set` values to it.
//! 2. [`Scenario::check`](scenario::Scenario::check): converts the tree into a [`Plan`](plan::Plan), or reports all
//!    [`Problems`](problem::Problems) at once, each with its place (`source`: line and column) and the expected value.
//! 3. [`show`](show::show) writes a plan as a complete scenario, [`schema`](schema::schema) the format for editors.
//! 4. [`RequestContext`](live_requests::RequestContext) checks faults and changes requested during a run, by the same
//!    code; a [`Watch`](condition::Watch) detects when the condition of a fault is met.
//! 5. [`Evaluation`](evaluation::Evaluation) computes the plan's derived signals and metrics as records arrive, from
//!    its [expressions](expression), and evaluates its [requirements] by [`Monitors`](monitor::Monitors) of all
//!    [`Formula`](formula::Formula)s.
//! 6. [`stimulus`] evaluates the waveforms of a plan, with their derivatives.
//! 7. A [`Port`](port::Port) describes frames on a wire and the signal of each of their fields.
//! 8. A [`Study`](study::Study) names a scenario and its varied values, for a campaign of many runs.

mod analysis;
mod check;
mod document;
mod flag;
mod keys;
mod quantity;
mod reader;
mod source;
mod title;

pub use analysis::{Response, SineFit};

pub mod bus;
pub mod condition;
pub mod evaluation;
pub mod expression;
pub mod formula;
pub mod live_requests;
pub mod monitor;
pub mod plan;
pub mod port;
pub mod problem;
pub mod requirements;
pub mod scenario;
pub mod schema;
pub mod show;
pub mod stimulus;
pub mod study;
pub mod table;
pub mod table_file;

pub use source::SourceLine;

//! Scenarios: from text to values that plant and controller can use as they are.
//!
//! Used by the launcher, which knows plants and laws only by what their binaries say of themselves
//! ([`shared_types::describe`]), and by the plant, which takes its part of a [`Plan`](plan::Plan).
//! Starts nothing, and reads no file but scenarios, studies and the CSV files of points and faults that
//! scenarios name.
//!
//! 1. [`Scenario::read`](scenario::Scenario::read): the text becomes a tree whose values know where
//!    they stand; [`set`](scenario::Scenario::set) puts `--set` values over it.
//! 2. [`Scenario::check`](scenario::Scenario::check): the tree becomes a [`Plan`](plan::Plan), or
//!    all [`Problems`](problem::Problems) at once, each with its place (`source`: line and column) and
//!    what would be right.
//! 3. [`show`](show::show) writes a plan as a complete scenario, [`schema`](schema::schema) the
//!    format for editors.
//! 4. [`RequestContext`](live_requests::RequestContext) checks the faults and changes that a running plant
//!    is asked for, by the same code; a [`Watch`](condition::Watch) tells when the condition of a fault is met.
//! 5. [`Evaluation`](evaluation::Evaluation) computes the plan's derived signals and metrics while
//!    records arrive, from its [expressions](expression), and judges its [requirements] by
//!    [`Monitors`](monitor::Monitors) of all [`Formula`](formula::Formula)s.
//! 6. A [`Study`](study::Study) names a scenario and what varies in it, for a campaign of very many runs.

mod analysis;
mod check;
mod document;
mod flag;
mod keys;
mod quantity;
mod reader;
mod source;

pub mod condition;
pub mod evaluation;
pub mod expression;
pub mod formula;
pub mod live_requests;
pub mod monitor;
pub mod plan;
pub mod problem;
pub mod requirements;
pub mod scenario;
pub mod schema;
pub mod show;
pub mod study;

pub use source::SourceLine;

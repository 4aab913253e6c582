//! A run from checked scenario to summary: its processes or its one thread, the recorder, the real-time settings,
//! the controllers that come and go. Decides nothing about several runs, and compares nothing.

mod controllers;
mod execute;
mod in_process;
mod log;
pub(crate) mod open_files;
pub(crate) mod processes;
pub(crate) mod realtime;
pub mod recorder;
pub mod swap;

use execute::Prepared;
pub(crate) use execute::{Basis, Ran, Repeated, Setup, begin, execute, refuse_in_process};

//! Shared parts of the tests: an environment and a watchdog for each run ([`harness`]), its results ([`run`],
//! [`leftovers`]), the programs under test ([`programs`]), a board for the controller ([`board`]), two hosts with a
//! wire ([`hosts`]), a guest with a kernel of its own ([`guest`]), a cluster ([`slurm`]), contention ([`company`]),
//! a terminal ([`terminal`]), inherited signals ([`signals`]), FMUs ([`fmus`]), one of 500 variables
//! ([`vendor_fmu`]), a Python interpreter ([`python`]), packages of npm ([`node`]) and an independent reader of recordings ([`mcap_reader`]).

pub(crate) mod board;
pub(crate) mod company;
#[path = "../../shared/fmus.rs"]
pub(crate) mod fmus;
pub(crate) mod guest;
pub(crate) mod harness;
pub(crate) mod hosts;
pub(crate) mod leftovers;
pub(crate) mod mcap_reader;
pub(crate) mod node;
pub(crate) mod programs;
pub(crate) mod python;
pub(crate) mod run;
pub(crate) mod signals;
pub(crate) mod slurm;
pub(crate) mod terminal;
#[path = "../../shared/vendor_fmu.rs"]
pub(crate) mod vendor_fmu;

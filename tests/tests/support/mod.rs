//! Shared pieces of the tests, none of them a test: a place of its own and a watchdog for each run
//! ([`harness`]) what it leaves ([`run`], [`leftovers`]), the programs that are run ([`programs`]), a board for the controller ([`board`]) and two hosts with a wire ([`hosts`]), a guest with a kernel of its own ([`guest`]), a cluster ([`slurm`]), others beside them ([`company`]), a terminal
//! ([`terminal`]), the signals that programs are started with ([`signals`]), FMUs ([`fmus`]), one of 500 variables ([`vendor_fmu`]), a Python interpreter ([`python`]) and a reader of recordings without the project's code ([`mcap_reader`]).

pub(crate) mod board;
pub(crate) mod company;
#[path = "../../shared/fmus.rs"]
pub(crate) mod fmus;
pub(crate) mod guest;
pub(crate) mod harness;
pub(crate) mod hosts;
pub(crate) mod leftovers;
pub(crate) mod mcap_reader;
pub(crate) mod programs;
pub(crate) mod python;
pub(crate) mod run;
pub(crate) mod signals;
pub(crate) mod slurm;
pub(crate) mod terminal;
#[path = "../../shared/vendor_fmu.rs"]
pub(crate) mod vendor_fmu;

//! Recordings of runs: written record by record as a run goes, and read back by what the file says of
//! itself, however it ended. Judges nothing and computes no figure; knows neither scenarios nor programs.
//!
//! A recording is an MCAP file that other programs open too. It holds a message for each step, of the very
//! words that crossed shared memory, the events between them, facts of the run before and after it, and
//! text files that travel with it. The page `docs/recordings-in-rust.md` shows both ways in programs.
//!
//! Written:
//!
//! 1. [`writer::Recording`] takes facts, then records and events one by one; [`schema`] and [`event`] say
//!    in which form. Where not all is kept, [`excerpt`] chooses, and [`size`] tells beforehand how large a
//!    file can get.
//! 2. Messages are put together, indexed and compressed in `chunk`; rows of words by the project's LZ4,
//!    `lz4`, which any reader unpacks. [`compression`] is only the choice.
//! 3. `mcap_file` writes chunks from front to back, each with a `mark` that vouches for every byte before
//!    it. [`reserve`] keeps room on the disk for the end.
//!
//! Read:
//!
//! 1. [`reader::RunReader`] goes through a file of any state once: to its end, to where it broke off, or to
//!    its damage. It checks every sum, computes the digest and keeps no record.
//! 2. `unpack` takes chunks apart, torn ones too; [`clean`] makes texts of events fit to be shown.
//! 3. [`copy::Rescue`] makes a whole file of what could be read of another.
//!
//! [`part_file`] makes files that appear whole or not at all, and removes what a killed `hil` left of one.

mod chunk;
pub mod clean;
pub mod compression;
pub mod copy;
pub mod event;
pub mod excerpt;
mod lz4;
mod mark;
mod mcap_file;
pub mod part_file;
pub mod reader;
pub mod reserve;
pub mod schema;
pub mod size;
mod unpack;
pub mod writer;

#[cfg(test)]
extern crate self as hil_recording;
#[cfg(test)]
#[path = "../tests/shared/fixture.rs"]
mod fixture;

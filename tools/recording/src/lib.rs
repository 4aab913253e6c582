//! Recordings of runs: written record by record during a run, and read back from self-describing files, however the run
//! ended. The package judges nothing, computes no figures and is independent of scenarios and programs.
//!
//! A recording is an MCAP file that other programs can also open. It contains a message for each step with the exact
//! words from shared memory, the events between steps, facts about the run before and after it, and attached text
//! files. The page `docs/recordings-in-rust.md` shows programs that write and read recordings.
//!
//! Writing:
//!
//! 1. [`writer::Recording`] takes facts, then records and events one by one, encoded as defined by [`schema`] and
//!    [`event`]. For a partial recording [`excerpt`] selects signals and steps; [`size`] predicts the maximum size of
//!    a file.
//! 2. `chunk` collects, indexes and compresses messages, using the project's `lz4` for rows of words, whose output
//!    any LZ4 reader unpacks. [`compression`] is only the setting.
//! 3. `mcap_file` writes chunks sequentially, each with a `mark` that contains a checksum of every preceding byte.
//!    [`reserve`] reserves disk space for the end.
//!
//! Reading:
//!
//! 1. [`reader::RunReader`] reads a file in any state once: up to its end, truncation or damage. It verifies every
//!    checksum, computes the digest and retains no records.
//! 2. [`reader::SpanReader`] reads the records of a span of steps from the chunks that contain them.
//! 3. [`reader::ColumnReader`] copies words of all records of a chunk into columns, for whole signals of long runs.
//! 4. `unpack` decompresses chunks, including truncated ones; [`clean`] sanitises event texts for display.
//! 5. [`copy::Rescue`] copies the readable part of a file into a complete one.
//!
//! [`ros`] reads numbers of ROS 2 messages, which other programs wrote.
//!
//! [`part_file`] writes files atomically and removes leftovers of a killed `hil`.

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
pub mod ros;
pub mod schema;
pub mod size;
mod unpack;
pub mod writer;

#[cfg(test)]
extern crate self as hil_recording;
#[cfg(test)]
#[path = "../tests/shared/fixture.rs"]
mod fixture;

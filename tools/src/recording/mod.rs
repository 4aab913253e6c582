//! The recording of a run as a file: written record by record as the run goes, or a part of it, and read
//! back by what the file says of itself, however it ended. Judges nothing, and computes no figure.

mod chunk;
pub(crate) mod clean;
pub mod compression;
pub(crate) mod copy;
pub(crate) mod event;
pub mod excerpt;
mod lz4;
pub(crate) mod mark;
mod mcap_file;
pub mod reader;
pub(crate) mod schema;
pub mod size;
pub(crate) mod unpack;
pub(crate) mod validity;
pub mod writer;

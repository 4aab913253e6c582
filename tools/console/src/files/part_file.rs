//! Results of commands as atomically written files.

use std::path::Path;

use hil_recording::part_file::write;
pub use hil_recording::part_file::{PartFile, PartFolder, sweep};

use crate::terminal::exit::Failure;

/// Writes a file atomically.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write(path, text.as_bytes()).map_err(|error| {
        Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
    })
}

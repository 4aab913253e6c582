//! Results of commands as files that appear whole or not at all.

use std::path::Path;

use hil_recording::part_file::write;
pub use hil_recording::part_file::{PartFile, PartFolder, sweep};

use crate::terminal::exit::Failure;

/// Writes a file whole or not at all.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write(path, text.as_bytes()).map_err(|error| {
        Failure::infrastructure(format!("cannot write {}: {error}", path.display()))
    })
}

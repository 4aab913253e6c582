//! Errors of reading, with the place in the file and advice.

use std::path::{Path, PathBuf};

/// Advice for a file of which nothing can be had.
const AGAIN: &str = "copy it again from where it is whole, or run the scenario again";

fn damage(path: &Path, what: &str, records: u64) -> String {
    match records {
        0 => format!("before its first record: {what}; {AGAIN}"),
        _ => format!(
            "after {records} records: {what}; `hil recover {} -o FILE` makes a recording of what is before",
            path.display()
        ),
    }
}

/// A run cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The folder of a run has no recording.
    #[error("{0} has no recording; it was run with --no-record, or is no run's folder")]
    NoRecording(PathBuf),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        error: std::io::Error,
    },
    /// Only a part of the run was kept.
    #[error(
        "{path} is an excerpt ({kept}); this needs the whole run: record it without --record, --record-every and --record-around-faults"
    )]
    Excerpt {
        /// The file.
        path: PathBuf,
        /// Description of what was kept.
        kept: String,
    },
    /// Something in the file is wrong, and not only its end is missing.
    #[error(
        "{path} is damaged at byte {at} of {length}, {}",
        damage(path, what, *records)
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Description of what is wrong with the file.
        what: String,
        /// Byte at which the file is damaged.
        at: u64,
        /// Bytes of the file.
        length: u64,
        /// Records before.
        records: u64,
    },
    /// The file ends before there is anything of a run in it.
    #[error(
        "{path} was cut off after {length} bytes, before its first record: nothing of the run is in it; {AGAIN}"
    )]
    Cut {
        /// The file.
        path: PathBuf,
        /// Bytes.
        length: u64,
    },
    /// The file is not what `hil run` writes.
    #[error("{path} is no recording of a run: {what}")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Description of what is wrong with the file.
        what: String,
    },
}

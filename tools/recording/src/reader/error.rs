//! Errors of reading, with location in the file and advice.

use std::path::{Path, PathBuf};

/// Advice for a file without readable content.
const AGAIN: &str = "copy it again from an intact original, or run the scenario again";

fn damage(path: &Path, what: &str, records: u64) -> String {
    match records {
        0 => format!("before its first record: {what}; {AGAIN}"),
        _ => format!(
            "after {records} records: {what}; recover the part before it with `hil recover {} -o FILE`",
            path.display()
        ),
    }
}

/// Error of reading a run.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The folder of a run has no recording.
    #[error("{0} has no recording: the run used --no-record, or this is not the folder of a run")]
    NoRecording(PathBuf),
    /// The file cannot be read.
    #[error("cannot read {path}: {error}")]
    Io {
        /// Path of the recording.
        path: PathBuf,
        /// Error of the operating system.
        error: std::io::Error,
    },
    /// The recording contains only a part of the run.
    #[error(
        "{path} is an excerpt ({selection}), but the whole run is needed: record it without --record, --record-every and --record-around-faults"
    )]
    Excerpt {
        /// Path of the recording.
        path: PathBuf,
        /// Description of the recorded part.
        selection: String,
    },
    /// The file is damaged, beyond a missing end.
    #[error(
        "{path} is damaged at byte {at} of {length}, {}",
        damage(path, what, *records)
    )]
    Damaged {
        /// Path of the recording.
        path: PathBuf,
        /// Description of the damage.
        what: String,
        /// Offset of the damage, in bytes.
        at: u64,
        /// Size of the file, in bytes.
        length: u64,
        /// Number of records before the damage.
        records: u64,
    },
    /// The file ends before the first record.
    #[error(
        "{path} was cut off after {length} bytes, before its first record, so it contains nothing of the run; {AGAIN}"
    )]
    Cut {
        /// Path of the recording.
        path: PathBuf,
        /// Size of the file, in bytes.
        length: u64,
    },
    /// The file was not written by `hil run`.
    #[error("{path} is not a recording of a run: {what}")]
    Foreign {
        /// Path of the file.
        path: PathBuf,
        /// Reason why the file is not a recording.
        what: String,
    },
}

//! A recording: any bytes as the `run.mcap` of a run, passed to every command that reads recordings.
//!
//! An unreadable file is refused by name. A readable run equals itself.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

use hil_benchmark::recorded;
use hil_console::terminal::interruption::Interruption;
use hil_recording::reader::{RECORDING, RunReader, digest_of_first};
use hil_verification::arguments::tolerance::Tolerances;
use hil_verification::compare::{Verdict, compare};
use hil_verification::judge::judged;
use hil_verification::repetition::RecordedScenario;
use hil_views::arguments::export::{ExportArguments, ExportFormat};
use hil_views::export;
use tempfile::TempDir;

use super::assert_told;

thread_local! {
    /// The folder of the run.
    static FOLDER: RefCell<TempDir> = RefCell::new(tempfile::tempdir().expect("a temporary folder"));
}

/// Runs the target.
pub fn run(bytes: &[u8]) {
    is_whole(bytes);
}

/// Passes a file to every reader; returns `true` if it is read to its end as a complete recording.
pub fn is_whole(bytes: &[u8]) -> bool {
    FOLDER.with_borrow(|folder| {
        let path = folder.path().join(RECORDING);
        fs::write(&path, bytes).expect("written");
        let is_whole = read(&path);
        if is_whole.is_some() {
            commands(&path, folder.path());
        }
        is_whole == Some(true)
    })
}

/// Reads as far as possible; returns `true` for a complete recording, and nothing for a file that is none.
fn read(path: &Path) -> Option<bool> {
    let told = |error: &dyn std::fmt::Display| {
        let told = error.to_string();
        assert!(told.contains(RECORDING), "{told}");
        assert_told(&told);
    };
    let mut reader = RunReader::open(path).map_err(|error| told(&error)).ok()?;
    let width = reader.columns().len();
    assert!(reader.hashed_words() <= width);
    let is_read = loop {
        match reader.advance() {
            Ok(true) => assert_eq!(reader.words().len(), width),
            Ok(false) => break true,
            Err(error) => {
                told(&error);
                break false;
            }
        }
    };
    let _ = (reader.rate(), reader.digest());
    Some(is_read && reader.is_whole())
}

/// Executes the commands on a file that begins like a recording.
fn commands(path: &Path, folder: &Path) {
    if let Ok(comparison) = compare(path, path, &[], &Tolerances::default()) {
        assert_eq!(
            comparison.verdict(),
            Verdict::Same,
            "{}",
            comparison.describe()
        );
    }
    let _ = judged(path, None);
    let _ = recorded::case(path, 0);
    let _ = digest_of_first(path, 3);
    if let Ok(recorded) = RecordedScenario::read(path) {
        let _ = recorded.scenario();
    }
    for format in [ExportFormat::Csv, ExportFormat::Parquet] {
        let output: PathBuf = folder.join(format!("run.{}", format.name()));
        let arguments = ExportArguments {
            runs: vec![path.to_owned()],
            output: Some(output.clone()),
            format: Some(format),
            signal: Vec::new(),
            from: None,
            until: None,
            every: 1,
            validity: true,
            evidence: None,
            needs: None,
            force: true,
            list: false,
            json: true,
        };
        if export::table(&arguments, Interruption::default()).is_ok() {
            assert!(output.is_file());
        }
    }
}

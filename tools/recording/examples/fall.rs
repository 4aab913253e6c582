//! Writes the recording of one second of free fall, as a program other than `hil` could.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::process::ExitCode;

use hil_recording::compression::Compression;
use hil_recording::writer::{Provenance, Recording};
use shared_types::record::{RecordLayout, Timing};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

/// Records `h = 10 - g t^2 / 2` at 100 Hz.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn fall(path: &Path) -> io::Result<()> {
    let rate = Rate::new(100.0).expect("a rate that a run can have");
    let layout = RecordLayout {
        truth: vec![Field::signal("height_m", "m", "Height above the ground.")],
        ..RecordLayout::default()
    };
    let provenance = Provenance {
        facts: BTreeMap::from([("rate_hz".into(), rate.hz().to_string())]),
        attachments: Vec::new(),
    };
    let mut recording = Recording::create(path, Compression::Lz4, &layout, &provenance, None)?;
    let mut words = vec![0; layout.words()];
    let (values, timing) = (layout.values_start(), layout.words() - Timing::WORDS);
    for step in (0..=100).map(Step) {
        let t_s = rate.seconds(step);
        words[0] = step.0;
        words[values] = (10.0 - 9.81 * t_s * t_s / 2.0).to_bits();
        words[timing] = rate.nanoseconds(step);
        recording.record(&words, &layout.view(&words))?;
    }
    recording.finish(BTreeMap::from([("outcome".into(), "completed".into())]))
}

#[allow(dead_code, reason = "the test of the examples calls what it calls")]
fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("usage: fall FILE");
        return ExitCode::from(2);
    };
    match fall(Path::new(&path)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{path}: {error}");
            ExitCode::FAILURE
        }
    }
}

//! Prints the signals of a recorded run, or the minimum and maximum of one of them.

use std::path::Path;
use std::process::ExitCode;

use hil_recording::reader::{ReadError, RunReader};

/// Lists the signals of a run with their units.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn signals(run: &Path) -> Result<String, ReadError> {
    let reader = RunReader::open(run)?;
    let signals = reader.columns().iter().filter(|column| column.is_signal());
    let lines = signals.map(|column| format!("{} [{}]\n", column.name, column.unit));
    Ok(lines.collect())
}

/// Finds the minimum and maximum of a signal; `None` if the run has no such signal.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn extremes(run: &Path, signal: &str) -> Result<Option<String>, ReadError> {
    let mut reader = RunReader::open(run)?;
    let Some(place) = reader.place(signal) else {
        return Ok(None);
    };
    let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
    while reader.advance()? {
        let value = f64::from_bits(reader.words()[place]);
        // Comparisons with NaN, which marks a missing value, are false.
        if value < least {
            least = value;
        }
        if value > greatest {
            greatest = value;
        }
    }
    let mut text = format!("{least} to {greatest} in {} records\n", reader.records());
    // A truncated file is read as far as it goes.
    if let Some(caveat) = reader.caveat() {
        text += &format!("note: {caveat}\n");
    }
    Ok(Some(text))
}

#[allow(dead_code, reason = "the test of the examples calls what it calls")]
fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let Some(run) = arguments.next() else {
        eprintln!("usage: extremes RUN [SIGNAL]");
        return ExitCode::from(2);
    };
    let run = Path::new(&run);
    let result = match arguments.next() {
        None => signals(run).map(Some),
        Some(signal) => extremes(run, &signal),
    };
    match result {
        Ok(Some(text)) => {
            print!("{text}");
            return ExitCode::SUCCESS;
        }
        Ok(None) => eprintln!("the run has no such signal"),
        Err(error) => eprintln!("{error}"),
    }
    ExitCode::FAILURE
}

//! Standard output: results, and what it means when nobody takes them.

use std::fmt;
use std::io::{ErrorKind, IsTerminal, Write};

use serde::Serialize;
use shared_types::text::printable;

use crate::terminal::exit::Failure;

/// Writes a formatted line to standard error. Unlike the standard library's, it is no panic if nobody
/// takes it: a note that is not read changes nothing.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => { $crate::terminal::output::tell(&::std::format!($($text)*)) };
}

/// Writes a line to standard error, which may be gone, as a terminal that was closed.
pub fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", printable(line));
}

/// Writes text to standard output, without what a terminal obeys. A reader that went away wanted no
/// more, which is no failure.
///
/// # Errors
/// If the text cannot be written for any other reason.
pub fn write(text: &str) -> Result<(), Failure> {
    write_coloured(&printable(text))
}

/// Like [`write()`], with colours; nothing of the text may be of others.
///
/// # Errors
/// As of [`write()`].
pub fn write_coloured(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::infrastructure(
            format!("cannot write the output: {error}"),
        )),
        _ => Ok(()),
    }
}

/// Writes a result as JSON for a machine, or in words for a person.
///
/// # Errors
/// As of [`write()`].
pub fn result(
    json: bool,
    result: &impl Serialize,
    told: impl FnOnce() -> String,
) -> Result<(), Failure> {
    write(&if json { pretty(result)? } else { told() })
}

/// Gives a result as indented JSON.
///
/// # Errors
/// If it has no form in JSON.
pub fn pretty(result: &impl Serialize) -> Result<String, Failure> {
    let json = serde_json::to_string_pretty(result).map_err(Failure::infrastructure)?;
    Ok(json + "\n")
}

/// Collects what is written into a string, which cannot fail.
pub fn text(write: impl FnOnce(&mut String) -> fmt::Result) -> String {
    let mut text = String::new();
    let _ = write(&mut text);
    text
}

/// Tells whether a person reads standard error as it comes.
pub fn person_watches() -> bool {
    std::io::stderr().is_terminal()
}

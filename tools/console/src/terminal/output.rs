//! Standard output and standard error, including readers that no longer exist.

use std::fmt;
use std::io::{ErrorKind, IsTerminal, Write};

use serde::Serialize;
use shared_types::text::printable;

use crate::terminal::exit::Failure;

/// Writes a formatted line to standard error. Unlike the standard library's macro it does not panic if nobody reads the
/// line: an unread note must not affect the command.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => { $crate::terminal::output::tell(&::std::format!($($text)*)) };
}

/// Writes a line to standard error; ignores errors, such as a closed terminal.
pub fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", printable(line));
}

/// Writes text to standard output with terminal control characters escaped. A reader that has gone away is not an
/// error.
///
/// # Errors
/// If the text cannot be written for any other reason.
pub fn write(text: &str) -> Result<(), Failure> {
    write_coloured(&printable(text))
}

/// Does the same as [`write()`], but permits colours; the text must not contain foreign content.
///
/// # Errors
/// See [`write()`].
pub fn write_coloured(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::infrastructure(
            format!("cannot write the output: {error}"),
        )),
        _ => Ok(()),
    }
}

/// Writes a result as JSON or as text.
///
/// # Errors
/// See [`write()`].
pub fn result(
    json: bool,
    result: &impl Serialize,
    to_text: impl FnOnce() -> String,
) -> Result<(), Failure> {
    write(&if json { pretty(result)? } else { to_text() })
}

/// Formats a result as indented JSON.
///
/// # Errors
/// If the result cannot be serialised.
pub fn pretty(result: &impl Serialize) -> Result<String, Failure> {
    let json = serde_json::to_string_pretty(result).map_err(Failure::infrastructure)?;
    Ok(json + "\n")
}

/// Collects formatted output in a string, which cannot fail.
pub fn text(write: impl FnOnce(&mut String) -> fmt::Result) -> String {
    let mut text = String::new();
    let _ = write(&mut text);
    text
}

/// Returns `true` if standard error is a terminal.
pub fn person_watches() -> bool {
    std::io::stderr().is_terminal()
}

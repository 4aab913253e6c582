//! Standard output: results, and what it means when nobody takes them.

use std::io::{ErrorKind, Write};

use crate::exit::Failure;

/// Text of others, without what a terminal would do something at instead of showing it.
#[must_use]
pub fn printable(text: &str) -> String {
    let is_unprintable = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    text.replace(is_unprintable, "\u{fffd}")
}

/// Writes text to standard output. A reader that went away wanted no more, which is no failure.
///
/// # Errors
/// If the text cannot be written for any other reason.
pub fn write(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::infrastructure(
            format!("cannot write the output: {error}"),
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::printable;

    #[test]
    fn a_text_of_others_does_nothing_to_a_terminal() {
        assert_eq!(printable("a\tb\nµm/s²"), "a\tb\nµm/s²");
        assert_eq!(
            printable("\u{1b}[31mm\r\u{7}"),
            "\u{fffd}[31mm\u{fffd}\u{fffd}"
        );
        assert_eq!(printable("\u{9b}2J\u{7f}"), "\u{fffd}2J\u{fffd}");
    }
}

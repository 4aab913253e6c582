//! Text of others, made fit to be shown.
//!
//! What a plant, a controller or a file says may hold what a terminal obeys instead of showing: it
//! could clear the screen, write over a verdict, fill the clipboard. Whatever is decoded from them
//! passes here; [`record`](crate::record) does so by its types.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer};

/// Longest [`line()`], in characters.
const LONGEST_LINE: usize = 4000;

/// Returns true if a terminal obeys a character instead of showing it, line ends and tabulators excepted.
#[must_use]
pub fn is_unprintable(c: char) -> bool {
    c.is_control() && !matches!(c, '\n' | '\t')
}

/// Replaces the characters that a terminal obeys.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.contains(is_unprintable) {
        Cow::Owned(text.replace(is_unprintable, "\u{fffd}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// Makes one line of a text, printable and not too long for a row of a table.
#[must_use]
pub fn line(text: &str) -> String {
    let is_fit = !text.contains(char::is_control) && text.len() <= LONGEST_LINE;
    if is_fit {
        return text.to_owned();
    }
    let text = text.trim_end();
    let mut shown: String = (text.chars().take(LONGEST_LINE))
        .map(|c| match c {
            '\n' | '\t' => ' ',
            c if c.is_control() => '\u{fffd}',
            c => c,
        })
        .collect();
    if text.chars().nth(LONGEST_LINE).is_some() {
        shown.push_str(" ...");
    }
    shown
}

/// Deserialises a text as a [`line()`].
///
/// # Errors
/// If there is no text.
pub fn line_of<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    String::deserialize(from).map(|text| line(&text))
}

/// Deserialises a list of texts, each as a [`line()`].
///
/// # Errors
/// If there is no such list.
pub fn lines_of<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    let texts = Vec::<String>::deserialize(from)?;
    Ok(texts.iter().map(|text| line(text)).collect())
}

/// Deserialises a text that may be missing as a [`line()`].
///
/// # Errors
/// If there is something else.
pub fn line_if_any<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    let text = Option::<String>::deserialize(from)?;
    Ok(text.map(|text| line(&text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_of_others_does_nothing_to_a_terminal() {
        assert_eq!(printable("a\tb\nµm/s²"), "a\tb\nµm/s²");
        assert_eq!(
            printable("\u{1b}[31mm\r\u{7}"),
            "\u{fffd}[31mm\u{fffd}\u{fffd}"
        );
        assert_eq!(printable("\u{9b}2J\u{7f}"), "\u{fffd}2J\u{fffd}");
    }

    #[test]
    fn a_line_is_one_and_ends() {
        assert_eq!(line("a µ"), "a µ");
        assert_eq!(
            line("it failed\nverdict\tpass\u{1b}]52;c;eA==\u{7}\n"),
            "it failed verdict pass\u{fffd}]52;c;eA==\u{fffd}"
        );
        let cut = line(&"µ".repeat(1 << 20));
        assert_eq!(cut.chars().count(), LONGEST_LINE + 4);
        assert!(cut.ends_with("µ ..."));
    }
}

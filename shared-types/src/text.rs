//! Foreign text, made safe to display.
//!
//! Text from a plant, a controller or a file may contain control sequences that a terminal executes: they could clear
//! the screen, overwrite a verdict or fill the clipboard. Everything decoded from such sources passes through here; the
//! types of [`record`](crate::record) ensure this.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer};

/// Maximum length of a [`line()`], in characters.
const LONGEST_LINE: usize = 4000;

/// Returns `true` if a terminal executes a character instead of displaying it. Line ends and tabs do not count.
#[must_use]
pub fn is_unprintable(c: char) -> bool {
    c.is_control() && !matches!(c, '\n' | '\t')
}

/// Replaces the characters that a terminal executes.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.contains(is_unprintable) {
        Cow::Owned(text.replace(is_unprintable, "\u{fffd}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// Turns a text into one printable line that fits into a table row.
#[must_use]
pub fn line(text: &str) -> String {
    let is_fit = !text.contains(char::is_control) && text.len() <= LONGEST_LINE;
    if is_fit {
        return text.to_owned();
    }
    let text = text.trim_end();
    let mut text_line: String = (text.chars().take(LONGEST_LINE))
        .map(|c| match c {
            '\n' | '\t' => ' ',
            c if c.is_control() => '\u{fffd}',
            c => c,
        })
        .collect();
    if text.chars().nth(LONGEST_LINE).is_some() {
        text_line.push_str(" ...");
    }
    text_line
}

/// Deserialises a text as a [`line()`].
///
/// # Errors
/// If the value is not a text.
pub fn line_of<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    String::deserialize(from).map(|text| line(&text))
}

/// Deserialises a list of texts, each as a [`line()`].
///
/// # Errors
/// If the value is not a list of texts.
pub fn lines_of<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    let texts = Vec::<String>::deserialize(from)?;
    Ok(texts.iter().map(|text| line(text)).collect())
}

/// Deserialises an optional text as a [`line()`].
///
/// # Errors
/// If the value is neither a text nor null.
pub fn line_if_any<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    let text = Option::<String>::deserialize(from)?;
    Ok(text.map(|text| line(&text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_has_no_effect_on_a_terminal() {
        assert_eq!(printable("a\tb\nµm/s²"), "a\tb\nµm/s²");
        assert_eq!(
            printable("\u{1b}[31mm\r\u{7}"),
            "\u{fffd}[31mm\u{fffd}\u{fffd}"
        );
        assert_eq!(printable("\u{9b}2J\u{7f}"), "\u{fffd}2J\u{fffd}");
    }

    #[test]
    fn a_line_is_single_and_limited() {
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

//! Source texts of a scenario, and places in them.
//!
//! Used by everything that reports a problem: the scenario file, every `--set` value and every table of points is a
//! source, and each value remembers its place in a source. Texts are never interpreted here.

use std::ops::Range;

use serde::Serialize;

/// Maximum length of a line shown in full, in bytes.
const LONGEST_LINE: usize = 400;

/// Range of bytes in one of the [`Sources`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// Index of the source.
    pub source: usize,
    /// Bytes of the source.
    pub span: Range<usize>,
}

/// Named text.
#[derive(Clone, Debug)]
struct Source {
    name: String,
    text: String,
    /// Lines before the text, of a file of which only a part is kept.
    lines_before: usize,
}

/// All sources of a scenario; the first is the scenario file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sources(Vec<Source>);

impl Sources {
    /// Index of the scenario file.
    pub(crate) const SCENARIO: usize = 0;

    /// Adds a text and returns its index.
    pub(crate) fn add(&mut self, name: String, text: String) -> usize {
        self.add_part(name, text, 0)
    }

    /// Adds a line of a longer text by its number, from 1, and returns its index.
    pub(crate) fn add_line(&mut self, name: String, text: String, number: usize) -> usize {
        self.add_part(name, text, number - 1)
    }

    fn add_part(&mut self, name: String, text: String, lines_before: usize) -> usize {
        self.0.push(Source {
            name,
            text,
            lines_before,
        });
        self.0.len() - 1
    }

    /// Returns the name of a source, as shown in messages.
    pub(crate) fn name(&self, source: usize) -> &str {
        &self.0[source].name
    }

    /// Returns the whole text of a source.
    pub(crate) fn whole(&self, source: usize) -> &str {
        &self.0[source].text
    }

    /// Returns the text of a place.
    pub(crate) fn text(&self, place: &Place) -> &str {
        self.0[place.source]
            .text
            .get(place.span.clone())
            .unwrap_or_default()
    }

    /// Returns the place of a part of a string value, `part` in bytes of the value.
    ///
    /// The value must stand in the text literally. If it contains escapes, its bytes cannot be mapped by counting, and
    /// the place of the whole value is returned.
    pub(crate) fn inside(&self, place: &Place, value: &str, part: Range<usize>) -> Place {
        match self.text(place).find(value) {
            Some(offset) if !value.is_empty() => {
                let start = place.span.start + offset;
                Place {
                    source: place.source,
                    span: start + part.start..start + part.end,
                }
            }
            _ => place.clone(),
        }
    }

    /// Returns the line of a place, ready for display.
    pub(crate) fn excerpt(&self, place: &Place) -> SourceLine {
        let Source {
            text, lines_before, ..
        } = &self.0[place.source];
        let start = floor_char_boundary(text, place.span.start);
        let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |at| start + at);
        let end = floor_char_boundary(text, place.span.end.clamp(start, line_end));
        let column = text[line_start..start].chars().count() + 1;
        // Of a line too long for any screen, only the surroundings of the mark.
        let (before, behind) = if line_end - line_start > LONGEST_LINE {
            let from = start.saturating_sub(LONGEST_LINE / 2);
            let from = if from > line_start { from } else { line_start };
            let to = start + LONGEST_LINE / 2;
            let to = if to < line_end { to } else { line_end };
            (
                floor_char_boundary(text, from),
                floor_char_boundary(text, to),
            )
        } else {
            (line_start, line_end)
        };
        let end = if end < behind { end } else { behind };
        SourceLine {
            line: lines_before + text[..line_start].matches('\n').count() + 1,
            column,
            width: text[start..end].chars().count().max(1),
            text: text[before..behind].trim_end().to_owned(),
            text_column: column - text[before..start].chars().count(),
        }
    }
}

fn floor_char_boundary(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// Line that contains a problem.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SourceLine {
    /// Number of the line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Number of characters to mark, at least 1.
    pub width: usize,
    /// Line; for a very long line, the part around the mark.
    pub text: String,
    /// Column of the first character of `text`: 1, unless the line is very long.
    pub text_column: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn excerpt(text: &str, span: Range<usize>) -> SourceLine {
        let mut sources = Sources::default();
        let source = sources.add("x".into(), text.into());
        sources.excerpt(&Place { source, span })
    }

    #[test]
    fn columns_count_characters_and_lines_count_from_one() {
        let excerpt_line = excerpt("a = 1\nµm = \"x\"\n", 12..15);
        assert_eq!(
            (excerpt_line.line, excerpt_line.column, excerpt_line.width),
            (2, 6, 3)
        );
        assert_eq!(excerpt_line.text, "µm = \"x\"");
    }

    #[test]
    fn a_place_at_the_end_of_the_text_is_shown() {
        let excerpt_line = excerpt("a = ", 4..4);
        assert_eq!(
            (excerpt_line.line, excerpt_line.column, excerpt_line.width),
            (1, 5, 1)
        );
        let excerpt_line = excerpt("", 0..10);
        assert_eq!((excerpt_line.line, excerpt_line.column), (1, 1));
    }

    #[test]
    fn a_place_over_several_lines_shows_the_first() {
        assert_eq!(excerpt("[[\n1]]", 0..6).width, 2);
    }

    #[test]
    fn a_very_long_line_is_shown_around_the_place() {
        let text = format!("{}µ = 1{}", "x".repeat(100_000), "y".repeat(100_000));
        let excerpt_line = excerpt(&text, 100_000..150_000);
        assert_eq!((excerpt_line.line, excerpt_line.column), (1, 100_001));
        let at = excerpt_line.column - excerpt_line.text_column;
        assert_eq!(excerpt_line.text.chars().nth(at), Some('µ'));
        assert!(
            excerpt_line.text.len() <= LONGEST_LINE,
            "{}",
            excerpt_line.text.len()
        );
        assert_eq!(excerpt_line.width, excerpt_line.text.chars().count() - at);
    }

    #[test]
    fn a_part_of_a_string_is_found_in_the_text_unless_it_has_escapes() {
        let mut sources = Sources::default();
        let source = sources.add("x".into(), r#"e = "a + b" "\u0061""#.into());
        let place = |span| Place { source, span };
        let part = sources.inside(&place(4..11), "a + b", 4..5);
        assert_eq!(sources.text(&part), "b");
        assert_eq!(sources.inside(&place(12..20), "a", 0..1), place(12..20));
    }
}

//! Texts that a scenario is made of, and places in them.
//!
//! Used by everything that reports a problem: the scenario file, every `--set` value and every
//! table of points is a source, and each value remembers the place it came from. Never interprets
//! a text.

use std::ops::Range;

use serde::Serialize;

/// A range of bytes in one of the [`Sources`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    /// Which source.
    pub source: usize,
    /// Which bytes of it.
    pub span: Range<usize>,
}

/// A named text.
#[derive(Clone, Debug)]
struct Source {
    name: String,
    text: String,
}

/// All texts of a scenario; the first is the scenario file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sources(Vec<Source>);

impl Sources {
    /// Index of the scenario file.
    pub(crate) const SCENARIO: usize = 0;

    /// Adds a text and returns its index.
    pub(crate) fn add(&mut self, name: String, text: String) -> usize {
        self.0.push(Source { name, text });
        self.0.len() - 1
    }

    /// The name of a source as messages show it.
    pub(crate) fn name(&self, source: usize) -> &str {
        &self.0[source].name
    }

    /// The text of a place.
    pub(crate) fn text(&self, place: &Place) -> &str {
        self.0[place.source]
            .text
            .get(place.span.clone())
            .unwrap_or_default()
    }

    /// The place of a part of a string value, `part` counted in bytes of the value.
    ///
    /// The value must stand in the text as it is. With escapes in it the two cannot be matched by
    /// counting, and the place of the whole value is returned.
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

    /// The line of a place, ready to be shown.
    pub(crate) fn excerpt(&self, place: &Place) -> Excerpt {
        let text = &self.0[place.source].text;
        let start = floor_char_boundary(text, place.span.start);
        let line_start = text[..start].rfind('\n').map_or(0, |at| at + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |at| start + at);
        let end = floor_char_boundary(text, place.span.end.clamp(start, line_end));
        Excerpt {
            line: text[..line_start].matches('\n').count() + 1,
            column: text[line_start..start].chars().count() + 1,
            width: text[start..end].chars().count().max(1),
            text: text[line_start..line_end].trim_end().to_owned(),
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

/// The line that a problem is in.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Excerpt {
    /// Number of the line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Number of characters to mark, at least 1.
    pub width: usize,
    /// The line itself.
    pub text: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn excerpt(text: &str, span: Range<usize>) -> Excerpt {
        let mut sources = Sources::default();
        let source = sources.add("x".into(), text.into());
        sources.excerpt(&Place { source, span })
    }

    #[test]
    fn columns_count_characters_and_lines_count_from_one() {
        let found = excerpt("a = 1\nµm = \"x\"\n", 12..15);
        assert_eq!((found.line, found.column, found.width), (2, 6, 3));
        assert_eq!(found.text, "µm = \"x\"");
    }

    #[test]
    fn a_place_at_the_end_of_the_text_is_shown() {
        let found = excerpt("a = ", 4..4);
        assert_eq!((found.line, found.column, found.width), (1, 5, 1));
        let found = excerpt("", 0..10);
        assert_eq!((found.line, found.column), (1, 1));
    }

    #[test]
    fn a_place_over_several_lines_shows_the_first() {
        assert_eq!(excerpt("[[\n1]]", 0..6).width, 2);
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

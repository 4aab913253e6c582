//! XML document as a tree of elements with attributes; text between elements is ignored.

use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use shared_types::text;

use super::DescriptionError;

/// Maximum nesting depth of elements.
const DEEPEST: usize = 64;
/// Maximum number of elements.
const MOST: usize = 4_000_000;

/// XML element.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    attributes: Vec<(String, String)>,
    pub(super) children: Vec<Self>,
}

impl Element {
    /// Parses a document; returns its root element.
    pub(super) fn read(text: &str) -> Result<Self, DescriptionError> {
        let mut reader = Reader::from_str(text.trim_start_matches('\u{feff}'));
        let mut open: Vec<Self> = vec![Self::default()];
        let mut count = 0;
        loop {
            let event = reader.read_event().map_err(|error| refused(&error))?;
            let (element, is_empty) = match event {
                Event::Start(start) => (Self::of(&start)?, false),
                Event::Empty(start) => (Self::of(&start)?, true),
                Event::End(_) => {
                    let done = open.pop().unwrap_or_default();
                    let above = open
                        .last_mut()
                        .ok_or_else(|| refused(&"the document is truncated"))?;
                    above.children.push(done);
                    continue;
                }
                Event::DocType(_) => {
                    return Err(refused(
                        &"a document type could define entities and is not supported",
                    ));
                }
                Event::Eof => break,
                _ => continue,
            };
            count += 1;
            if count > MOST || open.len() > DEEPEST {
                return Err(refused(&"too many elements, or elements nested too deeply"));
            }
            match (is_empty, open.last_mut()) {
                (true, Some(above)) => above.children.push(element),
                _ => open.push(element),
            }
        }
        let document = open.pop().filter(|_| open.is_empty());
        let root = document.and_then(|document| document.children.into_iter().next());
        root.ok_or_else(|| refused(&"the document is truncated"))
    }

    fn of(start: &BytesStart<'_>) -> Result<Self, DescriptionError> {
        let text = |bytes: &[u8]| {
            let text = std::str::from_utf8(bytes);
            text.map(str::to_owned).map_err(|error| refused(&error))
        };
        let mut attributes = Vec::new();
        // The reader's check compares all pairs, which an attribute bomb could make slow.
        for attribute in start.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| refused(&error))?;
            let value = attribute.normalized_value(XmlVersion::Explicit1_0);
            let value = value.map_err(|error| refused(&error))?;
            attributes.push((text(attribute.key.as_ref())?, value.into_owned()));
        }
        Ok(Self {
            name: text(start.name().as_ref())?,
            attributes,
            children: Vec::new(),
        })
    }

    /// Returns the text of an attribute.
    pub(super) fn text(&self, name: &str) -> Option<&str> {
        let attribute = self.attributes.iter().find(|(key, _)| key == name);
        attribute.map(|(_, value)| value.as_str())
    }

    /// Returns the text of a required attribute.
    pub(super) fn needed(&self, name: &str) -> Result<&str, DescriptionError> {
        let missing = || self.wrong(name, "is missing");
        self.text(name).ok_or_else(missing)
    }

    /// Parses an attribute, if it exists.
    pub(super) fn value<T: std::str::FromStr>(
        &self,
        name: &str,
    ) -> Result<Option<T>, DescriptionError> {
        let Some(text) = self.text(name) else {
            return Ok(None);
        };
        let wrong = |_| self.wrong(name, &format!("is {:?}", shortened(text)));
        text.trim().parse().map(Some).map_err(wrong)
    }

    /// Returns a Boolean attribute; `false` if it is missing.
    pub(super) fn flag(&self, name: &str) -> Result<bool, DescriptionError> {
        match self.text(name).map(str::trim) {
            None | Some("false" | "0") => Ok(false),
            Some("true" | "1") => Ok(true),
            Some(text) => Err(self.wrong(name, &format!("is {:?}", shortened(text)))),
        }
    }

    /// Returns the first child element with this name.
    pub(super) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// Returns the children of the child element with this name.
    pub(super) fn list(&self, name: &str) -> &[Self] {
        self.child(name).map_or(&[], |child| &child.children)
    }

    /// Creates the error for an invalid attribute.
    pub(super) fn wrong(&self, attribute: &str, what: &str) -> DescriptionError {
        let name = shortened(&self.name);
        let of = self.text("name").unwrap_or_default();
        let of = match of {
            "" => String::new(),
            of => format!(" {:?}", shortened(of)),
        };
        DescriptionError::Content(format!("`{attribute}` of {name}{of} {what}"))
    }
}

/// Truncates a text of the document for display.
pub(super) fn shortened(text: &str) -> String {
    shortened_to(text, 80)
}

/// Truncates a text to `most` characters.
pub(super) fn shortened_to(text: &str, most: usize) -> String {
    text::line(text).chars().take(most).collect()
}

fn refused(error: &dyn std::fmt::Display) -> DescriptionError {
    DescriptionError::Xml(shortened(&error.to_string()))
}

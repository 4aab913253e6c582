//! JSON lines: the text of a frame as pieces between values, and a scanner that visits every value with its path.
//!
//! Called by packers and unpackers. The scanner allocates nothing; nesting is limited by [`DEEPEST`].

use crate::frame::{JsonContent, JsonField};
use crate::path::{DEEPEST, Node, Part, Path, tree};

/// Text before a value, and the field of the value; no field at the end.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Piece {
    pub text: Box<[u8]>,
    pub field: Option<usize>,
}

/// Returns the text of a line as pieces; constants are part of the text.
pub(crate) fn pieces(fields: &[JsonField]) -> Vec<Piece> {
    let paths: Vec<&Path> = fields.iter().map(|field| &field.path).collect();
    let root = tree(&paths);
    let mut pieces = Vec::new();
    let mut text = Vec::new();
    if let Some(root) = &root {
        write(root, fields, &mut text, &mut pieces);
    }
    text.push(b'\n');
    pieces.push(Piece {
        text: text.into(),
        field: None,
    });
    pieces
}

fn write(node: &Node, fields: &[JsonField], text: &mut Vec<u8>, pieces: &mut Vec<Piece>) {
    match node {
        Node::Leaf(field) => match &fields[*field].content {
            JsonContent::Text(constant) => {
                text.extend(b"\"");
                text.extend(constant.as_bytes());
                text.extend(b"\"");
            }
            JsonContent::Number(number) => {
                text.extend(zmij::Buffer::new().format_finite(*number).as_bytes());
            }
            JsonContent::Signal(..) | JsonContent::Counter(_) => pieces.push(Piece {
                text: std::mem::take(text).into(),
                field: Some(*field),
            }),
        },
        Node::Object(entries) => {
            for (place, (key, inner)) in entries.iter().enumerate() {
                text.extend(if place == 0 { b"{\"" } else { b",\"" });
                text.extend(key.as_bytes());
                text.extend(b"\":");
                write(inner, fields, text, pieces);
            }
            text.push(b'}');
        }
        Node::Array(items) => {
            for (place, inner) in items.iter().flatten().enumerate() {
                text.push(if place == 0 { b'[' } else { b',' });
                write(inner, fields, text, pieces);
            }
            text.push(b']');
        }
    }
}

/// Value at a leaf of a JSON text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Leaf<'b> {
    Number(f64),
    NotFinite,
    Null,
    Boolean(bool),
    Text(&'b [u8]),
}

/// Step from a value to one inside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step<'b> {
    Key(&'b [u8]),
    Index(usize),
}

/// Returns `true` if steps follow a path.
pub(crate) fn is_at(steps: &[Step<'_>], path: &[Part]) -> bool {
    steps.len() == path.len()
        && steps.iter().zip(path).all(|pair| match pair {
            (Step::Key(key), Part::Key(other)) => *key == other.as_bytes(),
            (Step::Index(index), Part::Index(other)) => index == other,
            _ => false,
        })
}

/// Visits every leaf of a JSON text.
///
/// # Errors
/// The byte at which the text is not JSON or nested too deeply.
pub(crate) fn scan<'b>(
    bytes: &'b [u8],
    visit: &mut impl FnMut(&[Step<'b>], Leaf<'b>),
) -> Result<(), usize> {
    let mut scanner = Scanner {
        bytes,
        at: 0,
        steps: [Step::Index(0); DEEPEST],
        depth: 0,
    };
    scanner.value(visit)?;
    scanner.skip();
    match scanner.at == bytes.len() {
        true => Ok(()),
        false => Err(scanner.at),
    }
}

struct Scanner<'b> {
    bytes: &'b [u8],
    at: usize,
    steps: [Step<'b>; DEEPEST],
    depth: usize,
}

impl<'b> Scanner<'b> {
    fn value(&mut self, visit: &mut impl FnMut(&[Step<'b>], Leaf<'b>)) -> Result<(), usize> {
        self.skip();
        let leaf = match self.peek() {
            Some(b'{') => return self.object(visit),
            Some(b'[') => return self.array(visit),
            Some(b'"') => Leaf::Text(self.text()?),
            _ => self.word()?,
        };
        visit(&self.steps[..self.depth], leaf);
        Ok(())
    }

    fn object(&mut self, visit: &mut impl FnMut(&[Step<'b>], Leaf<'b>)) -> Result<(), usize> {
        self.at += 1;
        self.skip();
        if self.takes(b'}') {
            return Ok(());
        }
        loop {
            self.skip();
            let key = self.text()?;
            self.skip();
            self.expect(b':')?;
            self.inside(Step::Key(key), visit)?;
            self.skip();
            if self.takes(b'}') {
                return Ok(());
            }
            self.expect(b',')?;
        }
    }

    fn array(&mut self, visit: &mut impl FnMut(&[Step<'b>], Leaf<'b>)) -> Result<(), usize> {
        self.at += 1;
        self.skip();
        if self.takes(b']') {
            return Ok(());
        }
        for index in 0.. {
            self.inside(Step::Index(index), visit)?;
            self.skip();
            if self.takes(b']') {
                break;
            }
            self.expect(b',')?;
        }
        Ok(())
    }

    fn inside(
        &mut self,
        step: Step<'b>,
        visit: &mut impl FnMut(&[Step<'b>], Leaf<'b>),
    ) -> Result<(), usize> {
        let slot = self.steps.get_mut(self.depth).ok_or(self.at)?;
        *slot = step;
        self.depth += 1;
        self.value(visit)?;
        self.depth -= 1;
        Ok(())
    }

    /// Reads a text; returns what stands between its quotes.
    fn text(&mut self) -> Result<&'b [u8], usize> {
        self.expect(b'"')?;
        let start = self.at;
        loop {
            match self.peek().ok_or(self.at)? {
                b'"' => break,
                b'\\' => self.at += 2,
                0..0x20 => return Err(self.at),
                _ => self.at += 1,
            }
        }
        let bytes: &'b [u8] = self.bytes;
        let text = &bytes[start..self.at];
        self.at += 1;
        Ok(text)
    }

    /// Reads a number or a word. Python writes NaN and Infinity, which JSON does not know.
    fn word(&mut self) -> Result<Leaf<'b>, usize> {
        let start = self.at;
        let rest = &self.bytes[start.min(self.bytes.len())..];
        let is_part = |c: &u8| c.is_ascii_alphanumeric() || matches!(c, b'+' | b'-' | b'.');
        let length = rest.iter().take_while(|c| is_part(c)).count();
        let word = std::str::from_utf8(&rest[..length]).map_err(|_| start)?;
        let leaf = match word {
            "null" => Leaf::Null,
            "true" => Leaf::Boolean(true),
            "false" => Leaf::Boolean(false),
            "NaN" | "Infinity" | "-Infinity" => Leaf::NotFinite,
            _ => {
                let is_number = word.starts_with(|c: char| c == '-' || c.is_ascii_digit());
                let number: f64 = word.parse().map_err(|_| start)?;
                match number.is_finite() {
                    _ if !is_number || word.starts_with("-i") || word.starts_with("-n") => {
                        return Err(start);
                    }
                    true => Leaf::Number(number),
                    false => Leaf::NotFinite,
                }
            }
        };
        self.at += length;
        Ok(leaf)
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn skip(&mut self) {
        while matches!(self.peek(), Some(b' ' | b'\t' | b'\n' | b'\r')) {
            self.at += 1;
        }
    }

    fn takes(&mut self, byte: u8) -> bool {
        let is_next = self.peek() == Some(byte);
        self.at += usize::from(is_next);
        is_next
    }

    fn expect(&mut self, byte: u8) -> Result<(), usize> {
        match self.takes(byte) {
            true => Ok(()),
            false => Err(self.at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves(text: &str) -> Result<Vec<String>, usize> {
        let mut leaves = Vec::new();
        scan(text.as_bytes(), &mut |steps, leaf| {
            let steps = steps.iter().map(|step| match step {
                Step::Key(key) => String::from_utf8_lossy(key).into_owned(),
                Step::Index(index) => index.to_string(),
            });
            let steps: Vec<String> = steps.collect();
            leaves.push(format!("{} {leaf:?}", steps.join("/")));
        })?;
        Ok(leaves)
    }

    #[test]
    fn every_leaf_is_visited_with_its_path() {
        let text = " {\"a\": [1, -2.5e3, null], \"b\": {\"c\\\"\": true, \"d\": \"x\"}, \"e\": NaN, \"f\": {}}\r\n";
        let expected = [
            "a/0 Number(1.0)",
            "a/1 Number(-2500.0)",
            "a/2 Null",
            "b/c\\\" Boolean(true)",
            "b/d Text([120])",
            "e NotFinite",
        ];
        assert_eq!(leaves(text), Ok(expected.map(String::from).to_vec()));
        assert_eq!(leaves("1e999"), Ok(vec![" NotFinite".into()]));
    }

    #[test]
    fn text_that_is_not_json_is_refused_at_its_place() {
        for (text, at) in [
            ("", 0),
            ("{\"a\":1", 6),
            ("{\"a\":1}x", 7),
            ("[1,]", 3),
            ("{a:1}", 1),
            ("inf", 0),
            ("-inf", 0),
            ("+1", 0),
            ("\"a", 2),
            ("\"a\\", 4),
            ("[1 2]", 3),
        ] {
            assert_eq!(leaves(text), Err(at), "{text}");
        }
        assert_eq!(leaves(&"[".repeat(100_000)), Err(17));
    }
}

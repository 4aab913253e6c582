//! Messages described in `ros2msg`: their fields, and the numbers in a message.

use std::collections::BTreeMap;

use super::cdr::{Cursor, Number};
use crate::schema::RULER;

/// Deepest nesting; deeper is damage.
const DEEPEST: usize = 32;
/// Elements of a fixed array that are listed.
const MOST_LISTED: usize = 64;
/// Fields that are listed.
const MOST_FIELDS: usize = 10_000;

/// Message with all that is nested in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message(Vec<Field>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct Field {
    name: String,
    kind: Kind,
    count: Count,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    Number(Number),
    /// Text of characters of a size.
    Text(usize),
    Message(Message),
}

/// Reason why the numbers of a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Unread {
    /// The message does not fit its schema.
    Damaged,
    /// An array has no element of the index in a path.
    Short {
        /// Path of the array.
        array: String,
        /// Number of its elements.
        elements: usize,
    },
}

/// Part of a message.
enum Part {
    /// Number.
    Number(f64),
    /// Array of so many elements, before they follow.
    Array(usize),
}

/// Returns the index that a path has for an array.
fn index_in(path: &str, array: &str) -> Option<usize> {
    let rest = path.strip_prefix(array)?.strip_prefix('[')?;
    rest.split_once(']')?.0.parse().ok()
}

/// Number of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    One,
    Fixed(usize),
    Sequence,
}

impl Message {
    /// Parses a schema; `None` if it is not understood.
    pub(super) fn parse(schema: &str) -> Option<Self> {
        let mut parts = schema.split(RULER);
        let top = parts.next()?;
        let mut nested = BTreeMap::new();
        for part in parts {
            let (name, fields) = part
                .trim_start_matches('=')
                .trim_start()
                .strip_prefix("MSG:")?
                .split_once('\n')?;
            nested.insert(name.trim(), fields);
        }
        Self::of(top, &nested, 0)
    }

    fn of(text: &str, nested: &BTreeMap<&str, &str>, depth: usize) -> Option<Self> {
        if depth > DEEPEST {
            return None;
        }
        let lines = text
            .lines()
            .map(|line| line.split('#').next().unwrap_or_default().trim());
        let mut fields = Vec::new();
        for line in lines.filter(|line| !line.is_empty()) {
            let (kind, rest) = line.split_once(char::is_whitespace)?;
            // A constant takes no bytes; a default value changes none.
            let name = rest.split_whitespace().next()?;
            let is_constant = rest
                .trim_start()
                .strip_prefix(name)?
                .trim_start()
                .starts_with('=')
                || name.contains('=');
            if !is_constant {
                fields.push(Field::of(kind, name, nested, depth)?);
            }
        }
        Some(Self(fields))
    }

    /// Lists the paths of all numbers; of a sequence the first.
    pub(super) fn numbers(&self) -> Vec<String> {
        let mut paths = Vec::new();
        self.list("", &mut paths);
        paths
    }

    fn list(&self, before: &str, paths: &mut Vec<String>) {
        for field in &self.0 {
            let elements = match field.count {
                Count::One => vec![format!("{before}{}", field.name)],
                Count::Fixed(count) => (0..count.min(MOST_LISTED))
                    .map(|at| format!("{before}{}[{at}]", field.name))
                    .collect(),
                Count::Sequence => vec![format!("{before}{}[0]", field.name)],
            };
            for path in elements {
                if paths.len() >= MOST_FIELDS {
                    return;
                }
                match &field.kind {
                    Kind::Number(_) => paths.push(path),
                    Kind::Text(_) => {}
                    Kind::Message(message) => message.list(&format!("{path}."), paths),
                }
            }
        }
    }

    /// Reads the numbers of these paths from a message.
    ///
    /// # Errors
    /// If the message does not fit its schema, or lacks one of the numbers.
    pub(super) fn read(&self, data: &[u8], paths: &[&str], row: &mut [f64]) -> Result<(), Unread> {
        let mut left = paths.len();
        let mut short = None;
        let mut sink = |path: &str, part: Part| match part {
            Part::Number(value) => {
                for (number, _) in row.iter_mut().zip(paths).filter(|(_, one)| **one == path) {
                    *number = value;
                    left -= 1;
                }
            }
            Part::Array(elements) => {
                let mut indices = paths.iter().filter_map(|one| index_in(one, path));
                if short.is_none() && indices.any(|index| index >= elements) {
                    let array = path.to_owned();
                    short = Some(Unread::Short { array, elements });
                }
            }
        };
        let mut cursor = Cursor::of(data).ok_or(Unread::Damaged)?;
        self.walk(&mut cursor, &mut String::new(), paths, &mut sink)
            .ok_or(Unread::Damaged)?;
        match left {
            0 => Ok(()),
            _ => Err(short.unwrap_or(Unread::Damaged)),
        }
    }

    fn walk(
        &self,
        cursor: &mut Cursor<'_>,
        path: &mut String,
        paths: &[&str],
        sink: &mut dyn FnMut(&str, Part),
    ) -> Option<()> {
        let before = path.len();
        if self.0.is_empty() {
            // CDR has no empty structure: ROS 2 puts one byte there.
            return cursor.skip(Number::Unsigned(1), 1);
        }
        for field in &self.0 {
            let count = match field.count {
                Count::One => 1,
                Count::Fixed(count) => count,
                Count::Sequence => cursor.length()?,
            };
            path.push_str(&field.name);
            let is_wanted = paths.iter().any(|one| one.starts_with(path.as_str()));
            if is_wanted && field.count != Count::One {
                sink(path, Part::Array(count));
            }
            match &field.kind {
                Kind::Number(number) if !is_wanted => cursor.skip(*number, count)?,
                kind => {
                    for at in 0..count {
                        let name = path.len();
                        if field.count != Count::One {
                            use std::fmt::Write as _;
                            let _ = write!(path, "[{at}]");
                        }
                        match kind {
                            Kind::Number(number) => {
                                sink(path, Part::Number(cursor.number(*number)?))
                            }
                            Kind::Text(size) => cursor.skip_text(*size)?,
                            Kind::Message(message) => {
                                path.push('.');
                                message.walk(cursor, path, paths, sink)?;
                            }
                        }
                        path.truncate(name);
                    }
                }
            }
            path.truncate(before);
        }
        Some(())
    }
}

impl Field {
    fn of(kind: &str, name: &str, nested: &BTreeMap<&str, &str>, depth: usize) -> Option<Self> {
        let (base, count) = match kind
            .strip_suffix(']')
            .and_then(|rest| rest.rsplit_once('['))
        {
            None => (kind, Count::One),
            Some((base, count)) if count.is_empty() || count.starts_with("<=") => {
                (base, Count::Sequence)
            }
            Some((base, count)) => (base, Count::Fixed(count.parse().ok()?)),
        };
        let word = base.split_once("<=").map_or(base, |(word, _)| word);
        let kind = match word {
            "string" => Kind::Text(1),
            "wstring" => Kind::Text(2),
            word => match Number::of(word) {
                Some(number) => Kind::Number(number),
                None => Kind::Message(message(word, nested, depth)?),
            },
        };
        Some(Self {
            name: name.into(),
            kind,
            count,
        })
    }
}

/// Parses a nested message, which may be named with or without its package and `msg`.
fn message(name: &str, nested: &BTreeMap<&str, &str>, depth: usize) -> Option<Message> {
    let last = |name: &str| name.rsplit('/').next().map(str::to_owned);
    let short = name.replace("/msg/", "/");
    let is_it = |full: &&&str| **full == name || full.replace("/msg/", "/") == short;
    let full = nested.keys().find(is_it);
    let full = full.or_else(|| {
        nested
            .keys()
            .find(|full| !name.contains('/') && last(full) == last(name))
    });
    let text = match full {
        Some(full) => nested[full],
        None if matches!(
            short.as_str(),
            "builtin_interfaces/Time" | "builtin_interfaces/Duration"
        ) =>
        {
            "int32 sec\nuint32 nanosec"
        }
        None => return None,
    };
    Message::of(text, nested, depth + 1)
}

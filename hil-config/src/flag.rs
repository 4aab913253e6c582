//! `--set KEY=VALUE`: one value of the scenario from the command line.
//!
//! A key is the path of a value, such as `faults[0].effects[1].speed_per_s`; missing tables are created, but list
//! entries must exist. `faults[+]` at the end of a key appends an entry, to a new list if there is none. A value is TOML; anything that is not valid TOML is text, so that `controller.law=pid` needs no
//! quotes. The value remembers that it came from the flag.

use std::ops::Range;

use crate::document::{Entry, Node, Table, Value};
use crate::source::{Place, Sources};

/// Error in a flag, with the faulty bytes of the flag.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct FlagError {
    pub message: String,
    pub span: Range<usize>,
    /// Key up to the error.
    pub key: String,
    /// Source of an earlier flag that conflicts with this one.
    pub earlier: Option<usize>,
}

/// Maximum number of parts of a key: no value is nested more deeply, and nested values are processed recursively.
const MOST_PARTS: usize = 32;

/// Part of a key.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Part {
    Key(String),
    Index(usize),
    /// New entry at the end of a list.
    Append,
}

/// Part of a key and its bytes in the flag.
type Placed = (Part, Range<usize>);

/// Sets the value of a flag in the scenario.
pub(crate) fn apply(root: &mut Table, flag: &str, source: usize) -> Result<(), FlagError> {
    let Some((key, text)) = flag.split_once('=') else {
        return Err(error(0..flag.len(), "", "expected KEY=VALUE, found no `=`"));
    };
    let parts = parts(key)?;
    let start = key.len() + 1;
    if text.trim().is_empty() {
        return Err(error(start..flag.len(), key, "no value after the `=`"));
    }
    let place = Place {
        source,
        span: start..flag.len(),
    };
    let value = Value::parse(text, &place).unwrap_or_else(|| Value::Text(text.trim().into()));
    put(root, &parts, Node { value, place }, source).map_err(|failure| match failure.earlier {
        Some(_) => FlagError {
            span: 0..key.len(),
            key: key.into(),
            ..failure
        },
        None => failure,
    })
}

/// Returns the key of a flag.
pub(crate) fn key_of(flag: &str) -> Option<&str> {
    flag.split_once('=').map(|(key, _)| key)
}

/// Checks the syntax of a flag, independently of any scenario.
pub(crate) fn check(flag: &str) -> Result<(), String> {
    let result = flag
        .split_once('=')
        .ok_or_else(|| format!("`{flag}` has no `=`"));
    let (key, value) = result?;
    parts(key).map_err(|error| error.message)?;
    match value.trim() {
        "" => Err(format!("`{flag}` has no value after the `=`")),
        _ => Ok(()),
    }
}

fn error(span: Range<usize>, key: &str, message: impl Into<String>) -> FlagError {
    FlagError {
        message: message.into(),
        span,
        key: key.into(),
        earlier: None,
    }
}

/// Returns the source of an earlier flag that set a value or a part of it.
fn earlier(node: &Node, source: usize) -> Option<usize> {
    let own = node.place.source;
    if own != Sources::SCENARIO && own != source {
        return Some(own);
    }
    match &node.value {
        Value::Table(table) => (table.entries().iter()).find_map(|one| earlier(&one.node, source)),
        Value::List(items) => items.iter().find_map(|one| earlier(one, source)),
        _ => None,
    }
}

/// Splits `a[0].b` into its parts.
fn parts(key: &str) -> Result<Vec<Placed>, FlagError> {
    let mut parts = Vec::new();
    let mut at = 0;
    for word in key.split('.') {
        if parts.len() > MOST_PARTS {
            let message = format!("a key of more than {MOST_PARTS} parts");
            return Err(error(0..at, &key[..at], message));
        }
        let name_end = word.find('[').unwrap_or(word.len());
        let (name, indices) = word.split_at(name_end);
        let span = at..at + name.len();
        let bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
        if name.is_empty() || !name.chars().all(bare) {
            let message = format!("`{name}` is not a key: letters, digits, - and _");
            return Err(error(span, key, message));
        }
        parts.push((Part::Key(name.into()), span));
        at += name.len();
        let mut rest = indices;
        while !rest.is_empty() {
            let closed = rest.strip_prefix('[').and_then(|rest| rest.split_once(']'));
            let index = closed.and_then(|(digits, rest)| match digits {
                "+" => Some((Part::Append, rest)),
                digits => Some((Part::Index(digits.parse().ok()?), rest)),
            });
            let Some((index, after)) = index else {
                let message = format!("`{rest}` is not an index like [0]");
                return Err(error(at..at + rest.len(), key, message));
            };
            let length = rest.len() - after.len();
            parts.push((index, at..at + length));
            at += length;
            rest = after;
        }
        at += 1;
    }
    Ok(parts)
}

/// Sets a value at a path that begins with a key.
fn put(table: &mut Table, parts: &[Placed], value: Node, source: usize) -> Result<(), FlagError> {
    let (name, span, rest) = first_key(table, parts);
    let name = &name;
    let key_place = Place {
        source,
        span: span.clone(),
    };
    if let (Some((Part::Index(_), span)), None) = (rest.first(), table.get(name)) {
        let message = format!("there is no list `{name}`");
        return Err(error(span.clone(), name, message));
    }
    let is_appended = matches!(rest.first(), Some((Part::Append, _)));
    let entry = table.entry(name, || Entry {
        key: name.clone(),
        key_place: key_place.clone(),
        node: Node {
            value: match is_appended {
                true => Value::List(Vec::new()),
                false => Value::Table(Table::default()),
            },
            place: key_place.clone(),
        },
    });
    if rest.is_empty() {
        entry.key_place = key_place;
    }
    put_below(&mut entry.node, name, rest, value, source)
}

/// Splits off the first key of a path: as many parts as a key of the table has (a key may be quoted and contain dots),
/// otherwise one part.
fn first_key<'a>(table: &Table, parts: &'a [Placed]) -> (String, Range<usize>, &'a [Placed]) {
    let names: Vec<&str> = (parts.iter())
        .map_while(|(part, _)| match part {
            Part::Key(name) => Some(name.as_str()),
            Part::Index(_) | Part::Append => None,
        })
        .collect();
    let quoted = (2..=names.len()).rev().find_map(|count| {
        let name = names[..count].join(".");
        table.get(&name).is_some().then_some((name, count))
    });
    // A path begins with a key, and so does what follows a table.
    let (name, count) = quoted.unwrap_or_else(|| (names[0].into(), 1));
    let span = parts[0].1.start..parts[count - 1].1.end;
    (name, span, &parts[count..])
}

/// Sets a value at the rest of a path, below the value of `name`.
fn put_below(
    node: &mut Node,
    name: &str,
    rest: &[Placed],
    value: Node,
    source: usize,
) -> Result<(), FlagError> {
    match rest.first() {
        None => match earlier(node, source) {
            Some(earlier) => Err(FlagError {
                earlier: Some(earlier),
                ..error(0..0, name, "the same value is set by")
            }),
            None => {
                *node = value;
                Ok(())
            }
        },
        Some((Part::Key(_), span)) => match &mut node.value {
            Value::Table(table) => put(table, rest, value, source),
            other => {
                let message = format!("`{name}` is {}, not a table", other.type_name());
                Err(error(span.clone(), name, message))
            }
        },
        Some((Part::Append, span)) => match &mut node.value {
            _ if rest.len() > 1 => {
                let message =
                    format!("`{name}[+]` appends a whole entry; nothing may follow `[+]`");
                Err(error(span.clone(), name, message))
            }
            Value::List(items) => {
                items.push(value);
                Ok(())
            }
            other => {
                let message = format!("`{name}` is {}, not a list", other.type_name());
                Err(error(span.clone(), name, message))
            }
        },
        Some((Part::Index(index), span)) => match &mut node.value {
            Value::List(items) => {
                let count = items.len();
                let Some(item) = items.get_mut(*index) else {
                    let message = format!(
                        "`{name}` has {count} entries, counted from 0; there is no [{index}]"
                    );
                    return Err(error(span.clone(), name, message));
                };
                put_below(item, name, &rest[1..], value, source)
            }
            other => {
                let message = format!("`{name}` is {}, not a list", other.type_name());
                Err(error(span.clone(), name, message))
            }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_split_into_names_and_indices() {
        let actual = parts("faults[0].effects[12].speed_per_s").expect("a key");
        let expected = [
            (Part::Key("faults".into()), 0..6),
            (Part::Index(0), 6..9),
            (Part::Key("effects".into()), 10..17),
            (Part::Index(12), 17..21),
            (Part::Key("speed_per_s".into()), 22..33),
        ];
        assert_eq!(actual, expected);
    }

    #[test]
    fn an_endless_key_is_refused() {
        let key = vec!["a"; 100_000].join(".");
        let error = parts(&key).expect_err("too deep");
        assert!(error.message.contains("more than 32 parts"));
        assert!(error.key.len() < 100);
    }

    #[test]
    fn an_invalid_key_is_refused_at_its_place() {
        for (key, span) in [
            ("", 0..0),
            ("a..b", 2..2),
            ("a.", 2..2),
            ("[0]", 0..0),
            ("a[", 1..2),
            ("a[x]", 1..4),
            ("a[0]b", 4..5),
            ("a[-1]", 1..5),
            ("a[+", 1..3),
            ("a[++]", 1..5),
            ("a b", 0..3),
        ] {
            assert_eq!(parts(key).expect_err(key).span, span, "{key}");
        }
    }
}

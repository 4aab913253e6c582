//! Spelling of foreign names: maps any text to a valid signal name, and back.
//!
//! Names from FMUs and C programs, such as `der(x)`, `a.b[1]`, `'quoted name'` or `φ`, cannot be used in expressions
//! and in the schema of a recording. [`spelled`] maps each to its unique valid name, and [`foreign`] maps such a name
//! back. Called by shells of foreign programs, once at the start.
//!
//! | foreign | here |
//! |---|---|
//! | a valid name without `__` | itself |
//! | `der(x)` | `der__x` |
//! | `a.b[1]`, `a[1,2]` | `a.b__1`, `a__1_2` |
//! | `a name` | `a__name` |
//! | `'a name'`, a whole name or the part after a dot | `q__a__name` |
//! | any other character | `__uHEX_`, its Unicode number: `a-b` is `a__u2d_b` |
//!
//! A name in this form that would be read back as another text is written with `__uHEX_` for every character that is
//! not plain. No two texts share a name, because [`foreign`] reads each name back.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::layout::{LONGEST_NAME, schema_name};

/// Prefix of the name of a derivative, `der(..)`.
const DERIVATIVE: &str = "der__";
/// Prefix of a quoted part of a name.
const QUOTED: &str = "q__";
/// Prefix of a character given by its number.
const NUMBERED: &str = "__u";
/// Name of the empty text.
const EMPTY: &str = "__u_";

/// Reason why a foreign name is unusable.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unspellable {
    /// Name whose spelling is too long.
    #[error(
        "the name {begin:?}.. has {bytes} bytes when spelled with letters, digits and _; at most {most} are allowed",
        most = LONGEST_NAME
    )]
    Long {
        /// Beginning of the foreign name.
        begin: String,
        /// Length of the spelling.
        bytes: usize,
    },
    /// Two names that coincide in a recording, whose schema has `_` for each dot.
    #[error(
        "the names {one:?} and {other:?} coincide in a recording, whose columns have _ for a dot; rename one of them"
    )]
    Alike {
        /// A foreign name.
        one: String,
        /// Another foreign name.
        other: String,
    },
}

/// Spells a foreign name as a valid signal name.
///
/// # Errors
/// If the spelling is too long.
pub fn spelled(foreign: &str) -> Result<String, Unspellable> {
    let readable = readable(foreign);
    let name = if is_legal(&readable) && read(&readable) == foreign {
        readable
    } else {
        plain(foreign)
    };
    if name.len() > LONGEST_NAME {
        return Err(Unspellable::Long {
            begin: foreign.chars().take(40).collect(),
            bytes: name.len(),
        });
    }
    Ok(name)
}

/// Spells the names of one table, each independently.
///
/// # Errors
/// If a name is too long, is a duplicate, or coincides with another name in a recording.
pub fn spelled_all<S: AsRef<str>>(foreign: &[S]) -> Result<Vec<String>, Unspellable> {
    let mut columns: BTreeMap<String, &str> = BTreeMap::new();
    let mut names = Vec::with_capacity(foreign.len());
    for other in foreign.iter().map(AsRef::as_ref) {
        let name = spelled(other)?;
        if let Some(one) = columns.insert(schema_name(&name), other) {
            let (one, other) = (one.into(), other.into());
            return Err(Unspellable::Alike { one, other });
        }
        names.push(name);
    }
    Ok(names)
}

/// Returns the foreign name with this spelling; `None` if there is none.
#[must_use]
pub fn foreign(name: &str) -> Option<String> {
    let text = read(name);
    (spelled(&text).as_deref() == Ok(name)).then_some(text)
}

/// Returns the short form, which may be read back as another text.
fn readable(foreign: &str) -> String {
    let (mut inner, mut order) = (foreign, 0);
    while let Some(rest) = (inner.strip_prefix("der(")).and_then(|rest| rest.strip_suffix(')')) {
        (inner, order) = (rest, order + 1);
    }
    let parts = inner.split('.').map(|part| {
        let inner = (part.strip_prefix('\'')).and_then(|rest| rest.strip_suffix('\''));
        match inner {
            Some(inner) => format!("{QUOTED}{}", readable_part(inner)),
            None => readable_part(part),
        }
    });
    DERIVATIVE.repeat(order) + &parts.collect::<Vec<_>>().join(".")
}

fn readable_part(part: &str) -> String {
    let mut name = String::with_capacity(part.len());
    let mut rest = part;
    while let Some(c) = rest.chars().next() {
        if let Some((indices, after)) = indices(rest) {
            name.push_str("__");
            name.push_str(&indices.replace(',', "_"));
            rest = after;
            continue;
        }
        match c {
            ' ' => name.push_str("__"),
            '_' => name.push('_'),
            c if c.is_ascii_alphanumeric() => name.push(c),
            c => number(&mut name, c),
        }
        rest = &rest[c.len_utf8()..];
    }
    name
}

/// Splits a text into its leading indices, `1,2` of `[1,2]`, and the rest.
fn indices(text: &str) -> Option<(&str, &str)> {
    let (indices, after) = text.strip_prefix('[')?.split_once(']')?;
    let is_whole = indices.split(',').all(is_index);
    is_whole.then_some((indices, after))
}

/// Returns `true` if a text is a whole number without a leading zero.
fn is_index(text: &str) -> bool {
    let digits = !text.is_empty() && text.bytes().all(|c| c.is_ascii_digit());
    digits && (text == "0" || !text.starts_with('0'))
}

/// Returns the long form, which is always read back as the same text: letters, digits, and the dots and `_` between
/// them remain; every other character is written by number.
fn plain(foreign: &str) -> String {
    if foreign.is_empty() {
        return EMPTY.into();
    }
    let mut name = String::with_capacity(foreign.len());
    let mut before = None;
    let mut rest = foreign.chars().peekable();
    while let Some(c) = rest.next() {
        let is_plain = |c: Option<&char>| c.is_some_and(char::is_ascii_alphanumeric);
        let is_between = is_plain(before.as_ref()) && is_plain(rest.peek());
        let is_first = matches!(before, None | Some('.'));
        match c {
            '.' | '_' if is_between => name.push(c),
            c if c.is_ascii_alphabetic() || (c.is_ascii_digit() && !is_first) => name.push(c),
            c => number(&mut name, c),
        }
        before = Some(c);
    }
    name
}

fn number(name: &mut String, c: char) {
    let _ = write!(name, "{NUMBERED}{:x}_", u32::from(c));
}

/// Reads a name of either form.
fn read(name: &str) -> String {
    let (mut inner, mut order) = (name, 0);
    while let Some(rest) = inner.strip_prefix(DERIVATIVE)
        && numbered(&inner["der".len()..]).is_none()
    {
        (inner, order) = (rest, order + 1);
    }
    let parts = inner.split('.').map(|part| {
        let quoted = part.strip_prefix(QUOTED);
        match quoted.filter(|_| numbered(&part["q".len()..]).is_none()) {
            Some(inner) => format!("'{}'", read_part(inner)),
            None => read_part(part),
        }
    });
    let text = match inner {
        EMPTY => String::new(),
        _ => parts.collect::<Vec<_>>().join("."),
    };
    format!("{}{text}{}", "der(".repeat(order), ")".repeat(order))
}

fn read_part(part: &str) -> String {
    let mut text = String::with_capacity(part.len());
    let mut rest = part;
    while let Some(c) = rest.chars().next() {
        if let Some((numbered, after)) = numbered(rest) {
            text.push(numbered);
            rest = after;
        } else if rest.starts_with('_') && numbered(&rest[1..]).is_some() {
            text.push('_');
            rest = &rest[1..];
        } else if let Some(after) = rest.strip_prefix("__") {
            let length = spelled_indices(after);
            if length == 0 {
                text.push(' ');
            } else {
                let _ = write!(text, "[{}]", after[..length].replace('_', ","));
            }
            rest = &after[length..];
        } else {
            text.push(c);
            rest = &rest[c.len_utf8()..];
        }
    }
    text
}

/// Returns the length of the leading indices `1_2` of a text.
fn spelled_indices(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let mut length = digits(text);
    while length > 0 && text[length..].starts_with('_') {
        match digits(&text[length + 1..]) {
            0 => break,
            more => length += 1 + more,
        }
    }
    length
}

/// Splits a text into its leading character, given by number, and the rest.
fn numbered(text: &str) -> Option<(char, &str)> {
    let (hex, after) = text.strip_prefix(NUMBERED)?.split_once('_')?;
    let is_hex = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
    if hex.is_empty() || hex.starts_with('0') && hex != "0" || !hex.bytes().all(is_hex) {
        return None;
    }
    let c = u32::from_str_radix(hex, 16).ok().and_then(char::from_u32)?;
    Some((c, after))
}

fn is_legal(name: &str) -> bool {
    name.split('.').all(crate::layout::is_name)
}

#[cfg(test)]
mod tests;

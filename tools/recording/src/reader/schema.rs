//! The columns of a record, parsed from the schema of a recording.

use std::collections::BTreeMap;

use shared_types::record::{GROUPS, HASHED_GROUPS, Timing};

/// Maximum number of validity words: those of the widest frame, with room to grow; more is damage.
const MOST_WORDS: usize = 1024;

/// Word of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name: `step`, `truth.x_m`, `sample_invalid[0]`.
    pub name: String,
    /// Unit; empty for words that are not signals.
    pub unit: String,
}

impl Column {
    /// Returns `true` if the column is a number with a unit rather than a count or bits.
    #[must_use]
    pub fn is_signal(&self) -> bool {
        self.name.contains('.')
    }
}

/// Parses the columns from a `ros2msg` schema with `uint64` and arrays of it, arrays with two `uint32` per word,
/// messages of `float64`, and messages that split one word for other programs.
pub(super) fn columns_of(schema: &str) -> Option<Vec<Column>> {
    let mut parts = schema.split(crate::schema::RULER);
    let top = parts.next()?;
    let mut messages = BTreeMap::new();
    for part in parts {
        let (name, fields) = part.trim_start().strip_prefix("MSG: ")?.split_once('\n')?;
        messages.insert(name.trim(), fields);
    }
    let word = |name: String| Column {
        name,
        unit: String::new(),
    };
    let mut columns = Vec::new();
    for line in top.lines().filter(|line| !line.trim().is_empty()) {
        let (kind, name, _) = field(line)?;
        if let Some(fields) = messages.get(kind) {
            if is_one_word(fields) {
                columns.push(word(name.into()));
                continue;
            }
            for line in fields.lines().filter(|line| !line.trim().is_empty()) {
                let ("float64", field, unit) = field(line)? else {
                    return None;
                };
                let name = format!("{name}.{field}");
                columns.push(Column {
                    name,
                    unit: unit.into(),
                });
            }
        } else if let Some((scalar, count)) = array(kind) {
            let words = match scalar {
                "uint64" => count,
                "uint32" if count.is_multiple_of(2) => count / 2,
                _ => return None,
            };
            if words > MOST_WORDS {
                return None;
            }
            columns.extend((0..words).map(|index| word(format!("{name}[{index}]"))));
        } else if kind == "uint64" {
            columns.push(word(name.into()));
        } else {
            return None;
        }
    }
    (columns.first()?.name == "step").then_some(columns)
}

/// Parses the descriptions of signals, by the names of their columns, from a schema whose columns are valid.
pub(super) fn descriptions_of(schema: &str) -> BTreeMap<String, String> {
    let mut descriptions = BTreeMap::new();
    for part in schema.split(crate::schema::RULER).skip(1) {
        let name = part.trim_start().strip_prefix("MSG: hil_msgs/");
        let Some((message, fields)) = name.and_then(|rest| rest.split_once('\n')) else {
            continue;
        };
        let group = message.trim().to_ascii_lowercase();
        for line in fields.lines() {
            let comment = line
                .split_once("# [")
                .and_then(|(_, rest)| rest.split_once(']'));
            if let (Some(("float64", name, _)), Some((_, text))) = (field(line), comment) {
                descriptions.insert(format!("{group}.{name}"), text.trim().to_owned());
            }
        }
    }
    descriptions
}

/// Parses the type and length of an array.
fn array(kind: &str) -> Option<(&str, usize)> {
    let (scalar, count) = kind.strip_suffix(']')?.split_once('[')?;
    Some((scalar, count.parse().ok()?))
}

/// Returns `true` if a message consists of small integers that fill one word.
fn is_one_word(fields: &str) -> bool {
    let bytes = |line: &str| {
        let (kind, ..) = field(line)?;
        let (scalar, count) = array(kind).unwrap_or((kind, 1));
        let bytes: usize = match scalar {
            "uint8" => 1,
            "uint16" => 2,
            "uint32" => 4,
            _ => return None,
        };
        bytes.checked_mul(count)
    };
    let mut lines = fields.lines().filter(|line| !line.trim().is_empty());
    lines.try_fold(0_usize, |sum, line| sum.checked_add(bytes(line)?)) == Some(size_of::<u64>())
}

/// Parses the type, name and unit of a field.
fn field(line: &str) -> Option<(&str, &str, &str)> {
    let (field, comment) = line.split_once('#').unwrap_or((line, ""));
    let mut words = field.split_ascii_whitespace();
    let unit = comment.trim_start().strip_prefix('[');
    let unit = unit
        .and_then(|rest| rest.split_once(']'))
        .map_or("", |(unit, _)| unit);
    Some((words.next()?, words.next()?, unit))
}

/// Counts the words before the first word that the digest omits.
pub(super) fn hashed(columns: &[Column]) -> usize {
    let is_left_out = |column: &Column| match column.name.split_once('.') {
        Some((group, _)) => GROUPS[HASHED_GROUPS..].contains(&group),
        None => Timing::NAMES.contains(&column.name.as_str()),
    };
    columns
        .iter()
        .position(is_left_out)
        .unwrap_or(columns.len())
}

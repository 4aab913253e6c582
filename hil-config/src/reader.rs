//! Reader of a scenario's tree according to the tables of [`keys`](crate::keys): types, ranges and unknown keys.
//!
//! Used by every part of the [`check`](crate::check). A faulty value is reported and read as `None`, so that the rest
//! of the scenario is still checked.

mod values;

use shared_types::text::printable;

use crate::document::{Entry, Node, Table, Value};
use crate::keys::{Key, KeyKind};
use crate::problem::{MOST_PROBLEMS, Problem, ProblemKind, Problems, listed};
use crate::quantity::Quantity;
use crate::source::{Place, Sources};
use crate::table_file::Format;

/// Maximum length of a message, in characters: a name in a message may be as long as the file.
const LONGEST_MESSAGE: usize = 1000;

/// Collects problems while a scenario is read.
#[derive(Debug)]
pub(crate) struct Reader {
    /// Sources of the scenario.
    pub sources: Sources,
    /// Problems found so far.
    pub problems: Vec<Problem>,
    /// Readers of further formats of tables.
    pub formats: &'static [Format],
    /// Last problem that exceeds the limit.
    untold: Option<Problem>,
}

/// Table of the scenario and its valid keys.
#[derive(Clone, Debug)]
pub(crate) struct Section<'a> {
    /// Table.
    pub table: &'a Table,
    /// Keys.
    pub keys: &'static [Key],
    /// Path of the table in the tree, for example `faults[0]`; empty for the whole scenario.
    pub path: String,
    /// Place of the table in the text.
    pub place: &'a Place,
}

impl<'a> Section<'a> {
    /// Returns the full name of one of the section's keys, for example `faults[0].at_s`.
    pub(crate) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.into()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// Returns the place of a key's value, or of the section if the key is missing.
    pub(crate) fn place_of(&self, key: &str) -> &'a Place {
        self.table
            .get(key)
            .map_or(self.place, |entry| &entry.node.place)
    }

    /// Returns the same table, read with other keys.
    pub(crate) fn with_keys(&self, keys: &'static [Key]) -> Self {
        Self {
            keys,
            ..self.clone()
        }
    }

    fn key(&self, name: &str) -> &'static Key {
        self.keys
            .iter()
            .find(|key| key.name == name)
            .expect("only keys of the table are read")
    }
}

impl Reader {
    /// Creates a reader of these sources, with the problems found so far.
    pub(crate) const fn new(sources: Sources, problems: Vec<Problem>) -> Self {
        Self {
            sources,
            problems,
            formats: &[],
            untold: None,
        }
    }

    /// Returns the result, or all problems if there are any: in the order of the text, and those of other sources after
    /// the scenario.
    pub(crate) fn finish<T>(self, read: Option<T>) -> Result<T, Problems> {
        let Self {
            sources,
            mut problems,
            ..
        } = self;
        match read {
            Some(read) if problems.is_empty() => Ok(read),
            _ => {
                let file = sources.name(Sources::SCENARIO);
                problems.sort_by_key(|problem| {
                    let at = problem.excerpt.as_ref().map(|at| (at.line, at.column));
                    (problem.source != file, at)
                });
                if let [.., last] = problems.as_mut_slice()
                    && self.untold.is_some()
                {
                    last.help(format!(
                        "there are more problems; {MOST_PROBLEMS} of them are listed"
                    ));
                }
                Err(Problems(problems))
            }
        }
    }

    /// Reports a problem of a key of this section.
    pub(crate) fn report_at(
        &mut self,
        section: &Section<'_>,
        key: &str,
        kind: ProblemKind,
        message: impl Into<String>,
    ) -> &mut Problem {
        self.report(kind, section.path_of(key), section.place_of(key), message)
    }

    /// Reports an invalid text under a key.
    pub(crate) fn refuse(&mut self, section: &Section<'_>, key: &str, text: &str, expected: &str) {
        let message = format!("`{}` is `{text}`", section.path_of(key));
        self.report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(expected);
    }

    /// Reports a problem.
    pub(crate) fn report(
        &mut self,
        kind: ProblemKind,
        key: impl Into<String>,
        place: &Place,
        message: impl Into<String>,
    ) -> &mut Problem {
        let is_told = self.problems.len() < MOST_PROBLEMS;
        let problem = Problem {
            kind,
            key: printable(&clipped(key.into())).into_owned(),
            message: printable(&clipped(message.into())).into_owned(),
            expected: None,
            nearest: Vec::new(),
            help: None,
            source: self.sources.name(place.source).into(),
            excerpt: is_told.then(|| self.sources.excerpt(place)),
        };
        if !is_told {
            return self.untold.insert(problem);
        }
        self.problems.push(problem);
        let last = self.problems.len() - 1;
        &mut self.problems[last]
    }

    /// Reports every key of a section that is neither its own nor among the additional ones.
    pub(crate) fn refuse_unknown(&mut self, section: &Section<'_>, further: &[&str]) {
        self.refuse_misplaced(section, further, &[], "");
    }

    /// Reports unknown keys, and for some of them the table to which they belong.
    pub(crate) fn refuse_misplaced(
        &mut self,
        section: &Section<'_>,
        further: &[&str],
        others: &[&str],
        table: &str,
    ) {
        let names: Vec<&str> = section
            .keys
            .iter()
            .map(|key| key.name)
            .chain(further.iter().copied())
            .collect();
        for entry in section.table.entries() {
            if !names.contains(&entry.key.as_str()) {
                let problem = self.unknown_key(section, entry, &names);
                if others.contains(&entry.key.as_str()) {
                    problem.help(format!("`{}` belongs to {table}", entry.key));
                }
            }
        }
    }

    fn unknown_key(
        &mut self,
        section: &Section<'_>,
        entry: &Entry,
        names: &[&str],
    ) -> &mut Problem {
        let wherein = match section.path.as_str() {
            "" if std::ptr::eq(section.keys, crate::keys::STUDY) => "in a study".into(),
            "" if std::ptr::eq(section.keys, crate::keys::PORT) => "in a port file".into(),
            "" => "in a scenario".into(),
            path => format!("in `{path}`"),
        };
        self.report(
            ProblemKind::UnknownKey,
            section.path_of(&entry.key),
            &entry.key_place,
            format!("unknown key `{}` {wherein}", entry.key),
        )
        .one_of(&entry.key, names.iter().copied())
    }

    /// Returns the value of a key, and reports a required key that is missing.
    fn value<'a>(&mut self, section: &Section<'a>, key: &Key) -> Option<&'a Node> {
        let entry = section.table.get(key.name);
        if entry.is_none() && key.required {
            let path = section.path_of(key.name);
            let expected = describe(&key.kind);
            self.missing(section, &path, expected);
        }
        entry.map(|entry| &entry.node)
    }

    /// Reports a missing required key.
    pub(crate) fn missing(&mut self, section: &Section<'_>, path: &str, expected: String) {
        self.report(
            ProblemKind::MissingKey,
            path,
            section.place,
            format!("`{path}` is missing"),
        )
        .expected(expected);
    }

    /// Reports a value of the wrong type.
    pub(crate) fn wrong_type(&mut self, path: &str, node: &Node, expected: impl Into<String>) {
        self.report(
            ProblemKind::WrongType,
            path,
            &node.place,
            format!("`{path}` is {}", node.value.type_name()),
        )
        .expected(expected);
    }

    /// Returns the table under one of the section's own keys; `None` if it is missing or not a table.
    pub(crate) fn section<'a>(
        &mut self,
        parent: &Section<'a>,
        name: &'static str,
    ) -> Option<Section<'a>> {
        let key = parent.key(name);
        self.value(parent, key)?;
        let keys = match key.kind {
            KeyKind::Section(keys) => keys,
            _ => &[],
        };
        Some(self.table(parent, name)?.with_keys(keys))
    }

    /// Returns the table under any key; `None` if it is missing or not a table.
    pub(crate) fn table<'a>(&mut self, parent: &Section<'a>, name: &str) -> Option<Section<'a>> {
        let node = &parent.table.get(name)?.node;
        let Value::Table(table) = &node.value else {
            self.wrong_type(&parent.path_of(name), node, "a table");
            return None;
        };
        Some(Section {
            table,
            keys: &[],
            path: parent.path_of(name),
            place: &node.place,
        })
    }

    /// Returns a section read with the keys of its `kind`, which must be one of these, and that kind.
    pub(crate) fn of_kind<'a>(
        &mut self,
        section: &Section<'a>,
        what: &str,
        kinds: impl Iterator<Item = (&'static str, &'static [Key])> + Clone,
    ) -> Option<(&'a str, Section<'a>)> {
        let name = self.text(section, "kind")?;
        let Some((_, keys)) = kinds.clone().find(|(kind, _)| *kind == name) else {
            let names = kinds.map(|(kind, _)| kind);
            let message = format!("unknown kind of {what} `{name}`");
            self.report_at(section, "kind", ProblemKind::UnknownName, message)
                .one_of(name, names);
            return None;
        };
        let further: Vec<&str> = keys.iter().map(|key| key.name).collect();
        self.refuse_unknown(section, &further);
        Some((name, section.with_keys(keys)))
    }

    /// Returns the tables of a list under a key.
    pub(crate) fn list<'a>(
        &mut self,
        parent: &Section<'a>,
        name: &'static str,
    ) -> Vec<Section<'a>> {
        let key = parent.key(name);
        let KeyKind::List(keys) = key.kind else {
            unreachable!("`{name}` is a list")
        };
        let Some(node) = self.value(parent, key) else {
            return Vec::new();
        };
        let Value::List(items) = &node.value else {
            let path = parent.path_of(name);
            let expected = format!("a list of tables, each under `[[{}]]`", plain(&path));
            self.wrong_type(&path, node, expected);
            return Vec::new();
        };
        let mut sections = Vec::new();
        for (index, item) in items.iter().enumerate() {
            let path = format!("{}[{index}]", parent.path_of(name));
            match &item.value {
                Value::Table(table) => sections.push(Section {
                    table,
                    keys,
                    path,
                    place: &item.place,
                }),
                _ => self.wrong_type(&path, item, "a table"),
            }
        }
        sections
    }
}

/// Truncates a text that is too long for a message.
fn clipped(mut text: String) -> String {
    if let Some((end, _)) = text.char_indices().nth(LONGEST_MESSAGE) {
        text.truncate(end);
        text.push('…');
    }
    text
}

/// Returns a path without indices, as in a header.
fn plain(path: &str) -> String {
    let mut inside = false;
    path.chars()
        .filter(|&c| {
            inside = (inside || c == '[') && c != ']';
            !inside && c != ']'
        })
        .collect()
}

/// Describes the value of a key, for messages and comments.
pub(crate) fn describe(kind: &KeyKind) -> String {
    match *kind {
        KeyKind::Number { unit, min, max, .. } => {
            let any = Quantity::finite(unit);
            Quantity { min, max, ..any }.expected()
        }
        KeyKind::Integer { min, max, .. } if min == max => min.to_string(),
        KeyKind::Integer { min, max, .. } => format!("a whole number from {min} to {max}"),
        KeyKind::Text { choices: [], .. } => "text".into(),
        KeyKind::Text { choices, .. } => format!("one of {}", listed(choices.iter().copied())),
        KeyKind::Boolean { .. } => "true or false".into(),
        KeyKind::Numbers => "a list of numbers".into(),
        KeyKind::Texts => "a list of texts, at least one".into(),
        KeyKind::Values => "a list of numbers, of texts, or of true and false".into(),
        KeyKind::Pair => "two numbers".into(),
        KeyKind::Pairs => "a list of pairs of numbers".into(),
        KeyKind::Quantity { unit, min, max } => {
            let any = Quantity::finite(unit);
            format!(
                "{}, or text with a unit",
                Quantity { min, max, ..any }.expected()
            )
        }
        KeyKind::Range => "two numbers or texts with a unit, the smaller one first".into(),
        KeyKind::Event => "the name or number of a fault event".into(),
        KeyKind::Section(_) | KeyKind::Described => "a table".into(),
        KeyKind::List(_) => "a list of tables".into(),
        KeyKind::Program => {
            "a file, or a table of files by the machine's name in `uname -m`".into()
        }
    }
}

//! DBC files that a port file names, each read once.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io;
use std::path::Path;

use hil_codec::dbc::{Dbc, Message};

use crate::document::{Table, Value};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::scenario::{Scenario, advice_on_missing};
use crate::source::Place;

/// Largest DBC file.
const LARGEST: u64 = 16 << 20;

/// Lists the DBC files that the text of a port file names, relative to its folder; none if the text cannot be parsed.
#[must_use]
pub fn dbc_files(text: &str, origin: &Path) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    if let Ok(file) = Scenario::parse(text, origin) {
        names_in(&file.table, &mut names);
    }
    names
}

fn names_in(table: &Table, names: &mut BTreeSet<String>) {
    for entry in table.entries() {
        match &entry.node.value {
            Value::Text(name) if entry.key == "dbc" => {
                names.insert(name.clone());
            }
            Value::Table(table) => names_in(table, names),
            Value::List(items) => {
                for item in items {
                    if let Value::Table(table) = &item.value {
                        names_in(table, names);
                    }
                }
            }
            _ => {}
        }
    }
}

/// DBC files by their names; `None` for one that cannot be used, which is reported once.
pub(super) struct DbcFiles<'a> {
    origin: &'a Path,
    /// Texts of files that need not exist.
    texts: &'a BTreeMap<String, String>,
    files: HashMap<String, Option<Dbc>>,
}

impl<'a> DbcFiles<'a> {
    pub(super) fn new(origin: &'a Path, texts: &'a BTreeMap<String, String>) -> Self {
        Self {
            origin,
            texts,
            files: HashMap::new(),
        }
    }

    /// Returns the message that describes a frame, if it names one.
    pub(super) fn message(
        &mut self,
        reader: &mut Reader,
        section: &Section<'_>,
    ) -> Result<Option<Message>, ()> {
        let has = |key| section.table.get(key).is_some();
        for (key, other) in [("dbc", "message"), ("message", "dbc")] {
            if has(key) && !has(other) {
                let path = section.path_of(other);
                reader.missing(section, &path, format!("a text, because `{key}` is set"));
                return Err(());
            }
        }
        if !has("dbc") {
            return Ok(None);
        }
        let name = reader.text(section, "dbc").ok_or(())?;
        let message = reader.text(section, "message").ok_or(())?;
        let dbc = self.file(reader, section, name).ok_or(())?;
        let entry = dbc.message(message);
        if entry.is_none() {
            let text = format!("`{name}` has no message `{message}`");
            let names = dbc.messages.iter().map(|message| message.name.as_str());
            reader
                .report_at(section, "message", ProblemKind::UnknownName, text)
                .one_of(message, names);
        }
        entry.cloned().map(Some).ok_or(())
    }

    fn file(&mut self, reader: &mut Reader, section: &Section<'_>, name: &str) -> Option<&Dbc> {
        if !self.files.contains_key(name) {
            let dbc = self.read(reader, section, name);
            self.files.insert(name.to_owned(), dbc);
        }
        self.files.get(name)?.as_ref()
    }

    fn read(&self, reader: &mut Reader, section: &Section<'_>, name: &str) -> Option<Dbc> {
        let folder = self.origin.parent().unwrap_or(Path::new(""));
        let path = folder.join(name);
        let text = self.texts.get(name).cloned();
        let text = match text.map_or_else(|| read_text(&path), Ok) {
            Ok(text) => text,
            Err(error) => {
                let message = format!("`{name}` cannot be read: {error}");
                let advice = match error.kind() {
                    io::ErrorKind::NotFound => advice_on_missing(folder, name, "port file"),
                    _ => String::new(),
                };
                reader
                    .report_at(section, "dbc", ProblemKind::Unreadable, message)
                    .help(advice);
                return None;
            }
        };
        let dbc = Dbc::read(&text);
        let source = reader.sources.add(path.display().to_string(), text);
        match dbc {
            Ok(dbc) => Some(dbc),
            Err(mistakes) => {
                for mistake in mistakes {
                    let span = mistake.place;
                    let place = Place { source, span };
                    reader.report(ProblemKind::Mismatch, "", &place, mistake.message);
                }
                None
            }
        }
    }
}

/// Reads a DBC file, which many tools write in Latin-1.
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    let info = std::fs::metadata(path)?;
    if !info.is_file() || info.len() > LARGEST {
        return Err(io::Error::other("not a regular file of at most 16 MiB"));
    }
    let bytes = std::fs::read(path)?;
    let text = String::from_utf8(bytes);
    Ok(text.unwrap_or_else(|error| {
        error
            .as_bytes()
            .iter()
            .map(|byte| char::from(*byte))
            .collect()
    }))
}

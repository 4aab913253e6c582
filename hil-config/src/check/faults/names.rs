//! Names of events, and the numbers to which `after` resolves them.

use std::collections::HashMap;

use super::Origin;
use super::span::Reported;
use crate::document::Value;
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};
use crate::title::is_title;

/// Events that `after` can refer to.
#[derive(Debug)]
pub(super) struct Names<'a> {
    /// Names in the order of definition.
    known: Vec<&'a str>,
    by_name: HashMap<&'a str, u32>,
    by_id: HashMap<u32, &'a str>,
    /// Number of the last event.
    last_id: u32,
}

impl<'a> Names<'a> {
    /// Collects the names of all events; an invalid or duplicate one is reported.
    pub(super) fn collect(
        reader: &mut Reader,
        sections: &[Section<'a>],
        origin: Origin<'a>,
    ) -> Self {
        let first_id = origin.first_id();
        let mut all = Self {
            known: Vec::new(),
            by_name: HashMap::new(),
            by_id: HashMap::new(),
            last_id: first_id + sections.len() as u32 - 1,
        };
        if let Origin::Live { names, .. } = origin {
            names.iter().for_each(|(name, id)| all.add(name, *id));
        }
        for (id, section) in (first_id..).zip(sections) {
            let Some(entry) = section.table.get("name") else {
                continue;
            };
            let Value::Text(name) = &entry.node.value else {
                continue; // reported where the event is read
            };
            let is_legal = name.starts_with(|c: char| c.is_ascii_alphabetic()) && is_title(name);
            if !is_legal {
                let expected = "1 to 64 letters, digits, - and _, a letter first";
                reader.refuse(section, "name", name, expected);
            } else if all.by_name.contains_key(name.as_str()) {
                let message = format!("another fault event is already named `{name}`");
                reader.report_at(section, "name", ProblemKind::Duplicate, message);
            }
            all.add(name, id);
        }
        all
    }

    fn add(&mut self, name: &'a str, id: u32) {
        self.known.push(name);
        self.by_name.entry(name).or_insert(id);
        self.by_id.insert(id, name);
    }

    /// Returns the number of the event to which a section's `after` refers.
    pub(super) fn find(&self, reader: &mut Reader, section: &Section<'_>) -> Result<u32, Reported> {
        let entry = section.table.get("after").ok_or(Reported)?;
        let path = section.path_of("after");
        let names = || self.known.iter().copied();
        let expected = || {
            let numbers = format!("a number from 1 to {}", self.last_id);
            match self.known.len() {
                0 => numbers,
                _ => format!("one of {}, or {numbers}", listed(names())),
            }
        };
        match &entry.node.value {
            Value::Text(name) => {
                let id = self.by_name.get(name.as_str());
                id.copied().ok_or_else(|| {
                    let message = format!("there is no fault event `{name}`");
                    reader
                        .report(ProblemKind::UnknownName, path, &entry.node.place, message)
                        .expected(expected())
                        .nearest(name, names());
                    Reported
                })
            }
            Value::Integer(number) => {
                let id = u32::try_from(*number).ok();
                let valid = id.filter(|id| (1..=self.last_id).contains(id));
                valid.ok_or_else(|| {
                    let message = format!("there is no fault event {number}");
                    reader
                        .report(ProblemKind::UnknownName, path, &entry.node.place, message)
                        .expected(expected());
                    Reported
                })
            }
            _ => {
                reader.wrong_type(&path, &entry.node, expected());
                Err(Reported)
            }
        }
    }

    /// Returns the name of an event in messages.
    pub(super) fn label(&self, id: u32) -> String {
        match self.by_id.get(&id) {
            Some(name) => format!("`{name}`"),
            None => format!("event {id}"),
        }
    }
}

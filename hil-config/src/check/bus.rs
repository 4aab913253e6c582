//! `[bus]`: a sound port file whose frames carry everything that the law reads and the plant is commanded by.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::SignalKind;
use shared_types::quality::age_signal;
use shared_types::table::Field;

use super::run::Grid;
use crate::bus;
use crate::document::Value;
use crate::plan::BusPlan;
use crate::port::{Carries, Port, PortTables, dbc_files, read_dbc};
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};
use crate::scenario::{advice_on_missing, read_regular};

/// Both ends of the bus. A part that is `None` is itself faulty.
pub(super) struct Ends<'a> {
    pub plant: Option<&'a PlantDescription>,
    /// Law with the plant's names of its signals.
    pub law: Option<&'a LawDescription>,
    pub reference: Option<&'a [Field]>,
    pub grid: Option<Grid>,
}

/// Returns the bus, if there is one; the outer `None` if it is faulty.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    folder: &Path,
    ends: &Ends<'_>,
) -> Option<Option<BusPlan>> {
    if root.table.get("bus").is_none() {
        return Some(None);
    }
    let section = reader.section(root, "bus")?;
    reader.refuse_unknown(&section, &[]);
    let networks = reader.integer(&section, "redundancy");
    let skew_limit_s = reader.optional_number(&section, "skew_limit_s");
    let source = source(reader, &section, folder);
    let (networks, skew_limit_s) = (networks? as u8, skew_limit_s?);
    if networks == 1 && skew_limit_s.is_some() {
        let message = format!("`{}` has no effect", section.path_of("skew_limit_s"));
        reader
            .report_at(&section, "skew_limit_s", ProblemKind::Mismatch, message)
            .expected("`redundancy = 2` beside it");
        return None;
    }
    let (file, source) = source?;
    let grid = ends.grid?;
    let plan = BusPlan {
        networks,
        skew_limit_steps: skew_limit_s
            .map(|limit_s| (limit_s * grid.rate.hz() * (1.0 + 1e-9)) as u64),
        ..source
    };
    let (plant, law) = (ends.plant?, ends.law?);
    let tables = PortTables {
        measured: &plant.measured,
        reference: ends.reference?,
        commands: &plant.commands,
    };
    let port = match bus::read(&plan, &file, &tables) {
        Ok(port) => port,
        Err(problems) => {
            reader.problems.extend(problems.0);
            return None;
        }
    };
    let key = if section.table.get("file").is_some() {
        "file"
    } else {
        "text"
    };
    let is_carried = carries_all(reader, (&section, key), &port, plant, law);
    match bus::frames(&port, &plan, grid.rate) {
        Ok(frames) => {
            let excess = bus::excess(&frames, networks, |carries| port.table(carries));
            if let Ok(Some((memory, most))) = excess {
                let message = format!("frames in transit would take {memory} bytes");
                reader
                    .report_at(&section, key, ProblemKind::OutOfRange, message)
                    .expected(format!("at most {most} bytes"));
                return None;
            }
        }
        Err(wrong) => {
            for (message, expected) in wrong {
                reader
                    .report_at(&section, key, ProblemKind::OutOfRange, message)
                    .expected(expected);
            }
            return None;
        }
    }
    is_carried.then_some(Some(plan))
}

/// Returns the port file with the texts of it and of its DBC files.
fn source(reader: &mut Reader, section: &Section<'_>, folder: &Path) -> Option<(PathBuf, BusPlan)> {
    let has = |key: &str| section.table.get(key).is_some();
    match (has("file"), has("text")) {
        (true, true) => {
            let message = "a bus has a file or a text";
            reader
                .report_at(section, "text", ProblemKind::Mismatch, message)
                .help("omit one of them");
            return None;
        }
        (false, false) => {
            let path = section.path_of("file");
            reader.missing(section, &path, "a port file".into());
            return None;
        }
        _ => {}
    }
    let plan = |file: PathBuf, text, dbc| {
        let plan = BusPlan {
            text,
            dbc,
            networks: 1,
            skew_limit_steps: None,
        };
        Some((file, plan))
    };
    if has("text") {
        let text = text_of(reader, section, "text")?;
        let dbc = match has("dbc") {
            true => {
                let table = reader.table(section, "dbc")?;
                let entries = table.table.entries().iter();
                let texts = entries
                    .map(|entry| Some((entry.key.clone(), text_of(reader, &table, &entry.key)?)));
                texts.collect::<Option<BTreeMap<_, _>>>()?
            }
            false => BTreeMap::new(),
        };
        return plan(folder.join("bus.toml"), text, dbc);
    }
    if has("dbc") {
        let message = format!("`{}` has no effect beside `file`", section.path_of("dbc"));
        reader.report_at(section, "dbc", ProblemKind::Mismatch, message);
        return None;
    }
    let name = reader.text(section, "file")?;
    let path = folder.join(name);
    let text = match read_regular(&path) {
        Ok(text) => text,
        Err(error) => {
            let message = format!("`{name}` cannot be read: {error}");
            let advice = match error.kind() {
                ErrorKind::NotFound => advice_on_missing(folder, name, "scenario"),
                _ => String::new(),
            };
            reader
                .report_at(section, "file", ProblemKind::Unreadable, message)
                .help(advice);
            return None;
        }
    };
    let home = path.parent().unwrap_or(Path::new("")).to_owned();
    // A file that cannot be read is reported where the port file names it.
    let dbc = dbc_files(&text, &path)
        .into_iter()
        .filter_map(|name| Some((name.clone(), read_dbc(&home.join(name)).ok()?)));
    let dbc = dbc.collect();
    plan(path, text, dbc)
}

/// Returns a text of any number of lines.
fn text_of(reader: &mut Reader, section: &Section<'_>, key: &str) -> Option<String> {
    let node = &section.table.get(key)?.node;
    match &node.value {
        Value::Text(text) => Some(text.clone()),
        _ => {
            reader.wrong_type(&section.path_of(key), node, "text");
            None
        }
    }
}

/// Refuses signals of the law and commands of the plant that no frame carries; returns `true` if there are none.
fn carries_all(
    reader: &mut Reader,
    (section, key): (&Section<'_>, &str),
    port: &Port,
    plant: &PlantDescription,
    law: &LawDescription,
) -> bool {
    let (sample, command) = (port.table(Carries::Sample), port.table(Carries::Command));
    let is_in = |kind, field: &Field| {
        let table = if kind == SignalKind::Command {
            &command
        } else {
            &sample
        };
        let mut signals = table.0.iter();
        signals.any(|signal| signal.kind == kind && signal.field.name == field.name)
    };
    // The receiver itself knows how old a carried signal is.
    let is_age = |field: &Field| {
        plant.measured.iter().any(|other| {
            age_signal([field], &other.name).is_some() && is_in(SignalKind::Measured, other)
        })
    };
    let required = [
        (SignalKind::Measured, &law.measured),
        (SignalKind::Reference, &law.reference),
        (SignalKind::Command, &plant.commands),
    ];
    let missing: Vec<String> = required
        .into_iter()
        .flat_map(|(kind, fields)| fields.iter().map(move |field| (kind, field)))
        .filter(|(kind, field)| {
            let is_made = *kind == SignalKind::Measured && is_age(field);
            !(is_made || is_in(*kind, field))
        })
        .map(|(kind, field)| format!("{}.{}", kind.prefix(), field.name))
        .collect();
    if missing.is_empty() {
        return true;
    }
    let names = listed(missing.iter().map(String::as_str));
    let message = format!("no frame of the bus carries {names}");
    let expected = format!(
        "a field for each signal that law `{}` reads and for each command of plant `{}`",
        law.name, plant.name
    );
    reader
        .report_at(section, key, ProblemKind::Unbound, message)
        .expected(expected);
    false
}

//! `plant.program` and `controller.program`: programs that come with the scenario.

use std::collections::BTreeMap;
use std::path::Path;

use super::files::file;
use super::model_settings;
use crate::document::{Node, Value};
use crate::keys::{self, Key};
use crate::plan::{ControllerProgram, Permissions, Programs};
use crate::reader::{Reader, Section, describe};

/// Returns the programs by absolute path. Their existence is checked when they are started.
pub(super) fn check(reader: &mut Reader, root: &Section<'_>, folder: &Path) -> Programs {
    let entry = |table: &str| entry_of(root, table, "program");
    let mut file = |path: &str, node: &Node| file(reader, folder, path, node);
    let plant = entry("plant").and_then(|node| file("plant.program", node));
    let controller = entry("controller").and_then(|node| match &node.value {
        Value::Table(table) => {
            let mut files = BTreeMap::new();
            for entry in table.entries() {
                let path = format!("controller.program.{}", entry.key);
                files.insert(entry.key.clone(), file(&path, &entry.node)?);
            }
            Some(ControllerProgram::ByMachine(files))
        }
        _ => file("controller.program", node).map(ControllerProgram::One),
    });
    let locals = entry_of(root, "plant", "locals");
    let locals = locals.map_or(Vec::new(), |node| texts(reader, "plant.locals", node));
    let mut permissions = |table: &str| {
        Permissions::of(|key| {
            let node = entry_of(root, table, key);
            node.is_some_and(|node| flag(reader, &format!("{table}.{key}"), node))
        })
    };
    let plant_permissions = permissions("plant");
    let controller_permissions = permissions("controller");
    let mut settings = |table: &'static str, keys| {
        let section = section_of(root, table, keys);
        section.map_or_else(Default::default, |section| {
            model_settings::check(reader, &section, folder)
        })
    };
    let plant_settings = settings("plant", keys::PLANT);
    let controller_settings = settings("controller", keys::CONTROLLER);
    Programs {
        plant,
        controller,
        locals,
        plant_permissions,
        controller_permissions,
        plant_settings,
        controller_settings,
    }
}

/// Returns an optional section, without reporting an invalid one.
fn section_of<'a>(
    root: &Section<'a>,
    table: &'static str,
    keys: &'static [Key],
) -> Option<Section<'a>> {
    let node = &root.table.get(table)?.node;
    let Value::Table(entries) = &node.value else {
        return None;
    };
    Some(Section {
        table: entries,
        keys,
        path: table.into(),
        place: &node.place,
    })
}

/// Returns the value of a boolean key; `false` for any other value, which is reported.
fn flag(reader: &mut Reader, path: &str, node: &Node) -> bool {
    let Value::Boolean(value) = node.value else {
        let expected = describe(&crate::keys::KeyKind::Boolean { default: false });
        reader.wrong_type(path, node, expected);
        return false;
    };
    value
}

/// Returns the value of a key in a table, if both exist.
fn entry_of<'a>(root: &Section<'a>, table: &str, key: &str) -> Option<&'a Node> {
    let Value::Table(table) = &root.table.get(table)?.node.value else {
        return None;
    };
    Some(&table.get(key)?.node)
}

/// Returns the texts of a list, which must not be empty.
fn texts(reader: &mut Reader, path: &str, node: &Node) -> Vec<String> {
    let expected = describe(&crate::keys::KeyKind::Texts);
    let items = match &node.value {
        Value::List(items) if !items.is_empty() => items,
        _ => {
            reader.wrong_type(path, node, expected);
            return Vec::new();
        }
    };
    let text = |(index, item)| reader.printable(&format!("{path}[{index}]"), item, "text");
    let texts = items.iter().enumerate().filter_map(text);
    texts.map(str::to_owned).collect()
}

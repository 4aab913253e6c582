//! `plant.program` and `controller.program`: the programs that the scenario brings with it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::document::{Node, Value};
use crate::plan::{ControllerProgram, Programs};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section, describe};

/// The programs that are named, each as an absolute path. Whoever starts them checks that the files
/// exist.
pub(super) fn check(reader: &mut Reader, root: &Section<'_>, folder: &Path) -> Programs {
    let entry = |table: &str| {
        let Value::Table(table) = &root.table.get(table)?.node.value else {
            return None;
        };
        Some(&table.get("program")?.node)
    };
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
    Programs { plant, controller }
}

/// The file of a key.
fn file(reader: &mut Reader, folder: &Path, path: &str, node: &Node) -> Option<PathBuf> {
    let expected = describe(match path {
        "controller.program" => &crate::keys::Kind::Program,
        _ => &crate::keys::TEXT,
    });
    let text = reader.printable(path, node, expected)?;
    match std::path::absolute(folder.join(text)) {
        Ok(file) if !text.is_empty() => Some(file),
        _ => {
            let message = format!("`{path}` is `{text}`, which names no file");
            reader
                .report(ProblemKind::OutOfRange, path, &node.place, message)
                .expected("a file, relative to the scenario");
            None
        }
    }
}

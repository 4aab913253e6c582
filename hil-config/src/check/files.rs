//! Files that keys of a scenario name.

use std::path::{Path, PathBuf};

use crate::document::Node;
use crate::problem::ProblemKind;
use crate::reader::{Reader, describe};
/// Returns the file under a key.
pub(super) fn file(reader: &mut Reader, folder: &Path, path: &str, node: &Node) -> Option<PathBuf> {
    let expected = describe(match path {
        "controller.program" => &crate::keys::KeyKind::Program,
        _ => &crate::keys::TEXT,
    });
    let text = reader.printable(path, node, expected)?;
    match std::path::absolute(folder.join(text)) {
        Ok(file) if !text.is_empty() => Some(file),
        _ => {
            let message = format!("`{path}` is `{text}`, which is not a file name");
            reader
                .report(ProblemKind::OutOfRange, path, &node.place, message)
                .expected("a file, relative to the scenario");
            None
        }
    }
}

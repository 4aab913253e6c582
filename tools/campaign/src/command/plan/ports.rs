//! Files beside a port file, which a copy of it in a campaign folder needs beside it, too. Never the port itself: its wire
//! stays where it is.

use std::path::{Component, Path};

use hil_config::port::{Port, dbc_files, is_port};
use hil_console::terminal::exit::Failure;

/// Returns the text of a port file; `None` for any other file.
pub(super) fn text_of(path: &Path) -> Option<String> {
    let is_toml = path.extension().is_some_and(|ending| ending == "toml");
    let text = is_toml
        .then(|| std::fs::read_to_string(path).ok())
        .flatten();
    text.filter(|text| is_port(text))
}

/// Lists the DBC files of a port file, relative to its folder.
///
/// # Errors
/// If one lies elsewhere.
pub(super) fn dbc_beside(path: &Path, text: &str) -> Result<Vec<String>, Failure> {
    let names = dbc_files(text, path).into_iter();
    names.map(|name| beside(path, name)).collect()
}

/// Lists the files that the frames of a port file and the start of its far end name, relative to its folder.
///
/// # Errors
/// If the file cannot be read, or one of them lies elsewhere.
pub(super) fn all_beside(path: &Path) -> Result<Vec<String>, Failure> {
    let port = Port::read(path, None)?;
    let text = std::fs::read_to_string(path).map_err(Failure::usage)?;
    let mut names = dbc_beside(path, &text)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    for (place, word) in port.start.command.into_iter().enumerate() {
        // A program without a folder is looked up in PATH.
        let is_file = (place > 0 || word.contains('/')) && folder.join(&word).is_file();
        if is_file && Path::new(&word).is_relative() {
            names.push(beside(path, word)?);
        }
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// Refuses a file that is not below the folder of the port file.
fn beside(path: &Path, name: String) -> Result<String, Failure> {
    let mut parts = Path::new(&name).components();
    match parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
        true => Ok(name),
        false => Err(Failure::usage(format!(
            "{} names `{name}`, and a campaign copies only files below the folder of a port file; move it there",
            path.display()
        ))),
    }
}

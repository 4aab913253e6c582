//! The folder of a run.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::files::part_file;
use crate::terminal::exit::Failure;

/// Returns the folder of a run: `--out`, or a new one below `runs`.
pub fn of_run(out: Option<&Path>, scenario: &str, session: &str) -> PathBuf {
    out.map_or_else(|| default(scenario, session), Path::to_owned)
}

/// Creates the folder of a run.
///
/// # Errors
/// If the folder exists and is not empty, or cannot be written.
pub fn create(folder: &Path) -> Result<(), Failure> {
    // The absolute path is passed on to other processes as text.
    refuse_odd(&std::path::absolute(folder).map_err(Failure::usage)?)?;
    let cannot = |error: std::io::Error| {
        let hint = match error.kind() {
            ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
                "; a file of that name is in the way"
            }
            _ => "",
        };
        Failure::usage(format!(
            "cannot write to {}: {error}{hint}",
            folder.display()
        ))
    };
    if let Some(parent) = folder.parent() {
        fs::create_dir_all(parent).map_err(cannot)?;
    }
    match fs::create_dir(folder) {
        // The folder is new and empty, and its owner can write to it.
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists && folder.is_dir() => {}
        Err(error) => return Err(cannot(error)),
    }
    part_file::sweep(folder);
    if fs::read_dir(folder).map_err(cannot)?.next().is_some() {
        let folder_text = folder.display();
        return Err(Failure::usage(format!(
            "{folder_text} is not empty; a run needs an empty folder"
        )));
    }
    // Only a write shows whether the folder is writable.
    tempfile::tempfile_in(folder).map_err(cannot)?;
    Ok(())
}

/// Refuses a path that cannot be represented in JSON or TOML.
pub fn refuse_odd(path: &Path) -> Result<(), Failure> {
    match path.to_str() {
        Some(_) => Ok(()),
        None => Err(Failure::usage(format!(
            "{path:?}: the path is stored as text, so it must be valid UTF-8"
        ))),
    }
}

fn default(scenario: &str, session: &str) -> PathBuf {
    let time = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let time = time.replace(['-', ':'], "");
    Path::new("runs").join(format!("{scenario}-{time}-{session}"))
}

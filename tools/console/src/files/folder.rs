//! The folder of a run.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::files::part_file;
use crate::terminal::exit::Failure;

/// Names the folder of a run: `--out`, or a new one under `runs`.
pub fn of_run(out: Option<&Path>, scenario: &str, session: &str) -> PathBuf {
    out.map_or_else(|| default(scenario, session), Path::to_owned)
}

/// Creates the folder of a run.
///
/// # Errors
/// If it exists with something in it, or cannot be written.
pub fn create(folder: &Path) -> Result<(), Failure> {
    // Other processes are told of it.
    refuse_odd(&std::path::absolute(folder).map_err(Failure::usage)?)?;
    let cannot = |error: std::io::Error| {
        let hint = match error.kind() {
            ErrorKind::NotADirectory | ErrorKind::AlreadyExists => "; a file is in the way",
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
        // Nobody else put anything into it, and its owner may write to it.
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists && folder.is_dir() => {}
        Err(error) => return Err(cannot(error)),
    }
    part_file::sweep(folder);
    if fs::read_dir(folder).map_err(cannot)?.next().is_some() {
        let shown = folder.display();
        return Err(Failure::usage(format!(
            "{shown} is not empty; a run needs a folder of its own"
        )));
    }
    // Whether it can be written shows only when it is.
    tempfile::tempfile_in(folder).map_err(cannot)?;
    Ok(())
}

/// Refuses a path that cannot be written into JSON or TOML.
pub fn refuse_odd(path: &Path) -> Result<(), Failure> {
    match path.to_str() {
        Some(_) => Ok(()),
        None => Err(Failure::usage(format!(
            "{path:?}: its name is to be written down, so all of it must be UTF-8"
        ))),
    }
}

fn default(scenario: &str, session: &str) -> PathBuf {
    let time = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let time = time.replace(['-', ':'], "");
    Path::new("runs").join(format!("{scenario}-{time}-{session}"))
}

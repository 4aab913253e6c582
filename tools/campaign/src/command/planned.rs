//! Verification of the copies in a campaign folder before they are run or trusted. Like a program that a scenario
//! names, they must not be writable by users other than the owner and root, and each must have its planned hash.
//! Results are exempt, because a folder that is only read may belong to anybody.

use std::fs::{self, File, TryLockError};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::folder::Folder;
use crate::manifest::{MANIFEST, Manifest};
use hil_config::study::Study;
use hil_console::terminal::exit::Failure;
use hil_facts::programs::binaries::trusted;
use hil_session::file::hash;

use super::quoted;

/// Subfolder of the programs, where `hil` also finds its companions.
pub(super) const PROGRAMS: &str = "programs";
/// Subfolder of a port file as the controller, with the files that its far end needs.
pub(super) const PORT: &str = "port";

/// Checks the owner, mode and hash of every copy.
///
/// # Errors
/// If another user could have written a copy, or a copy has changed.
pub(super) fn check(folder: &Folder) -> Result<(), Failure> {
    refuse_foreign(folder)?;
    folder.check().map_err(Failure::usage)
}

/// Returns `true` if the controller of a campaign is behind a port, whose wire serves one case at a time.
pub(super) fn has_port(folder: &Folder) -> bool {
    let controller = folder.manifest().controller.as_ref();
    controller.is_some_and(|copy| copy.path.starts_with(&format!("{PORT}/")))
}

/// Locks the port of a campaign, if it has one, for as long as the file is open.
///
/// # Errors
/// If another worker on the same file system has locked it.
pub(super) fn lock_port(folder: &Folder) -> Result<Option<File>, Failure> {
    let controller = folder.manifest().controller.as_ref();
    let Some(copy) = controller.filter(|_| has_port(folder)) else {
        return Ok(None);
    };
    let port =
        File::open(folder.path().join(&copy.path)).map_err(|error| cannot(folder, &error))?;
    match port.try_lock() {
        Ok(()) => Ok(Some(port)),
        Err(TryLockError::WouldBlock) => Err(Failure::usage(format!(
            "another worker uses the port of the campaign in {}, whose wire serves one case at a time; wait until it has ended, or end it",
            folder.path().display()
        ))),
        Err(TryLockError::Error(error)) => Err(cannot(folder, &error)),
    }
}

/// Re-executes the `hil` with which the campaign was planned, unless it is this one.
pub(super) fn become_planned(folder: &Folder) -> Result<(), Failure> {
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    let planned = &folder.manifest().hil;
    if hash(&own).is_ok_and(|own| own == planned.blake3) {
        return Ok(());
    }
    refuse_foreign(folder)?;
    let copy = program(folder)?;
    let of_copy = hash(&copy).map_err(|error| cannot(folder, &error))?;
    if of_copy != planned.blake3 {
        return Err(Failure::usage(format!(
            "{} has hash {of_copy}, and the campaign was planned with {}",
            copy.display(),
            planned.blake3
        )));
    }
    let error = Command::new(&copy).args(std::env::args_os().skip(1)).exec();
    Err(Failure::infrastructure(format!(
        "cannot run {}: {error}",
        copy.display()
    )))
}

/// Returns the path of the campaign's `hil`, with links resolved.
///
/// # Errors
/// If another user could have written the file.
pub(super) fn program(folder: &Folder) -> Result<PathBuf, Failure> {
    let copy = folder.path().join(&folder.manifest().hil.path);
    trusted::program(&copy).map_err(|why| foreign(folder, &why))
}

/// Refuses a folder in which another user could have written a program, the manifest, or a copy to which it refers.
fn refuse_foreign(folder: &Folder) -> Result<(), Failure> {
    let (path, manifest) = (folder.path(), folder.manifest());
    let refused = |why: String| foreign(folder, &why);
    trusted::file(&path.join(MANIFEST)).map_err(refused)?;
    for copy in manifest.files() {
        trusted::file(&path.join(&copy.path)).map_err(refused)?;
    }
    for program in programs(path, manifest)? {
        trusted::program(&program).map_err(refused)?;
    }
    Ok(())
}

/// Lists all programs: those of the manifest, and those that `hil` finds in its own folder.
fn programs(path: &Path, manifest: &Manifest) -> Result<Vec<PathBuf>, Failure> {
    let own = [
        Some(&manifest.hil),
        manifest.plant.as_ref(),
        manifest.controller.as_ref(),
    ];
    let own = own
        .into_iter()
        .flatten()
        .chain(manifest.both().into_iter().flatten());
    let mut all: Vec<PathBuf> = own.map(|copy| path.join(&copy.path)).collect();
    append_files(&path.join(PROGRAMS), &mut all)?;
    Ok(all)
}

/// Appends all files in a folder and below: a Python file and the package that runs it have folders of their own.
fn append_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let entries = fs::read_dir(folder)
        .map_err(|error| Failure::usage(format!("{}: {error}", folder.display())))?;
    for entry in entries {
        let path = entry.map_err(Failure::infrastructure)?.path();
        let metadata = fs::symlink_metadata(&path).map_err(Failure::infrastructure)?;
        match metadata.is_dir() {
            true => append_files(&path, files)?,
            false => files.push(path),
        }
    }
    Ok(())
}

fn foreign(folder: &Folder, why: &str) -> Failure {
    let folder_text = folder.path().display();
    Failure::usage(format!(
        "refusing to run {folder_text}: {why}; if you trust its origin, copy it to a folder that you own and only you can write to: cp -r {} FOLDER",
        quoted(folder.path())
    ))
}

/// Reads the study of a campaign.
///
/// # Errors
/// If the study cannot be read or is not the planned one, because its goals could differ.
pub(super) fn study(folder: &Folder) -> Result<Study, Failure> {
    let copy = &folder.manifest().study;
    let path = folder.path().join(&copy.path);
    folder.check_copies([copy]).map_err(|why| {
        let (folder_text, study) = (folder.path().display(), quoted(&path));
        if !path.exists() {
            return Failure::usage(format!(
                "{why}; it defines the goals and variants of the results in {folder_text}. Restore the study that the campaign was planned with, whose BLAKE3 hash is {}",
                copy.blake3
            ));
        }
        Failure::usage(format!(
            "{why}; the results in {folder_text} belong to the original study. Restore it, or plan a campaign of the changed one: hil campaign plan {study} -o OTHER"
        ))
    })?;
    Ok(Study::read(path)?)
}

/// Creates the error for a folder that cannot be used.
pub(super) fn cannot(folder: &Folder, error: &dyn std::fmt::Display) -> Failure {
    let folder_text = folder.path().display();
    Failure::infrastructure(format!(
        "cannot work on {folder_text}: {error}; existing results are kept, and the same command continues"
    ))
}

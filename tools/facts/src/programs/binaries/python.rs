//! Interpreter of Python files that are plants or controllers.
//!
//! The installed wheel passes its own interpreter in [`VARIABLE`]; without it, `python3` of PATH is used. The package
//! `hil` is the one that this program belongs to, in a wheel or in a clone, so that both are of one version; without one
//! the interpreter must have it.

use std::env::{current_exe, split_paths, var_os};
use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use super::file::is_script;
use super::named::NamedBy;

/// Environment variable with the path of the interpreter.
const VARIABLE: &str = "HIL_PYTHON";
/// Interpreter that is looked for in PATH.
const NAME: &str = "python3";
/// File extension of a Python file.
const ENDING: &str = "py";
/// File of the package that runs a side.
const HOST: &str = "hil/side.py";
/// Folder in which Python keeps what it compiled.
const COMPILED: &str = "__pycache__";
/// Name of the package.
const PACKAGE: &str = "hil";
/// Native part that a build of the clone leaves beside the programs.
const LIBRARY: &str = "libhil_python.so";
/// Folder of the package in a clone.
const IN_CLONE: &str = "tools/python";
/// Argument with which modules are imported only from files that nobody else can have written.
const CHECKED: &str = "checked";
/// Program that the interpreter runs, with the folder of the package, this program, [`CHECKED`] or nothing, the side and
/// the file as arguments.
/// The current folder, which Python puts first, is not searched for modules: anybody may have written it.
const START: &str = "\
import sys
if sys.version_info < (3, 9):
    sys.exit('error: a plant or law needs Python 3.9 or later, and %s is %s' % (sys.executable, sys.version.split()[0]))
if sys.path and not sys.path[0]:
    del sys.path[0]
folder, program, owners = sys.argv[1:4]
if folder:
    sys.path.insert(0, folder)
try:
    from hil.side import main
except ImportError as error:
    sys.exit(f'error: {sys.executable} has no package hil with plants and laws ({error}); install the wheel there, or name its interpreter with HIL_PYTHON')
if folder:
    sys.path.append(sys.path.pop(0))
import os
os.environ.setdefault('HIL_BIN', program)
main(sys.argv[4:], checks_owners=bool(owners))
";

/// Returns `true` for a Python file that is no program of its own: one is executable and names its interpreter.
pub(super) fn is_python_file(path: &Path) -> bool {
    let is_named = path
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case(ENDING));
    let is_program = || {
        let mode = fs::metadata(path).map_or(0, |metadata| metadata.permissions().mode());
        mode & 0o111 != 0 && is_script(path)
    };
    is_named && path.is_file() && !is_program()
}

/// Returns the path of the interpreter.
///
/// # Errors
/// If there is none; the error lists where it was looked for.
pub(super) fn interpreter() -> Result<PathBuf, String> {
    if let Some(named) = var_os(VARIABLE).filter(|named| !named.is_empty()) {
        return std::path::absolute(named).map_err(|error| format!("{VARIABLE}: {error}"));
    }
    let path = var_os("PATH").unwrap_or_default();
    let folders = split_paths(&path).filter(|folder| folder.is_absolute());
    let mut programs = folders.map(|folder| folder.join(NAME));
    programs.find(|program| program.is_file()).ok_or_else(|| {
        let path = path.to_string_lossy();
        format!("a Python file needs an interpreter: {VARIABLE} is not set, and there is no {NAME} in PATH ({path})")
    })
}

/// Returns the arguments of the interpreter before the side. A file that another file names must be written by this
/// user or root alone, and so must the modules that it imports.
///
/// # Errors
/// If the path of this program cannot be determined.
pub(super) fn first_arguments(by: &NamedBy) -> Result<Vec<OsString>, String> {
    let own = current_exe().and_then(|own| own.canonicalize());
    let own = own.map_err(|error| error.to_string())?;
    let folder = package_of(&own).unwrap_or_default();
    let owners = match by {
        NamedBy::Scenario(..) | NamedBy::Recording(_) => CHECKED,
        NamedBy::Person(_) | NamedBy::Nobody => "",
    };
    let (folder, own) = (folder.into(), own.into());
    Ok(["-c".into(), START.into(), folder, own, owners.into()].into())
}

/// Returns the files beside a Python file that modules of these names consist of, with their places relative to its
/// folder.
///
/// # Errors
/// If a folder cannot be read.
pub(super) fn modules_beside<'a>(
    path: &Path,
    names: impl Iterator<Item = &'a str>,
) -> io::Result<Vec<(PathBuf, PathBuf)>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut files = Vec::new();
    for name in names {
        let file = Path::new(name).with_extension(ENDING);
        if folder.join(&file).is_file() {
            files.push((folder.join(&file), file));
        } else if folder.join(name).is_dir() {
            append_files(folder, Path::new(name), &mut files)?;
        }
    }
    Ok(files)
}

/// Appends all files in a folder and below, but for compiled ones.
fn append_files(root: &Path, folder: &Path, files: &mut Vec<(PathBuf, PathBuf)>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(folder))? {
        let (entry, kind) = entry.and_then(|entry| entry.file_type().map(|kind| (entry, kind)))?;
        let place = folder.join(entry.file_name());
        if kind.is_file() {
            files.push((root.join(&place), place));
        } else if kind.is_dir() && entry.file_name() != COMPILED {
            append_files(root, &place, files)?;
        }
    }
    Ok(())
}

/// Returns what a copy of this program in another folder needs to run a Python file there, with the places in that
/// folder: the package and its native part.
///
/// # Errors
/// If this program belongs to no package.
pub(super) fn companions() -> Result<Vec<(PathBuf, PathBuf)>, String> {
    let own = current_exe().and_then(|own| own.canonicalize());
    let own = own.map_err(|error| error.to_string())?;
    let folder = package_of(&own)
        .ok_or_else(|| format!("{} belongs to no Python package", own.display()))?
        .join(PACKAGE);
    let entries =
        fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let files = entries.flatten().map(|entry| entry.path());
    let to = Path::new(IN_CLONE).join(PACKAGE);
    let mut all: Vec<_> = files
        .filter(|file| file.is_file())
        .filter_map(|file| Some((file.clone(), to.join(file.file_name()?))))
        .collect();
    // A wheel has it in the package.
    let library = own.with_file_name(LIBRARY);
    if library.is_file() {
        all.push((library, LIBRARY.into()));
    }
    all.sort();
    Ok(all)
}

/// Returns the folder of the package that a program belongs to: that of a wheel has the program in `hil/bin`, a clone
/// in a folder of its own.
fn package_of(program: &Path) -> Option<PathBuf> {
    let bin = program.parent()?;
    let wheel = bin.ancestors().nth(2).filter(|_| bin.ends_with("hil/bin"));
    let clone = || {
        let mut folders = bin.ancestors().map(|folder| folder.join(IN_CLONE));
        folders.find(|folder| folder.join(HOST).is_file())
    };
    (wheel.filter(|folder| folder.join(HOST).is_file()))
        .map(Path::to_owned)
        .or_else(clone)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_python_file_that_names_its_interpreter_and_is_executable_is_a_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("motor.py");
        let put = |text: &str, mode| {
            fs::write(&path, text).expect("written");
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("it is ours");
            is_python_file(&path)
        };
        assert!(put("import hil\n", 0o644));
        assert!(
            put("import hil\n", 0o755),
            "copied from a disk without modes"
        );
        assert!(put("#!/usr/bin/env python3\n", 0o644));
        assert!(!put("#!/usr/bin/env python3\n", 0o755));
        assert!(!is_python_file(folder.path()));
        assert!(!is_python_file(Path::new("/nowhere/motor.py")));
    }

    #[test]
    fn the_package_of_a_program_is_that_of_its_wheel_or_its_clone() {
        let folder = tempfile::tempdir().expect("a folder");
        let place = |path: &str| folder.path().join(path);
        let package = |program: &str| package_of(&place(program));
        for path in ["clone/tools/python/hil", "site/hil/bin", "other/bin"] {
            fs::create_dir_all(place(path)).expect("made");
        }
        for path in ["clone/tools/python", "site"] {
            fs::write(place(path).join(HOST), "").expect("written");
        }
        assert_eq!(
            package("clone/target/release/hil"),
            Some(place("clone/tools/python"))
        );
        assert_eq!(package("site/hil/bin/hil"), Some(place("site")));
        assert_eq!(package("other/bin/hil"), None);
    }
}

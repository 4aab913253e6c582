//! Models that need a host program, which runs them in a process of its own: `hil-fmu` for FMUs and `hil-port` for port
//! files, both installed next to `hil`, and the interpreter for Python files.
//!
//! The model is named, must be trusted and must remain unchanged; the host is recorded with its own hash. Only the host
//! reads FMUs and Python files, and opens ports.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use hil_config::plan::Permissions;
use hil_config::port::{Port, is_port};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::private_folder;
use hil_target::contact::Answer;
use shared_types::describe::ModelSettings;

use super::named::Choice;
use super::{FileIdentity, asked, beside, hashed, python};

/// Program next to `hil` that runs FMUs.
const OF_FMUS: &str = "hil-fmu";
/// Program next to `hil` that runs ports.
const OF_PORTS: &str = "hil-port";
/// Longest beginning of a port file in which its first key is looked for, in bytes.
const LONGEST_BEGINNING: u64 = 64 * 1024;
/// First bytes of a ZIP archive.
const ARCHIVE: [u8; 4] = *b"PK\x03\x04";
/// File extension of an FMU.
const ENDING: &str = "fmu";

/// Kind of model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelKind {
    /// FMU.
    Fmu,
    /// Port file.
    Port,
    /// Python file.
    Python,
}

impl ModelKind {
    /// Returns the kind of a file: an FMU by its extension or its ZIP header, a port file by its first key, a Python file
    /// by its extension unless it is a program itself; `None` for a program.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        if is_fmu(path) {
            return Some(Self::Fmu);
        }
        if python::is_python_file(path) {
            return Some(Self::Python);
        }
        is_port_file(path).then_some(Self::Port)
    }

    /// Returns the name of the program next to `hil` that runs such a model; `None` for one elsewhere.
    #[must_use]
    pub const fn host(self) -> Option<&'static str> {
        match self {
            Self::Fmu => Some(OF_FMUS),
            Self::Port => Some(OF_PORTS),
            Self::Python => None,
        }
    }

    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Fmu => "an FMU",
            Self::Port => "a port file",
            Self::Python => "a Python file",
        }
    }
}

/// Program that runs a model.
#[derive(Clone, Debug)]
pub struct Host {
    /// Kind of the model.
    pub kind: ModelKind,
    /// Path of the program.
    pub path: PathBuf,
    /// Hash of the program.
    pub blake3: String,
    /// Patterns of local signals recorded as truth.
    pub(crate) locals: Vec<String>,
    /// Permissions of the model.
    pub(crate) permissions: Permissions,
    /// Settings of the model.
    pub(crate) settings: ModelSettings,
    /// Settings of the model as an argument.
    settings_argument: Option<String>,
    /// `true` if the model's library is loaded to list its requirements.
    loads: bool,
    /// `false` for a port whose far end keeps a clock of its own, so that equal runs differ.
    pub is_repeatable: bool,
    pub(super) file: FileIdentity,
    side: &'static str,
    /// Arguments before the side.
    first: Vec<OsString>,
}

impl Host {
    /// Returns the host of a model as a side; `None` if the file is a program.
    ///
    /// # Errors
    /// If there is no host.
    pub(crate) fn of(choice: &Choice, side: &'static str) -> Result<Option<Self>, String> {
        let Some(kind) = ModelKind::of(&choice.path) else {
            return Ok(None);
        };
        let own = match kind.host() {
            Some(name) => beside(name).map_err(|error| error.to_string())?,
            None => python::interpreter()?,
        };
        let in_words = |error| {
            let (words, own) = (kind.words(), own.display());
            format!("{words} needs {own}, which cannot be run: {error}")
        };
        let (file, blake3) = hashed(&own).map_err(in_words)?;
        Ok(Some(Self {
            kind,
            path: own,
            blake3,
            locals: choice.locals.clone(),
            permissions: choice.permissions,
            settings: choice.settings.clone(),
            settings_argument: choice.settings.argument(),
            loads: choice.loads,
            // A file with mistakes is refused by the host.
            is_repeatable: kind != ModelKind::Port
                || Port::read(&choice.path, None).is_ok_and(|port| port.is_repeatable),
            file,
            side,
            first: match kind {
                ModelKind::Python => python::first_arguments(&choice.by)?,
                ModelKind::Fmu | ModelKind::Port => Vec::new(),
            },
        }))
    }

    /// Returns the files that run such a model beside a copy of `hil`, with their places in its folder.
    ///
    /// # Errors
    /// If this `hil` was installed without them.
    pub fn companions(&self) -> Result<Vec<(PathBuf, PathBuf)>, String> {
        match self.kind.host() {
            Some(name) => Ok([(self.path.clone(), name.into())].into()),
            None => python::companions(),
        }
    }

    /// Returns the command that runs a model, without the common arguments of programs.
    pub fn command(&self, model: &Path) -> Command {
        let mut command = Command::new(&self.path);
        command.args(self.arguments(model));
        command
    }

    /// Queries a model like a program; the inner error is the host's.
    pub fn ask(
        &self,
        model: &Path,
        arguments: &[&OsStr],
        interruption: &Interruption,
    ) -> Result<Result<Answer, String>, Failure> {
        let own = self.arguments(model);
        let all: Vec<&OsStr> = { own.iter().copied() }
            .chain(arguments.iter().copied())
            .collect();
        let answer = asked(&self.path, &all, interruption);
        // One that was ended by its model leaves what it unpacked.
        private_folder::sweep();
        answer
    }

    fn arguments<'a>(&'a self, model: &'a Path) -> Vec<&'a OsStr> {
        let mut arguments: Vec<&OsStr> = self.first.iter().map(OsString::as_os_str).collect();
        arguments.extend([self.side.as_ref(), model.as_os_str()]);
        if self.kind != ModelKind::Fmu {
            return arguments;
        }
        for pattern in &self.locals {
            arguments.extend([OsStr::new("--truth"), pattern.as_ref()]);
        }
        if let Some(settings) = &self.settings_argument {
            arguments.extend([OsStr::new("--settings"), settings.as_ref()]);
        }
        let Permissions {
            trust_archive,
            allow_execution_tool,
        } = self.permissions;
        let flags = [
            (trust_archive, "--trust-archive"),
            (allow_execution_tool, "--allow-execution-tool"),
            (self.loads, "--load"),
        ];
        let flags = flags.iter().filter(|(is_set, _)| *is_set);
        arguments.extend(flags.map(|(_, flag)| OsStr::new(*flag)));
        arguments
    }
}

/// Returns `true` if a file is a port file.
#[must_use]
pub fn is_port_file(path: &Path) -> bool {
    let read = || {
        let mut begin = Vec::new();
        // A pipe would block.
        let file = path.is_file().then(|| File::open(path).ok())??;
        file.take(LONGEST_BEGINNING).read_to_end(&mut begin).ok()?;
        Some(is_port(&String::from_utf8_lossy(&begin)))
    };
    read().unwrap_or_default()
}

fn is_fmu(path: &Path) -> bool {
    let is_named = path
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case(ENDING));
    if is_named {
        return path.is_file();
    }
    let mut begin = [0; ARCHIVE.len()];
    path.is_file()
        && File::open(path).is_ok_and(|mut file| file.read_exact(&mut begin).is_ok())
        && begin == ARCHIVE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_recognised_by_its_extension_or_its_beginning() {
        let folder = tempfile::tempdir().expect("a folder");
        let is_model = |path: &Path| ModelKind::of(path) == Some(ModelKind::Fmu);
        let file = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).expect("written");
            path
        };
        assert!(is_model(&file("a.fmu", b"no archive")));
        assert!(is_model(&file("b.FMU", b"")));
        assert!(is_model(&file("plant", b"PK\x03\x04 and more")));
        assert!(!is_model(&file("program", b"\x7fELF")));
        assert!(!is_model(&file("short", b"PK")));
        let port = file("desk", b"# Wires of the rig.\n\nport = 1\n");
        assert_eq!(ModelKind::of(&port), Some(ModelKind::Port));
        let python = file("motor.py", b"import hil\n");
        assert_eq!(ModelKind::of(&python), Some(ModelKind::Python));
        assert_eq!(
            ModelKind::of(&file("scenario", b"schema = 1\nport = 1")),
            None
        );
        assert!(!is_model(&folder.path().join("none.fmu")));
        assert!(!is_model(folder.path()));
    }
}

//! Models that need a host program, installed next to `hil`, which runs them in a process of its own: FMUs, by
//! `hil-fmu`, and ports in front of a plant, by `hil-rig`.
//!
//! The model is named, must be trusted and must remain unchanged; the host is recorded with its own hash. Only the host
//! reads FMUs.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use hil_config::plan::Permissions;
use hil_config::port::is_port;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::private_folder;
use hil_target::contact::Answer;
use shared_types::describe::ModelSettings;

use super::named::Choice;
use super::{FileIdentity, asked, beside, hashed};

/// Program next to `hil` that runs FMUs.
pub const HOST: &str = "hil-fmu";
/// Program next to `hil` that runs ports in front of a plant.
const RIG: &str = "hil-rig";
/// Largest part of a file that is read to recognise a port.
const HEAD_BYTES: u64 = 4096;
/// First bytes of a ZIP archive.
const ARCHIVE: [u8; 4] = *b"PK\x03\x04";
/// File extension of an FMU.
const ENDING: &str = "fmu";

/// Program that runs a model.
#[derive(Clone, Debug)]
pub struct Host {
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
    pub(super) file: FileIdentity,
    side: &'static str,
}

impl Host {
    /// Returns the host of a model as a side; `None` if the file is a program.
    ///
    /// # Errors
    /// If there is no host.
    pub(crate) fn of(choice: &Choice, side: &'static str) -> Result<Option<Self>, String> {
        let (name, what) = if is_model(&choice.path) {
            (HOST, "an FMU")
        } else if side == "plant" && is_port_file(&choice.path) {
            (RIG, "a port")
        } else {
            return Ok(None);
        };
        let own = beside(name).map_err(|error| error.to_string())?;
        let in_words =
            |error| format!("it is {what}, and {} cannot be run: {error}", own.display());
        let (file, blake3) = hashed(&own).map_err(in_words)?;
        Ok(Some(Self {
            path: own,
            blake3,
            locals: choice.locals.clone(),
            permissions: choice.permissions,
            settings: choice.settings.clone(),
            settings_argument: choice.settings.argument(),
            loads: choice.loads,
            file,
            side,
        }))
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
        let mut arguments = vec![self.side.as_ref(), model.as_os_str()];
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

/// Returns `true` if a file is an FMU by its extension or its ZIP header.
pub(super) fn is_model(path: &Path) -> bool {
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

/// Returns `true` if a file is a port file by its first key; copies on targets have no ending.
fn is_port_file(path: &Path) -> bool {
    let mut head = Vec::new();
    let file = File::open(path).ok().filter(|_| path.is_file());
    let result = file.map(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    result.is_some_and(|read| read.is_ok()) && is_port(&String::from_utf8_lossy(&head))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_recognised_by_its_first_key() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str, content: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).expect("written");
            path
        };
        assert!(is_port_file(&file("rig.port.toml", "# A rig.\nport = 1\n")));
        assert!(is_port_file(&file("copy", "port=1")));
        assert!(!is_port_file(&file("run.toml", "schema = 1\nport = 1")));
        assert!(!is_port_file(&folder.path().join("none")));
    }

    #[test]
    fn a_model_is_recognised_by_its_extension_or_its_first_bytes() {
        let folder = tempfile::tempdir().expect("a folder");
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
        assert!(!is_model(&folder.path().join("none.fmu")));
        assert!(!is_model(folder.path()));
    }
}

//! Kinds of files that users pass to `hil`, recognised by their first bytes, their keys or their name.
//!
//! Checked before a command reads its file, so that a file for another command is answered with that command. A file
//! that is not clearly of a kind has none, and the command itself reports the error.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use hil_config::port::is_port;
use hil_recording::reader::RECORDING;
use toml_edit::DocumentMut;

/// Name of the manifest in the folder of a campaign.
pub const MANIFEST: &str = "manifest.json";
/// Maximum number of bytes that are read to determine the kind.
const MOST: u64 = 1 << 20;

/// Kind of a file or folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// Scenario in TOML.
    Scenario,
    /// Study in TOML.
    Study,
    /// Folder of a run, or its recording.
    Recording,
    /// `summary.json` of a run.
    Summary,
    /// Folder of a campaign.
    Campaign,
    /// Executable file.
    Program,
    /// Model in the form of the Functional Mock-up Interface.
    Fmu,
    /// Description of frames on a wire.
    Port,
}

impl FileKind {
    /// Determines the kind of a path.
    pub fn of(path: &Path) -> Option<Self> {
        if path.is_dir() {
            return match path {
                path if path.join(RECORDING).is_file() => Some(Self::Recording),
                path if path.join(MANIFEST).is_file() => Some(Self::Campaign),
                _ => None,
            };
        }
        let extension = path.extension().and_then(|extension| extension.to_str());
        if path.exists() && !path.is_file() {
            return None; // a pipe must not be read twice
        }
        let mut bytes = Vec::new();
        let read = File::open(path).and_then(|file| file.take(MOST).read_to_end(&mut bytes));
        match &bytes[..] {
            _ if read.is_err() => match extension {
                Some("mcap") => Some(Self::Recording),
                Some("fmu") => Some(Self::Fmu),
                _ => None,
            },
            [0x89, b'M', b'C', b'A', b'P', ..] => Some(Self::Recording),
            [0x7f, b'E', b'L', b'F', ..] => Some(Self::Program),
            [b'P', b'K', ..] if extension == Some("fmu") => Some(Self::Fmu),
            [b'{', ..] => Self::of_json(&bytes),
            bytes => Self::of_text(std::str::from_utf8(bytes).ok()?),
        }
    }

    /// Determines the kind of a JSON text: a summary has a verdict and names its scenario.
    fn of_json(bytes: &[u8]) -> Option<Self> {
        let value: serde_json::Value = serde_json::from_slice(bytes).ok()?;
        let has = |key: &str| value.get(key).is_some();
        (has("verdict") && has("scenario") && has("digest")).then_some(Self::Summary)
    }

    /// Determines the kind of a TOML text: a port file begins with its key, a study refers to a scenario; a scenario has
    /// a run, plant or controller.
    fn of_text(text: &str) -> Option<Self> {
        if is_port(text) {
            return Some(Self::Port);
        }
        let document: DocumentMut = text.parse().ok()?;
        let has = |key: &&str| document.contains_key(key);
        let names_scenario = has(&"scenario");
        match ["run", "plant", "controller"].iter().any(has) {
            true => Some(Self::Scenario).filter(|_| !names_scenario),
            false => Some(Self::Study).filter(|_| names_scenario),
        }
    }

    /// Returns the kind in words, and the commands that accept it.
    pub const fn in_words(self) -> (&'static str, &'static str) {
        match self {
            Self::Scenario => (
                "a scenario",
                "`hil run`, `hil config check` and `hil config show`",
            ),
            Self::Study => (
                "a study",
                "`hil campaign check`, `hil campaign plan` and `hil search`",
            ),
            Self::Recording => (
                "a recording",
                "`hil report`, `hil judge`, `hil export` and `hil rerun`",
            ),
            Self::Summary => (
                "the summary of a run",
                "read it as JSON; its folder is a run, which `hil report`, `hil compare` and `hil rerun` accept",
            ),
            Self::Campaign => (
                "the folder of a campaign",
                "`hil campaign run`, `hil campaign show` and `hil report`",
            ),
            Self::Program => (
                "a program",
                "`hil describe`, `--plant-bin` and `--controller-bin`",
            ),
            Self::Fmu => (
                "an FMU",
                "`hil describe` and the key `plant.program` of a scenario",
            ),
            Self::Port => ("a port file", "`hil describe`"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_recognised_by_content_and_a_missing_one_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let kind = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).expect("written");
            FileKind::of(&path)
        };
        let scenario = b"schema = 1\nplant.model = \"spring-mass\"\n";
        assert_eq!(kind("a.toml", scenario), Some(FileKind::Scenario));
        let study = b"schema = 1\nscenario = \"a.toml\"\ncases = 3\n";
        assert_eq!(kind("b.toml", study), Some(FileKind::Study));
        assert_eq!(
            kind("c.toml", b"\x89MCAP0\r\n.."),
            Some(FileKind::Recording)
        );
        assert_eq!(kind("d", b"\x7fELF\x02.."), Some(FileKind::Program));
        assert_eq!(kind("rig.toml", b"port = 1\n[run]\n"), Some(FileKind::Port));
        assert_eq!(kind("e.fmu", b"PK\x03\x04.."), Some(FileKind::Fmu));
        let summary = br#"{"schema": 1, "scenario": "a", "verdict": "pass", "digest": null}"#;
        assert_eq!(kind("summary.json", summary), Some(FileKind::Summary));
        for (name, content) in [
            ("a.json", &b"{\"schema\": 1}"[..]),
            ("f.toml", b"schema = 1\n"),
            ("g.toml", b"scenario = \"a\"\nrun.rate_hz = 1\n"),
            ("h.toml", b"no TOML"),
            ("i.mcap", b"no recording"),
            ("j.sh", b"#!/bin/sh\n"),
        ] {
            assert_eq!(kind(name, content), None, "{name}");
        }
        let missing = |name: &str| FileKind::of(&folder.path().join(name));
        assert_eq!(missing("run.mcap"), Some(FileKind::Recording));
        assert_eq!(missing("nothing.toml"), None);
        std::fs::write(folder.path().join(RECORDING), "").expect("written");
        assert_eq!(FileKind::of(folder.path()), Some(FileKind::Recording));
    }
}

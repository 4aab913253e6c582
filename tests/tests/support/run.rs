//! Finished `hil`, with its output and files.

use std::path::PathBuf;

use serde_json::Value;

/// Finished `hil`.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    /// Run folder, which exists if the run got that far.
    pub(crate) folder: PathBuf,
}

impl Run {
    /// Fails with all output if the exit code differs.
    #[track_caller]
    pub(crate) fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{}\n{}", self.stdout, self.stderr);
        self
    }

    /// Fails if standard error lacks one of these texts.
    #[track_caller]
    pub(crate) fn says(self, fragments: &[&str]) -> Self {
        assert_has(&self.stderr, fragments);
        self
    }

    /// Fails if standard output lacks one of these texts.
    #[track_caller]
    pub(crate) fn prints(self, fragments: &[&str]) -> Self {
        assert_has(&self.stdout, fragments);
        self
    }

    /// Parses standard output as JSON.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        let (text, stderr) = (&self.stdout, &self.stderr);
        serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}\n{stderr}"))
    }

    /// Reads `summary.json`.
    pub(crate) fn summary(&self) -> Value {
        let path = self.folder.join("summary.json");
        let text = std::fs::read_to_string(&path);
        let text = text.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        serde_json::from_str(&text).expect("the summary is JSON")
    }

    /// Returns the digest.
    pub(crate) fn digest(&self) -> String {
        let summary = self.summary();
        let digest = summary["digest"].as_str();
        digest
            .unwrap_or_else(|| panic!("no digest in {summary}"))
            .to_owned()
    }

    /// Returns the recording.
    pub(crate) fn recording(&self) -> PathBuf {
        self.folder.join("run.mcap")
    }
}

#[track_caller]
fn assert_has(output: &str, fragments: &[&str]) {
    for fragment in fragments {
        assert!(
            output.contains(fragment),
            "`{fragment}` is not in:\n{output}"
        );
    }
}

//! `hil recover`: makes a complete recording from a truncated one.
//!
//! 1. [`RecordedOutcome`] reads the recording as far as possible.
//! 2. A complete recording is left alone. Otherwise every record up to the truncation is copied to a new file, with
//!    indexes, checksums and the result of a run that ended there. New checksums prove nothing about old content, so
//!    the new file marks all data that no checksum of the old file covered.
//! 3. The new file replaces the old one only once it is complete on disk.
//! 4. A folder without `summary.json` gets one; a summary written by the guard of a killed `hil` is replaced.
//!
//! A file damaged before its end is never replaced, because the new file lacks everything after the damage.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use hil_console::files::part_file::{self, PartFile};
use hil_console::files::runs::SUMMARY;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::results::lost;
use hil_facts::results::outcome::RecordedOutcome;
use hil_facts::session::writing::refuse_live;
use hil_recording::copy::Rescue;
use hil_recording::reader::{FileEnd, Unvouched};
use serde::Serialize;

use crate::arguments::recover::RecoverArguments;

/// Result of examining a recording and recovering it.
#[derive(Debug, Serialize)]
struct Recovered {
    /// Examined recording.
    run: String,
    state: State,
    /// Written file; null if none was written.
    file: Option<String>,
    records: u64,
    /// Size of the recording in bytes.
    bytes: u64,
    /// Offset of the truncation or the damage: of the first byte outside a complete record of the file.
    whole_bytes: u64,
    digest: Option<String>,
    /// Number of records covered by checksums.
    vouched_records: u64,
    /// Description of the data not covered by checksums; null if everything is covered.
    unvouched: Option<String>,
    /// Reason why the run ended; null if the recording contains it.
    reason: Option<String>,
    /// Written summary; null if none was written.
    summary: Option<String>,
}

/// State of the recording before its recovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum State {
    Whole,
    BrokenOff,
    Damaged,
}

/// Runs the command.
///
/// # Errors
/// If the recording has no recoverable data or is still being written, or if the new file cannot be written.
pub(crate) fn recover(arguments: &RecoverArguments) -> Result<Exit, Failure> {
    let recovered = recovered(&arguments.run, arguments.output.as_deref())?;
    output::result(arguments.json, &recovered, || recovered.describe())?;
    Ok(Exit::Pass)
}

fn recovered(run: &Path, output: Option<&Path>) -> Result<Recovered, Failure> {
    let outcome = RecordedOutcome::of(run, None).map_err(Failure::usage)?;
    let path = outcome.reader.path().to_owned();
    let path_text = path.display();
    let (end, bytes) = outcome.reader.end();
    let (state, whole_bytes) = match (&outcome.damage, end) {
        (Some(_), _) => (State::Damaged, outcome.reader.position()),
        (None, Some(FileEnd::Torn(at))) => (State::BrokenOff, at),
        (None, _) => (State::Whole, bytes),
    };
    refuse_live(&path)?;
    let records = outcome.recorded.written;
    let unvouched = outcome.reader.unvouched();
    let mut reason = None;
    let mut file = None;
    if state != State::Whole {
        if outcome.messages == 0 {
            return Err(Failure::usage(format!(
                "nothing can be recovered from {path_text}: the recording {}",
                match &outcome.damage {
                    Some(damage) => format!("has no record before the damage: {damage}"),
                    None => "breaks off before its first record".to_owned(),
                }
            )));
        }
        if let (Some(damage), None) = (&outcome.damage, output) {
            return Err(Failure::usage(format!(
                "{damage}; data after the damage would be lost, so {path_text} is not replaced"
            )));
        }
        // A checksum error could be anywhere, for example in a value.
        if !outcome.has_result() || state == State::Damaged {
            let doubt = unvouched.as_ref();
            let doubt = doubt.map_or_else(String::new, |doubt| format!("; {}", doubt.text));
            reason = Some(match &outcome.damage {
                Some(damage) => format!("recovered: {damage}{doubt}"),
                None => {
                    format!("recovered: the recording broke off after {records} records{doubt}")
                }
            });
        }
        let to = match output {
            Some(output) => output.to_owned(),
            // Replaces the target of a link, not the link.
            None => path.canonicalize().unwrap_or_else(|_| path.clone()),
        };
        let interruption = Interruption::listen()?;
        let copied = copy(
            &outcome,
            &to,
            output.is_none(),
            reason.as_deref(),
            unvouched.as_ref(),
            &interruption,
        );
        copied.map_err(|error| {
            let to = to.display();
            match error.kind() {
                io::ErrorKind::Interrupted => Failure::Interrupted,
                io::ErrorKind::AlreadyExists => {
                    Failure::usage(format!("{to} already exists; name another file"))
                }
                _ => Failure::infrastructure(format!(
                    "cannot write {to}: {error}; {path_text} is unchanged"
                )),
            }
        })?;
        file = Some(output.unwrap_or(&path).display().to_string());
    }
    let digest = outcome.recorded.digest.clone();
    let summary = match (output, run.is_dir()) {
        (None, true) => summarise(outcome, run, reason.as_deref())?,
        _ => None,
    };
    Ok(Recovered {
        run: path_text.to_string(),
        state,
        file,
        records,
        bytes,
        whole_bytes,
        digest,
        vouched_records: (unvouched.as_ref()).map_or(records, |unvouched| unvouched.records),
        unvouched: unvouched.map(|unvouched| unvouched.text),
        reason,
        summary: summary.map(|path| path.display().to_string()),
    })
}

/// Copies the readable messages of a recording to a new file.
fn copy(
    outcome: &RecordedOutcome,
    to: &Path,
    may_replace: bool,
    reason: Option<&str>,
    unvouched: Option<&Unvouched>,
    interruption: &Interruption,
) -> io::Result<()> {
    let original = File::open(outcome.reader.path())?;
    let part = PartFile::beside(to)?;
    part.file()
        .set_permissions(original.metadata()?.permissions())?;
    let rescue = Rescue {
        messages: outcome.messages,
        is_doubtful: outcome.damage.is_some(),
        unvouched,
        result: outcome.result(reason.unwrap_or_default()),
    };
    rescue.copy(original, part.file().try_clone()?, || !interruption.came())?;
    part.complete(to, may_replace)
}

/// Writes the summary of a run that has none, or whose summary lacks data of its recording.
fn summarise(
    outcome: RecordedOutcome,
    folder: &Path,
    reason: Option<&str>,
) -> Result<Option<PathBuf>, Failure> {
    let path = folder.join(SUMMARY);
    let lost = lost::reason_in(&path);
    if path.exists() && lost.is_none() {
        return Ok(None);
    }
    let reason = reason.map(|reason| match lost {
        Some(lost) => format!("{reason}; {lost}"),
        None => reason.to_owned(),
    });
    match outcome.summary(reason.as_deref()) {
        Ok(summary) => {
            let json = serde_json::to_string_pretty(&summary).map_err(Failure::infrastructure)?;
            part_file::write_text(&path, &json)?;
            Ok(Some(path))
        }
        Err(failure) => {
            tell!("note: no summary.json could be written: {failure}");
            Ok(None)
        }
    }
}

impl Recovered {
    /// Formats the result for the user.
    fn describe(&self) -> String {
        let Self {
            run,
            records,
            bytes,
            whole_bytes,
            ..
        } = self;
        let mut text = match &self.file {
            None => format!("{run} is complete: {records} records, nothing to recover\n"),
            Some(file) => {
                let state = match self.state {
                    State::Damaged => "is damaged",
                    State::BrokenOff | State::Whole => "broke off",
                };
                format!(
                    "{run} {state} at byte {whole_bytes} of {bytes}\n{records} records recovered, in {file}\n"
                )
            }
        };
        if let Some(unvouched) = &self.unvouched {
            text += &format!("note: {unvouched}\n");
        }
        if let Some(digest) = &self.digest {
            text += &format!("digest {digest}\n");
        }
        if let Some(summary) = &self.summary {
            text += &format!("summary in {summary}\n");
        }
        text
    }
}

#[cfg(test)]
mod integrity;
#[cfg(test)]
mod tests;

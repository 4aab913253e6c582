//! `hil recover`: a whole recording of one that broke off.
//!
//! 1. [`RecordedOutcome`] reads it as far as it goes.
//! 2. What is whole is left alone. Of anything else every record up to the tear is copied to a new file,
//!    with indexes, sums and the result of a run that ended there. New sums make nothing true: the new
//!    file says what no sum of the old one vouched for.
//! 3. That takes the place of the old one when it is whole on the disk, not before.
//! 4. A folder without `summary.json` gets one, as does one whose summary the guard of a killed `hil` wrote.
//!
//! A file that is damaged before its end is never replaced: what comes after the damage is not in the
//! new one.

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
use hil_recording::copy::Rescue;
use hil_recording::reader::{FileEnd, Unvouched};
use hil_session::session;
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use serde::Serialize;

use crate::arguments::recover::RecoverArguments;

/// Result of looking at a recording and recovering it.
#[derive(Debug, Serialize)]
struct Recovered {
    /// The recording that was looked at.
    run: String,
    state: State,
    /// The file that was written; null if none was.
    file: Option<String>,
    records: u64,
    /// Bytes of the recording.
    bytes: u64,
    /// Offset of the break or the damage: of the first byte that is not part of a whole record of the file.
    whole_bytes: u64,
    digest: Option<String>,
    /// Records that check sums vouch for.
    vouched_records: u64,
    /// Description of what check sums do not vouch for; null if they vouch for all.
    unvouched: Option<String>,
    /// Reason for which the run counts as ended; null if the recording tells that itself.
    reason: Option<String>,
    /// The summary that was written; null if none was.
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
/// If nothing can be had of the recording, it is being written, or the new one cannot be written.
pub(crate) fn recover(arguments: &RecoverArguments) -> Result<Exit, Failure> {
    let recovered = recovered(&arguments.run, arguments.output.as_deref())?;
    output::result(arguments.json, &recovered, || recovered.describe())?;
    Ok(Exit::Pass)
}

fn recovered(run: &Path, output: Option<&Path>) -> Result<Recovered, Failure> {
    let outcome = RecordedOutcome::of(run, None).map_err(Failure::usage)?;
    let path = outcome.reader.path().to_owned();
    let shown = path.display();
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
                "nothing can be had of {shown}: it {}",
                match &outcome.damage {
                    Some(damage) => format!("has no record before its damage: {damage}"),
                    None => "broke off before its first record".to_owned(),
                }
            )));
        }
        if let (Some(damage), None) = (&outcome.damage, output) {
            return Err(Failure::usage(format!(
                "{damage}; what comes after that would be lost, so {shown} is not replaced"
            )));
        }
        // What a check sum says is wrong anywhere: a value may be.
        if !outcome.has_result() || state == State::Damaged {
            let doubt = unvouched.as_ref();
            let doubt = doubt.map_or_else(String::new, |doubt| format!("; {}", doubt.told));
            reason = Some(match &outcome.damage {
                Some(damage) => format!("recovered: {damage}{doubt}"),
                None => {
                    format!("recovered: the recording broke off after {records} records{doubt}")
                }
            });
        }
        let to = match output {
            Some(output) => output.to_owned(),
            // What a link leads to, not the link.
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
                    Failure::usage(format!("{to} is there already; name another file"))
                }
                _ => Failure::infrastructure(format!(
                    "cannot write {to}: {error}; {shown} is as it was"
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
        run: shown.to_string(),
        state,
        file,
        records,
        bytes,
        whole_bytes,
        digest,
        vouched_records: (unvouched.as_ref()).map_or(records, |unvouched| unvouched.records),
        unvouched: unvouched.map(|unvouched| unvouched.told),
        reason,
        summary: summary.map(|path| path.display().to_string()),
    })
}

/// Refuses a recording that somebody still writes: its writer holds a lock on it.
fn refuse_live(path: &Path) -> Result<(), Failure> {
    let folder = path.canonicalize();
    let folder = folder.as_deref().ok().and_then(Path::parent);
    // Where sessions cannot be listed there is none: a recording may be mended anywhere.
    let live = session::list().unwrap_or_default();
    let is_its = |info: &&session::SessionInfo| {
        let run_dir = info.run_dir.as_ref();
        let run_dir = run_dir.and_then(|folder| folder.canonicalize().ok());
        folder.is_some() && run_dir.as_deref() == folder
    };
    let shown = path.display();
    if let Some(info) = live.iter().find(is_its) {
        let name = &info.name;
        return Err(Failure::usage(format!(
            "session `{name}` is still writing {shown}"
        )));
    }
    // It may be another user's, or have been moved.
    let file = File::open(path).map_err(Failure::usage)?;
    match flock(&file, FlockOperation::NonBlockingLockShared) {
        Err(Errno::WOULDBLOCK) => Err(Failure::usage(format!("{shown} is still being written"))),
        // Where files have no locks nobody can be warned.
        _ => Ok(()),
    }
}

/// Writes the messages of a recording, as many as could be read, to a new file.
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

/// Writes the summary of a run that has none, or one that knows nothing of its recording.
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
            tell!("note: no summary.json could be made: {failure}");
            Ok(None)
        }
    }
}

impl Recovered {
    /// Describes the result for a person.
    fn describe(&self) -> String {
        let Self {
            run,
            records,
            bytes,
            whole_bytes,
            ..
        } = self;
        let mut text = match &self.file {
            None => format!("{run} is whole: {records} records, nothing to recover\n"),
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

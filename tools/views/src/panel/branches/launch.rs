//! Start of a branch: from the nearest checkpoint at or before its step or, without one, from the beginning.
//!
//! 1. The recording is read up to the step, with its digest there and all live interventions before it.
//! 2. `hil run` starts the new run, which holds at the step. Interventions after a checkpoint cannot be repeated from
//!    it, so that an earlier one is taken, and the beginning repeats all of them.
//! 3. The digest of the records before the step must be that of the trunk.
//!
//! Whatever makes a branch impossible is a reason in words.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::Failure;
use hil_facts::checkpoint::command_line;
use hil_recording::reader::{RECORDING, ReadError, RunReader, folder_of};
use hil_session::live;
use hil_session::session::{SessionInfo, peek};
use hil_verification::repetition::RecordedScenario;
use shared_types::live::{Request, Response, Status};
use shared_types::time::Step;
use tempfile::NamedTempFile;

use super::{Branches, LOOK};

/// Time limit for records to reach the file of a run that is held.
const FLUSH_LIMIT: Duration = Duration::from_secs(10);
/// Time limit without progress of the new run.
const PROGRESS_LIMIT: Duration = Duration::from_secs(60);
/// Interval between two looks at the new run.
const BETWEEN: Duration = Duration::from_millis(100);
/// Time limit for an answer of the new run.
const ANSWER_LIMIT: Duration = Duration::from_secs(2);
/// Maximum number of lines kept of what the new run prints.
const LINES: usize = 40;

/// Starts a branch; returns where it starts, in words.
///
/// # Errors
/// The reason why there is no branch at this step.
pub(super) fn launch(branches: &Branches, step: Step) -> Result<String, String> {
    let recording = branches.trunk.recording.as_deref();
    let recording = recording
        .ok_or("the run is not recorded, so that its past cannot be read; omit --no-record")?;
    let before = |step| {
        RecordedScenario::before(recording, step).map_err(|failure: Failure| failure.reason())
    };
    refuse(&before(Step(0))?, step)?;
    let expected = digest_at(recording, step, branches.trunk.is_live)?;
    let past = before(step)?;
    let (_, rate) = past.length();
    let folder = base_of(recording);
    let start = match branches.trunk.is_live {
        true => None,
        false => past.checkpoint_before(folder_of(recording), step),
    };
    let out = free(&folder, step)?;
    let mut words = vec!["--pause-at".to_owned(), rate.seconds(step).to_string()];
    // Removed when the new run has read it.
    let mut scenario: Option<NamedTempFile> = None;
    let origin = match &start {
        Some((at, checkpoint)) => {
            words.extend(["--from".into(), checkpoint.display().to_string()]);
            let command = command_line(checkpoint, step, rate);
            branches.note(|branch| branch.command = Some(command));
            format!("from the checkpoint before step {at}")
        }
        None => {
            let text = past.scenario().map_err(|failure| failure.reason())?;
            let file = beside_tables(folder_of(recording), &text)?;
            words.push(file.path().display().to_string());
            scenario = Some(file);
            "from the beginning".into()
        }
    };
    branches.note(|branch| {
        branch.folder = Some(out.display().to_string());
        branch.text = format!("repeats the steps {origin}");
    });
    let printed = begin(branches, &words, &out)?;
    let session = hold(branches, &out, step, &printed)?;
    drop(scenario);
    compare(&out, step, &expected)?;
    let text = format!("branch of {} at step {step}", folder.display());
    let mark = Request::Mark { text };
    let answer = live::ask(&session, &mark, ANSWER_LIMIT);
    if !matches!(answer, Ok(Response::Marked { .. })) {
        return Err("the new run cannot note its origin".into());
    }
    let url = printed.url().ok_or("the new run has no panel")?;
    branches.note(|branch| {
        (branch.panel, branch.session) = (Some(url), Some(session.name));
    });
    Ok(format!("repeated {origin}"))
}

/// Refuses a run that cannot be repeated, and a step that is not in it.
fn refuse(run: &RecordedScenario, step: Step) -> Result<(), String> {
    if run.is_against_clock() {
        return Err(
            "the run was in real time, whose bits depend on which messages came too late".into(),
        );
    }
    if run.is_behind_port() {
        return Err("the plant is behind a port, and its far end does not go back in time".into());
    }
    let (steps, _) = run.length();
    if step >= steps {
        return Err(format!(
            "step {step} is not before the end of the run at step {steps}"
        ));
    }
    Ok(())
}

/// Returns the digest of the records of a run before a step; waits for records that are still being written.
fn digest_at(recording: &Path, step: Step, is_live: bool) -> Result<String, String> {
    let since = Instant::now();
    loop {
        let (digest, records) = digest_before(recording, step)?;
        if let Some(digest) = digest {
            return Ok(digest);
        }
        if !is_live || since.elapsed() > FLUSH_LIMIT {
            return Err(format!(
                "step {step} is beyond the {records} steps that the run has recorded"
            ));
        }
        std::thread::sleep(BETWEEN);
    }
}

/// Computes the digest of the records before a step, with the number of records; `None` if there are fewer.
fn digest_before(recording: &Path, step: Step) -> Result<(Option<String>, u64), String> {
    let in_words = |error: ReadError| error.to_string();
    let mut reader = RunReader::open(recording).map_err(in_words)?;
    reader.refuse_excerpt().map_err(in_words)?;
    while reader.records() < step.0 && reader.advance().map_err(in_words)? {
        if reader.step() + 1 != reader.records() {
            return Err("records of the run were lost".into());
        }
    }
    let records = reader.records();
    Ok(((records == step.0).then(|| reader.digest()), records))
}

/// Returns the path that names a run: its folder, or its recording without the ending.
fn base_of(recording: &Path) -> PathBuf {
    let is_named =
        recording.is_dir() || recording.file_name().is_some_and(|name| name == RECORDING);
    match is_named {
        true => folder_of(recording).to_owned(),
        false => recording.with_extension(""),
    }
}

/// Returns an unused folder beside a run for its branch.
fn free(run: &Path, step: Step) -> Result<PathBuf, String> {
    let run = std::path::absolute(run).map_err(|error| error.to_string())?;
    let name = run.file_name().unwrap_or_default().to_string_lossy();
    let names = std::iter::once(format!("{name}-at-{step}"))
        .chain((2..).map(|number| format!("{name}-at-{step}-{number}")));
    let mut paths = names.map(|name| run.with_file_name(name));
    paths
        .find(|path| !path.exists())
        .ok_or_else(|| "there is no name left for the new run".into())
}

/// Writes a scenario beside the tables that it names.
fn beside_tables(folder: &Path, text: &str) -> Result<NamedTempFile, String> {
    let mut file = tempfile::Builder::new()
        .prefix(".branch-")
        .suffix(".toml")
        .tempfile_in(folder)
        .map_err(|error| format!("cannot write into {}: {error}", folder.display()))?;
    file.write_all(text.as_bytes())
        .map_err(|error| error.to_string())?;
    Ok(file)
}

/// Starts the new run.
fn begin(branches: &Branches, words: &[String], out: &Path) -> Result<Printed, String> {
    let cannot = |error: std::io::Error| format!("cannot start hil: {error}");
    let mut hil = Command::new(std::env::current_exe().map_err(cannot)?);
    hil.arg("run").args(words).arg("--out").arg(out);
    hil.args(["--panel", "--no-open", "--owner"]);
    hil.arg(std::process::id().to_string());
    hil.stdin(Stdio::null()).stdout(Stdio::null());
    // A terminal interrupts this panel, which then interrupts the run.
    hil.stderr(Stdio::piped()).process_group(0);
    let mut child = hil.spawn().map_err(cannot)?;
    let printed = Printed::of(child.stderr.take());
    match branches.keep(child) {
        true => Ok(printed),
        false => Err("the panel was closed".into()),
    }
}

/// Waits until the new run is held at its step.
fn hold(
    branches: &Branches,
    out: &Path,
    step: Step,
    printed: &Printed,
) -> Result<SessionInfo, String> {
    let (mut reached, mut since) = (None, Instant::now());
    while since.elapsed() < PROGRESS_LIMIT {
        if branches.has_ended() {
            return Err(printed.reason());
        }
        if let Some(session) = session_of(out)
            && let Ok(Response::Status(status)) =
                live::ask(&session, &Request::Status, ANSWER_LIMIT)
        {
            let Status {
                step: at, paused, ..
            } = status;
            if paused && at == step.0 && printed.url().is_some() {
                return Ok(session);
            }
            if reached != Some(at) {
                (reached, since) = (Some(at), Instant::now());
                branches.note(|branch| branch.text = format!("repeats step {at} of {step}"));
            }
        }
        std::thread::sleep(LOOK);
    }
    Err(format!(
        "the new run did not reach step {step}: no progress for {} s",
        PROGRESS_LIMIT.as_secs()
    ))
}

/// Returns the session that writes into a folder.
fn session_of(out: &Path) -> Option<SessionInfo> {
    peek()
        .into_iter()
        .find(|one| one.run_dir.as_deref() == Some(out))
}

/// Compares the new run up to its step with the digest of the trunk.
fn compare(out: &Path, step: Step, expected: &str) -> Result<(), String> {
    let recording = out.join(RECORDING);
    let digest = match step.0 {
        0 => return Ok(()),
        _ => digest_at(&recording, step, true)?,
    };
    match digest == expected {
        true => Ok(()),
        false => Err(format!(
            "not repeatable: the new run has other bits before step {step}; `hil compare` of both runs shows the first"
        )),
    }
}

/// Output of the new run: the address of its panel, and its last lines.
#[derive(Clone, Default)]
struct Printed(Arc<Mutex<(Option<String>, Vec<String>)>>);

impl Printed {
    /// Reads the output to its end in the background, so that the run never waits.
    fn of(stderr: Option<ChildStderr>) -> Self {
        let printed = Self::default();
        let shared = printed.clone();
        std::thread::spawn(move || {
            let lines = stderr
                .into_iter()
                .flat_map(|one| BufReader::new(one).lines());
            for line in lines.map_while(Result::ok) {
                let mut inner = shared.0.lock().unwrap_or_else(PoisonError::into_inner);
                match line.strip_prefix("panel: ") {
                    Some(url) => inner.0 = Some(url.to_owned()),
                    None if inner.1.len() < LINES => inner.1.push(line),
                    None => {}
                }
            }
        });
        printed
    }

    fn url(&self) -> Option<String> {
        let inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        inner.0.clone()
    }

    /// Returns the reason for an early end: the error, if the run printed one.
    fn reason(&self) -> String {
        std::thread::sleep(BETWEEN); // the last lines may be under way
        let inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let lines = &inner.1;
        let begin = lines.iter().position(|line| line.starts_with("error: "));
        match (begin, lines.last()) {
            (Some(begin), _) => lines[begin..].join("; ").replacen("error: ", "", 1),
            (None, Some(last)) => last.clone(),
            (None, None) => "the new run ended before its step".into(),
        }
    }
}

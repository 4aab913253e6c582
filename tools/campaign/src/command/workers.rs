//! Workers on the cores of this machine: starts them, watches them and restarts those that die.
//!
//! No result depends on the workers' order: the first worker to publish a shard wins, here or elsewhere.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;

use crate::folder::Folder;
use crate::shard::{Shard, missing};
use crate::table::{LOST, Row};
use indicatif::ProgressBar;
use rustix::process::Signal;
use shared_types::number::{counted, short};

use super::answers::{Gathered, class_of};
use super::plan::bar;
use super::planned::{self, cannot, program};
use super::work::{DIFFERS, FAILED, open};
use super::{collect, quoted, show};
use crate::arguments::RunCampaignArguments;

/// Interval of polling for changes without notification.
const LOOK: Duration = Duration::from_millis(100);
/// Interval of polling for shards that other workers have claimed.
const ELSEWHERE: Duration = Duration::from_secs(1);
/// Interval between progress lines when standard error is not a terminal.
const LINES: Duration = Duration::from_secs(10);
/// Number of consecutive worker deaths without a started case that points to a fault other than a case.
const MOST_STILLBORN: u32 = 5;

/// Runs the missing cases.
///
/// # Errors
/// If workers fail, or the command is interrupted.
pub(super) fn run(arguments: &RunCampaignArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    planned::check(&folder)?;
    if arguments.again {
        try_again(&folder)?;
    }
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let each = if folder.manifest().plant.is_some() {
        2
    } else {
        1
    };
    let jobs = match (arguments.jobs, planned::has_port(&folder)) {
        (Some(jobs @ 2..), true) => {
            return Err(Failure::usage(format!(
                "the controller of this campaign is behind a port, and {jobs} cases at once would use the same wire; use --jobs 1, or copy the campaign to machines with a wire of their own"
            )));
        }
        (_, true) => 1,
        (Some(jobs), false) => jobs as usize,
        (None, false) => cores.div_ceil(each),
    };
    let study = planned::study(&folder)?;
    let mut broken = BTreeSet::new();
    let (collected, gathered) = loop {
        let mut progress = Progress::new(&folder)?;
        let ran = all(&folder, jobs, &interruption, &mut progress);
        progress.end();
        ran?;
        let mut gathered = Gathered::new(&folder, &study);
        let collected = collect::join(&folder, &study, false, |part| gathered.take(part))?;
        // Invalid results are detected only when they are read.
        if collected.missing.is_empty() {
            break (collected, gathered);
        }
        for (number, what) in &collected.broken {
            if !broken.insert(*number) {
                let again = format!("the result of shard {number} was recomputed, but {what}");
                return Err(cannot(&folder, &again));
            }
        }
    };
    show::print(&folder, &collected, gathered, arguments.json)
}

/// Withdraws the results with cases that were set aside, to retry only these cases.
fn try_again(folder: &Folder) -> Result<(), Failure> {
    let mut count = 0;
    for number in 0..folder.manifest().shards() {
        let shard = Shard::of(folder, number);
        let Ok(part) = shard.part() else { continue };
        let is_lost = |row: &Row| class_of(folder.manifest(), row) == LOST;
        let lost = part.rows().filter(is_lost).count();
        if lost > 0 {
            let opened = shard.reopen(|row| !is_lost(row));
            opened.map_err(|error| cannot(folder, &error))?;
        }
        count += lost as u64;
    }
    tell!("retrying {}", counted(count, "case"));
    Ok(())
}

/// Runs rounds of workers until nothing is missing.
fn all(
    folder: &Folder,
    jobs: usize,
    interruption: &Interruption,
    progress: &mut Progress,
) -> Result<(), Failure> {
    let mut has_told = false;
    loop {
        let missing = missing(folder);
        if missing.is_empty() {
            return Ok(());
        }
        let mut free = None;
        for number in &missing {
            if is_free(folder, *number)? {
                free = Some(*number);
                break;
            }
        }
        if let Some(free) = free {
            let workers = if missing.len() < jobs {
                missing.len()
            } else {
                jobs
            };
            let before = done(folder)?;
            round(folder, workers, interruption, progress)?;
            // A working worker computes a free shard or reports why it cannot.
            let is_idle = !interruption.came()
                && self::missing(folder) == missing
                && done(folder)? == before
                && is_free(folder, free)?;
            if is_idle {
                let program = program(folder)?;
                return Err(Failure::infrastructure(format!(
                    "all workers ended without an error but computed nothing, although shard {free} is free: {} does not behave like the hil of this campaign; existing results are kept",
                    program.display()
                )));
            }
        } else {
            if !std::mem::replace(&mut has_told, true) {
                let count = counted(missing.len() as u64, "shard");
                let folder_text = quoted(folder.path());
                progress.tell(&format!("waiting for {count} that other workers have claimed; hil campaign work {folder_text} --ignore-claims computes them too"));
            }
            progress.look(folder)?;
            std::thread::sleep(ELSEWHERE);
        }
        if interruption.came() {
            return Err(interrupted(folder));
        }
    }
}

/// Returns `true` if no worker holds the shard.
fn is_free(folder: &Folder, number: u64) -> Result<bool, Failure> {
    let claim = Shard::of(folder, number).claim();
    Ok(claim.map_err(|error| cannot(folder, &error))?.is_some())
}

fn interrupted(folder: &Folder) -> Failure {
    let folder_text = quoted(folder.path());
    tell!("interrupted; hil campaign run {folder_text} continues");
    Failure::Interrupted
}

/// Message from the thread that watches a worker.
enum WorkerMessage {
    Line(String),
    Ended(usize),
}

/// Runs workers until each finds nothing to do, restarting those that die.
fn round(
    folder: &Folder,
    workers: usize,
    interruption: &Interruption,
    progress: &mut Progress,
) -> Result<(), Failure> {
    let (send, news) = channel();
    let mut children: Vec<Option<Child>> = Vec::new();
    for number in 0..workers {
        children.push(Some(start(folder, number, &send)?));
    }
    let mut stillborn = 0;
    let mut failed = None;
    let mut reason = None;
    let mut is_ending = false;
    while children.iter().any(Option::is_some) {
        if (interruption.came() || failed.is_some()) && !is_ending {
            is_ending = true;
            // Closing their input ends the workers.
            let inputs = children
                .iter_mut()
                .flatten()
                .map(|child| child.stdin.take());
            inputs.for_each(drop);
        }
        let Ok(news) = news.recv_timeout(LOOK) else {
            continue;
        };
        match news {
            WorkerMessage::Line(line) if line == DIFFERS => {
                failed = Some(Failure::Differ(
                    "cases had different results in new processes; results published earlier may be wrong, too".into(),
                ));
            }
            WorkerMessage::Line(line) => {
                stillborn = 0;
                match line.strip_prefix(FAILED) {
                    Some(text) => reason = reason.or_else(|| serde_json::from_str(text).ok()),
                    None => progress.take(&line),
                }
            }
            WorkerMessage::Ended(number) => {
                let Some(mut child) = children[number].take() else {
                    continue;
                };
                let status = child.wait().map_err(Failure::infrastructure)?;
                // Ctrl-C in a terminal also reaches the workers, perhaps earlier than this process.
                let is_interrupted = status.code() == Some(Exit::Interrupted as i32)
                    || status.signal() == Some(Signal::INT.as_raw());
                if is_ending || is_interrupted || status.code().is_some_and(|code| code < 2) {
                    continue;
                }
                if let Some(code @ (2 | 3)) = status.code() {
                    let code = || format!("a worker ended with exit code {code}");
                    failed = Some(Failure::infrastructure(reason.take().unwrap_or_else(code)));
                    continue;
                }
                stillborn += 1;
                progress.tell(&died(status));
                if stillborn >= MOST_STILLBORN {
                    failed = Some(Failure::infrastructure(format!(
                        "{stillborn} workers died before any of them began a case"
                    )));
                    continue;
                }
                children[number] = Some(start(folder, number, &send)?);
            }
        }
    }
    failed.map_or(Ok(()), Err)
}

fn died(status: ExitStatus) -> String {
    format!("a worker died ({status}); starting another one")
}

/// Starts a worker, with a thread that reads its output.
fn start(folder: &Folder, number: usize, send: &Sender<WorkerMessage>) -> Result<Child, Failure> {
    let program = program(folder)?;
    let child = Command::new(&program)
        .args(["campaign", "work", "--tell", "--leash"])
        .arg(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let cannot =
        |error| Failure::infrastructure(format!("cannot run {}: {error}", program.display()));
    let mut child = child.map_err(cannot)?;
    let output = child.stdout.take();
    let send = send.clone();
    std::thread::spawn(move || {
        let lines = output
            .into_iter()
            .flat_map(|output| BufReader::new(output).lines());
        for line in lines.map_while(Result::ok) {
            if send.send(WorkerMessage::Line(line)).is_err() {
                return;
            }
        }
        let _ = send.send(WorkerMessage::Ended(number)); // fails only if the receiver is gone
    });
    Ok(child)
}

/// Progress display on standard error.
struct Progress {
    bar: ProgressBar,
    all: u64,
    done: u64,
    /// Number of finished cases at the start.
    before: u64,
    failures: u64,
    began: Instant,
    last_line: Instant,
}

impl Progress {
    fn new(folder: &Folder) -> Result<Self, Failure> {
        let all = folder.manifest().cases;
        let done = done(folder)?;
        let bar = bar(all, "cases");
        bar.set_position(done);
        bar.reset_eta();
        let now = Instant::now();
        Ok(Self {
            bar,
            all,
            done,
            before: done,
            failures: 0,
            began: now,
            last_line: now,
        })
    }

    fn take(&mut self, line: &str) {
        let mut words = line.split(' ');
        let (Some("case"), Some(_), class) = (words.next(), words.next(), words.next()) else {
            return;
        };
        self.done += 1;
        self.failures += u64::from(class != Some("pass"));
        self.bar.set_position(self.done);
        self.bar
            .set_message(format!("cases, {} no pass", self.failures));
        if self.bar.is_hidden() && self.last_line.elapsed() > LINES {
            self.last_line = Instant::now();
            let rate =
                self.done.saturating_sub(self.before) as f64 / self.began.elapsed().as_secs_f64();
            let left_ns = (self.all.saturating_sub(self.done)) as f64 / rate * 1e9;
            tell!(
                "{} of {}, {} a second, {} left, {} no pass",
                self.done,
                counted(self.all, "case"),
                short(rate),
                shown_ns(left_ns as u64),
                self.failures
            );
        }
    }

    /// Updates the count with cases that other workers have finished.
    fn look(&mut self, folder: &Folder) -> Result<(), Failure> {
        self.done = done(folder)?;
        self.bar.set_position(self.done);
        Ok(())
    }

    fn tell(&self, text: &str) {
        self.bar.suspend(|| tell!("{text}"));
    }

    fn end(&self) {
        self.bar.finish_and_clear();
    }
}

/// Counts the cases that have a row.
fn done(folder: &Folder) -> Result<u64, Failure> {
    let mut done = 0;
    for number in 0..folder.manifest().shards() {
        let shard = Shard::of(folder, number);
        let cases = shard.cases();
        done += match shard.is_published() {
            true => cases.end - cases.start,
            false => shard.begun().map_err(|error| cannot(folder, &error))?.0,
        };
    }
    Ok(done)
}

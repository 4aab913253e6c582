//! Workers on the cores of this machine: started, watched, started again when one dies.
//!
//! Decides nothing about results: whoever finishes a shard first, here or elsewhere, is right.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
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
use shared_types::number::{counted, short};

use super::answers::{Gathered, class_of};
use super::plan::bar;
use super::planned::{self, cannot, program};
use super::work::{DIFFERS, FAILED, open};
use super::{collect, quoted, show};
use crate::arguments::RunCampaignArguments;

/// Time between two looks at what nobody tells.
const LOOK: Duration = Duration::from_millis(100);
/// Time between two looks at shards that others have claimed.
const ELSEWHERE: Duration = Duration::from_secs(1);
/// Time between two lines of progress where nobody watches.
const LINES: Duration = Duration::from_secs(10);
/// Deaths in a row of workers that began no case, after which it is no case's fault.
const MOST_STILLBORN: u32 = 5;

/// Runs what is missing.
///
/// # Errors
/// If workers cannot work, or it was interrupted.
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
    let jobs = arguments
        .jobs
        .map_or(cores.div_ceil(each), |jobs| jobs as usize);
    let study = planned::study(&folder)?;
    let mut broken = BTreeSet::new();
    let (collected, gathered) = loop {
        let mut progress = Progress::new(&folder)?;
        let ran = all(&folder, jobs, &interruption, &mut progress);
        progress.end();
        ran?;
        let mut gathered = Gathered::new(folder.manifest(), &study);
        let collected = collect::join(&folder, &study, false, |part| gathered.take(part))?;
        // A result that does not count is known once it is read.
        if collected.missing.is_empty() {
            break (collected, gathered);
        }
        for (number, what) in &collected.broken {
            if !broken.insert(*number) {
                let again = format!("the result of shard {number} was computed again, and {what}");
                return Err(cannot(&folder, &again));
            }
        }
    };
    show::print(&folder, &collected, gathered, arguments.json)
}

/// Opens the results again that have cases without one, for these cases alone.
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
    tell!("{} tried again", counted(count, "case"));
    Ok(())
}

/// Starts workers until nothing is missing.
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
            // A worker in order computes what is free, or says why it cannot.
            let is_idle = !interruption.came()
                && self::missing(folder) == missing
                && done(folder)? == before
                && is_free(folder, free)?;
            if is_idle {
                let program = program(folder)?;
                return Err(Failure::infrastructure(format!(
                    "all workers ended without an error, and computed nothing although nobody else has shard {free}: {} does not work as the hil of this campaign; what is there stays",
                    program.display()
                )));
            }
        } else {
            if !std::mem::replace(&mut has_told, true) {
                let count = counted(missing.len() as u64, "shard");
                let shown = quoted(folder.path());
                progress.tell(&format!("waiting for {count} that other workers have claimed; hil campaign work {shown} --ignore-claims computes them too"));
            }
            progress.look(folder)?;
            std::thread::sleep(ELSEWHERE);
        }
        if interruption.came() {
            return Err(interrupted(folder));
        }
    }
}

/// Returns `true` if nobody works on a shard.
fn is_free(folder: &Folder, number: u64) -> Result<bool, Failure> {
    let claim = Shard::of(folder, number).claim();
    Ok(claim.map_err(|error| cannot(folder, &error))?.is_some())
}

fn interrupted(folder: &Folder) -> Failure {
    let shown = quoted(folder.path());
    tell!("interrupted; hil campaign run {shown} goes on");
    Failure::Interrupted
}

/// News of a worker.
enum News {
    Line(String),
    Ended(usize),
}

/// Runs N workers until each finds nothing to do; those that die are started again.
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
            // Their input ends, and so do they.
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
            News::Line(line) if line == DIFFERS => {
                failed = Some(Failure::Differ(
                    "cases came out otherwise in new processes; what was published before may be wrong too".into(),
                ));
            }
            News::Line(line) => {
                stillborn = 0;
                match line.strip_prefix(FAILED) {
                    Some(text) => reason = reason.or_else(|| serde_json::from_str(text).ok()),
                    None => progress.take(&line),
                }
            }
            News::Ended(number) => {
                let Some(mut child) = children[number].take() else {
                    continue;
                };
                let status = child.wait().map_err(Failure::infrastructure)?;
                if is_ending || status.code().is_some_and(|code| code < 2) {
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
    format!("a worker died ({status}); another one goes on")
}

/// Starts a worker, with a thread that listens to it.
fn start(folder: &Folder, number: usize, send: &Sender<News>) -> Result<Child, Failure> {
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
            if send.send(News::Line(line)).is_err() {
                return;
            }
        }
        let _ = send.send(News::Ended(number)); // nobody may be left to hear it
    });
    Ok(child)
}

/// Progress of a campaign on standard error.
struct Progress {
    bar: ProgressBar,
    all: u64,
    done: u64,
    /// Cases that were there when it began.
    before: u64,
    failures: u64,
    began: Instant,
    said: Instant,
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
            said: now,
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
        if self.bar.is_hidden() && self.said.elapsed() > LINES {
            self.said = Instant::now();
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

    /// Looks at what others have done meanwhile.
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

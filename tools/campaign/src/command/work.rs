//! The worker: runs the cases of free shards, one after another, until no shard is free.
//!
//! Every engine starts this worker, which depends on none of them. Whatever ends a worker, its finished cases are in
//! the journal. A case that kills three workers, or that fails three times, is set aside and its shard continues. Where
//! processes are reused, some cases are verified in new processes before they count, and a difference stops the
//! worker.

use std::cell::RefCell;
use std::io::Read;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::results::curve::Curve;
use hil_run::kept::Kept;

use crate::folder::{Conflict, Folder};
use crate::manifest::ManifestError;
use crate::shard::attempt::{Attempt, Published, difference};
use crate::shard::{MOST_TRIES, PartError, Shard, missing};
use crate::table::Row;
use hil_session::session;
use rustix::process::{Signal, getpid, kill_process};

use super::answers::class_of;
use super::cases::Cases;
use super::planned::{self, become_planned, cannot};
use super::result::CaseResult;
use crate::arguments::WorkArguments;

/// Message of a worker when a case had another result in new processes.
pub(super) const DIFFERS: &str = "differs";
/// Message of a worker that cannot continue, followed by the reason as a JSON string.
pub(super) const FAILED: &str = "failed ";
/// Interval between two checks of the watchdog.
const LOOK: Duration = Duration::from_millis(100);

/// Works on the requested shards.
///
/// # Errors
/// If the folder cannot be used.
pub(super) fn work(arguments: &WorkArguments) -> Result<Exit, Failure> {
    match run_shards(arguments) {
        // The parent command reports an interruption once for all its workers.
        Err(Failure::Interrupted) if arguments.leash => Ok(Exit::Interrupted),
        Err(failure @ (Failure::Usage(_) | Failure::Infrastructure(_))) if arguments.leash => {
            let reason = serde_json::to_string(&failure.reason());
            let reason = reason.map_err(Failure::infrastructure)?;
            output::write(&format!("{FAILED}{reason}\n"))?;
            Ok(failure.exit())
        }
        result => result,
    }
}

fn run_shards(arguments: &WorkArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let folder = open(&arguments.folder)?;
    become_planned(&folder)?;
    if arguments.leash {
        end_with_input();
    }
    planned::check(&folder)?;
    let _wire = planned::lock_port(&folder)?;
    let cases = Cases::of_folder(&folder, &interruption)?;
    let worker = Worker {
        watchdog: Watchdog::begin(cases.study().case_limit_s),
        processes: RefCell::new(Kept::new(cases.study().wait_limit_s)),
        cases,
        folder: &folder,
        interruption,
        tells: arguments.tell,
    };
    let mut exit = Exit::Pass;
    for number in requested_shards(arguments, &folder)? {
        let shard = Shard::of(&folder, number);
        if shard.is_published() {
            continue;
        }
        let claim = shard.claim().map_err(|error| cannot(&folder, &error))?;
        // Another worker may have published the shard between the two checks.
        let is_taken = claim.is_none() && !arguments.ignore_claims;
        if is_taken || shard.is_published() {
            continue;
        }
        if worker.shard(shard)? == Exit::Failed {
            exit = Exit::Failed;
        }
    }
    Ok(exit)
}

/// Opens the folder of a campaign.
///
/// # Errors
/// If the folder is not that of a campaign.
pub(super) fn open(path: &Path) -> Result<Folder, Failure> {
    Folder::open(path).map_err(|error| match error {
        ManifestError::Damaged(_) => Failure::infrastructure(error),
        _ => Failure::usage(error),
    })
}

/// Ends the worker at the end of its input, when its parent is gone.
fn end_with_input() {
    std::thread::spawn(|| {
        let mut input = std::io::stdin().lock();
        while matches!(input.read(&mut [0; 64]), Ok(1..)) {}
        let _ = kill_process(getpid(), Signal::TERM); // cannot fail for its own process
    });
}

/// Lists the requested shards.
fn requested_shards(arguments: &WorkArguments, folder: &Folder) -> Result<Vec<u64>, Failure> {
    let shards = folder.manifest().shards();
    if let Some(list) = &arguments.shards {
        let all = listed(list).ok_or_else(|| {
            Failure::usage(format!(
                "--shards {list}: expected numbers and ranges, for example 0-9,12"
            ))
        })?;
        if let Some(beyond) = all.iter().find(|number| **number >= shards) {
            return Err(Failure::usage(format!(
                "--shards: there is no shard {beyond}; the campaign has {shards} shards, counted from 0"
            )));
        }
        return Ok(all);
    }
    let missing = missing(folder);
    let Some(task) = &arguments.task else {
        return Ok(missing);
    };
    let part = task.split_once('/').and_then(|(part, of)| {
        let (part, of): (u64, u64) = (part.parse().ok()?, of.parse().ok()?);
        (part < of).then_some((part, of))
    });
    let (part, of) = part
        .ok_or_else(|| Failure::usage(format!("--task {task}: expected K/N, for example 0/16")))?;
    // Assigned by a hash of the shard number, so that the assignment does not depend on finished shards, and the
    // shards that one task left are spread over several tasks.
    let mixed = |number: u64| number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
    Ok((missing.into_iter())
        .filter(|number| mixed(*number) % of == part)
        .collect())
}

/// Parses a list such as `0-9,12`.
fn listed(list: &str) -> Option<Vec<u64>> {
    let mut all = Vec::new();
    for part in list.split(',') {
        let (from, to) = part.split_once('-').unwrap_or((part, part));
        let (from, to): (u64, u64) = (from.trim().parse().ok()?, to.trim().parse().ok()?);
        if from > to || to - from > 100_000_000 {
            return None;
        }
        all.extend(from..=to);
    }
    Some(all)
}

struct Worker<'a> {
    cases: Cases,
    processes: RefCell<Kept>,
    folder: &'a Folder,
    interruption: Interruption,
    watchdog: Watchdog,
    tells: bool,
}

impl Worker<'_> {
    /// Computes the missing cases of a shard and publishes it.
    fn shard(&self, shard: Shard<'_>) -> Result<Exit, Failure> {
        let cannot = |error: std::io::Error| cannot(self.folder, &error);
        let mut attempt = shard.attempt().map_err(cannot)?;
        for case in shard.cases() {
            if attempt.has(case) {
                continue;
            }
            let began = Instant::now();
            let (row, curve) = self.row(case, &mut attempt)?;
            let class = class_of(self.folder.manifest(), &row).to_owned();
            attempt
                .row(row, began.elapsed().as_secs_f64(), curve)
                .map_err(cannot)?;
            self.tell(&format!("case {case} {class}"))?;
        }
        let published = match attempt.publish() {
            Err(PartError::Broken(what)) => {
                let aside = shard.set_aside().map_err(cannot)?;
                tell!(
                    "shard {}: {what}; it is now {}",
                    shard.number(),
                    aside.display()
                );
                return Ok(Exit::Pass); // missing again
            }
            Err(error) => return Err(super::planned::cannot(self.folder, &error)),
            Ok(published) => published,
        };
        self.tell(&format!("shard {}", shard.number()))?;
        match published {
            Published::First | Published::Again => Ok(Exit::Pass),
            Published::Otherwise(conflict) => {
                tell!("error: {conflict}");
                Ok(Exit::Failed)
            }
        }
    }

    /// Runs a case until it has a row, with its curve if one is recorded.
    fn row(&self, case: u64, attempt: &mut Attempt<'_>) -> Result<(Row, Option<Curve>), Failure> {
        let columns = &self.folder.manifest().columns;
        let mut tries = attempt.tries(case);
        let mut why = format!("the case killed its worker {tries} times");
        while tries < MOST_TRIES {
            attempt
                .start(case)
                .map_err(|error| cannot(self.folder, &error))?;
            self.tell(&format!("start {case}"))?;
            tries += 1;
            match self.try_once(case) {
                Ok((row, result)) if crate::table::fits(&row, columns) => {
                    if result.is_to_check {
                        // Verified before it counts: if the worker dies meanwhile, the case has no row.
                        self.check(case, &row)?;
                    }
                    return Ok((row, result.curve));
                }
                Ok(_) => {
                    why = "its results have different columns from those of the first case".into()
                }
                Err(Failure::Interrupted) => {
                    let result = attempt.leave(case);
                    result.map_err(|error| cannot(self.folder, &error))?;
                    return Err(Failure::Interrupted);
                }
                Err(failure) => {
                    why = failure.to_string();
                    // An invalid case stays invalid.
                    tries += if matches!(failure, Failure::Usage(_)) {
                        MOST_TRIES
                    } else {
                        0
                    };
                }
            }
        }
        tell!("case {case} is set aside: {why}");
        Ok((self.cases.lost(case, columns, &why), None))
    }

    /// Runs a case again in new processes and compares the results.
    ///
    /// # Errors
    /// If the results differ, or the new processes give no result.
    fn check(&self, case: u64, row: &Row) -> Result<(), Failure> {
        let columns = &self.folder.manifest().columns;
        let fresh = self.fresh(case)?;
        let Some(conflict) = difference(row, &fresh, columns, "new processes") else {
            return Ok(());
        };
        let noted = self.folder.note(&conflict);
        noted.map_err(|error| cannot(self.folder, &error))?;
        let Conflict {
            column,
            first,
            second,
            ..
        } = conflict;
        let advice = match difference(&fresh, &self.fresh(case)?, columns, "") {
            None => {
                "the plant or the controller keeps state from one run to the next, for example in a static variable. Fix it, or plan the campaign again with `fresh_processes = true` in its study"
            }
            Some(_) => {
                "a second pair of new processes gave yet another value: the plant or the controller depends on more than its inputs, such as a clock, a file or a random seed"
            }
        };
        self.tell(DIFFERS)?; // whoever hears it ends all workers
        Err(Failure::Differ(format!(
            "case {case}: {column} is {first} in processes that ran earlier cases, but {second} in new ones; {advice}"
        )))
    }

    /// Runs a case in new processes.
    fn fresh(&self, case: u64) -> Result<Row, Failure> {
        let plan = self.cases.plan(case)?;
        let mut tries = 0;
        loop {
            let _watched = self.watchdog.watch(case);
            tries += 1;
            match self.cases.run_fresh(&plan, &self.interruption) {
                Ok(result) => return Ok(self.cases.row(case, &result)),
                Err(Failure::Infrastructure(_)) if tries < MOST_TRIES => {}
                Err(Failure::Infrastructure(why)) => {
                    return Err(Failure::infrastructure(format!(
                        "case {case} has a result in processes that ran earlier cases, but none in new ones: {why}"
                    )));
                }
                Err(failure) => return Err(failure),
            }
        }
    }

    fn try_once(&self, case: u64) -> Result<(Row, CaseResult), Failure> {
        let _watched = self.watchdog.watch(case);
        let run = || {
            let plan = self.cases.plan(case)?;
            let result =
                self.cases
                    .run(&plan, &mut self.processes.borrow_mut(), &self.interruption)?;
            Ok((self.cases.row(case, &result), result))
        };
        // The state of a panicked run is discarded, so it cannot be observed broken.
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(run))
            .unwrap_or_else(|panic| Err(Failure::panicked("the run", &*panic)))
    }

    fn tell(&self, line: &str) -> Result<(), Failure> {
        if self.tells {
            output::write(&format!("{line}\n"))?;
        }
        Ok(())
    }
}

/// Kills the process when a case takes too long: a law in an endless loop cannot be ended otherwise.
struct Watchdog(Arc<Mutex<Option<(u64, Instant)>>>);

/// Guard of a case under watch.
struct Watched<'a>(&'a Watchdog);

impl Watchdog {
    fn begin(limit_s: f64) -> Self {
        let limit = Duration::from_secs_f64(limit_s);
        let watched = Arc::<Mutex<Option<(u64, Instant)>>>::default();
        let shared = Arc::clone(&watched);
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(LOOK);
                let case = *shared.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some((case, _)) = case.filter(|(_, since)| since.elapsed() > limit) {
                    tell!(
                        "error: case {case} took longer than {limit_s} s (case_limit_s); killing its worker"
                    );
                    session::abandon();
                    let _ = kill_process(getpid(), Signal::KILL); // cannot fail for its own process
                }
            }
        });
        Self(watched)
    }

    fn watch(&self, case: u64) -> Watched<'_> {
        self.set(Some((case, Instant::now())));
        Watched(self)
    }

    fn set(&self, case: Option<(u64, Instant)>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = case;
    }
}

impl Drop for Watched<'_> {
    fn drop(&mut self) {
        self.0.set(None);
    }
}

#[cfg(test)]
mod tests {
    use super::listed;

    #[test]
    fn lists_consist_of_numbers_and_ranges() {
        assert_eq!(listed("0-2,7"), Some(vec![0, 1, 2, 7]));
        for wrong in ["", "a", "2-1", "1-", "-1", "1,,2"] {
            assert_eq!(listed(wrong), None, "{wrong}");
        }
    }
}

//! The worker: runs the cases of free shards, one after another, until no shard is free.
//!
//! Every engine starts this worker, which depends on none of them. Whatever ends a worker, its finished cases are in
//! the journal. A case that kills three workers, or that fails three times, is set aside and its shard continues. The
//! [runner](super::runner) runs each case.

use std::cell::RefCell;
use std::io::Read;
use std::path::Path;
use std::time::Instant;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::results::curve::Curve;
use hil_run::kept::Kept;

use crate::folder::{Conflict, Folder};
use crate::manifest::ManifestError;
use crate::shard::attempt::{Attempt, Published};
use crate::shard::{PartError, Shard, missing};
use crate::table::{Column, LOST, NOT_POSSIBLE, Row};
use hil_config::plan::Plan;
use rustix::process::{Signal, getpid, kill_process};

use super::answers::class_of;
use super::cases::Cases;
use super::planned::{self, become_planned, cannot};
use super::result::CaseResult;
use super::runner::{Case, Runner, Watchdog};
use crate::arguments::WorkArguments;

/// Message of a worker when a case had another result in new processes.
pub(super) const DIFFERS: &str = "differs";
/// Message of a worker that cannot continue, followed by the reason as a JSON string.
pub(super) const FAILED: &str = "failed ";

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
        watchdog: Watchdog::begin(cases.study().case_limit_s, "its worker"),
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
        let (manifest, columns) = (self.folder.manifest(), &self.folder.manifest().columns);
        let faults = manifest.faults.as_ref();
        if let Some(reason) = faults.and_then(|faults| faults.impossible.get(&case)) {
            let row = self.cases.unrun(case, columns, NOT_POSSIBLE, reason);
            return Ok((row, None));
        }
        let runner = Runner {
            cases: &self.cases,
            watchdog: &self.watchdog,
            interruption: &self.interruption,
        };
        let mut one = ShardCase {
            worker: self,
            case,
            attempt,
        };
        match runner.run(&mut one, &mut self.processes.borrow_mut())? {
            Ok(row) => Ok(row),
            Err(why) => {
                tell!("case {case} is set aside: {why}");
                Ok((self.cases.unrun(case, columns, LOST, &why), None))
            }
        }
    }

    fn tell(&self, line: &str) -> Result<(), Failure> {
        if self.tells {
            output::write(&format!("{line}\n"))?;
        }
        Ok(())
    }
}

/// Case of a shard.
struct ShardCase<'a, 'w, 's> {
    worker: &'a Worker<'w>,
    case: u64,
    attempt: &'a mut Attempt<'s>,
}

impl ShardCase<'_, '_, '_> {
    fn cannot(&self, error: &std::io::Error) -> Failure {
        cannot(self.worker.folder, error)
    }
}

impl Case for ShardCase<'_, '_, '_> {
    fn label(&self) -> String {
        format!("case {}", self.case)
    }

    fn tries(&self) -> u64 {
        self.attempt.tries(self.case)
    }

    fn plan(&self) -> Result<Plan, Failure> {
        self.worker.cases.plan(self.case)
    }

    fn row(&self, result: &CaseResult) -> Row {
        self.worker.cases.row(self.case, result)
    }

    fn columns(&self, _: &CaseResult) -> Vec<Column> {
        self.worker.folder.manifest().columns.clone()
    }

    fn start(&mut self) -> Result<(), Failure> {
        let started = self.attempt.start(self.case);
        started.map_err(|error| self.cannot(&error))?;
        self.worker.tell(&format!("start {}", self.case))
    }

    fn leave(&mut self) -> Result<(), Failure> {
        let left = self.attempt.leave(self.case);
        left.map_err(|error| self.cannot(&error))
    }

    fn differs(&mut self, conflict: &Conflict) -> Result<(), Failure> {
        let noted = self.worker.folder.note(conflict);
        noted.map_err(|error| self.cannot(&error))
    }

    fn ends(&mut self) -> Result<(), Failure> {
        self.worker.tell(DIFFERS) // whoever hears it ends all workers
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

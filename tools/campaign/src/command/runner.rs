//! Runner of single cases, used by the worker of a campaign and by the evaluator of points.
//!
//! A case that ends three processes, or that fails three times, has no row. Where processes are reused, some cases are
//! verified in new processes before they count. Never decides what a case is, nor where its row is stored: that is
//! [`Case`].

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::results::curve::Curve;
use hil_run::kept::Kept;
use hil_session::session;
use rustix::process::{Signal, getpid, kill_process};

use super::cases::Cases;
use super::result::CaseResult;
use crate::folder::Conflict;
use crate::shard::MOST_TRIES;
use crate::shard::attempt::difference;
use crate::table::{Column, Row, fits};

/// Interval between two checks of the watchdog.
const LOOK: Duration = Duration::from_millis(100);

/// Case to run, with the place of its entries.
pub(super) trait Case {
    /// Returns the name of the case in messages.
    fn label(&self) -> String;

    /// Returns the number of processes that died while running the case.
    fn tries(&self) -> u64;

    /// Builds the plan.
    ///
    /// # Errors
    /// If the case is invalid.
    fn plan(&self) -> Result<Plan, Failure>;

    /// Builds the row of a result.
    fn row(&self, result: &CaseResult) -> Row;

    /// Lists the columns that the row of a result must have.
    fn columns(&self, result: &CaseResult) -> Vec<Column>;

    /// Records the start of a try.
    ///
    /// # Errors
    /// If the entry cannot be written.
    fn start(&mut self) -> Result<(), Failure>;

    /// Records that the started try was interrupted and counts for nothing.
    ///
    /// # Errors
    /// If the entry cannot be written.
    fn leave(&mut self) -> Result<(), Failure>;

    /// Records that new processes gave another result.
    ///
    /// # Errors
    /// If the entry cannot be written.
    fn differs(&mut self, conflict: &Conflict) -> Result<(), Failure>;

    /// Reports that no other case should be run, because results differ.
    ///
    /// # Errors
    /// If the report cannot be written.
    fn ends(&mut self) -> Result<(), Failure>;
}

/// Row of a case with its curve if one is recorded, or the reason for which it has none.
pub(super) type Outcome = Result<(Row, Option<Curve>), String>;

/// Runner of cases.
#[derive(Clone, Copy)]
pub(super) struct Runner<'a> {
    pub(super) cases: &'a Cases,
    pub(super) watchdog: &'a Watchdog,
    pub(super) interruption: &'a Interruption,
}

impl Runner<'_> {
    /// Runs a case until it has a row.
    ///
    /// # Errors
    /// If the command was interrupted, results differ, or an entry cannot be written.
    pub(super) fn run(
        &self,
        case: &mut dyn Case,
        processes: &mut Kept,
    ) -> Result<Outcome, Failure> {
        let mut tries = case.tries();
        let label = case.label();
        let mut why = format!("{label} killed its worker {tries} times");
        while tries < MOST_TRIES {
            case.start()?;
            tries += 1;
            match self.try_once(case, processes) {
                Ok(result) => {
                    let (row, columns) = (case.row(&result), case.columns(&result));
                    if !fits(&row, &columns) {
                        why = "its results have different columns from those of the first case"
                            .into();
                        continue;
                    }
                    if result.is_to_check {
                        // Verified before it counts: if the process dies meanwhile, the case has no row.
                        self.check(case, &row, &columns)?;
                    }
                    return Ok(Ok((row, result.curve)));
                }
                Err(Failure::Interrupted) => {
                    case.leave()?;
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
        Ok(Err(why))
    }

    /// Runs a case again in new processes and compares the results.
    ///
    /// # Errors
    /// If the results differ, or the new processes give no result.
    fn check(&self, case: &mut dyn Case, row: &Row, columns: &[Column]) -> Result<(), Failure> {
        let fresh = self.fresh(case)?;
        let Some(conflict) = difference(row, &fresh, columns, "new processes") else {
            return Ok(());
        };
        case.differs(&conflict)?;
        let advice = match difference(&fresh, &self.fresh(case)?, columns, "") {
            None => {
                "the plant or the controller keeps state from one run to the next, for example in a static variable. Fix it, or set `fresh_processes = true` in the study and begin again"
            }
            Some(_) => {
                "a second pair of new processes gave yet another value: the plant or the controller depends on more than its inputs, such as a clock, a file or a random seed"
            }
        };
        case.ends()?;
        let Conflict {
            column,
            first,
            second,
            ..
        } = conflict;
        Err(Failure::Differ(format!(
            "{}: {column} is {first} in processes that ran earlier cases, but {second} in new ones; {advice}",
            case.label()
        )))
    }

    /// Runs a case in new processes.
    fn fresh(&self, case: &dyn Case) -> Result<Row, Failure> {
        let plan = case.plan()?;
        let mut tries = 0;
        loop {
            let _watched = self.watchdog.watch(case.label());
            tries += 1;
            match self.cases.run_fresh(&plan, self.interruption) {
                Ok(result) => return Ok(case.row(&result)),
                Err(Failure::Infrastructure(_)) if tries < MOST_TRIES => {}
                Err(Failure::Infrastructure(why)) => {
                    return Err(Failure::infrastructure(format!(
                        "{} has a result in processes that ran earlier cases, but none in new ones: {why}",
                        case.label()
                    )));
                }
                Err(failure) => return Err(failure),
            }
        }
    }

    fn try_once(&self, case: &dyn Case, processes: &mut Kept) -> Result<CaseResult, Failure> {
        let _watched = self.watchdog.watch(case.label());
        let run = || {
            let plan = case.plan()?;
            self.cases.run(&plan, processes, self.interruption)
        };
        // The state of a panicked run is discarded, so it cannot be observed broken.
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(run))
            .unwrap_or_else(|panic| Err(Failure::panicked("the run", &*panic)))
    }
}

/// Case under way on each thread, with the time at which it began.
type UnderWay = Arc<Mutex<HashMap<ThreadId, (String, Instant)>>>;

/// Kills the process when a case takes too long: a law in an endless loop cannot be ended otherwise.
pub(super) struct Watchdog(UnderWay);

/// Guard of a case under watch.
struct Watched<'a>(&'a Watchdog);

impl Watchdog {
    /// Starts the watch; `process` names this process in the message.
    pub(super) fn begin(limit_s: f64, process: &'static str) -> Self {
        let limit = Duration::from_secs_f64(limit_s);
        let watched = UnderWay::default();
        let shared = Arc::clone(&watched);
        thread::spawn(move || {
            loop {
                thread::sleep(LOOK);
                let cases = locked(&shared);
                let late = cases.values().find(|(_, since)| since.elapsed() > limit);
                if let Some((label, _)) = late {
                    tell!(
                        "error: {label} took longer than {limit_s} s (case_limit_s); killing {process}"
                    );
                    session::abandon();
                    let _ = kill_process(getpid(), Signal::KILL); // cannot fail for its own process
                }
            }
        });
        Self(watched)
    }

    fn watch(&self, label: String) -> Watched<'_> {
        locked(&self.0).insert(thread::current().id(), (label, Instant::now()));
        Watched(self)
    }
}

impl Drop for Watched<'_> {
    fn drop(&mut self) {
        locked(&self.0.0).remove(&thread::current().id());
    }
}

fn locked(cases: &UnderWay) -> MutexGuard<'_, HashMap<ThreadId, (String, Instant)>> {
    cases.lock().unwrap_or_else(PoisonError::into_inner)
}

//! Execution of cases, several at a time; each case is compared with the first run of its scenario once both have
//! ended.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use hil_run::Origin;

use hil_console::terminal::exit::{Exit, Failure};

use super::case::{Case, Row};

/// Premature result of a command, before all its cases ran.
pub(super) type EarlyResult = Result<Exit, Failure>;

/// Runs the cases that have no row yet, `jobs` at a time; returns the rows in the order of the cases. `begins` is
/// called with the number of each case, `ended` with the number of finished cases and the newest row.
///
/// # Errors
/// The premature result that `ended` returned, after which no further case starts.
pub(super) fn all(
    cases: &[Case],
    done: Vec<Row>,
    jobs: usize,
    begins: &(dyn Fn(usize, &Case) + Sync),
    ended: &(dyn Fn(usize, &mut Row) -> Result<(), EarlyResult> + Sync),
) -> Result<Vec<Row>, EarlyResult> {
    let next = AtomicUsize::new(done.len());
    let missing = cases.len() - done.len();
    let mut rows: Vec<Option<Row>> = done.into_iter().map(Some).collect();
    rows.extend((0..missing).map(|_| None));
    let state = Mutex::new((rows, Ok(())));
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(case) = cases.get(index) else { return };
            begins(index, case);
            let is_wanted = case.skipped.is_none();
            let row = case.row(is_wanted.then(|| case.run(Origin::Scenario)));
            let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
            let (rows, end) = &mut *state;
            rows[index] = Some(row);
            compare(rows, cases, index);
            let done = rows.iter().flatten().count();
            let reaction = rows[index].as_mut().map(|row| ended(done, row));
            if let (Some(Err(early)), true) = (reaction, end.is_ok()) {
                next.store(cases.len(), Ordering::Relaxed);
                *end = Err(early);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(work);
        }
    });
    let (rows, end) = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    end.map(|()| rows.into_iter().flatten().collect())
}

/// Compares a finished run with the first run of its scenario; if it is the first, compares all earlier finishers
/// with it.
fn compare(rows: &mut [Option<Row>], cases: &[Case], index: usize) {
    let first = cases[index].first;
    let (before, others) = rows.split_at_mut(first + 1);
    let Some(reference) = &before[first] else {
        return;
    };
    for (number, row) in (first + 1..).zip(others) {
        let case = &cases[number];
        let is_new = index == first || index == number;
        if let Some(row) = row
            && is_new
            && case.first == first
            && case.repeats()
        {
            row.compare(reference);
        }
    }
}

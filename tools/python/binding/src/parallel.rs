//! Work of several threads without the interpreter, whose thread looks for signals meanwhile.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use hil_console::terminal::interruption::Interruption;
use pyo3::prelude::*;

use crate::bound::Along;

/// Interval between two looks for signals, such as Ctrl-C.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(20);

/// Calls a function for each place below `count` without the interpreter, on several threads. Returns the results in
/// order, or the first error.
///
/// # Errors
/// Those of the function; or the exception of a signal, after which no further call begins.
pub(crate) fn in_parallel<T: Send>(
    py: Python<'_>,
    count: usize,
    workers: usize,
    interruption: &Interruption,
    work: impl Fn(usize) -> PyResult<T> + Sync,
) -> PyResult<Vec<T>> {
    let (next, has_failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results: Mutex<Vec<(usize, PyResult<T>)>> = Mutex::default();
    let worker = || {
        while !has_failed.load(Ordering::Relaxed) && !interruption.came() {
            let place = next.fetch_add(1, Ordering::Relaxed);
            if place >= count {
                return;
            }
            let result = work(place);
            has_failed.fetch_or(result.is_err(), Ordering::Relaxed);
            let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
            results.push((place, result));
        }
    };
    let signalled = std::thread::scope(|scope| {
        // Closed once every worker has ended.
        let (working, mut are_over) = channel::<()>();
        for _ in 0..workers.clamp(1, count.max(1)) {
            let working = working.clone();
            scope.spawn(move || {
                worker();
                drop(working);
            });
        }
        drop(working);
        let mut signalled = Ok(());
        let mut along = Along(&mut are_over);
        while !py.detach(|| is_over(along.get())) {
            if let Err(interrupt) = py.check_signals() {
                interruption.request();
                signalled = Err(interrupt);
            }
        }
        signalled
    });
    signalled?;
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(place, _)| *place);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Waits a moment; returns `true` as soon as all workers have ended.
fn is_over(workers: &Receiver<()>) -> bool {
    workers.recv_timeout(BETWEEN_SIGNALS) == Err(RecvTimeoutError::Disconnected)
}

//! Value that stays in the thread and the process that made it, inside of an object of Python, which any thread may use.

use std::cell::{RefCell, RefMut};
use std::mem::ManuallyDrop;
use std::thread::ThreadId;

use pyo3::PyResult;

use crate::failure::session_error;

/// Value that only its thread can use.
pub(crate) struct Bound<T> {
    thread: ThreadId,
    process: u32,
    /// `None` once it was closed.
    value: ManuallyDrop<RefCell<Option<T>>>,
}

// SAFETY: every access to the value, also its drop, first checks that the current thread is the one that made it. All
// other fields are plain numbers.
unsafe impl<T> Send for Bound<T> {}
// SAFETY: as above.
unsafe impl<T> Sync for Bound<T> {}

impl<T> Bound<T> {
    /// Binds a value to the current thread.
    pub(crate) fn new(value: T) -> Self {
        Self {
            thread: std::thread::current().id(),
            process: std::process::id(),
            value: ManuallyDrop::new(RefCell::new(Some(value))),
        }
    }

    /// Checks that the value may be used here.
    ///
    /// # Errors
    /// In another thread, or in a process that was forked off.
    fn check(&self) -> PyResult<()> {
        if std::process::id() != self.process {
            return Err(session_error(
                "this session was opened before a fork, by the parent process; open another one in this process",
            ));
        }
        if std::thread::current().id() != self.thread {
            return Err(session_error(
                "this session belongs to another thread, which opened it; open one in each thread",
            ));
        }
        Ok(())
    }

    /// Returns the value for exclusive use.
    ///
    /// # Errors
    /// In another thread, in a process that was forked off, during another use, or after the end of the session.
    #[inline]
    pub(crate) fn get(&self) -> PyResult<RefMut<'_, T>> {
        self.check()?;
        let value = (self.value.try_borrow_mut()).map_err(|_| {
            session_error("this session is in use: it cannot be used by its own plant or law")
        })?;
        RefMut::filter_map(value, Option::as_mut)
            .map_err(|_| session_error("this session is closed; open another one"))
    }

    /// Drops the value, unless that happened earlier.
    ///
    /// # Errors
    /// As for [`get`](Self::get), except after the end of the session.
    pub(crate) fn close(&self) -> PyResult<()> {
        self.check()?;
        let mut value = (self.value.try_borrow_mut()).map_err(|_| {
            session_error("this session is in use: its own plant or law cannot close it")
        })?;
        drop(value.take());
        Ok(())
    }
}

impl<T> Drop for Bound<T> {
    fn drop(&mut self) {
        // The garbage collector may run in any thread. There the value is left, which is memory alone.
        if std::thread::current().id() == self.thread {
            // SAFETY: dropped here only, and nothing uses it afterwards.
            unsafe { ManuallyDrop::drop(&mut self.value) };
        }
    }
}

/// Reference that the thread takes along while it has given up the interpreter.
pub(crate) struct Along<'a, T>(pub(crate) &'a mut T);

// SAFETY: `Python::detach` calls its closure in the current thread; it demands `Send` to keep objects of Python out.
unsafe impl<T> Send for Along<'_, T> {}

impl<T> Along<'_, T> {
    /// Returns the reference; a method, so that a closure takes the whole.
    pub(crate) fn get(&mut self) -> &mut T {
        self.0
    }
}

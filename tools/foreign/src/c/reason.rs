//! Reasons that a callback gives before it returns that it failed.
//!
//! Kept for each thread until the status that they belong to comes back; never shown without one.

use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_int};

use shared_types::failure::Failure;

use super::interface::{DIVERGED, FAILED, OK};
use crate::float_modes;

thread_local! {
    static REASON: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Result of a callback that returned a status, after the modes that it left behind are the default again.
///
/// # Errors
/// If it is not [`OK`]: the reason that was kept, or else the status.
#[inline]
pub(super) fn outcome(callback: &'static str, status: c_int) -> Result<(), Failure> {
    float_modes::settle(callback);
    match status {
        OK => Ok(()),
        status => Err(failure(callback, status)),
    }
}

#[cold]
fn failure(callback: &str, status: c_int) -> Failure {
    let reason = REASON.take();
    let reason = reason.unwrap_or_else(|| format!("`{callback}` returned {status} and no reason"));
    match status {
        DIVERGED => Failure::diverged(reason),
        _ => Failure::lost(reason),
    }
}

/// Keeps a text of C as the reason.
///
/// # Safety
/// The text is null or ends with a zero.
unsafe fn keep(reason: *const c_char) {
    let text = match reason.is_null() {
        true => None,
        // SAFETY: the caller says so.
        false => Some(unsafe { CStr::from_ptr(reason) }),
    };
    let text = text.map(|text| text.to_string_lossy().into_owned());
    REASON.set(text.filter(|text| !text.is_empty()));
}

/// `hil_diverged` of the header: keeps the reason, gives [`DIVERGED`].
///
/// # Safety
/// The text is null or ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_diverged(reason: *const c_char) -> c_int {
    // SAFETY: the caller says so.
    unsafe { keep(reason) };
    DIVERGED
}

/// `hil_failed` of the header: keeps the reason, gives [`FAILED`].
///
/// # Safety
/// The text is null or ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_failed(reason: *const c_char) -> c_int {
    // SAFETY: the caller says so.
    unsafe { keep(reason) };
    FAILED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_belongs_to_the_next_failure_alone() {
        assert_eq!(outcome("step", OK), Ok(()));
        // SAFETY: a literal with a zero at its end.
        let status = unsafe { hil_diverged(c"the rod broke".as_ptr()) };
        assert_eq!(
            outcome("step", status),
            Err(Failure::diverged("the rod broke"))
        );
        let silent = Failure::lost("`step` returned 7 and no reason");
        assert_eq!(outcome("step", 7), Err(silent));
        // SAFETY: null is allowed.
        let status = unsafe { hil_failed(std::ptr::null()) };
        let silent = Failure::lost("`step` returned 2 and no reason");
        assert_eq!(outcome("step", status), Err(silent));
    }
}

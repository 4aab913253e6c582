//! Failure reasons that a callback passes before it returns an error status.
//!
//! A reason is stored for each thread until the status is returned, and is never shown without a status.

use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_int};

use shared_types::failure::Failure;

use super::interface::{DIVERGED, FAILED, OK};
use crate::float_modes;

thread_local! {
    static REASON: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Converts the status of a callback to a result, after resetting floating-point modes that the callback changed.
///
/// # Errors
/// If the status is not [`OK`]: with the stored reason, or else with the status.
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
    let reason =
        reason.unwrap_or_else(|| format!("`{callback}` returned {status} without a reason"));
    match status {
        DIVERGED => Failure::diverged(reason),
        _ => Failure::lost(reason),
    }
}

/// Stores a C text as the reason.
///
/// # Safety
/// The text is null or zero-terminated.
unsafe fn keep(reason: *const c_char) {
    let text = match reason.is_null() {
        true => None,
        // SAFETY: guaranteed by the caller.
        false => Some(unsafe { CStr::from_ptr(reason) }),
    };
    let text = text.map(|text| text.to_string_lossy().into_owned());
    REASON.set(text.filter(|text| !text.is_empty()));
}

/// `hil_diverged` of the header: stores the reason and returns [`DIVERGED`].
///
/// # Safety
/// The text is null or zero-terminated.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_diverged(reason: *const c_char) -> c_int {
    // SAFETY: guaranteed by the caller.
    unsafe { keep(reason) };
    DIVERGED
}

/// `hil_failed` of the header: stores the reason and returns [`FAILED`].
///
/// # Safety
/// The text is null or zero-terminated.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_failed(reason: *const c_char) -> c_int {
    // SAFETY: guaranteed by the caller.
    unsafe { keep(reason) };
    FAILED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_applies_only_to_the_next_failure() {
        assert_eq!(outcome("step", OK), Ok(()));
        // SAFETY: a zero-terminated literal.
        let status = unsafe { hil_diverged(c"the rod broke".as_ptr()) };
        assert_eq!(
            outcome("step", status),
            Err(Failure::diverged("the rod broke"))
        );
        let silent = Failure::lost("`step` returned 7 without a reason");
        assert_eq!(outcome("step", 7), Err(silent));
        // SAFETY: null is allowed.
        let status = unsafe { hil_failed(std::ptr::null()) };
        let silent = Failure::lost("`step` returned 2 without a reason");
        assert_eq!(outcome("step", status), Err(silent));
    }
}

//! Messages of an FMU: written to the log as they come, and the last one kept for the reason of an end.
//!
//! The library calls back here, from any thread. A callback never panics, never calls the library and never
//! believes that a pointer is one.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::{Mutex, PoisonError};

use shared_types::{program, text};

use super::status::Status;

/// Most bytes of a message that is written or kept.
const LONGEST: usize = 1024;

/// Place that the messages of one instance come to. It stays where it is as long as the instance lives.
#[derive(Debug, Default)]
pub(super) struct Journal {
    last: Mutex<Option<String>>,
}

impl Journal {
    /// The last message that told of something wrong.
    pub(super) fn last(&self) -> Option<String> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        last.clone()
    }

    fn note(&self, status: c_int, category: &str, message: &str) {
        let status = Status::of(status);
        let message = text::line(message.trim_end());
        let category = text::line(category);
        program::say(&format!("fmu: {status}: {category}: {message}"));
        if status != Status::Ok {
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            *last = Some(message);
        }
    }
}

/// Text at a pointer of the library, cut to a bounded length.
///
/// # Safety
/// The pointer is null, or leads to a text with a zero at its end.
unsafe fn read(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: not null, and the caller says that it is a text.
    let text = unsafe { CStr::from_ptr(pointer) };
    let bytes = text.to_bytes();
    String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST)]).into_owned()
}

/// Logger of FMI 3.
///
/// # Safety
/// `environment` is the [`Journal`] that the instance was made with; the others are texts or null.
pub(super) unsafe extern "C" fn log_three(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: the instance was made with a journal that lives longer; texts are the library's to keep sound.
    unsafe { log(environment, status, category, message) }
}

/// Logger of FMI 2, whose type in C is variadic: `(void*, const char*, int, const char*, const char*, ...)`.
///
/// Stable Rust can call a variadic function and not define one. This function takes the fixed arguments and
/// leaves the others where they are, so a message with `%d` is shown with the mark. It may be called as the
/// variadic one: in the System V ABI of x86-64 (section 3.5.7) and in the procedure call standard of ARM for
/// 64 bits (AAPCS64, section 6.8.2) named arguments of a variadic call are passed as those of any other, the
/// caller takes back the stack, and what is passed besides (in `al`, the number of vector registers used) is
/// of a register that every function may change.
///
/// # Safety
/// As of [`log_three`].
pub(super) unsafe extern "C" fn log_two(
    environment: *mut c_void,
    _instance: *const c_char,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: as in `log_three`.
    unsafe { log(environment, status, category, message) }
}

/// # Safety
/// As of [`log_three`].
unsafe fn log(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: the caller says that it is null or a journal.
    let Some(journal) = (unsafe { environment.cast::<Journal>().as_ref() }) else {
        return; // a library that lost it has nobody to tell
    };
    // SAFETY: the caller says that they are texts.
    let (category, message) = unsafe { (read(category), read(message)) };
    journal.note(status, &category, &message);
}

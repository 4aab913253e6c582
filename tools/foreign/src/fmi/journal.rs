//! Messages of an FMU: each is written to the log, and the last is retained as the reason for an end.
//!
//! The library may call back from any thread. A callback never panics, never calls the library and never trusts a
//! pointer: for an invalid environment (some libraries pass a constant), it uses the journal of the newest instance.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use hil_session::program;
use shared_types::text;

use super::status::Status;

/// Maximum length of a message, in bytes.
const LONGEST: usize = 1024;

/// Journals of the instances of this process, newest last.
static JOURNALS: Mutex<Vec<Weak<Journal>>> = Mutex::new(Vec::new());

/// Receiver of the messages of one instance.
#[derive(Debug, Default)]
pub(super) struct Journal {
    last: Mutex<Option<String>>,
}

impl Journal {
    /// Creates a journal that callbacks find by its address.
    pub(super) fn open() -> Arc<Self> {
        let journal = Arc::default();
        let mut journals = journals();
        journals.retain(|journal| journal.strong_count() > 0);
        journals.push(Arc::downgrade(&journal));
        journal
    }

    /// Returns the journal at an address, or else the newest journal.
    fn at(address: *const c_void) -> Option<Arc<Self>> {
        let journals = journals();
        let is_here = |journal: &&Weak<Self>| journal.as_ptr().cast() == address;
        let here = journals.iter().find(is_here).and_then(Weak::upgrade);
        here.or_else(|| journals.iter().rev().find_map(Weak::upgrade))
    }

    /// Returns the last message about an error.
    pub(super) fn last(&self) -> Option<String> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        last.clone()
    }

    fn note(&self, status: c_int, category: &str, message: &str) {
        let status = Status::of(status);
        let message = text::line(message.trim_end());
        let category = text::line(category);
        program::say(&format!("fmu: {status}: {category}: {message}"));
        if status != Status::Ok && !message.is_empty() {
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            *last = Some(message);
        }
    }
}

fn journals() -> MutexGuard<'static, Vec<Weak<Journal>>> {
    JOURNALS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads a text of the library, truncated to the maximum length.
///
/// # Safety
/// The pointer is null or refers to a zero-terminated text.
unsafe fn read(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: not null, and the caller guarantees a text.
    let text = unsafe { CStr::from_ptr(pointer) };
    let bytes = text.to_bytes();
    String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST)]).into_owned()
}

/// Logger of FMI 3.
///
/// # Safety
/// `category` and `message` are null or zero-terminated texts.
pub(super) unsafe extern "C" fn log_three(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: the library guarantees valid texts.
    unsafe { log(environment, status, category, message, None) }
}

/// Logger of FMI 2, whose type in C is variadic: `(void*, const char*, int, const char*, const char*, ...)`.
///
/// Stable Rust can call a variadic function but cannot define one. This function takes the fixed arguments and ignores
/// the rest, so a message with `%d` is shown with the placeholder. The first variadic argument is in the position of a
/// sixth fixed argument and is shown if the first placeholder is `%s`, which suffices for many tools. If the caller
/// passes only five, that position contains an arbitrary number, so the number is treated as an address only for that
/// placeholder, and read by a system call that fails for invalid addresses. The function may be called as a variadic
/// one: in the System V ABI of x86-64 (section 3.5.7) and in the procedure call standard of ARM for 64 bits (AAPCS64,
/// section 6.8.2), named arguments of a variadic call are passed like those of any other, the caller cleans up the
/// stack, and the additional information (in `al`, the number of vector registers used) is passed in a caller-saved
/// register.
///
/// # Safety
/// See [`log_three`].
pub(super) unsafe extern "C" fn log_two(
    environment: *mut c_void,
    _instance: *const c_char,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
    first: usize,
) {
    // SAFETY: as in `log_three`.
    unsafe { log(environment, status, category, message, Some(first)) }
}

/// # Safety
/// See [`log_three`].
unsafe fn log(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
    first: Option<usize>,
) {
    let Some(journal) = Journal::at(environment) else {
        return;
    };
    // SAFETY: the caller guarantees texts.
    let (category, mut message) = unsafe { (read(category), read(message)) };
    if let Some(address) = first
        && let Some(at) = first_text_mark(&message)
        && let Some(text) = text_at(address)
    {
        message.replace_range(at..at + 2, &text);
    }
    journal.note(status, &category, &message);
}

/// Finds the first placeholder of a format, if it is `%s`.
fn first_text_mark(format: &str) -> Option<usize> {
    let mut from = 0;
    while let Some(at) = format[from..].find('%').map(|at| from + at) {
        match format.as_bytes().get(at + 1) {
            Some(b'%') => from = at + 2,
            Some(b's') => return Some(at),
            _ => return None,
        }
    }
    None
}

/// Reads the text at an address of this process, truncated to the maximum length; `None` if there is none. The kernel
/// copies the text, so an invalid address causes no crash.
fn text_at(address: usize) -> Option<String> {
    /// Smallest page size: readable memory ends at a page boundary.
    const PAGE: usize = 4096;
    let mut bytes = Vec::new();
    while bytes.len() < LONGEST {
        let at = address.checked_add(bytes.len())?;
        let mut part = [0_u8; PAGE];
        let count = (PAGE - at % PAGE).min(LONGEST - bytes.len());
        let local = libc::iovec {
            iov_base: part.as_mut_ptr().cast(),
            iov_len: count,
        };
        let remote = libc::iovec {
            iov_base: at as *mut c_void,
            iov_len: count,
        };
        // SAFETY: the kernel writes at most `count` bytes to `part`, which has that size, and checks the other
        // address.
        let read = unsafe {
            libc::process_vm_readv(libc::getpid(), &raw const local, 1, &raw const remote, 1, 0)
        };
        if usize::try_from(read) != Ok(count) {
            return None;
        }
        match part[..count].iter().position(|byte| *byte == 0) {
            Some(end) => {
                bytes.extend(&part[..end]);
                break;
            }
            None => bytes.extend(&part[..count]),
        }
    }
    Some(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use std::ffi::CString;

    use super::*;

    /// Returns the message that a journal retains for these arguments.
    fn last_message(format: &str, first: usize) -> String {
        let journal = Journal::open();
        let format = CString::new(format).expect("text");
        // SAFETY: valid texts, and a number that need not be an address.
        unsafe {
            log_two(
                Arc::as_ptr(&journal).cast_mut().cast(),
                c"model".as_ptr(),
                3,
                c"error".as_ptr(),
                format.as_ptr(),
                first,
            );
        }
        journal.last().expect("an error is kept")
    }

    #[test]
    fn the_first_text_argument_of_a_message_is_shown() {
        let text = CString::new("the solver gives up").expect("text");
        let address = text.as_ptr() as usize;
        assert_eq!(last_message("%s", address), "the solver gives up");
        assert_eq!(
            last_message("at 100%%: %s after %d steps", address),
            "at 100%%: the solver gives up after %d steps"
        );
        // Only if the first placeholder is a text.
        assert_eq!(last_message("%d: %s", address), "%d: %s");
        assert_eq!(last_message("no mark", address), "no mark");
        assert_eq!(last_message("100%", address), "100%");
        let long = CString::new("x".repeat(3 * LONGEST)).expect("text");
        assert_eq!(
            last_message("%s", long.as_ptr() as usize),
            "x".repeat(LONGEST)
        );
    }

    #[test]
    fn a_message_without_text_gives_no_reason() {
        let journal = Journal::open();
        journal.note(3, "error", "the pump cavitates");
        journal.note(3, "error", " \n");
        assert_eq!(journal.last().as_deref(), Some("the pump cavitates"));
        let silent = Journal::open();
        silent.note(3, "error", "");
        assert_eq!(silent.last(), None);
    }

    #[test]
    fn an_invalid_address_leaves_the_placeholder_without_a_crash() {
        for address in [0, 1, usize::MAX, usize::MAX - 4095, 1 << 63] {
            assert_eq!(last_message("%s", address), "%s");
        }
    }
}

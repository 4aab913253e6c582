//! Messages of an FMU: written to the log as they come, and the last one kept for the reason of an end.
//!
//! The library calls back here, from any thread. A callback never panics, never calls the library and never
//! believes that a pointer is one: a library that lost its environment, and some pass a constant, writes to the journal
//! of the instance that was made last.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use shared_types::{program, text};

use super::status::Status;

/// Most bytes of a message that is written or kept.
const LONGEST: usize = 1024;

/// Journals of the instances of this process, the newest last.
static JOURNALS: Mutex<Vec<Weak<Journal>>> = Mutex::new(Vec::new());

/// Place that the messages of one instance come to.
#[derive(Debug, Default)]
pub(super) struct Journal {
    last: Mutex<Option<String>>,
}

impl Journal {
    /// Makes a journal that the callbacks find by its address.
    pub(super) fn open() -> Arc<Self> {
        let journal = Arc::default();
        let mut journals = journals();
        journals.retain(|journal| journal.strong_count() > 0);
        journals.push(Arc::downgrade(&journal));
        journal
    }

    /// The journal at an address, else the newest one.
    fn at(address: *const c_void) -> Option<Arc<Self>> {
        let journals = journals();
        let is_here = |journal: &&Weak<Self>| journal.as_ptr().cast() == address;
        let here = journals.iter().find(is_here).and_then(Weak::upgrade);
        here.or_else(|| journals.iter().rev().find_map(Weak::upgrade))
    }

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
        if status != Status::Ok && !message.is_empty() {
            let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            *last = Some(message);
        }
    }
}

fn journals() -> MutexGuard<'static, Vec<Weak<Journal>>> {
    JOURNALS.lock().unwrap_or_else(PoisonError::into_inner)
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
/// `category` and `message` are texts or null.
pub(super) unsafe extern "C" fn log_three(
    environment: *mut c_void,
    status: c_int,
    category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: texts are the library's to keep sound.
    unsafe { log(environment, status, category, message, None) }
}

/// Logger of FMI 2, whose type in C is variadic: `(void*, const char*, int, const char*, const char*, ...)`.
///
/// Stable Rust can call a variadic function and not define one. This function takes the fixed arguments and
/// leaves the others where they are, so a message with `%d` is shown with the mark. The first of the others stands
/// where a sixth fixed argument stands, and is shown if the first mark is `%s`: many tools say everything that way.
/// A caller that passes five leaves any number there, so it is an address only by that mark, and read by a system
/// call that fails where nothing is. The function may be called as the variadic one: in the System V ABI of x86-64 (section 3.5.7) and in the procedure call standard of ARM for
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
    first: usize,
) {
    // SAFETY: as in `log_three`.
    unsafe { log(environment, status, category, message, Some(first)) }
}

/// # Safety
/// As of [`log_three`].
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
    // SAFETY: the caller says that they are texts.
    let (category, mut message) = unsafe { (read(category), read(message)) };
    if let Some(address) = first
        && let Some(at) = first_text_mark(&message)
        && let Some(text) = text_at(address)
    {
        message.replace_range(at..at + 2, &text);
    }
    journal.note(status, &category, &message);
}

/// Place of the first mark of a format, if that is `%s`.
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

/// The text at an address of this process, cut to a bounded length; `None` if there is none. The kernel reads it, so an
/// address that is none is no crash.
fn text_at(address: usize) -> Option<String> {
    /// Size of the smallest page: what is readable ends where one does.
    const PAGE: usize = 4096;
    let mut bytes = Vec::new();
    while bytes.len() < LONGEST {
        let at = address.checked_add(bytes.len())?;
        let mut part = [0_u8; PAGE];
        let count = (PAGE - at % PAGE).min(LONGEST - bytes.len());
        let here = libc::iovec {
            iov_base: part.as_mut_ptr().cast(),
            iov_len: count,
        };
        let there = libc::iovec {
            iov_base: at as *mut c_void,
            iov_len: count,
        };
        // SAFETY: the kernel writes `count` bytes at most to `part`, which has as many, and checks the other address.
        let read = unsafe {
            libc::process_vm_readv(libc::getpid(), &raw const here, 1, &raw const there, 1, 0)
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

    /// The message that a journal keeps of these arguments.
    fn kept(format: &str, first: usize) -> String {
        let journal = Journal::open();
        let format = CString::new(format).expect("text");
        // SAFETY: texts, and a number that need not be an address.
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
    fn a_message_by_its_first_text_argument_is_shown() {
        let text = CString::new("the solver gives up").expect("text");
        let address = text.as_ptr() as usize;
        assert_eq!(kept("%s", address), "the solver gives up");
        assert_eq!(
            kept("at 100%%: %s after %d steps", address),
            "at 100%%: the solver gives up after %d steps"
        );
        // Only where the first argument is a text.
        assert_eq!(kept("%d: %s", address), "%d: %s");
        assert_eq!(kept("no mark", address), "no mark");
        assert_eq!(kept("100%", address), "100%");
        let long = CString::new("x".repeat(3 * LONGEST)).expect("text");
        assert_eq!(kept("%s", long.as_ptr() as usize), "x".repeat(LONGEST));
    }

    #[test]
    fn a_message_without_a_text_is_no_reason() {
        let journal = Journal::open();
        journal.note(3, "error", "the pump cavitates");
        journal.note(3, "error", " \n");
        assert_eq!(journal.last().as_deref(), Some("the pump cavitates"));
        let silent = Journal::open();
        silent.note(3, "error", "");
        assert_eq!(silent.last(), None);
    }

    #[test]
    fn an_address_where_nothing_is_leaves_the_mark_and_is_no_crash() {
        for address in [0, 1, usize::MAX, usize::MAX - 4095, 1 << 63] {
            assert_eq!(kept("%s", address), "%s");
        }
    }
}

//! Instantiation for both versions of the standard. Parameters and signals are unknown here.

use std::ffi::{CString, c_int, c_void};
use std::path::Path;
use std::ptr::null;

use shared_types::describe::Invalid;

use crate::crash::calling;
use crate::float_modes;
use crate::fmi::Model;
use crate::fmi::journal::{Journal, log_three, log_two};
use crate::fmi::library::{CallbacksTwo, Functions, Handle, Own};

/// FMU type of co-simulation in FMI 2.
const CO_SIMULATION: c_int = 1;

/// Creates an instance; also returns its callbacks, if the library keeps a pointer to them.
pub(super) fn instantiate(
    model: &Model,
    functions: &Functions,
    resources: &Path,
    journal: &Journal,
) -> Result<(Handle, Option<Box<CallbacksTwo>>), Invalid> {
    let text = |text: &str| {
        let result = CString::new(text);
        result.map_err(|_| Invalid(format!("{text:?} contains a zero byte")))
    };
    let described = &model.description;
    let (name, token) = (text(&described.name)?, text(&described.token)?);
    let environment = std::ptr::from_ref(journal).cast_mut().cast();
    // All messages are enabled only if the library does not classify them.
    let logs = !described
        .categories
        .iter()
        .any(|name| name.starts_with("logStatus"));
    let mut callbacks = None;
    let handle = match functions.own {
        Own::Two { instantiate, .. } => {
            let place = text(&location(resources))?;
            let callbacks = callbacks.insert(Box::new(CallbacksTwo {
                logger: log_two,
                allocate: calloc,
                free,
                step_finished: None,
                environment,
            }));
            let _call = calling(&"Instantiate");
            // SAFETY: all texts live until the call returns; the callbacks and the journal live until the instance is
            // freed.
            unsafe {
                instantiate(
                    name.as_ptr(),
                    CO_SIMULATION,
                    token.as_ptr(),
                    place.as_ptr(),
                    &raw const **callbacks,
                    0,
                    c_int::from(logs),
                )
            }
        }
        Own::Three { instantiate, .. } => {
            // The standard requires a trailing separator.
            let place = text(&format!("{}/", resources.display()))?;
            let _call = calling(&"InstantiateCoSimulation");
            // SAFETY: as above. Event mode, early return and intermediate update are disabled.
            unsafe {
                instantiate(
                    name.as_ptr(),
                    token.as_ptr(),
                    place.as_ptr(),
                    false,
                    logs,
                    false,
                    false,
                    null(),
                    0,
                    environment,
                    log_three,
                    null(),
                )
            }
        }
    };
    float_modes::settle("Instantiate");
    if handle.is_null() {
        let message = journal
            .last()
            .map_or(String::new(), |message| format!(": {message}"));
        return Err(Invalid(format!(
            "the FMU refuses to be instantiated{message}"
        )));
    }
    Ok((handle, callbacks))
}

/// Returns the URI of a folder, as FMI 2 expects it.
fn location(folder: &Path) -> String {
    let mut uri = String::from("file://");
    for byte in folder.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' => {
                uri.push(char::from(*byte));
            }
            other => uri.push_str(&format!("%{other:02X}")),
        }
    }
    uri
}

// FMI 2 lets a library use the importer's allocator. It is that of C, so memory may be freed by either side.
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(place: *mut c_void);
}

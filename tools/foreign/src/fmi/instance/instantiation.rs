//! Instances as the two versions of the standard make them. Nothing here knows parameters or signals.

use std::ffi::{CString, c_int, c_void};
use std::path::Path;
use std::ptr::null;

use shared_types::describe::Invalid;

use crate::crash::calling;
use crate::float_modes;
use crate::fmi::Model;
use crate::fmi::journal::{Journal, log_three, log_two};
use crate::fmi::library::{CallbacksTwo, Functions, Handle, Own};

/// Number of co-simulation among the types of an FMU, in FMI 2.
const CO_SIMULATION: c_int = 1;

/// Makes an instance; gives its callbacks too, where the library keeps a pointer to them.
pub(super) fn instantiate(
    model: &Model,
    functions: &Functions,
    resources: &Path,
    journal: &Journal,
) -> Result<(Handle, Option<Box<CallbacksTwo>>), Invalid> {
    let text = |text: &str| {
        let told = CString::new(text);
        told.map_err(|_| Invalid(format!("{text:?} has a zero in it")))
    };
    let described = &model.description;
    let (name, token) = (text(&described.name)?, text(&described.token)?);
    let environment = std::ptr::from_ref(journal).cast_mut().cast();
    // Messages of all kinds only where the library does not tell them apart.
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
            // SAFETY: all texts live until the call is over; the callbacks and the journal live until the
            // instance is freed.
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
            // As the standard has it, with a separator at the end.
            let place = text(&format!("{}/", resources.display()))?;
            let _call = calling(&"InstantiateCoSimulation");
            // SAFETY: as above. Neither event mode, early return nor intermediate update.
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
        let said = journal
            .last()
            .map_or(String::new(), |said| format!(": {said}"));
        return Err(Invalid(format!("the FMU refuses to be instantiated{said}")));
    }
    Ok((handle, callbacks))
}

/// Place of a folder as FMI 2 has it, a URI.
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

// The allocator that FMI 2 lets a library ask the importer for is that of C, whichever of the two frees.
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(place: *mut c_void);
}

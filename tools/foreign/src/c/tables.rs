//! Tables of C as those of the framework: read once, before anything starts.

use std::ffi::{CStr, c_char};
use std::slice;

use shared_types::describe::Invalid;
use shared_types::layout::MOST_FIELDS;
use shared_types::table::Field;

use super::interface::{API, FAULTABLE, Parameter, Restore, Rows, Save, Signal, TUNABLE};
use super::memory::{MOST_BYTES, Saving};

/// Refuses a program that was compiled with another header, or whose memory has no possible size.
///
/// # Errors
/// Both versions, or the size.
pub(super) fn check_form(api: u32, size: usize) -> Result<(), Invalid> {
    if api != API {
        return Err(Invalid(format!(
            "`api` is {api}, and this library speaks {API}: set it to HIL_API and compile with the header of the library"
        )));
    }
    if size > MOST_BYTES {
        return Err(Invalid(format!(
            "`size` is {size} bytes, and {MOST_BYTES} is the most"
        )));
    }
    Ok(())
}

/// The callback of a name.
///
/// # Errors
/// If it is missing.
pub(super) fn required<T>(callback: Option<T>, name: &str) -> Result<T, Invalid> {
    callback.ok_or_else(|| Invalid(format!("the callback `{name}` is missing")))
}

/// Takes the functions for checkpoints: all or none.
///
/// # Errors
/// If a part is missing.
pub(super) fn saving(
    size: usize,
    save: Option<Save>,
    restore: Option<Restore>,
) -> Result<Option<Saving>, Invalid> {
    match (save, restore) {
        (None, None) if size == 0 => Ok(None),
        (Some(save), Some(restore)) if size <= MOST_BYTES => Ok(Some(Saving {
            size,
            save,
            restore,
        })),
        _ => Err(Invalid(
            "`saved_size`, `save` and `restore` belong together: all three or none".into(),
        )),
    }
}

/// A text.
///
/// # Safety
/// It is null or ends with a zero.
///
/// # Errors
/// If it is null or no UTF-8.
pub(super) unsafe fn text(text: *const c_char, what: &str) -> Result<String, Invalid> {
    if text.is_null() {
        return Err(Invalid(format!("{what} is a null pointer")));
    }
    // SAFETY: it is not null, so it ends with a zero.
    let text = unsafe { CStr::from_ptr(text) };
    let text = text.to_str();
    (text.map(Into::into)).map_err(|_| Invalid(format!("{what} is not UTF-8")))
}

/// The rows of a table.
///
/// # Safety
/// If the pointer is not null it points to N rows.
unsafe fn rows<'t, T>(table: &'t Rows<T>, name: &str) -> Result<&'t [T], Invalid> {
    let count = table.count;
    if count == 0 {
        return Ok(&[]);
    }
    if table.rows.is_null() {
        return Err(Invalid(format!(
            "`{name}` has {count} rows at a null pointer"
        )));
    }
    if count > MOST_FIELDS {
        return Err(Invalid(format!(
            "`{name}` has {count} rows, and {MOST_FIELDS} is the most"
        )));
    }
    // SAFETY: the caller says so, and so many rows are far below the largest slice.
    Ok(unsafe { slice::from_raw_parts(table.rows, count) })
}

/// The columns of a table of signals.
///
/// # Safety
/// The table is one of `hil.h`: N rows, each text null or with a zero at its end.
///
/// # Errors
/// The row that has a null pointer or a text that is no UTF-8.
pub(super) unsafe fn signals(table: &Rows<Signal>, name: &str) -> Result<Vec<Field>, Invalid> {
    // SAFETY: the caller says so.
    let rows = unsafe { rows(table, name) }?;
    let field = |(number, row): (usize, &Signal)| {
        // SAFETY: the caller says so of the texts of each row.
        let field = unsafe { column((row.name, row.unit, row.description), name, number) }?;
        Ok(in_range(field, row.min, row.max))
    };
    rows.iter().enumerate().map(field).collect()
}

/// The columns of a table of parameters.
///
/// # Safety
/// As [`signals`].
///
/// # Errors
/// As [`signals`], and a flag that is none.
pub(super) unsafe fn parameters(
    table: &Rows<Parameter>,
    name: &str,
) -> Result<Vec<Field>, Invalid> {
    // SAFETY: the caller says so.
    let rows = unsafe { rows(table, name) }?;
    let field = |(number, row): (usize, &Parameter)| {
        // SAFETY: the caller says so of the texts of each row.
        let field = unsafe { column((row.name, row.unit, row.description), name, number) }?;
        let (flags, shown) = (row.flags, &field.name);
        if flags & !(FAULTABLE | TUNABLE) != 0 {
            return Err(Invalid(format!(
                "`{shown}` of `{name}` has flags that are none: {flags}"
            )));
        }
        Ok(Field {
            default: Some(row.initial),
            faultable: flags & FAULTABLE != 0,
            tunable: flags & TUNABLE != 0,
            ..in_range(field, row.min, row.max)
        })
    };
    rows.iter().enumerate().map(field).collect()
}

/// A column without default and range.
///
/// # Safety
/// Each text is null or ends with a zero.
unsafe fn column(
    (name, unit, description): (*const c_char, *const c_char, *const c_char),
    table: &str,
    number: usize,
) -> Result<Field, Invalid> {
    let of = |what: &str| format!("the {what} of row {} of `{table}`", number + 1);
    // SAFETY: the caller says so of all three.
    let (name, unit, description) = unsafe {
        (
            text(name, &of("name"))?,
            text(unit, &of("unit"))?,
            text(description, &of("description"))?,
        )
    };
    Ok(Field::signal(&name, &unit, &description))
}

/// A column with its range; both ends 0 are none.
fn in_range(field: Field, min: f64, max: f64) -> Field {
    match (min, max) {
        (0.0, 0.0) => field,
        (min, max) => Field { min, max, ..field },
    }
}

//! Conversion of the tables of a C program to those of the framework, once, before anything starts.

use std::ffi::{CStr, c_char};
use std::slice;

use shared_types::describe::Invalid;
use shared_types::layout::MOST_FIELDS;
use shared_types::table::Field;

use super::interface::{
    API, API_WITHOUT_QUALITY, API_WITHOUT_STATE, FAULTABLE, Parameter, Restore, Rows, Save, Signal,
    TUNABLE, TakeRow, WriteRow,
};
use super::memory::{MOST_BYTES, Naming, Saving};

/// Refuses a program that was compiled with another header version, or that requests too much memory.
///
/// # Errors
/// If the version or the size is invalid; the message contains both values.
pub(super) fn check_form(api: u32, size: usize) -> Result<(), Invalid> {
    if ![API_WITHOUT_QUALITY, API_WITHOUT_STATE, API].contains(&api) {
        return Err(Invalid(format!(
            "`api` is {api}, but this library supports {API}: set it to HIL_API and compile with the library's header"
        )));
    }
    if size > MOST_BYTES {
        return Err(Invalid(format!(
            "`size` is {size} bytes, above the maximum of {MOST_BYTES}"
        )));
    }
    Ok(())
}

/// Unwraps a callback.
///
/// # Errors
/// If the callback is missing; the message names it.
pub(super) fn required<T>(callback: Option<T>, name: &str) -> Result<T, Invalid> {
    callback.ok_or_else(|| Invalid(format!("the callback `{name}` is missing")))
}

/// Returns the callbacks for checkpoints, all of which must be given or none.
///
/// # Errors
/// If some are given and others are missing.
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
            "`saved_size`, `save` and `restore` belong together: set all three or none".into(),
        )),
    }
}

/// Returns the callbacks for the named numbers of a state, which belong to its table.
///
/// # Errors
/// If some are given and others are missing, or the state cannot be saved.
pub(super) fn naming(
    state: &[Field],
    (tell, take): (Option<WriteRow>, Option<TakeRow>),
    saving: Option<Saving>,
) -> Result<Option<Naming>, Invalid> {
    match (tell, take) {
        (None, None) if state.is_empty() => Ok(None),
        (Some(tell), Some(take)) if saving.is_some() => Ok(Some(Naming {
            count: state.len(),
            tell,
            take,
        })),
        _ => Err(Invalid(
            "`state`, `tell_state` and `take_state` belong together, with `save` and `restore`: set all of them or none of the three".into(),
        )),
    }
}

/// Copies a C text.
///
/// # Safety
/// The text is null or zero-terminated.
///
/// # Errors
/// If the text is null or not UTF-8.
pub(super) unsafe fn text(text: *const c_char, what: &str) -> Result<String, Invalid> {
    if text.is_null() {
        return Err(Invalid(format!("{what} is a null pointer")));
    }
    // SAFETY: it is not null, so it is zero-terminated.
    let text = unsafe { CStr::from_ptr(text) };
    let text = text.to_str();
    (text.map(Into::into)).map_err(|_| Invalid(format!("{what} is not UTF-8")))
}

/// Returns the rows of a table.
///
/// # Safety
/// If the pointer is not null, it points to the given number of rows.
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
            "`{name}` has {count} rows, above the maximum of {MOST_FIELDS}"
        )));
    }
    // SAFETY: guaranteed by the caller; the number of rows is far below the limit of slices.
    Ok(unsafe { slice::from_raw_parts(table.rows, count) })
}

/// Converts the columns of a table of signals.
///
/// # Safety
/// The table is valid as defined by `hil.h`: it has the given number of rows, and each text is null or
/// zero-terminated.
///
/// # Errors
/// If a row has a null pointer or a text that is not UTF-8.
pub(super) unsafe fn signals(table: &Rows<Signal>, name: &str) -> Result<Vec<Field>, Invalid> {
    // SAFETY: guaranteed by the caller.
    let rows = unsafe { rows(table, name) }?;
    let field = |(number, row): (usize, &Signal)| {
        // SAFETY: the caller guarantees the texts of each row.
        let field = unsafe { column((row.name, row.unit, row.description), name, number) }?;
        Ok(in_range(field, row.min, row.max))
    };
    rows.iter().enumerate().map(field).collect()
}

/// Adds the start values of commands; NaN means none.
///
/// # Safety
/// The pointer is null or points to as many numbers as there are commands.
pub(super) unsafe fn starts(commands: Vec<Field>, values: *const f64) -> Vec<Field> {
    if values.is_null() || commands.is_empty() {
        return commands;
    }
    // SAFETY: guaranteed by the caller; the number of commands is far below the limit of slices.
    let values = unsafe { slice::from_raw_parts(values, commands.len()) };
    let with_start = |(field, value): (Field, &f64)| Field {
        default: Some(*value).filter(|value| !value.is_nan()),
        ..field
    };
    commands.into_iter().zip(values).map(with_start).collect()
}

/// Converts the columns of a table of parameters.
///
/// # Safety
/// See [`signals`].
///
/// # Errors
/// See [`signals`]; also for unknown flags.
pub(super) unsafe fn parameters(
    table: &Rows<Parameter>,
    name: &str,
) -> Result<Vec<Field>, Invalid> {
    // SAFETY: guaranteed by the caller.
    let rows = unsafe { rows(table, name) }?;
    let field = |(number, row): (usize, &Parameter)| {
        // SAFETY: the caller guarantees the texts of each row.
        let field = unsafe { column((row.name, row.unit, row.description), name, number) }?;
        let (flags, parameter) = (row.flags, &field.name);
        if flags & !(FAULTABLE | TUNABLE) != 0 {
            return Err(Invalid(format!(
                "`{parameter}` of `{name}` has unknown flags: {flags}"
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

/// Converts a column without default and range.
///
/// # Safety
/// Each text is null or zero-terminated.
unsafe fn column(
    (name, unit, description): (*const c_char, *const c_char, *const c_char),
    table: &str,
    number: usize,
) -> Result<Field, Invalid> {
    let of = |what: &str| format!("the {what} of row {} of `{table}`", number + 1);
    // SAFETY: the caller guarantees all three.
    let (name, unit, description) = unsafe {
        (
            text(name, &of("name"))?,
            text(unit, &of("unit"))?,
            text(description, &of("description"))?,
        )
    };
    Ok(Field::signal(&name, &unit, &description))
}

/// Adds a range to a column, unless both ends are 0.
fn in_range(field: Field, min: f64, max: f64) -> Field {
    match (min, max) {
        (0.0, 0.0) => field,
        (min, max) => Field { min, max, ..field },
    }
}

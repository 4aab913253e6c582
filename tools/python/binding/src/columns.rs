//! Columns of a recording, copied from its chunks into memory of Python by several threads.

use std::fs::File;
use std::mem::MaybeUninit;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use hil_console::terminal::interruption::Interruption;
use hil_recording::reader::{Buffers, ColumnReader};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use rustix::mm::{Advice, madvise};

use crate::parallel::in_parallel;

/// Size of a huge page, in bytes.
const HUGE_PAGE: usize = 2 << 20;

/// A value: the bytes of a word.
type Value = MaybeUninit<[u8; 8]>;

/// Columns, or the place of a damaged chunk with the reason.
#[derive(IntoPyObject)]
pub(crate) enum Columns<'py> {
    Values(Bound<'py, PyByteArray>),
    Damaged((usize, String)),
}

/// Reads the words at these places of all records, one column after the other. Each chunk has an offset, a length and
/// a number of records; the records have `words` words on a channel.
#[pyfunction]
pub(crate) fn read_columns<'py>(
    py: Python<'py>,
    path: PathBuf,
    form: (u16, usize),
    places: Vec<usize>,
    chunks: Vec<(u64, usize, usize)>,
    workers: usize,
) -> PyResult<Columns<'py>> {
    let (channel, words) = form;
    if let Some(place) = places.iter().find(|place| **place >= words) {
        return Err(PyValueError::new_err(format!(
            "a record of {words} words has no word {place}"
        )));
    }
    let records: usize = chunks.iter().map(|(_, _, records)| records).sum();
    let values = records.checked_mul(places.len());
    let bytes =
        values.and_then(|values| isize::try_from(values.checked_mul(size_of::<Value>())?).ok());
    let (Some(values), Some(bytes)) = (values, bytes) else {
        return Err(PyMemoryError::new_err(format!("{records} records")));
    };
    // SAFETY: without content to copy, its bytes are not initialised; nobody but this function has them, and it returns
    // the object only after it has written all of them.
    let array = unsafe {
        let new = ffi::PyByteArray_FromStringAndSize(std::ptr::null(), bytes);
        Bound::from_owned_ptr_or_err(py, new)?.cast_into::<PyByteArray>()?
    };
    prefer_huge_pages(array.data(), bytes.unsigned_abs());
    // SAFETY: the object has this many bytes, and nothing else uses or moves them before it is returned.
    let memory = unsafe { std::slice::from_raw_parts_mut(array.data().cast::<Value>(), values) };
    let columns = parts(memory, &chunks, records);
    let reader = ColumnReader::new(File::open(path)?, channel, words, &places);
    let idle: Mutex<Vec<Buffers>> = Mutex::default();
    let locked = || idle.lock().unwrap_or_else(PoisonError::into_inner);
    let read = |place: usize| {
        let (at, bytes, _) = chunks[place];
        let mut buffers = locked().pop().unwrap_or_default();
        let mut columns = columns[place]
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let result = reader.read(
            (at, bytes),
            &mut columns,
            |value, word| {
                value.write(word);
            },
            &mut buffers,
        );
        locked().push(buffers);
        Ok(result.err())
    };
    let errors = in_parallel(py, chunks.len(), workers, &Interruption::default(), read)?;
    let mut errors = errors.into_iter().enumerate();
    let first = errors.find_map(|(place, error)| Some((place, error?)));
    Ok(first.map_or(Columns::Values(array), Columns::Damaged))
}

/// Asks for memory in huge pages, as numpy does for its arrays: its first use takes longer than all else otherwise.
fn prefer_huge_pages(memory: *mut u8, bytes: usize) {
    let skipped = memory.addr().next_multiple_of(HUGE_PAGE) - memory.addr();
    let pages = bytes.saturating_sub(skipped) / HUGE_PAGE;
    if pages > 0 {
        // SAFETY: the range is inside of the memory, whose content such advice does not change.
        let _unless_there_are_none = unsafe {
            let first = memory.add(skipped).cast();
            madvise(first, pages * HUGE_PAGE, Advice::LinuxHugepage)
        };
    }
}

/// Parts of all columns that belong to a chunk.
type Parts<'a> = Mutex<Vec<&'a mut [Value]>>;

/// Divides columns of all records among the chunks.
fn parts<'a>(
    memory: &'a mut [Value],
    chunks: &[(u64, usize, usize)],
    records: usize,
) -> Vec<Parts<'a>> {
    let mut parts: Vec<Vec<&mut [Value]>> = chunks.iter().map(|_| Vec::new()).collect();
    for mut column in memory.chunks_exact_mut(records.max(1)) {
        for (part, (_, _, count)) in parts.iter_mut().zip(chunks) {
            part.extend(column.split_off_mut(..*count));
        }
    }
    parts.into_iter().map(Mutex::new).collect()
}

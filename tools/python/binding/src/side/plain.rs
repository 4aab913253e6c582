//! Plain values of Python as bytes: `None`, `bool`, `int`, `float`, `str`, `bytes`, and lists, tuples and dictionaries of
//! them.
//!
//! Every float keeps its bits. Reading such bytes runs no code, unlike a pickle.

use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use serde::{Deserialize, Serialize};

/// Maximum depth of nested values.
const DEEPEST: usize = 32;

/// Part of a value; a container is followed by its parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Word {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    Bytes(Vec<u8>),
    List(usize),
    Tuple(usize),
    /// Pairs of key and value.
    Dict(usize),
}

/// Returns a value as words.
///
/// # Errors
/// If it is no plain value.
pub(super) fn words(value: &Bound<'_, PyAny>) -> PyResult<Vec<Word>> {
    let mut words = Vec::new();
    append(value, &mut words, 0)?;
    Ok(words)
}

fn append(value: &Bound<'_, PyAny>, words: &mut Vec<Word>, depth: usize) -> PyResult<()> {
    if depth > DEEPEST {
        let text = format!("`save` returned a value nested deeper than {DEEPEST} levels");
        return Err(PyValueError::new_err(text));
    }
    let mut all = |items: Vec<Bound<'_, PyAny>>, word: Word| {
        words.push(word);
        (items.iter()).try_for_each(|item| append(item, words, depth + 1))
    };
    if let Ok(list) = value.cast::<PyList>() {
        return all(list.iter().collect(), Word::List(list.len()));
    }
    if let Ok(tuple) = value.cast::<PyTuple>() {
        return all(tuple.iter().collect(), Word::Tuple(tuple.len()));
    }
    if let Ok(dict) = value.cast::<PyDict>() {
        let pairs = dict.iter().flat_map(|(key, value)| [key, value]);
        return all(pairs.collect(), Word::Dict(dict.len()));
    }
    words.push(scalar(value)?);
    Ok(())
}

fn scalar(value: &Bound<'_, PyAny>) -> PyResult<Word> {
    Ok(if value.is_none() {
        Word::None
    } else if value.is_instance_of::<PyBool>() {
        Word::Bool(value.extract()?)
    } else if value.is_instance_of::<PyInt>() {
        Word::Int(value.extract()?)
    } else if let Ok(float) = value.cast::<PyFloat>() {
        Word::Float(float.value())
    } else if value.is_instance_of::<PyString>() {
        Word::Text(value.extract()?)
    } else if value.is_instance_of::<PyBytes>() {
        Word::Bytes(value.extract()?)
    } else {
        let kind = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!(
            "`save` returned a {kind}; it must return None, numbers, texts, bytes, or lists, tuples and dictionaries of them"
        )));
    })
}

/// Returns the value of words.
///
/// # Errors
/// If the words are not those of one value.
pub(super) fn value(py: Python<'_>, words: Vec<Word>) -> PyResult<Bound<'_, PyAny>> {
    let mut words = words.into_iter();
    let value = next(py, &mut words, 0)?;
    match words.next() {
        None => Ok(value),
        Some(_) => Err(damaged()),
    }
}

fn next<'py>(
    py: Python<'py>,
    words: &mut impl Iterator<Item = Word>,
    depth: usize,
) -> PyResult<Bound<'py, PyAny>> {
    if depth > DEEPEST {
        return Err(damaged());
    }
    let word = words.next().ok_or_else(damaged)?;
    let mut items = |count: usize| -> PyResult<Vec<Bound<'py, PyAny>>> {
        (0..count).map(|_| next(py, words, depth + 1)).collect()
    };
    Ok(match word {
        Word::None => py.None().into_bound(py),
        Word::Bool(value) => value.into_bound_py_any(py)?,
        Word::Int(value) => value.into_bound_py_any(py)?,
        Word::Float(value) => value.into_bound_py_any(py)?,
        Word::Text(text) => text.into_bound_py_any(py)?,
        Word::Bytes(bytes) => PyBytes::new(py, &bytes).into_any(),
        Word::List(count) => PyList::new(py, items(count)?)?.into_any(),
        Word::Tuple(count) => PyTuple::new(py, items(count)?)?.into_any(),
        Word::Dict(count) => {
            let dict = PyDict::new(py);
            for _ in 0..count {
                let [key, value] = <[_; 2]>::try_from(items(2)?).map_err(|_| damaged())?;
                dict.set_item(key, value)?;
            }
            dict.into_any()
        }
    })
}

fn damaged() -> PyErr {
    PyValueError::new_err("the saved state is damaged")
}

//! Tables of a class: its columns, and rows as instances of the dataclass.

use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyIterator, PyString, PyTuple};
use shared_types::quality::SignalSet;
use shared_types::table::{Field, nearest};

use super::failure;

/// Table whose rows are instances of a dataclass.
pub(super) struct Rows {
    /// The dataclass; `None` for a table without columns that has none.
    class: Option<Py<PyAny>>,
    /// Name of the dataclass.
    title: String,
    /// Columns.
    pub(super) fields: Vec<Field>,
    names: Vec<Py<PyString>>,
    /// `true` if an instance may have attributes that are no columns.
    is_open: bool,
}

impl Rows {
    /// Reads a table of a declaration.
    pub(super) fn of(table: &Bound<'_, PyAny>) -> PyResult<Self> {
        let row = table.getattr("row")?;
        let columns = table.getattr("columns")?;
        let mut fields = Vec::new();
        for column in columns.try_iter()? {
            fields.push(field(&column?)?);
        }
        let name = |field: &Field| PyString::intern(table.py(), &field.name).unbind();
        Ok(Self {
            title: match row.is_none() {
                true => String::new(),
                false => row.getattr("__qualname__")?.extract()?,
            },
            class: (!row.is_none()).then(|| row.unbind()),
            names: fields.iter().map(name).collect(),
            fields,
            is_open: table.getattr("is_open")?.extract()?,
        })
    }

    /// Reads a table of a declaration by its role.
    pub(super) fn of_role(side: &Bound<'_, PyAny>, role: &str) -> PyResult<Self> {
        Self::of(&side.getattr("tables")?.get_item(role)?)
    }

    /// Returns a row as an instance; `None` of Python if the table has no dataclass.
    #[inline]
    pub(super) fn instance<'py>(
        &self,
        py: Python<'py>,
        row: &[f64],
    ) -> PyResult<Bound<'py, PyAny>> {
        match &self.class {
            Some(class) => class.bind(py).call1(PyTuple::new(
                py,
                row.iter().map(|value| PyFloat::new(py, *value)),
            )?),
            None => Ok(py.None().into_bound(py)),
        }
    }

    /// Writes the row of an instance that a method returned.
    #[inline]
    pub(super) fn read(
        &self,
        instance: &Bound<'_, PyAny>,
        row: &mut [f64],
        method: &str,
    ) -> PyResult<()> {
        let py = instance.py();
        let class = self.class.as_ref().map(|class| class.bind(py));
        if !class.is_some_and(|class| instance.get_type().is(class))
            && !class.map_or(Ok(instance.is_none()), |class| instance.is_instance(class))?
        {
            return Err(self.other(instance, method));
        }
        for (value, name) in row.iter_mut().zip(&self.names) {
            let attribute = instance.getattr(name.bind(py))?;
            *value =
                number(&attribute).map_err(|error| self.no_number(py, name, &error, method))?;
        }
        if self.is_open {
            self.refuse_others(instance, method)?;
        }
        Ok(())
    }

    /// Writes the attributes of an object that are called as the columns.
    pub(super) fn attributes(&self, object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let py = object.py();
        let attribute = |name: &Py<PyString>| {
            number(&object.getattr(name.bind(py))?)
                .map_err(|error| self.no_number(py, name, &error, "state"))
        };
        self.names.iter().map(attribute).collect()
    }

    /// Sets the attributes of an object that are called as the columns.
    pub(super) fn set_attributes(&self, object: &Bound<'_, PyAny>, row: &[f64]) -> PyResult<()> {
        let mut columns = self.names.iter().zip(row);
        columns.try_for_each(|(name, value)| object.setattr(name.bind(object.py()), *value))
    }

    /// Adds the columns that a method names to a set.
    pub(super) fn mark(
        &self,
        names: &Bound<'_, PyAny>,
        set: &mut SignalSet,
        method: &str,
    ) -> PyResult<()> {
        let no_names = || {
            let kind = kind_of(names);
            PyTypeError::new_err(format!("`{method}` returned {kind}; it must return names"))
        };
        // A text has an iterator too, of its letters.
        if names.is_instance_of::<PyString>() {
            return Err(no_names());
        }
        for name in names.try_iter().map_err(|_| no_names())? {
            let name: String = name?.extract().map_err(|_| no_names())?;
            set.insert(self.place(&name, method)?);
        }
        Ok(())
    }

    /// Returns the index of a column by its name.
    pub(super) fn place(&self, name: &str, method: &str) -> PyResult<usize> {
        let place = self.fields.iter().position(|field| field.name == name);
        place.ok_or_else(|| {
            let hint = self.hint(name);
            let title = &self.title;
            failure::unknown(format!("`{method}`: `{title}` has no `{name}`{hint}"))
        })
    }

    fn hint(&self, name: &str) -> String {
        let near = nearest(name, self.fields.iter().map(|field| &*field.name));
        match near.is_empty() {
            true => String::new(),
            false => format!("; nearest: {}", near.join(", ")),
        }
    }

    #[cold]
    fn other(&self, instance: &Bound<'_, PyAny>, method: &str) -> PyErr {
        let (title, kind) = (&self.title, kind_of(instance));
        PyTypeError::new_err(match (&self.class, instance.is_none()) {
            (None, _) => format!("`{method}` returned {kind}, but the class has no such table"),
            (_, true) => format!("`{method}` returned None; it must return a `{title}`"),
            _ => format!("`{method}` returned {kind}; it must return a `{title}`"),
        })
    }

    #[cold]
    fn no_number(&self, py: Python<'_>, name: &Py<PyString>, error: &PyErr, method: &str) -> PyErr {
        let (title, reason) = (&self.title, error.value(py).to_string());
        PyTypeError::new_err(format!("`{method}`: `{name}` of `{title}` is {reason}"))
    }

    /// Refuses public attributes that are no columns, as a misspelt one is.
    fn refuse_others(&self, instance: &Bound<'_, PyAny>, method: &str) -> PyResult<()> {
        let attributes = instance.getattr(pyo3::intern!(instance.py(), "__dict__"))?;
        if attributes.len()? == self.names.len() {
            return Ok(());
        }
        for name in attributes.try_iter()? {
            let name: String = name?.extract()?;
            if !name.starts_with('_') {
                self.place(&name, method)?;
            }
        }
        Ok(())
    }
}

fn field(column: &Bound<'_, PyAny>) -> PyResult<Field> {
    let text = |name: &str| column.getattr(name)?.extract::<String>();
    let flag = |name: &str| column.getattr(name)?.extract::<bool>();
    Ok(Field {
        default: column.getattr("default")?.extract()?,
        min: column.getattr("min")?.extract()?,
        max: column.getattr("max")?.extract()?,
        faultable: flag("faultable")?,
        tunable: flag("tunable")?,
        ..Field::signal(&text("name")?, &text("unit")?, &text("doc")?)
    })
}

/// Returns a number: a `float` or an `int`. Of numpy, only `float64` is a `float`.
#[inline]
pub(super) fn number(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    match value.cast::<PyFloat>() {
        Ok(float) => Ok(float.value()),
        Err(_) => whole_number(value),
    }
}

#[cold]
fn whole_number(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    if value.is_instance_of::<PyInt>() && !value.is_instance_of::<PyBool>() {
        return value
            .extract()
            .map_err(|_| PyOverflowError::new_err("an int beyond the range of a float"));
    }
    if value.is_none() {
        return Err(PyTypeError::new_err("None; it must be a float"));
    }
    let kind = value.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "of the type {kind}; it must be a float, so convert it with `float(..)`"
    )))
}

/// Returns a number among others, which have this name.
#[inline]
pub(super) fn number_among(value: &Bound<'_, PyAny>, name: &str) -> PyResult<f64> {
    number(value).map_err(|error| {
        let reason = error.value(value.py()).to_string();
        PyTypeError::new_err(format!("a number of `{name}` is {reason}"))
    })
}

/// Returns the items of a sequence of this name.
pub(super) fn items<'py>(
    values: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyIterator>> {
    values.try_iter().map_err(|_| {
        let kind = kind_of(values);
        PyTypeError::new_err(format!(
            "`{name}` is of the type {kind}; it must be a sequence"
        ))
    })
}

/// Returns the name of the type of an object.
fn kind_of(value: &Bound<'_, PyAny>) -> String {
    let kind = value.get_type().name();
    kind.map_or_else(|_| "another object".into(), |name| name.to_string())
}

/// Refuses a result of a method that returns nothing.
pub(super) fn nothing(result: &Bound<'_, PyAny>, method: &str) -> PyResult<()> {
    if result.is_none() {
        return Ok(());
    }
    let kind = result.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "`{method}` returned {kind}; it changes `self` and returns nothing"
    )))
}

//! Arguments of the methods: intervals, samples and setups.

use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyType;
use shared_types::quality::SignalSet;
use shared_types::time;

use super::tables::Rows;

/// Interval over which a plant is integrated.
#[pyclass(frozen, module = "hil")]
pub(crate) struct Interval {
    /// Simulated time at its beginning, in s.
    #[pyo3(get)]
    start_s: f64,
    /// Length, in s.
    #[pyo3(get)]
    length_s: f64,
    /// Number of equal integration steps.
    #[pyo3(get)]
    substeps: u32,
}

#[pymethods]
impl Interval {
    #[new]
    #[pyo3(signature = (start_s, length_s, substeps = 1))]
    fn new(start_s: f64, length_s: f64, substeps: u32) -> Self {
        Self {
            start_s,
            length_s,
            substeps,
        }
    }

    /// Length of one integration step, in s.
    #[getter]
    fn substep_s(&self) -> f64 {
        time::Interval::from(self).substep_s()
    }

    fn __repr__(&self) -> String {
        let (start_s, length_s, substeps) = (self.start_s, self.length_s, self.substeps);
        format!("Interval(start_s={start_s:?}, length_s={length_s:?}, substeps={substeps})")
    }
}

impl From<&time::Interval> for Interval {
    fn from(interval: &time::Interval) -> Self {
        Self::new(interval.start_s, interval.length_s, interval.substeps)
    }
}

impl From<&Interval> for time::Interval {
    fn from(interval: &Interval) -> Self {
        Self {
            start_s: interval.start_s,
            length_s: interval.length_s,
            substeps: interval.substeps,
        }
    }
}

/// Configuration of a law.
#[pyclass(frozen, module = "hil")]
pub(crate) struct Setup {
    /// Parameters of the law.
    #[pyo3(get)]
    pub(super) parameters: Py<PyAny>,
    /// The law's model of the plant.
    #[pyo3(get)]
    pub(super) model: Py<PyAny>,
    /// Time between two samples, in s.
    #[pyo3(get)]
    pub(super) period_s: f64,
}

#[pymethods]
impl Setup {
    #[new]
    #[pyo3(signature = (parameters, period_s, model = None))]
    fn new(py: Python<'_>, parameters: Py<PyAny>, period_s: f64, model: Option<Py<PyAny>>) -> Self {
        Self {
            parameters,
            model: model.unwrap_or_else(|| py.None()),
            period_s,
        }
    }

    /// Returns the class, for annotations as `Setup[Parameters, None]`.
    #[classmethod]
    fn __class_getitem__(class: &Bound<'_, PyType>, _item: &Bound<'_, PyAny>) -> Py<PyType> {
        class.clone().unbind()
    }
}

/// Sample that a law answers.
#[pyclass(frozen, module = "hil")]
pub(crate) struct Sample {
    /// Simulated time, in s.
    #[pyo3(get)]
    pub(super) time_s: f64,
    /// Measured signals.
    #[pyo3(get)]
    pub(super) measured: Py<PyAny>,
    /// Reference signals.
    #[pyo3(get)]
    pub(super) reference: Py<PyAny>,
    /// `True` if all of these signals are valid.
    #[pyo3(get)]
    pub(super) valid: bool,
    /// Number of steps for which the plant has held a command that was late.
    #[pyo3(get)]
    pub(super) held_steps: u32,
    pub(super) quality: Option<Quality>,
}

/// Quality of the signals of a sample.
pub(super) struct Quality {
    pub(super) tables: Arc<[Rows; 2]>,
    pub(super) invalid: [SignalSet; 2],
    pub(super) age_steps: Box<[u32]>,
}

/// Names of the two tables, in the order of [`Quality::tables`].
const TABLES: [&str; 2] = ["measured", "reference"];

impl Quality {
    /// Returns the table and the index of a signal: `measured.x`, `reference.x`, or `x` for a measured one.
    fn place(&self, name: &str) -> PyResult<(usize, usize)> {
        let (table, rest) = match name.split_once('.') {
            Some((table, rest)) => (TABLES.iter().position(|one| *one == table), rest),
            None => (Some(0), name),
        };
        let table = table.ok_or_else(|| {
            super::failure::missing(format!(
                "`{name}`: a signal is `measured.x`, `reference.x`, or `x` for a measured one"
            ))
        })?;
        Ok((table, self.tables[table].place(rest, "sample")?))
    }
}

#[pymethods]
impl Sample {
    #[new]
    #[pyo3(signature = (time_s, measured, reference = None, valid = true, held_steps = 0))]
    fn new(
        py: Python<'_>,
        time_s: f64,
        measured: Py<PyAny>,
        reference: Option<Py<PyAny>>,
        valid: bool,
        held_steps: u32,
    ) -> Self {
        Self {
            time_s,
            measured,
            reference: reference.unwrap_or_else(|| py.None()),
            valid,
            held_steps,
            quality: None,
        }
    }

    /// Names of the invalid signals, as `measured.x` and `reference.x`.
    #[getter]
    fn invalid(&self) -> Vec<String> {
        let Some(quality) = &self.quality else {
            return Vec::new();
        };
        let mut names = Vec::new();
        for ((table, rows), set) in TABLES
            .iter()
            .zip(quality.tables.iter())
            .zip(&quality.invalid)
        {
            let places = set.iter(rows.fields.len());
            names.extend(places.map(|place| format!("{table}.{}", rows.fields[place].name)));
        }
        names
    }

    /// Returns `True` if a signal is valid: `measured.x`, `reference.x`, or `x` for a measured one.
    fn is_valid(&self, name: &str) -> PyResult<bool> {
        let Some(quality) = &self.quality else {
            return Ok(self.valid);
        };
        let (table, place) = quality.place(name)?;
        Ok(!quality.invalid[table].contains(place))
    }

    /// Returns the age of a measured signal in steps.
    fn age_steps(&self, name: &str) -> PyResult<u32> {
        let Some(quality) = &self.quality else {
            return Ok(0);
        };
        match quality.place(name)? {
            (0, place) => Ok(quality.age_steps[place]),
            _ => Err(super::failure::missing(format!(
                "`{name}`: only measured signals have an age"
            ))),
        }
    }

    /// Returns the class, for annotations as `Sample[Measured, Reference]`.
    #[classmethod]
    fn __class_getitem__(class: &Bound<'_, PyType>, _item: &Bound<'_, PyAny>) -> Py<PyType> {
        class.clone().unbind()
    }
}

//! Functions with the same last bit on every machine, and the integrator: the module `hil.math`.

use plant_process::integrate::integrate as integrate_row;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use shared_types::time;

use super::arguments::Interval;
use super::tables::{items, number_among};

/// Arguments of [`integrate`] in messages.
const STATE: &str = "state";
const RATES: &str = "rates";
/// Largest state that [`integrate`] takes.
const MOST_STATES: usize = 64;

macro_rules! same_everywhere {
    ($($name:ident($($x:ident),+) = $function:path, $doc:literal;)*) => {
        $(
            #[doc = $doc]
            #[pyfunction]
            fn $name($($x: f64),+) -> f64 {
                $function($($x),+)
            }
        )*

        fn add_functions(module: &Bound<'_, PyModule>) -> PyResult<()> {
            $( module.add_function(wrap_pyfunction!($name, module)?)?; )*
            Ok(())
        }
    };
}

same_everywhere! {
    sin(x) = libm::sin, "Returns the sine of an angle in radians.";
    cos(x) = libm::cos, "Returns the cosine of an angle in radians.";
    tan(x) = libm::tan, "Returns the tangent of an angle in radians.";
    asin(x) = libm::asin, "Returns the inverse sine.";
    acos(x) = libm::acos, "Returns the inverse cosine.";
    atan(x) = libm::atan, "Returns the inverse tangent.";
    atan2(y, x) = libm::atan2, "Returns the angle of the point (x, y).";
    sinh(x) = libm::sinh, "Returns the hyperbolic sine.";
    cosh(x) = libm::cosh, "Returns the hyperbolic cosine.";
    tanh(x) = libm::tanh, "Returns the hyperbolic tangent.";
    asinh(x) = libm::asinh, "Returns the inverse hyperbolic sine.";
    acosh(x) = area_cosine, "Returns the inverse hyperbolic cosine.";
    atanh(x) = libm::atanh, "Returns the inverse hyperbolic tangent.";
    exp(x) = libm::exp, "Returns e to the power x.";
    exp2(x) = libm::exp2, "Returns 2 to the power x.";
    expm1(x) = libm::expm1, "Returns `exp(x) - 1`, exact for small x.";
    log(x) = libm::log, "Returns the natural logarithm.";
    log1p(x) = libm::log1p, "Returns `log(1 + x)`, exact for small x.";
    log2(x) = libm::log2, "Returns the logarithm to the base 2.";
    log10(x) = libm::log10, "Returns the logarithm to the base 10.";
    pow(x, y) = libm::pow, "Returns x to the power y.";
    sqrt(x) = libm::sqrt, "Returns the square root.";
    cbrt(x) = libm::cbrt, "Returns the cube root.";
    hypot(x, y) = libm::hypot, "Returns `sqrt(x * x + y * y)` without overflow.";
    fmod(x, y) = libm::fmod, "Returns the remainder of x / y with the sign of x.";
    erf(x) = libm::erf, "Returns the error function.";
}

/// Returns the inverse hyperbolic cosine, which `libm` gives numbers outside of its domain.
fn area_cosine(x: f64) -> f64 {
    match x {
        x if x < 1.0 => f64::NAN,
        x => libm::acosh(x),
    }
}

/// Returns the state after an interval, by the classical Runge-Kutta method of order 4 in its equal substeps.
///
/// `rates(time_s, state)` returns the derivative of each number; `state` is a tuple.
#[pyfunction]
fn integrate(
    state: &Bound<'_, PyAny>,
    interval: &Bound<'_, Interval>,
    rates: &Bound<'_, PyAny>,
) -> PyResult<Vec<f64>> {
    let state: Vec<f64> = items(state, STATE)?
        .map(|value| number_among(&value?, STATE))
        .collect::<PyResult<_>>()?;
    let interval = time::Interval::from(interval.get());
    if interval.substeps == 0 {
        return Err(PyValueError::new_err(
            "an interval has at least one substep",
        ));
    }
    match state.len() {
        0 => Ok(state),
        1 => padded::<1>(&state, &interval, rates),
        2 => padded::<2>(&state, &interval, rates),
        3..=4 => padded::<4>(&state, &interval, rates),
        5..=8 => padded::<8>(&state, &interval, rates),
        9..=16 => padded::<16>(&state, &interval, rates),
        17..=32 => padded::<32>(&state, &interval, rates),
        33..=MOST_STATES => padded::<MOST_STATES>(&state, &interval, rates),
        count => Err(PyValueError::new_err(format!(
            "`integrate` takes up to {MOST_STATES} numbers, not {count}"
        ))),
    }
}

/// Integrates a state padded with zeros; the method treats every component separately.
fn padded<const N: usize>(
    state: &[f64],
    interval: &time::Interval,
    rates: &Bound<'_, PyAny>,
) -> PyResult<Vec<f64>> {
    let count = state.len();
    let mut whole = [0.0; N];
    whole[..count].copy_from_slice(state);
    let mut failure = None;
    integrate_row(&mut whole, interval, |time_s, x| {
        let mut dx = [0.0; N];
        if failure.is_none() {
            failure = derive(rates, time_s, &x[..count], &mut dx[..count]).err();
        }
        dx
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(whole[..count].to_vec()),
    }
}

fn derive(rates: &Bound<'_, PyAny>, time_s: f64, x: &[f64], dx: &mut [f64]) -> PyResult<()> {
    let state = pyo3::types::PyTuple::new(rates.py(), x)?;
    let derivatives = rates.call1((time_s, state))?;
    let mut count = 0;
    for value in items(&derivatives, RATES)? {
        let value = number_among(&value?, RATES)?;
        if let Some(place) = dx.get_mut(count) {
            *place = value;
        }
        count += 1;
    }
    if count != dx.len() {
        let expected = dx.len();
        return Err(PyValueError::new_err(format!(
            "the rates are {count} numbers, but the state has {expected}"
        )));
    }
    Ok(())
}

/// Adds the functions to a module `math` of the module.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let math = PyModule::new(module.py(), "math")?;
    add_functions(&math)?;
    math.add_function(wrap_pyfunction!(integrate, &math)?)?;
    module.add_submodule(&math)
}

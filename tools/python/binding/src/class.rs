//! Classes of Python as plants and laws of sessions.
//!
//! Engine and runner keep references to them for the whole process, so each class is read once and stays.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use controller_process::controller::LawKind;
use plant_process::plant::PlantKind;
use pyo3::prelude::*;

use crate::agent::Agent;
use crate::side;

/// Kinds by the address of their class, which stays valid because the kind holds the class.
type Known<T> = Mutex<Option<HashMap<usize, &'static T>>>;

static PLANTS: Known<PlantKind> = Mutex::new(None);
static LAWS: Known<LawKind> = Mutex::new(None);

/// Returns the plant of a class.
///
/// # Errors
/// If the class is no plant.
pub(crate) fn plant(class: &Bound<'_, PyAny>) -> PyResult<&'static PlantKind> {
    known(&PLANTS, class, side::plant_kind)
}

/// Returns the law of a class, or of an agent.
///
/// # Errors
/// If the class is no law.
pub(crate) fn law(class: &Bound<'_, PyAny>) -> PyResult<&'static LawKind> {
    match class.cast::<Agent>() {
        Ok(agent) => Ok(agent.get().kind()),
        Err(_) => known(&LAWS, class, side::law_kind),
    }
}

fn known<T>(
    known: &Known<T>,
    class: &Bound<'_, PyAny>,
    read: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
) -> PyResult<&'static T> {
    let address = class.as_ptr() as usize;
    let locked = || known.lock().unwrap_or_else(PoisonError::into_inner);
    let earlier = locked()
        .as_ref()
        .and_then(|kinds| kinds.get(&address).copied());
    if let Some(kind) = earlier {
        return Ok(kind);
    }
    // Reads attributes of the class, which may run any code: without the lock.
    let kind: &'static T = Box::leak(Box::new(read(class)?));
    locked().get_or_insert_default().insert(address, kind);
    Ok(kind)
}

//! Classes of Python as plants and laws of sessions.
//!
//! A saved state belongs to the kinds of its run, so each class is read once, and kept as long as anything has its kind.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use controller_process::controller::LawKind;
use plant_process::plant::PlantKind;
use pyo3::prelude::*;

use crate::agent::Agent;
use crate::side;

/// Plant and law of a session that are not built in.
#[derive(Default)]
pub(crate) struct Classes {
    pub(crate) plant: Option<Arc<PlantKind>>,
    pub(crate) law: Option<Arc<LawKind>>,
}

impl Classes {
    /// Returns the kinds of a plant and of a law, which may also be an agent.
    ///
    /// # Errors
    /// If a class is no plant or no law.
    pub(crate) fn of(
        plant: Option<&Bound<'_, PyAny>>,
        law: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let plant = plant.map(|class| known(&PLANTS, class, side::plant_kind));
        let law = law.map(|class| match class.cast::<Agent>() {
            Ok(agent) => Ok(agent.get().kind()),
            Err(_) => known(&LAWS, class, side::law_kind),
        });
        Ok(Self {
            plant: plant.transpose()?,
            law: law.transpose()?,
        })
    }
}

/// Kinds in use by the address of their class, which stays valid because the kind holds the class.
type Known<T> = Mutex<Option<HashMap<usize, Weak<T>>>>;

static PLANTS: Known<PlantKind> = Mutex::new(None);
static LAWS: Known<LawKind> = Mutex::new(None);

fn known<T>(
    known: &Known<T>,
    class: &Bound<'_, PyAny>,
    read: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
) -> PyResult<Arc<T>> {
    let address = class.as_ptr() as usize;
    let locked = || known.lock().unwrap_or_else(PoisonError::into_inner);
    let earlier = locked()
        .as_ref()
        .and_then(|kinds| kinds.get(&address)?.upgrade());
    if let Some(kind) = earlier {
        return Ok(kind);
    }
    // Reads attributes of the class, which may run any code: without the lock.
    let kind = Arc::new(read(class)?);
    let mut kinds = locked();
    let kinds = kinds.get_or_insert_default();
    kinds.retain(|_, kind| kind.strong_count() > 0);
    kinds.insert(address, Arc::downgrade(&kind));
    Ok(kind)
}

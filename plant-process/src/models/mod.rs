//! The plants that come with the emulator.
//!
//! Each module is one plant: its tables, its equations and their tests. A plant of your own looks
//! the same; start from [`spring_mass`].

pub mod drhas;
pub mod spring_mass;

use crate::plant::PlantKind;

/// Every plant that a scenario can name.
#[must_use]
pub fn all() -> Vec<PlantKind> {
    vec![
        PlantKind::of::<drhas::Drhas>(),
        PlantKind::of::<spring_mass::SpringMass>(),
    ]
}

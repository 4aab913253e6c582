//! The state of the hydraulic system by name, for trim and linearisation.
//!
//! Called by the system's declaration of its state, and by nothing during a run.

use shared_types::table;
use shared_types::table::Table;
use zerocopy::transmute;

use super::{Drhas, Measured};

table! {
    /// Integrated state, then the spools. Without a lag a spool follows its command at once, and nothing depends on it.
    pub struct StateRow {
        /// Angle theta_d of the surface.
        surface_angle_rad: "rad",
        /// Rate of theta_d.
        surface_rate_radps: "rad/s",
        /// Position x_h of piston 1.
        actuator1_position_m: "m",
        /// Velocity of piston 1.
        actuator1_velocity_mps: "m/s",
        /// Pressure P_h11 of the active chamber of actuator 1.
        actuator1_pressure1_pa: "Pa",
        /// Pressure P_h12 of the passive chamber of actuator 1.
        actuator1_pressure2_pa: "Pa",
        /// Position x_h of piston 2.
        actuator2_position_m: "m",
        /// Velocity of piston 2.
        actuator2_velocity_mps: "m/s",
        /// Pressure P_h21 of the active chamber of actuator 2.
        actuator2_pressure1_pa: "Pa",
        /// Pressure P_h22 of the passive chamber of actuator 2.
        actuator2_pressure2_pa: "Pa",
        /// Position x_v of the spool of actuator 1.
        actuator1_spool_m: "m",
        /// Position at which the spool of actuator 1 sticks.
        actuator1_spool_stuck_m: "m",
        /// Position x_v of the spool of actuator 2.
        actuator2_spool_m: "m",
        /// Position at which the spool of actuator 2 sticks.
        actuator2_spool_stuck_m: "m",
    }
}

impl StateRow {
    /// Returns the row of a system.
    pub(super) fn of(plant: &Drhas) -> Self {
        let integrated: Measured = transmute!(plant.state);
        let spools = plant.spools.map(|spool| [spool.position_m, spool.stuck_m]);
        Self::from_row(&[integrated.row(), spools.as_flattened()].concat())
    }

    /// Sets the state of a system.
    pub(super) fn restore(plant: &mut Drhas, row: Self) {
        let (integrated, spools) = row.row().split_at(Measured::LEN);
        let integrated = Measured::from_row(integrated);
        plant.state = transmute!(integrated);
        for (spool, row) in plant.spools.iter_mut().zip(spools.chunks_exact(2)) {
            (spool.position_m, spool.stuck_m) = (row[0], row[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::drhas::Parameters;
    use crate::plant::Plant;

    #[test]
    fn every_number_of_the_state_has_its_own_row() {
        let mut plant = Drhas::start(&Parameters::default()).expect("starts");
        let numbers: Vec<f64> = (1..=14).map(f64::from).collect();
        StateRow::restore(&mut plant, StateRow::from_row(&numbers));
        assert_eq!(StateRow::of(&plant).row(), numbers);
        let ends = (
            plant.state.rate_radps,
            plant.state.actuators[1].pressure2_pa,
        );
        assert_eq!(ends, (2.0, 10.0));
        assert_eq!(
            (plant.spools[0].stuck_m, plant.spools[1].position_m),
            (12.0, 13.0)
        );
        let names = |fields: Vec<shared_types::table::Field>| {
            fields
                .into_iter()
                .map(|field| field.name)
                .collect::<Vec<_>>()
        };
        assert_eq!(names(StateRow::fields())[..10], names(Measured::fields()));
    }
}

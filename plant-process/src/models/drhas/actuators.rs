//! Both actuators side by side: their parameters and their states as pairs.
//!
//! Built from the tables and used by the equations. Contains only the parameters and states that the right-hand side
//! uses.

use super::ActuatorState;
use super::pair::Pair;
use super::tables::ActuatorParameters;

/// Defines a struct with pairs of some fields of a struct that describes one actuator.
macro_rules! side_by_side {
    ($(#[$text:meta])* $name:ident of $one:ident: $($field:ident)*) => {
        $(#[$text])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $(#[doc = concat!("`", stringify!($field), "` of both.")] pub $field: Pair,)*
        }

        impl $name {
            /// Combines two values, in order.
            #[inline]
            #[must_use]
            pub fn of([one, two]: [&$one; 2]) -> Self {
                Self { $($field: Pair::from([one.$field, two.$field])),* }
            }
        }
    };
}

side_by_side! {
    /// Parameters of both actuators in the equations.
    Actuators of ActuatorParameters:
    flow_gain_m2ps_per_sqrt_pa
    supply_pressure_pa
    supply_droop_pa_s_per_m3
    return_pressure_pa
    piston_mass_kg
    damping_n_s_per_m
    coulomb_friction_n
    friction_velocity_mps
    motion_blocked
    area1_m2
    area2_m2
    bulk_modulus_pa
    volume1_m3
    volume2_m3
    vapour_pressure_pa
    internal_leakage_m3ps_per_pa
    leakage_coefficient_m3ps_per_sqrt_pa
    external_leakage1_m3ps_per_sqrt_pa
    external_leakage2_m3ps_per_sqrt_pa
    connection_stiffness_n_per_m
}

side_by_side! {
    /// The states of both actuators.
    ActuatorStates of ActuatorState:
    position_m
    velocity_mps
    pressure1_pa
    pressure2_pa
}

impl ActuatorStates {
    /// Returns the lower pressure of each actuator.
    #[inline]
    #[must_use]
    pub fn lowest_pressures_pa(&self) -> Pair {
        let (p_h1, p_h2) = (self.pressure1_pa, self.pressure2_pa);
        p_h1.is_below(p_h2).choose(p_h1, p_h2)
    }

    /// Splits the state into those of the two actuators.
    #[inline]
    #[must_use]
    pub fn split(&self) -> [ActuatorState; 2] {
        let [position_m, velocity_mps, pressure1_pa, pressure2_pa] = [
            self.position_m,
            self.velocity_mps,
            self.pressure1_pa,
            self.pressure2_pa,
        ]
        .map(Pair::to_array);
        std::array::from_fn(|i| ActuatorState {
            position_m: position_m[i],
            velocity_mps: velocity_mps[i],
            pressure1_pa: pressure1_pa[i],
            pressure2_pa: pressure2_pa[i],
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Creates two identical actuators.
    pub(in super::super) fn alike(parameters: &ActuatorParameters) -> Actuators {
        Actuators::of([parameters; 2])
    }

    /// Creates two actuators in the same state.
    pub(in super::super) fn together(state: &ActuatorState) -> ActuatorStates {
        ActuatorStates::of([state; 2])
    }

    /// Returns the common value of both actuators.
    #[track_caller]
    pub(in super::super) fn of_each(pair: Pair) -> f64 {
        let [one, two] = pair.to_array();
        assert_eq!(one.to_bits(), two.to_bits(), "{pair:?}");
        one
    }

    #[test]
    fn a_joined_state_splits_into_its_parts() {
        let states = [1.0, 5.0].map(|n| ActuatorState {
            position_m: n,
            velocity_mps: n + 1.0,
            pressure1_pa: n + 2.0,
            pressure2_pa: n + 3.0,
        });
        let pairs = ActuatorStates::of(states.each_ref());
        assert_eq!(pairs.velocity_mps, Pair::from([2.0, 6.0]));
        assert_eq!(pairs.split(), states);
    }
}

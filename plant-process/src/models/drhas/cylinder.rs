//! The hydraulic cylinder: piston and chambers (eqs. 2 to 4).
//!
//! Called by the right-hand side of the hydraulic system, and [`boiled`] by its substeps. The piston has no end stops:
//! the limits of the truth signals end a run before the piston would reach them.

use super::actuators::{ActuatorStates, Actuators};
use super::pair::Pair;

/// Acceleration of the piston.
///
/// `x_h'' = (A_1 P_h1 - A_2 P_h2 - B_h x_h' - F_h - d) / m_h` (eq. 2; any state).
#[inline]
#[must_use]
pub fn piston_acceleration_mps2(
    p: &Actuators,
    state: &ActuatorStates,
    rod_force_n: Pair,
    disturbance_n: Pair,
) -> Pair {
    let (a_1, a_2, b_h, m_h) = (
        p.area1_m2,
        p.area2_m2,
        p.damping_n_s_per_m,
        p.piston_mass_kg,
    );
    let (v_h, p_h1, p_h2) = (state.velocity_mps, state.pressure1_pa, state.pressure2_pa);
    let (f_h, d) = (rod_force_n, disturbance_n);
    (a_1 * p_h1 - a_2 * p_h2 - b_h * v_h - f_h - d) / m_h
}

/// Volume of the active chamber.
///
/// `V_h1 = V_10 + A_1 x_h` (below eq. 4; the model ends where it is 0).
#[inline]
#[must_use]
pub fn active_volume_m3(p: &Actuators, position_m: Pair) -> Pair {
    p.volume1_m3 + p.area1_m2 * position_m
}

/// Volume of the passive chamber.
///
/// `V_h2 = V_20 - A_2 x_h` (below eq. 4; the model ends where it is 0).
#[inline]
#[must_use]
pub fn passive_volume_m3(p: &Actuators, position_m: Pair) -> Pair {
    p.volume2_m3 - p.area2_m2 * position_m
}

/// Stiffness of the oil in the active chamber: pressure per volume pushed into it.
///
/// `beta_e / V_h1`, the factor of eq. 3.
#[inline]
#[must_use]
pub fn active_stiffness_pa_per_m3(p: &Actuators, position_m: Pair) -> Pair {
    p.bulk_modulus_pa / active_volume_m3(p, position_m)
}

/// Stiffness of the oil in the passive chamber: pressure per volume pushed into it.
///
/// `beta_e / V_h2`, the factor of eq. 4.
#[inline]
#[must_use]
pub fn passive_stiffness_pa_per_m3(p: &Actuators, position_m: Pair) -> Pair {
    p.bulk_modulus_pa / passive_volume_m3(p, position_m)
}

/// Rate of the active chamber's pressure.
///
/// `P_h1' = beta_e / V_h1 (-A_1 x_h' - q_h + Q_h1)` (eq. 3); an external leak takes from `Q_h1`.
#[inline]
#[must_use]
pub fn active_pressure_rate_paps(
    p: &Actuators,
    state: &ActuatorStates,
    leakage_m3ps: Pair,
    inflow_m3ps: Pair,
) -> Pair {
    let (v_h, q_h, q_h1) = (state.velocity_mps, leakage_m3ps, inflow_m3ps);
    active_stiffness_pa_per_m3(p, state.position_m) * (-p.area1_m2 * v_h - q_h + q_h1)
}

/// Rate of the passive chamber's pressure.
///
/// `P_h2' = beta_e / V_h2 (A_2 x_h' + q_h - Q_h2)` (eq. 4); an external leak adds to `Q_h2`.
#[inline]
#[must_use]
pub fn passive_pressure_rate_paps(
    p: &Actuators,
    state: &ActuatorStates,
    leakage_m3ps: Pair,
    outflow_m3ps: Pair,
) -> Pair {
    let (v_h, q_h, q_h2) = (state.velocity_mps, leakage_m3ps, outflow_m3ps);
    passive_stiffness_pa_per_m3(p, state.position_m) * (p.area2_m2 * v_h + q_h - q_h2)
}

/// Returns the state with both chambers at or above the vapour pressure.
///
/// `max(P, P_v)`: vapour fills the missing volume at constant pressure (Merritt, Hydraulic Control Systems, 1967, on
/// cavitation). The size of the bubble is not modelled: when the chamber is refilled the pressure rises at once,
/// whereas a real one would first close the bubble. Applied after each integration step; a chamber above `P_v` is not
/// affected.
#[cold]
#[must_use]
pub fn boiled(p: &Actuators, state: &ActuatorStates) -> ActuatorStates {
    let p_v = p.vapour_pressure_pa;
    let above = |pressure_pa: Pair| pressure_pa.is_below(p_v).choose(p_v, pressure_pa);
    ActuatorStates {
        pressure1_pa: above(state.pressure1_pa),
        pressure2_pa: above(state.pressure2_pa),
        ..*state
    }
}

#[cfg(test)]
mod tests {
    use super::super::ActuatorState;
    use super::super::actuators::tests::{alike, of_each, together};
    use super::super::tables::ActuatorParameters;
    use super::*;

    /// Round numbers, different on each side.
    fn one() -> ActuatorParameters {
        ActuatorParameters {
            piston_mass_kg: 50.0,
            damping_n_s_per_m: 1e4,
            area1_m2: 2e-3,
            area2_m2: 1e-3,
            bulk_modulus_pa: 800e6,
            volume1_m3: 1e-4,
            volume2_m3: 0.5e-4,
            ..ActuatorParameters::default()
        }
    }

    const STATE: ActuatorState = ActuatorState {
        position_m: 0.01,
        velocity_mps: 0.1,
        pressure1_pa: 10e6,
        pressure2_pa: 6e6,
    };

    fn parameters() -> Actuators {
        alike(&one())
    }

    fn state() -> ActuatorStates {
        together(&STATE)
    }

    #[track_caller]
    fn assert_near(pair: Pair, expected: f64) {
        let value = of_each(pair);
        assert!(
            (value / expected - 1.0).abs() < 1e-14,
            "{value} is not {expected}"
        );
    }

    #[test]
    fn the_piston_obeys_newton() {
        // (20000 - 6000 - 1000 - 2500 - 500) / 50
        assert_near(
            piston_acceleration_mps2(
                &parameters(),
                &state(),
                Pair::both(2500.0),
                Pair::both(500.0),
            ),
            200.0,
        );
    }

    #[test]
    fn an_extended_rod_moves_volume_from_the_passive_to_the_active_side() {
        assert_near(active_volume_m3(&parameters(), Pair::both(0.01)), 1.2e-4);
        assert_near(passive_volume_m3(&parameters(), Pair::both(0.01)), 0.4e-4);
    }

    #[test]
    fn a_smaller_chamber_is_stiffer() {
        assert_near(
            active_stiffness_pa_per_m3(&parameters(), Pair::both(0.01)),
            8e8 / 1.2e-4,
        );
        assert_near(
            passive_stiffness_pa_per_m3(&parameters(), Pair::both(0.01)),
            2e13,
        );
    }

    #[test]
    fn the_active_pressure_rises_with_the_valve_and_falls_with_motion_and_leak() {
        // 800e6 / 1.2e-4 * (-2e-4 - 1e-5 + 3e-4)
        assert_near(
            active_pressure_rate_paps(&parameters(), &state(), Pair::both(1e-5), Pair::both(3e-4)),
            6e8,
        );
    }

    #[test]
    fn the_passive_pressure_rises_with_motion_and_leak_and_falls_with_the_valve() {
        // 800e6 / 0.4e-4 * (1e-4 + 1e-5 - 3e-4)
        assert_near(
            passive_pressure_rate_paps(&parameters(), &state(), Pair::both(1e-5), Pair::both(3e-4)),
            -3.8e9,
        );
    }

    #[test]
    fn a_chamber_boils_at_the_vapour_pressure() {
        let p = alike(&ActuatorParameters {
            vapour_pressure_pa: -0.9e5,
            ..one()
        });
        for (pressure_pa, expected_pa) in [
            (5.3e6, 5.3e6),
            (-0.8e5, -0.8e5),
            (-0.9e5, -0.9e5),
            (-5e6, -0.9e5),
        ] {
            // Each of the two in another chamber.
            let low1 = ActuatorState {
                pressure1_pa: pressure_pa,
                ..STATE
            };
            let low2 = ActuatorState {
                pressure2_pa: pressure_pa,
                ..STATE
            };
            let [one, two] = boiled(&p, &ActuatorStates::of([&low1, &low2])).split();
            assert_eq!((one.pressure1_pa, one.pressure2_pa), (expected_pa, 6e6));
            assert_eq!((two.pressure1_pa, two.pressure2_pa), (10e6, expected_pa));
            assert_eq!((one.position_m, one.velocity_mps), (0.01, 0.1));
        }
        // NaN must stay visible.
        let lost = ActuatorState {
            pressure1_pa: f64::NAN,
            ..STATE
        };
        let after = boiled(&p, &ActuatorStates::of([&lost, &STATE]));
        assert!(after.split()[0].pressure1_pa.is_nan());
    }
}

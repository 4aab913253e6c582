//! Oil that passes the piston's seal from the active to the passive chamber (eq. 5), with the exact flow of the fault's
//! part, whose end an explicit method cannot follow; and oil that leaves a chamber to the outside.
//!
//! Called by the right-hand side and the substeps of the hydraulic system. The fault's course over time (eq. 6) is not
//! here: it reaches the plant as the present value of `leakage_coefficient_m3ps_per_sqrt_pa`, which is `beta C_t`.
//!
//! Near `P_h1 = P_h2` the root in eq. 5 is not Lipschitz: the true pressures meet in finite time and stay together,
//! while a Runge-Kutta step overshoots, and the next one overshoots back. The fault's leak alone, at fixed volumes, has
//! a closed form instead. With `y = P_h1 - P_h2`, `sqrt|y|` falls linearly and stays at 0. A substep is cut into equal
//! parts if the leak alone would empty `y` of either actuator. If the leak would still do so within a part, it is
//! removed from the right-hand side there and its closed form is applied instead, half of it before and half after.

use super::actuators::{ActuatorStates, Actuators};
use super::cylinder;
use super::pair::{Pair, Which};

/// Normal leakage.
///
/// `C_i (P_h1 - P_h2)` (eq. 5, first term; laminar, any difference).
#[inline]
#[must_use]
pub fn normal_leakage_m3ps(p: &Actuators, state: &ActuatorStates) -> Pair {
    p.internal_leakage_m3ps_per_pa * (state.pressure1_pa - state.pressure2_pa)
}

/// Leakage of the fault past a worn seal.
///
/// `beta C_t sqrt|P_h1 - P_h2| sgn(P_h1 - P_h2)` (eq. 5, second term; turbulent, any difference, 0
/// at difference 0). The coefficient is `beta C_t`.
#[inline]
#[must_use]
pub fn fault_leakage_m3ps(coefficient_m3ps_per_sqrt_pa: Pair, state: &ActuatorStates) -> Pair {
    let y = state.pressure1_pa - state.pressure2_pa;
    let sqrt_y = y.abs().sqrt();
    coefficient_m3ps_per_sqrt_pa * sqrt_y.with_sign_of(y)
}

/// Leaks from the active and the passive chamber to the outside, through a crack or a burst line.
///
/// `q = c sqrt(P - P_r)` for `P > P_r`, otherwise 0 (turbulent like the second term of eq. 5; the orifice law of
/// Merritt, Hydraulic Control Systems, 1967, on flow through orifices, with `c = C_d A sqrt(2 / rho)`). The
/// surroundings are assumed to have the pressure of the return line, so that a chamber open to the return does not
/// leak, and no air enters. Near `P = P_r` the root is not Lipschitz: a Runge-Kutta step `h` may overshoot it by
/// `(c beta_e h / V)^2 / 16`, 5 kPa at the largest `c` and 25 us in the paper's actuator, and stays there, since
/// nothing flows back.
#[inline]
#[must_use]
pub fn external_leakages_m3ps(p: &Actuators, state: &ActuatorStates) -> [Pair; 2] {
    let none = Pair::both(0.0);
    let leak = |c: Pair, pressure_pa: Pair| {
        let drop_pa = pressure_pa - p.return_pressure_pa;
        (drop_pa.is_above(none)).choose(c * drop_pa.sqrt(), none)
    };
    [
        leak(p.external_leakage1_m3ps_per_sqrt_pa, state.pressure1_pa),
        leak(p.external_leakage2_m3ps_per_sqrt_pa, state.pressure2_pa),
    ]
}

/// Returns the speed at which the fault's leak alone brings the pressures together.
///
/// `a = beta C_t (beta_e / V_h1 + beta_e / V_h2)`, so that `y' = -a sqrt|y| sgn(y)` for
/// `y = P_h1 - P_h2` (second terms of eqs. 3 to 5 at fixed volumes).
#[inline]
#[must_use]
pub fn closing_speed_sqrt_pa_per_s(p: &Actuators, position_m: Pair) -> Pair {
    let c_t = p.leakage_coefficient_m3ps_per_sqrt_pa;
    let active = cylinder::active_stiffness_pa_per_m3(p, position_m);
    let passive = cylinder::passive_stiffness_pa_per_m3(p, position_m);
    c_t * (active + passive)
}

/// Marks the actuators whose pressures the fault's leak alone would make equal within a duration.
///
/// `sqrt|y| < a h / 2`, from the closed form in [`fault_leak_alone`].
#[inline]
#[must_use]
pub fn empties_within(p: &Actuators, state: &ActuatorStates, duration_s: f64) -> Which {
    let a = closing_speed_sqrt_pa_per_s(p, state.position_m);
    let y = state.pressure1_pa - state.pressure2_pa;
    y.abs().sqrt().is_below(a * 0.5 * duration_s)
}

/// Returns the states after a duration in which only the fault's leak acts.
///
/// `sqrt|y(h)| = max(0, sqrt|y(0)| - a h / 2)`, and the volume `(y(0) - y(h)) / (beta_e / V_h1 + beta_e / V_h2)` moves
/// from the active to the passive chamber: the solution of `y' = -a sqrt|y| sgn(y)` at fixed volumes. Exact for any
/// duration; the sign of `y` never changes.
#[must_use]
pub fn fault_leak_alone(p: &Actuators, state: &ActuatorStates, duration_s: f64) -> ActuatorStates {
    let none = Pair::both(0.0);
    let active = cylinder::active_stiffness_pa_per_m3(p, state.position_m);
    let passive = cylinder::passive_stiffness_pa_per_m3(p, state.position_m);
    let a = closing_speed_sqrt_pa_per_s(p, state.position_m);
    let y_0 = state.pressure1_pa - state.pressure2_pa;
    let root = y_0.abs().sqrt() - a * 0.5 * duration_s;
    let lasts = root.is_above(none);
    let y_h = y_0.is_below(none).choose(-root * root, root * root);
    let moved_m3 = lasts.choose(y_0 - y_h, y_0) / (active + passive);
    let pressure1_pa = state.pressure1_pa - active * moved_m3;
    // Equal pressures are one number: rounding must not leave a difference with the wrong sign.
    let pressure2_pa = lasts.choose(state.pressure2_pa + passive * moved_m3, pressure1_pa);
    ActuatorStates {
        pressure1_pa,
        pressure2_pa,
        ..*state
    }
}

#[cfg(test)]
mod tests {
    use super::super::ActuatorState;
    use super::super::actuators::tests::{alike, of_each, together};
    use super::super::tables::ActuatorParameters;
    use super::*;
    use crate::integrate::integrate;
    use shared_types::time::Interval;

    /// `beta_e / V_h1 = 8e12`, `beta_e / V_h2 = 1.6e13` at position 0, so `a = 1.2e7`.
    fn one() -> ActuatorParameters {
        ActuatorParameters {
            bulk_modulus_pa: 800e6,
            volume1_m3: 1e-4,
            volume2_m3: 0.5e-4,
            internal_leakage_m3ps_per_pa: 2e-12,
            leakage_coefficient_m3ps_per_sqrt_pa: 5e-7,
            ..ActuatorParameters::default()
        }
    }

    fn parameters() -> Actuators {
        alike(&one())
    }

    fn state(pressure1_pa: f64, pressure2_pa: f64) -> ActuatorStates {
        together(&ActuatorState {
            position_m: 0.0,
            velocity_mps: 0.2,
            pressure1_pa,
            pressure2_pa,
        })
    }

    #[track_caller]
    fn assert_near(pair: Pair, expected: f64) {
        let value = of_each(pair);
        assert!(
            (value / expected - 1.0).abs() < 1e-12,
            "{value} is not {expected}"
        );
    }

    #[test]
    fn normal_leakage_is_proportional_to_the_pressure_difference() {
        assert_near(normal_leakage_m3ps(&parameters(), &state(9e6, 5e6)), 8e-6);
        assert_near(normal_leakage_m3ps(&parameters(), &state(5e6, 9e6)), -8e-6);
    }

    #[test]
    fn fault_leakage_follows_the_root_and_flows_from_high_to_low() {
        assert_near(fault_leakage_m3ps(Pair::both(5e-7), &state(9e6, 5e6)), 1e-3);
        assert_near(
            fault_leakage_m3ps(Pair::both(5e-7), &state(5e6, 9e6)),
            -1e-3,
        );
        assert_eq!(
            of_each(fault_leakage_m3ps(Pair::both(5e-7), &state(5e6, 5e6))),
            0.0
        );
    }

    #[test]
    fn oil_leaves_a_chamber_with_the_root_of_its_pressure_above_the_outside() {
        let cracked = ActuatorParameters {
            external_leakage1_m3ps_per_sqrt_pa: 2e-7,
            external_leakage2_m3ps_per_sqrt_pa: 3e-7,
            return_pressure_pa: 0.5e6,
            ..one()
        };
        // 2e-7 sqrt(9e6) and 3e-7 sqrt(4e6), and nothing flows in.
        let [q_e1, q_e2] = external_leakages_m3ps(&alike(&cracked), &state(9.5e6, 4.5e6));
        assert_near(q_e1, 6e-4);
        assert_near(q_e2, 6e-4);
        let none = external_leakages_m3ps(&alike(&cracked), &state(0.5e6, 0.4e6));
        assert_eq!(none.map(of_each), [0.0; 2]);
        let tight = external_leakages_m3ps(&parameters(), &state(9.5e6, 4.5e6));
        assert_eq!(tight.map(of_each), [0.0; 2]);
    }

    #[test]
    fn closing_speed_adds_both_chambers() {
        assert_near(
            closing_speed_sqrt_pa_per_s(&parameters(), Pair::both(0.0)),
            1.2e7,
        );
    }

    #[test]
    fn a_difference_empties_when_its_root_has_fallen_to_zero() {
        // sqrt(14400) = 120 = a h / 2 at h = 20 us; the second actuator has an intact seal.
        let sound = ActuatorParameters {
            leakage_coefficient_m3ps_per_sqrt_pa: 0.0,
            ..one()
        };
        let state = state(10_014_400.0, 10_000_000.0);
        let actuators = Actuators::of([&one(), &sound]);
        let empties = |duration_s| {
            let (yes, no) = (Pair::both(1.0), Pair::both(0.0));
            let which = empties_within(&actuators, &state, duration_s);
            which.choose(yes, no).to_array()
        };
        assert_eq!(empties(19.999e-6), [0.0, 0.0]);
        assert_eq!(empties(20.001e-6), [1.0, 0.0]);
        assert_eq!(empties(1e6), [1.0, 0.0]);
    }

    #[test]
    fn the_root_of_the_difference_falls_linearly() {
        // sqrt(y): 2000, minus 1.2e7 * 1e-4 / 2 = 600, is 1400; y falls by 2.04e6, a third of it
        // in the active chamber, which is half as stiff as the passive one.
        for sign in [1.0, -1.0] {
            let before = state(10e6 + sign * 2e6, 10e6 - sign * 2e6);
            let after = fault_leak_alone(&parameters(), &before, 1e-4);
            assert_near(after.pressure1_pa, 10e6 + sign * (2e6 - 0.68e6));
            assert_near(after.pressure2_pa, 10e6 - sign * (2e6 - 1.36e6));
            assert_eq!(of_each(after.position_m), 0.0);
            assert_eq!(of_each(after.velocity_mps), 0.2);
        }
    }

    #[test]
    fn the_closed_form_matches_a_fine_integration() {
        let p = parameters();
        let before = state(11e6, 8e6);
        let mut pressures = [11e6, 8e6];
        let interval = Interval {
            start_s: 0.0,
            length_s: 2e-4,
            substeps: 2000,
        };
        integrate(&mut pressures, &interval, |_, &[p_1, p_2]| {
            let q = of_each(fault_leakage_m3ps(Pair::both(5e-7), &state(p_1, p_2)));
            [-8e12 * q, 1.6e13 * q]
        });
        let after = fault_leak_alone(&p, &before, 2e-4);
        assert_near(after.pressure1_pa, pressures[0]);
        assert_near(after.pressure2_pa, pressures[1]);
    }

    #[test]
    fn the_leak_conserves_oil() {
        // V dP / beta_e is the volume gained; what one chamber gains the other loses.
        for duration_s in [1e-6, 1e-5, 1.0] {
            let before = state(13.7e6, 9.1e6);
            let after = fault_leak_alone(&parameters(), &before, duration_s);
            let gained1_m3 = 1e-4 * of_each(after.pressure1_pa - before.pressure1_pa) / 8e8;
            let gained2_m3 = 0.5e-4 * of_each(after.pressure2_pa - before.pressure2_pa) / 8e8;
            assert!(
                (gained1_m3 + gained2_m3).abs() < 1e-21,
                "{gained1_m3} {gained2_m3}"
            );
            assert!(gained1_m3 < -1e-9);
        }
    }

    #[test]
    fn a_difference_never_changes_its_sign() {
        let (start1_pa, start2_pa) = (13.7e6, 9.1e6);
        let emptied = fault_leak_alone(&parameters(), &state(start1_pa, start2_pa), 1.0);
        assert_eq!(emptied.pressure1_pa, emptied.pressure2_pa);
        assert_near(emptied.pressure1_pa, 13.7e6 - 4.6e6 / 3.0);
        let again = fault_leak_alone(&parameters(), &emptied, 1.0);
        assert_eq!(again, emptied);
    }

    #[test]
    fn each_actuator_empties_independently() {
        let apart = |i: usize| state([12e6, 12.0001e6][i], [9e6, 12e6][i]).split()[0];
        let both = ActuatorStates::of([&apart(0), &apart(1)]);
        let [one, other] = fault_leak_alone(&parameters(), &both, 5e-5).split();
        for (i, after) in [one, other].into_iter().enumerate() {
            let alone = fault_leak_alone(&parameters(), &together(&apart(i)), 5e-5);
            assert_eq!(after, alone.split()[0]);
        }
        assert!(one.pressure1_pa > one.pressure2_pa);
        assert_eq!(other.pressure1_pa, other.pressure2_pa);
    }

    #[test]
    fn two_half_steps_equal_a_whole_one() {
        let before = state(9e6, 12e6);
        let half = fault_leak_alone(&parameters(), &before, 5e-5);
        let twice = fault_leak_alone(&parameters(), &half, 5e-5);
        let once = fault_leak_alone(&parameters(), &before, 1e-4);
        assert_near(twice.pressure1_pa, of_each(once.pressure1_pa));
        assert_near(twice.pressure2_pa, of_each(once.pressure2_pa));
    }
}

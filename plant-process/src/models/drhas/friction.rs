//! Forces that hold the piston in addition to oil, rod and viscous damping: dry friction and seizure.
//!
//! Called by the right-hand side of the hydraulic system. The paper has neither; with neutral parameters both forces
//! are absent. Both are smooth enough for the fixed step of the Runge-Kutta method.

use super::actuators::Actuators;
use super::pair::Pair;

/// Time constant at which a seized piston comes to rest.
///
/// Short compared with the piston's motion (its fastest vibration has 1.3e3 rad/s), long enough for Runge-Kutta: its
/// steps are stable up to 2.78 time constants, here 139 us.
const SEIZURE_TIME_S: f64 = 5e-5;

/// Coulomb friction of the piston's seals, against its motion.
///
/// `F = F_c tanh(v / v_s)`: Coulomb's `F_c sgn(v)` (Merritt, Hydraulic Control Systems, 1967, on nonlinearities) with a
/// smoothed jump, 76 % at `v_s` and 99.5 % at `3 v_s`. Below `v_s` it is a damper of `F_c / v_s`: a load creeps and
/// does not stick. Runge-Kutta steps `h` are stable while `(F_c / v_s + B_h) h / m_h < 2.78`; largest friction and
/// smallest `v_s` reach 1.8 at 25 us.
#[inline]
#[must_use]
pub fn coulomb_friction_n(p: &Actuators, velocity_mps: Pair) -> Pair {
    let (f_c, v_s) = (p.coulomb_friction_n, p.friction_velocity_mps);
    f_c * (velocity_mps / v_s).map(libm::tanh)
}

/// Acceleration of a piston that seizes in its cylinder.
///
/// `(1 - j) a - j v / tau`: with `j = 1` the piston comes to rest within a few `tau`, after a distance of `v(0) tau`,
/// and withstands any force of rod and oil, which the structure bears; with a `j` in between it drags like a damper of
/// `j m_h / tau`. `j = 0` is the free piston. This is a soft constraint, not an equation of the paper.
#[inline]
#[must_use]
pub fn seized_acceleration_mps2(
    p: &Actuators,
    velocity_mps: Pair,
    free_acceleration_mps2: Pair,
) -> Pair {
    let (j, v, a) = (p.motion_blocked, velocity_mps, free_acceleration_mps2);
    (Pair::both(1.0) - j) * a - j * v / Pair::both(SEIZURE_TIME_S)
}

#[cfg(test)]
mod tests {
    use super::super::actuators::tests::{alike, of_each};
    use super::super::tables::ActuatorParameters;
    use super::*;

    fn rubbing() -> ActuatorParameters {
        ActuatorParameters {
            coulomb_friction_n: 3000.0,
            friction_velocity_mps: 0.02,
            ..ActuatorParameters::default()
        }
    }

    fn friction_n(p: &ActuatorParameters, velocity_mps: f64) -> f64 {
        of_each(coulomb_friction_n(&alike(p), Pair::both(velocity_mps)))
    }

    fn acceleration_mps2(p: &ActuatorParameters, velocity_mps: f64, free_mps2: f64) -> f64 {
        let (v, a) = (Pair::both(velocity_mps), Pair::both(free_mps2));
        of_each(seized_acceleration_mps2(&alike(p), v, a))
    }

    #[test]
    fn friction_is_against_the_motion_and_does_not_grow_with_it() {
        // tanh 0.5 = 0.462117157260010
        assert_eq!(friction_n(&rubbing(), 0.0), 0.0);
        for sign in [1.0, -1.0] {
            let slow_n = sign * friction_n(&rubbing(), sign * 0.01);
            assert!((slow_n - 1386.351471780029).abs() < 1e-10, "{slow_n}");
            assert_eq!(sign * friction_n(&rubbing(), sign * 1.0), 3000.0);
        }
        assert_eq!(friction_n(&ActuatorParameters::default(), 1.0), 0.0);
    }

    #[test]
    fn a_free_piston_accelerates_as_before() {
        let p = ActuatorParameters::default();
        assert_eq!(acceleration_mps2(&p, 0.2, 123.4), 123.4);
    }

    #[test]
    fn a_seized_piston_feels_no_force_and_stops() {
        let p = ActuatorParameters {
            motion_blocked: 1.0,
            ..ActuatorParameters::default()
        };
        // -0.2 / 5e-5, whatever the force.
        for pushed_mps2 in [0.0, 700.0, -700.0] {
            let a = acceleration_mps2(&p, 0.2, pushed_mps2);
            assert!((a + 4000.0).abs() < 1e-9, "{a}");
        }
    }

    #[test]
    fn a_piston_seized_by_half_creeps_at_the_speed_where_drag_meets_force() {
        let p = ActuatorParameters {
            motion_blocked: 0.5,
            ..ActuatorParameters::default()
        };
        // (1 - j) a tau / j = 600 * 5e-5
        assert!(acceleration_mps2(&p, 0.03, 600.0).abs() < 1e-12);
    }
}

//! The control surface driven by both rods, and the force fight between them (eqs. 14 to 17, 24, 33).
//!
//! Called by the right-hand side and by the truth of the hydraulic system. Angles are small: a rod's end moves on a
//! straight line.

use super::actuators::Actuators;
use super::pair::Pair;
use super::tables::SurfaceParameters;

/// Linear displacement of the surface at the rods.
///
/// `x_d = r_d theta_d` (eq. 16; small angles, at 0.5 rad the error is 4 %).
#[inline]
#[must_use]
pub fn linear_displacement_m(p: &SurfaceParameters, angle_rad: f64) -> f64 {
    p.radial_distance_m * angle_rad
}

/// Force of a rod on the surface.
///
/// `F_h = K_h (x_h - x_d)` (eqs. 14 and 15; pull as well as push).
#[inline]
#[must_use]
pub fn rod_force_n(p: &Actuators, position_m: Pair, linear_displacement_m: f64) -> Pair {
    p.connection_stiffness_n_per_m * (position_m - Pair::both(linear_displacement_m))
}

/// Torque of the load.
///
/// `T_L = r_d F_L + T_0` with `F_L = K_d x_d` (section 4); `T_0` is constant and not in the paper.
#[inline]
#[must_use]
pub fn load_torque_nm(p: &SurfaceParameters, linear_displacement_m: f64) -> f64 {
    let (r_d, k_d, t_0) = (
        p.radial_distance_m,
        p.load_stiffness_n_per_m,
        p.load_torque_nm,
    );
    r_d * (k_d * linear_displacement_m) + t_0
}

/// Angular acceleration of the surface.
///
/// `theta_d'' = ((F_dh1 + F_dh2) r_d - beta_d theta_d' - T_L) / J_d` (eqs. 17 and 24).
#[inline]
#[must_use]
pub fn angular_acceleration_radps2(
    p: &SurfaceParameters,
    rate_radps: f64,
    rod_forces_n: Pair,
    load_torque_nm: f64,
) -> f64 {
    let (r_d, beta_d, j_d) = (
        p.radial_distance_m,
        p.damping_n_m_s_per_rad,
        p.inertia_kg_m2,
    );
    let ([f_dh1, f_dh2], t_l) = (rod_forces_n.to_array(), load_torque_nm);
    ((f_dh1 + f_dh2) * r_d - beta_d * rate_radps - t_l) / j_d
}

/// Force fight between the rods.
///
/// `Delta F = F_h1 - F_h2` (eq. 33).
#[must_use]
pub fn force_fight_n(rod_forces_n: Pair) -> f64 {
    let [f_h1, f_h2] = rod_forces_n.to_array();
    f_h1 - f_h2
}

#[cfg(test)]
mod tests {
    use super::super::actuators::tests::{alike, of_each};
    use super::super::tables::ActuatorParameters;
    use super::*;

    /// Round numbers.
    const SURFACE: SurfaceParameters = SurfaceParameters {
        radial_distance_m: 0.2,
        inertia_kg_m2: 10.0,
        damping_n_m_s_per_rad: 50.0,
        load_stiffness_n_per_m: 1e6,
        load_torque_nm: 0.0,
        initial_angle_rad: 0.0,
        initial_rate_radps: 0.0,
    };

    fn assert_near(value: f64, expected: f64) {
        assert!(
            (value / expected - 1.0).abs() < 1e-14,
            "{value} is not {expected}"
        );
    }

    #[test]
    fn displacement_is_arm_times_angle() {
        assert_near(linear_displacement_m(&SURFACE, 0.05), 0.01);
    }

    #[test]
    fn a_rod_ahead_of_the_surface_pushes_and_one_behind_pulls() {
        let stiff = alike(&ActuatorParameters {
            connection_stiffness_n_per_m: 2e8,
            ..ActuatorParameters::default()
        });
        let rod_n = |position_m| of_each(rod_force_n(&stiff, Pair::both(position_m), 0.01));
        assert_near(rod_n(0.01 + 1e-4), 2e4);
        assert_near(rod_n(0.01 - 1e-4), -2e4);
    }

    #[test]
    fn the_load_grows_with_displacement_and_arm() {
        assert_near(load_torque_nm(&SURFACE, 0.01), 2000.0);
    }

    #[test]
    fn a_constant_torque_adds_to_the_load() {
        let loaded = SurfaceParameters {
            load_torque_nm: -300.0,
            ..SURFACE
        };
        assert_near(load_torque_nm(&loaded, 0.01), 1700.0);
    }

    #[test]
    fn the_surface_obeys_newton() {
        // ((7000 + 5000) * 0.2 - 50 * 2 - 2000) / 10
        assert_near(
            angular_acceleration_radps2(&SURFACE, 2.0, Pair::from([7000.0, 5000.0]), 2000.0),
            30.0,
        );
    }

    #[test]
    fn equal_rods_do_not_fight() {
        assert_eq!(force_fight_n(Pair::from([7000.0, 7000.0])), 0.0);
        assert_eq!(force_fight_n(Pair::from([7000.0, 5000.0])), 2000.0);
    }
}

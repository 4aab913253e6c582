//! Desired trajectories of the sum and the difference of the stiffness-weighted piston positions (eqs. 24-33).
//!
//! Called by the law at every sample. The surface follows its command if `f_1 = K_h1 x_h1 + K_h2 x_h2` follows x_r1;
//! the force fight vanishes if `f_2 = K_h1 x_h1 - K_h2 x_h2` follows x_r2. The later steps of the design differentiate
//! both three times; every derivative here is exact, none is a finite difference.

use core::array::from_fn;

use super::Jet;
use super::gains::TrajectoryGains;
use super::model::{Model, SurfaceModel};

/// Trajectory generator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trajectory {
    surface: SurfaceModel,
    gains: TrajectoryGains,
    stiffness1_n_per_m: f64,
    stiffness2_n_per_m: f64,
}

impl Trajectory {
    /// Creates the generator for the law's model of the plant.
    #[must_use]
    pub fn new(model: &Model, gains: TrajectoryGains) -> Self {
        Self {
            surface: model.surface,
            gains,
            stiffness1_n_per_m: model.actuator1.connection_stiffness_n_per_m,
            stiffness2_n_per_m: model.actuator2.connection_stiffness_n_per_m,
        }
    }

    /// Returns the same generator with other gains.
    #[must_use]
    pub const fn with(self, gains: TrajectoryGains) -> Self {
        Self { gains, ..self }
    }

    /// Load torque and its derivatives.
    ///
    /// `T_L = r_d F_L = K_d r_d^2 y_1` (section 4 of the paper: `F_L = K_d x_d`).
    fn load_torque_nm<const N: usize>(&self, y_1: &Jet<f64, N>) -> Jet<f64, N> {
        let (r_d, k_d) = (
            self.surface.radial_distance_m,
            self.surface.load_stiffness_n_per_m,
        );
        y_1.map(|angle| k_d * r_d * r_d * angle)
    }

    /// Returns the surface's angle and its derivatives up to order four, from its angle and rate and from `f_1` with
    /// its first two derivatives.
    ///
    /// `y_1' = y_2`,
    /// `y_2' = r_d/J_d f_1 - r_d^2/J_d (K_h1 + K_h2) y_1 - beta_d/J_d y_2 - T_L/J_d` (eq. 24),
    /// and the latter differentiated twice.
    #[must_use]
    pub fn surface_angle(&self, angle_rad: f64, rate_radps: f64, f_1: &Jet<f64, 3>) -> Jet<f64, 5> {
        let (r_d, j_d, beta_d) = (
            self.surface.radial_distance_m,
            self.surface.inertia_kg_m2,
            self.surface.damping_n_m_s_per_rad,
        );
        let k_h = self.stiffness1_n_per_m + self.stiffness2_n_per_m;
        let mut y = [angle_rad, rate_radps, 0.0, 0.0, 0.0];
        for j in 0..3 {
            let [t_l] = self.load_torque_nm(&[y[j]]);
            y[j + 2] = (r_d * f_1[j] - r_d * r_d * k_h * y[j] - beta_d * y[j + 1] - t_l) / j_d;
        }
        y
    }

    /// Error of the surface's angle.
    ///
    /// `z_1 = y_1 - theta_r` (eq. 26).
    fn angle_error(y_1: &Jet<f64, 5>, theta_r: &Jet<f64, 6>) -> Jet<f64, 5> {
        from_fn(|j| y_1[j] - theta_r[j])
    }

    /// Desired rate of the surface.
    ///
    /// `alpha_r1 = -k_1 z_1 + theta_r'` (eq. 28).
    fn wanted_rate(&self, z_1: &Jet<f64, 5>, theta_r: &Jet<f64, 6>) -> Jet<f64, 5> {
        let k_1 = self.gains.angle_gain_per_s;
        from_fn(|j| -k_1 * z_1[j] + theta_r[j + 1])
    }

    /// Error of the surface's rate.
    ///
    /// `z_2 = y_2 - alpha_r1` (eq. 26).
    fn rate_error(y_1: &Jet<f64, 5>, alpha_r1: &Jet<f64, 5>) -> Jet<f64, 4> {
        from_fn(|j| y_1[j + 1] - alpha_r1[j])
    }

    /// Desired sum of the stiffness-weighted positions, in N, with three derivatives.
    ///
    /// `x_r1 = J_d/r_d [r_d^2/J_d (K_h1 + K_h2) y_1 + beta_d/J_d y_2 + T_L/J_d + alpha_r1' - k_2 z_2 - z_1]` (eq. 25).
    #[must_use]
    pub fn sum(&self, y_1: &Jet<f64, 5>, theta_r: &Jet<f64, 6>) -> Jet<f64, 4> {
        let (r_d, j_d, beta_d) = (
            self.surface.radial_distance_m,
            self.surface.inertia_kg_m2,
            self.surface.damping_n_m_s_per_rad,
        );
        let k_h = self.stiffness1_n_per_m + self.stiffness2_n_per_m;
        let k_2 = self.gains.rate_gain_per_s;
        let t_l = self.load_torque_nm(y_1);
        let z_1 = Self::angle_error(y_1, theta_r);
        let alpha_r1 = self.wanted_rate(&z_1, theta_r);
        let z_2 = Self::rate_error(y_1, &alpha_r1);
        from_fn(|j| {
            (r_d * r_d * k_h * y_1[j] + beta_d * y_1[j + 1] + t_l[j]) / r_d
                + j_d / r_d * (alpha_r1[j + 1] - k_2 * z_2[j] - z_1[j])
        })
    }

    /// Desired difference of the stiffness-weighted positions, in N, with three derivatives.
    ///
    /// `x_r2 = (K_h1 - K_h2) r_d theta_r` (after eq. 33).
    #[must_use]
    pub fn difference(&self, theta_r: &Jet<f64, 6>) -> Jet<f64, 4> {
        let r_d = self.surface.radial_distance_m;
        let k_h = self.stiffness1_n_per_m - self.stiffness2_n_per_m;
        from_fn(|j| k_h * r_d * theta_r[j])
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use libm::{cos, sin};

    pub(in super::super) fn uneven() -> Model {
        let mut model = Model::default();
        model.actuator1.connection_stiffness_n_per_m = 1.1e8;
        model.actuator1.piston_mass_kg = 50.0;
        model.actuator2.connection_stiffness_n_per_m = 0.9e8;
        model.actuator2.damping_n_s_per_m = 1.2e4;
        model
    }

    /// Returns `a sin(w t + p)` and its derivatives.
    pub(in super::super) fn wave<const N: usize>(a: f64, w: f64, p: f64, t: f64) -> Jet<f64, N> {
        let phase = w * t + p;
        let mut scale = a;
        from_fn(|j| {
            let value = match j % 4 {
                0 => sin(phase),
                1 => cos(phase),
                2 => -sin(phase),
                _ => -cos(phase),
            };
            let result = scale * value;
            scale *= w;
            result
        })
    }

    /// Central difference of order six with step `h`.
    pub(in super::super) fn slope(at: impl Fn(f64) -> f64, t: f64, h: f64) -> f64 {
        let pair = |n: f64| at(t + n * h) - at(t - n * h);
        (45.0 * pair(1.0) - 9.0 * pair(2.0) + pair(3.0)) / (60.0 * h)
    }

    #[track_caller]
    pub(in super::super) fn assert_close(actual: f64, expected: f64, tolerance: f64) {
        let off = (actual - expected).abs();
        assert!(
            off <= tolerance * expected.abs(),
            "{actual:e} is not {expected:e}"
        );
    }

    /// Returns theta_d and theta_r of a motion known in closed form, and the f_1 that causes it.
    fn motion(generator: &Trajectory, t: f64) -> (Jet<f64, 5>, Jet<f64, 6>, Jet<f64, 3>) {
        let theta: Jet<f64, 5> = wave(0.19, 6.0, 0.1, t);
        let theta_r = wave(0.2, 6.0, 0.0, t);
        let surface = generator.surface;
        let k_h = generator.stiffness1_n_per_m + generator.stiffness2_n_per_m;
        let r_d = surface.radial_distance_m;
        // Eq. (17) with eqs. (14)-(16), solved for f_1.
        let f_1 = from_fn(|j| {
            surface.inertia_kg_m2 / r_d * theta[j + 2]
                + surface.damping_n_m_s_per_rad / r_d * theta[j + 1]
                + (surface.load_stiffness_n_per_m + k_h) * r_d * theta[j]
        });
        (theta, theta_r, f_1)
    }

    #[test]
    fn the_angles_derivatives_match_the_motion_caused_by_the_forces() {
        let generator = Trajectory::new(&uneven(), TrajectoryGains::default());
        for t in [0.0, 0.1, 0.37] {
            let (theta, _, f_1) = motion(&generator, t);
            let actual = generator.surface_angle(theta[0], theta[1], &f_1);
            for j in 0..5 {
                // f_1 is 1e4 times larger than the inertia's part of it: 4 digits are lost per pair.
                assert_close(actual[j], theta[j], if j < 4 { 1e-10 } else { 1e-6 });
            }
        }
    }

    #[test]
    fn the_desired_sum_has_the_value_of_the_published_equation() {
        // Every term of eq. (25) by hand for Table 1, k_1 = 300, k_2 = 200:
        // y_1 = 0.1, y_2 = 0.5, theta_r = 0.09, theta_r' = 0.6, theta_r'' = 2.
        let generator = Trajectory::new(
            &Model::default(),
            TrajectoryGains {
                angle_gain_per_s: 300.0,
                rate_gain_per_s: 200.0,
            },
        );
        let y_1 = [0.1, 0.5, 0.0, 0.0, 0.0];
        let theta_r = [0.09, 0.6, 2.0, 0.0, 0.0, 0.0];
        // z_1 = 0.01, alpha_r1 = -3 + 0.6 = -2.4, z_2 = 2.9,
        // alpha_r1' = -300 (0.5 - 0.6) + 2 = 32
        // 0.15 * 2e8 * 0.1 + 51.75 / 0.15 * 0.5 + 9.14e5 * 0.15 * 0.1
        //   + 13.5 / 0.15 (32 - 200 * 2.9 - 0.01)
        let expected = 3e6 + 172.5 + 13_710.0 + 90.0 * (32.0 - 580.0 - 0.01);
        assert_close(generator.sum(&y_1, &theta_r)[0], expected, 1e-14);
    }

    #[test]
    fn the_derivatives_of_the_desired_sum_are_its_slopes() {
        let generator = Trajectory::new(&uneven(), TrajectoryGains::default());
        let sum_at = |t: f64| {
            let (theta, theta_r, _) = motion(&generator, t);
            generator.sum(&theta, &theta_r)
        };
        for j in 0..3 {
            for t in [0.05, 0.3] {
                assert_close(sum_at(t)[j + 1], slope(|t| sum_at(t)[j], t, 1e-2), 1e-7);
            }
        }
    }

    #[test]
    fn a_surface_that_follows_its_command_needs_exactly_the_force_of_its_motion() {
        // With y_1 = theta_r both errors vanish and x_r1 must be the f_1 that causes the motion.
        let generator = Trajectory::new(&uneven(), TrajectoryGains::default());
        let (theta, _, f_1) = motion(&generator, 0.2);
        let theta_r: Jet<f64, 6> = wave(0.19, 6.0, 0.1, 0.2);
        let sum = generator.sum(&theta, &theta_r);
        for j in 0..3 {
            assert_close(sum[j], f_1[j], 1e-12);
        }
    }

    #[test]
    fn the_desired_difference_makes_both_rods_push_equally() {
        // Eq. (33) at theta_d = theta_r: with f_2 = x_r2 the force fight is zero.
        let model = uneven();
        let generator = Trajectory::new(&model, TrajectoryGains::default());
        let theta_r: Jet<f64, 6> = wave(0.2, 6.0, 0.0, 0.2);
        let difference = generator.difference(&theta_r);
        for j in 0..4 {
            assert_close(difference[j], 2e7 * 0.15 * theta_r[j], 1e-14);
        }
        let even = Trajectory::new(&Model::default(), TrajectoryGains::default());
        assert_eq!(even.difference(&theta_r), [0.0; 4]);
    }
}

//! The three steps of the backstepping design (eqs. 39-55).
//!
//! Called by the law at every sample. Each step computes an error and, from it, the desired value of the next quantity
//! in the chain position, velocity, force, rate of force. Vectors have two components, the sum and the difference.
//! Derivatives follow by the chain rule and are exact for exact inputs.

use core::array::from_fn;

use nalgebra::Vector2;

use super::Jet;
use super::gains::Gains;
use super::transformation::Transformation;

type Vector = Vector2<f64>;

/// Three error vectors of the design.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// z_1 in N (eq. 39).
    pub z_1: Vector,
    /// z_2 in N/s (eq. 40).
    pub z_2: Vector,
    /// z_3 in N/s2 (eq. 43).
    pub z_3: Vector,
}

/// Gains of the steps, one vector or diagonal each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// k_1 in 1/s.
    k_1: Vector,
    /// k_2s1 + h_2 / (4 epsilon) in 1/s: both terms of alpha_2s act on z_2.
    velocity_gain: Vector,
    /// k_3s1 + h_3 / (4 xi) in 1/s: both terms of u_s act on z_3.
    force_gain: Vector,
}

impl Steps {
    /// Creates the steps with the paper's gains.
    ///
    /// `alpha_2s1 = -k_2s1 z_2` (eq. 45), `alpha_2s2 = -h_2 / (4 epsilon) z_2` (eq. 47),
    /// `u_s1 = -k_3s1 z_3` (eq. 52), `u_s2 = -h_3 / (4 xi) z_3` (eq. 55).
    #[must_use]
    pub fn new(gains: &Gains) -> Self {
        Self {
            k_1: gains.vector(|own| own.position_gain_per_s),
            velocity_gain: gains.vector(|own| {
                let (h_2, epsilon) = (
                    own.disturbance_weight_n2_per_s4,
                    own.disturbance_margin_n2_per_s3,
                );
                own.velocity_gain_per_s + h_2 / (4.0 * epsilon)
            }),
            force_gain: gains.vector(|own| {
                let (h_3, xi) = (own.leakage_weight_n2_per_s6, own.leakage_margin_n2_per_s5);
                own.force_gain_per_s + h_3 / (4.0 * xi)
            }),
        }
    }

    /// Step 1, error.
    ///
    /// `z_1 = f - x_r` (eq. 39).
    fn position_error(f: &Jet<Vector, 3>, x_r: &Jet<Vector, 4>) -> Jet<Vector, 3> {
        from_fn(|j| f[j] - x_r[j])
    }

    /// Step 1, desired f'.
    ///
    /// `alpha_1 = -k_1 z_1 + x_r'` (after eq. 41).
    fn wanted_velocity(&self, z_1: &Jet<Vector, 3>, x_r: &Jet<Vector, 4>) -> Jet<Vector, 3> {
        from_fn(|j| x_r[j + 1] - self.k_1.component_mul(&z_1[j]))
    }

    /// Step 2, error.
    ///
    /// `z_2 = f' - alpha_1` (eq. 40).
    fn velocity_error(f: &Jet<Vector, 3>, alpha_1: &Jet<Vector, 3>) -> Jet<Vector, 2> {
        from_fn(|j| f[j + 1] - alpha_1[j])
    }

    /// Step 2, desired transformed force M_3 x_3.
    ///
    /// `alpha_2 = -z_1 + M_1 f + M_2 f' - M_4 x_coupling + alpha_1' - k_2s1 z_2
    /// - h_2 / (4 epsilon) z_2` (eqs. 45, 47), with `x_coupling = [theta_d, theta_d]`.
    fn wanted_force(
        &self,
        plant: &Transformation,
        f: &Jet<Vector, 3>,
        theta_d: &Jet<f64, 5>,
        z_1: &Jet<Vector, 3>,
        alpha_1: &Jet<Vector, 3>,
        z_2: &Jet<Vector, 2>,
    ) -> Jet<Vector, 2> {
        from_fn(|j| {
            plant.m_1 * f[j] + plant.m_2 * f[j + 1]
                - plant.m_4 * Vector::repeat(theta_d[j])
                - z_1[j]
                + alpha_1[j + 1]
                - self.velocity_gain.component_mul(&z_2[j])
        })
    }

    /// Step 3, error.
    ///
    /// `z_3 = M_3 x_3 - alpha_2` (eq. 43).
    fn force_error(plant: &Transformation, x_3: Vector, alpha_2: &Jet<Vector, 2>) -> Vector {
        plant.m_3 * x_3 - alpha_2[0]
    }

    /// Step 3, desired rate of force, in N/s per actuator.
    ///
    /// `M_3^-1 (alpha_2' - z_2 - k_3s1 z_3 - h_3 / (4 xi) z_3)` (eqs. 52, 55).
    fn wanted_force_rate(
        &self,
        plant: &Transformation,
        alpha_2: &Jet<Vector, 2>,
        z_2: Vector,
        z_3: Vector,
    ) -> Vector {
        plant.m_3_inverse * (alpha_2[1] - z_2 - self.force_gain.component_mul(&z_3))
    }

    /// Returns the errors at a sample and the rate of force, in N/s per actuator, that the law demands beyond the
    /// plant's own terms.
    ///
    /// `f` and `x_r` are in N with their derivatives, `theta_d` in rad, `x_3` in N.
    #[must_use]
    pub fn errors_and_force_rate(
        &self,
        plant: &Transformation,
        f: &Jet<Vector, 3>,
        x_r: &Jet<Vector, 4>,
        theta_d: &Jet<f64, 5>,
        x_3: Vector,
    ) -> (Errors, Vector) {
        let z_1 = Self::position_error(f, x_r);
        let alpha_1 = self.wanted_velocity(&z_1, x_r);
        let z_2 = Self::velocity_error(f, &alpha_1);
        let alpha_2 = self.wanted_force(plant, f, theta_d, &z_1, &alpha_1, &z_2);
        let z_3 = Self::force_error(plant, x_3, &alpha_2);
        let force_rate = self.wanted_force_rate(plant, &alpha_2, z_2[0], z_3);
        let errors = Errors {
            z_1: z_1[0],
            z_2: z_2[0],
            z_3,
        };
        (errors, force_rate)
    }
}

#[cfg(test)]
mod tests {
    use super::super::gains::tests::table_2;
    use super::super::model::Model;
    use super::super::trajectory::tests::{assert_close, slope, uneven, wave};
    use super::*;

    /// Gains that differ in every component.
    fn steps() -> Steps {
        let mut gains = table_2();
        gains.components[1].position_gain_per_s = 700.0;
        gains.components[1].velocity_gain_per_s = 800.0;
        gains.components[1].force_gain_per_s = 900.0;
        gains.components[0].disturbance_weight_n2_per_s4 = 4e18;
        gains.components[0].leakage_weight_n2_per_s6 = 4e23;
        Steps::new(&gains)
    }

    /// A smooth motion: f with two derivatives, x_r with three, theta_d, and x_3 with one.
    struct Motion {
        f: Jet<Vector, 3>,
        x_r: Jet<Vector, 4>,
        theta_d: Jet<f64, 5>,
        x_3: Jet<Vector, 2>,
    }

    fn pair<const N: usize>(a: Jet<f64, N>, b: Jet<f64, N>) -> Jet<Vector, N> {
        from_fn(|j| Vector::new(a[j], b[j]))
    }

    fn motion(t: f64) -> Motion {
        Motion {
            f: pair(wave(6e6, 5.0, 0.2, t), wave(3e5, 7.0, 0.3, t)),
            x_r: pair(wave(5e6, 5.0, 0.1, t), wave(2e5, 7.0, 0.1, t)),
            theta_d: wave(0.2, 5.0, 0.0, t),
            x_3: pair(wave(2e4, 5.0, 0.4, t), wave(1.5e4, 6.0, 0.0, t)),
        }
    }

    /// Returns alpha_1 and alpha_2 of that motion.
    fn wanted(t: f64) -> (Jet<Vector, 3>, Jet<Vector, 2>) {
        let (steps, plant) = (steps(), Transformation::new(&uneven()));
        let m = motion(t);
        let z_1 = Steps::position_error(&m.f, &m.x_r);
        let alpha_1 = steps.wanted_velocity(&z_1, &m.x_r);
        let z_2 = Steps::velocity_error(&m.f, &alpha_1);
        let alpha_2 = steps.wanted_force(&plant, &m.f, &m.theta_d, &z_1, &alpha_1, &z_2);
        (alpha_1, alpha_2)
    }

    #[test]
    fn the_robust_terms_add_to_the_gains() {
        let steps = Steps::new(&table_2());
        // 1000 + 3.4e18 / 4e14 and 1000 + 2.5e23 / 4e21.
        assert_close(steps.velocity_gain[0], 9500.0, 1e-14);
        assert_close(steps.force_gain[1], 1062.5, 1e-14);
    }

    #[test]
    fn the_derivatives_of_the_desired_velocity_are_its_slopes() {
        for i in 0..2 {
            for j in 0..2 {
                let slope = slope(|t| wanted(t).0[j][i], 0.1, 1e-2);
                assert_close(wanted(0.1).0[j + 1][i], slope, 1e-7);
            }
        }
    }

    #[test]
    fn the_derivative_of_the_desired_force_is_its_slope() {
        for i in 0..2 {
            let slope = slope(|t| wanted(t).1[0][i], 0.1, 1e-2);
            assert_close(wanted(0.1).1[1][i], slope, 1e-7);
        }
    }

    #[test]
    fn the_desired_force_has_the_value_of_the_published_equation() {
        // Component 2 for Table 1 and Table 2, term by term; equal actuators, so M_1, M_2 are
        // multiples of the identity and the coupling cancels.
        let steps = Steps::new(&table_2());
        let plant = Transformation::new(&Model::default());
        let f = [100.0, 50.0, 20.0].map(|v| Vector::new(0.0, v));
        let x_r = [90.0, 30.0, 10.0, 5.0].map(|v| Vector::new(0.0, v));
        let theta_d = [0.1, 0.0, 0.0, 0.0, 0.0];
        let (errors, _) = steps.errors_and_force_rate(&plant, &f, &x_r, &theta_d, Vector::zeros());
        // z_1 = 10, alpha_1 = 30 - 1e4 = -9970, z_2 = 10020, alpha_1' = 10 - 1000 * 20 = -19990
        let alpha_2 = -10.0 + 1e8 / 55.0 * 100.0 + 1e4 / 55.0 * 50.0 - 19_990.0 - 9500.0 * 10_020.0;
        assert_eq!((errors.z_1[1], errors.z_2[1]), (10.0, 10_020.0));
        assert_close(errors.z_3[1], -alpha_2, 1e-13);
        assert_close(errors.z_3[0], 2.0 * 1e8 / 55.0 * 1e8 * 0.15 * 0.1, 1e-13);
    }

    #[test]
    fn without_disturbance_v3_falls_at_the_rate_of_the_gains() {
        // Eqs. (35), (50), (58) with d = 0 and no leakage:
        // V_3' = -z_1 k_1 z_1 - z_2 (k_2s1 + h_2/4eps) z_2 - z_3 (k_3s1 + h_3/4xi) z_3.
        // Here V_3' comes from the plant's equation (35) and the demanded force rate alone.
        let (steps, plant) = (steps(), Transformation::new(&uneven()));
        let mut m = motion(0.13);
        let x_3 = m.x_3[0];
        m.f[2] = -plant.m_1 * m.f[0] - plant.m_2 * m.f[1]
            + plant.m_3 * x_3
            + plant.m_4 * Vector::repeat(m.theta_d[0]);
        let (errors, force_rate) =
            steps.errors_and_force_rate(&plant, &m.f, &m.x_r, &m.theta_d, x_3);
        let z_1 = Steps::position_error(&m.f, &m.x_r);
        let alpha_1 = steps.wanted_velocity(&z_1, &m.x_r);
        let z_2 = Steps::velocity_error(&m.f, &alpha_1);
        let alpha_2 = steps.wanted_force(&plant, &m.f, &m.theta_d, &z_1, &alpha_1, &z_2);
        let z_3_rate = plant.m_3 * force_rate - alpha_2[1];
        let rate = errors.z_1.dot(&z_1[1]) + errors.z_2.dot(&z_2[1]) + errors.z_3.dot(&z_3_rate);
        let square = |gain: &Vector, z: &Vector| gain.component_mul(z).dot(z);
        let expected = -square(&steps.k_1, &errors.z_1)
            - square(&steps.velocity_gain, &errors.z_2)
            - square(&steps.force_gain, &errors.z_3);
        assert_close(rate, expected, 1e-9);
    }
}

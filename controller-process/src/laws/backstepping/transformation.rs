//! Linear transformation of the two pistons into sum and difference (eqs. 34, 35).
//!
//! Computed once, when the law starts. T is neither orthogonal nor symmetric if the connection stiffnesses differ; M_1
//! and M_2 then couple the two components.

use nalgebra::{Matrix2, Vector2};

use super::model::Model;

/// Matrices of the transformed system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transformation {
    /// `T = [[K_h1, K_h2], [K_h1, -K_h2]]` in N/m.
    pub t: Matrix2<f64>,
    /// `M_1 = T H_1 T^-1` in 1/s2.
    pub m_1: Matrix2<f64>,
    /// `M_2 = T H_2 T^-1` in 1/s.
    pub m_2: Matrix2<f64>,
    /// `M_3 = T H_3` in 1/s2 (N/m per kg).
    pub m_3: Matrix2<f64>,
    /// `M_3^-1 = H_3^-1 T^-1` in s2.
    pub m_3_inverse: Matrix2<f64>,
    /// `M_4 = T H_4` in N/s2 per rad.
    pub m_4: Matrix2<f64>,
}

impl Transformation {
    /// Creates the matrices for the law's model of the plant.
    ///
    /// `H_1 = diag(K_h / m_h)`, `H_2 = diag(B_h / m_h)`, `H_3 = diag(1 / m_h)`,
    /// `H_4 = diag(K_h r_d / m_h)` (after eq. 23).
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let actuators = model.actuators();
        let [k_1, k_2] = actuators.map(|own| own.connection_stiffness_n_per_m);
        let [m_1, m_2] = actuators.map(|own| own.piston_mass_kg);
        let [b_1, b_2] = actuators.map(|own| own.damping_n_s_per_m);
        let r_d = model.surface.radial_distance_m;
        let diag = |a, b| Matrix2::new(a, 0.0, 0.0, b);

        let t = Matrix2::new(k_1, k_2, k_1, -k_2);
        // In closed form: it exists for every pair of stiffnesses above zero.
        let t_inverse = Matrix2::new(0.5 / k_1, 0.5 / k_1, 0.5 / k_2, -0.5 / k_2);
        let h_1 = diag(k_1 / m_1, k_2 / m_2);
        let h_2 = diag(b_1 / m_1, b_2 / m_2);
        let h_3 = diag(1.0 / m_1, 1.0 / m_2);
        let h_4 = diag(k_1 * r_d / m_1, k_2 * r_d / m_2);
        Self {
            t,
            m_1: t * h_1 * t_inverse,
            m_2: t * h_2 * t_inverse,
            m_3: t * h_3,
            m_3_inverse: diag(m_1, m_2) * t_inverse,
            m_4: t * h_4,
        }
    }

    /// Computes `f = T [x_1, x_2]^T` (after eq. 34), for positions, velocities or accelerations.
    #[must_use]
    pub fn sum_and_difference(&self, pistons: Vector2<f64>) -> Vector2<f64> {
        self.t * pistons
    }
}

#[cfg(test)]
mod tests {
    use super::super::trajectory::tests::{assert_close, uneven};
    use super::*;

    #[track_caller]
    fn assert_matrix(matrix: Matrix2<f64>, rows: [[f64; 2]; 2]) {
        for (i, row) in rows.iter().enumerate() {
            for (j, expected) in row.iter().enumerate() {
                let off = (matrix[(i, j)] - expected).abs();
                assert!(
                    off <= 1e-13 * matrix.norm(),
                    "({i}, {j}): {matrix} is not {rows:?}"
                );
            }
        }
    }

    #[test]
    fn equal_actuators_leave_sum_and_difference_uncoupled() {
        let transformation = Transformation::new(&Model::default());
        let (k, b) = (1e8 / 55.0, 1e4 / 55.0);
        assert_matrix(transformation.m_1, [[k, 0.0], [0.0, k]]);
        assert_matrix(transformation.m_2, [[b, 0.0], [0.0, b]]);
        assert_matrix(transformation.m_3, [[k, k], [k, -k]]);
        assert_matrix(
            transformation.m_4,
            [[1e8 * 0.15 * k; 2], [1e8 * 0.15 * k, -1e8 * 0.15 * k]],
        );
    }

    #[test]
    fn unequal_actuators_couple_them() {
        // By hand: T diag(a, b) T^-1 = 1/2 [[a + b, a - b], [a - b, a + b]] for any K_h1, K_h2.
        let transformation = Transformation::new(&uneven());
        let (a, b) = (1.1e8 / 50.0, 0.9e8 / 55.0);
        let (p, q) = (0.5 * (a + b), 0.5 * (a - b));
        assert_matrix(transformation.m_1, [[p, q], [q, p]]);
        let (a, b) = (1e4 / 50.0, 1.2e4 / 55.0);
        let (p, q) = (0.5 * (a + b), 0.5 * (a - b));
        assert_matrix(transformation.m_2, [[p, q], [q, p]]);
        let (a, b) = (1.1e8 / 50.0, 0.9e8 / 55.0);
        assert_matrix(transformation.m_3, [[a, b], [a, -b]]);
        let (a, b) = (1.1e8 * 0.15 * a, 0.9e8 * 0.15 * b);
        assert_matrix(transformation.m_4, [[a, b], [a, -b]]);
    }

    #[test]
    fn the_inverse_of_m_3_undoes_it() {
        let transformation = Transformation::new(&uneven());
        assert_matrix(
            transformation.m_3 * transformation.m_3_inverse,
            [[1.0, 0.0], [0.0, 1.0]],
        );
    }

    #[test]
    fn positions_become_their_weighted_sum_and_difference() {
        let f = Transformation::new(&uneven()).sum_and_difference(Vector2::new(0.02, 0.01));
        assert_close(f[0], 3.1e6, 1e-15);
        assert_close(f[1], 1.3e6, 1e-15);
    }
}

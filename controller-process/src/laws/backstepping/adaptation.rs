//! Online estimate of the leakage coefficients (eqs. 67, 68).
//!
//! Called by the law after the command, so that an estimate takes effect at the next sample.

use nalgebra::Vector2;
use shared_types::describe::Invalid;
use shared_types::number::exact;

use super::transformation::Transformation;

shared_types::table! {
    /// The estimate of one actuator's leakage coefficient (Table 2).
    pub struct AdaptationGains {
        /// Learning rate Gamma. Higher learns faster.
        learning_rate_m8s2_per_n3: "m8 s2/N3" = 1e-37 in 0.0..=1e100 [tunable],
        /// Smallest possible coefficient, theta_min.
        estimate_min_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)" = 0.0 in 0.0..=1e3 [tunable],
        /// Largest possible coefficient, theta_max.
        estimate_max_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)" = 5e-6 in 0.0..=1e3 [tunable],
    }
}

/// Estimate theta_hat of both leakage coefficients, in m3/s/sqrt(Pa).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeakageEstimate {
    gains: [AdaptationGains; 2],
    theta_hat: Vector2<f64>,
}

impl LeakageEstimate {
    /// Creates the estimate before the first sample: no leakage, or the smallest possible leakage.
    ///
    /// # Errors
    /// If a smallest coefficient is above the largest.
    pub fn new(gains: [AdaptationGains; 2]) -> Result<Self, Invalid> {
        for (group, own) in ["adaptation1", "adaptation2"].iter().zip(gains) {
            let (min, max) = (
                own.estimate_min_m3ps_per_sqrt_pa,
                own.estimate_max_m3ps_per_sqrt_pa,
            );
            if min > max {
                return Err(Invalid(format!(
                    "{group}.estimate_min_m3ps_per_sqrt_pa = {} must not be above \
                     {group}.estimate_max_m3ps_per_sqrt_pa = {}",
                    exact(min),
                    exact(max)
                )));
            }
        }
        let [first, second] = gains.map(|own| projected(0.0, &own));
        Ok(Self {
            gains,
            theta_hat: Vector2::new(first, second),
        })
    }

    /// Applies other gains; the estimate stays, clamped to the new limits.
    pub fn retune(&mut self, gains: [AdaptationGains; 2]) {
        self.gains = gains;
        for (estimate, own) in self.theta_hat.iter_mut().zip(&gains) {
            *estimate = projected(*estimate, own);
        }
    }

    /// Returns the current estimate, in m3/s/sqrt(Pa).
    #[must_use]
    pub fn theta_hat(&self) -> Vector2<f64> {
        self.theta_hat
    }

    /// Continues from these estimates, in m3/s/sqrt(Pa).
    pub fn restore(&mut self, theta_hat: Vector2<f64>) {
        self.theta_hat = theta_hat;
    }

    /// Takes an explicit Euler step of the estimate.
    ///
    /// `sigma = -Gamma F_3^T M_3^T z_3` (eq. 67), applied while V_3 is above V_r; the projection of eq. (68) is the
    /// bound on each component. `f_3` holds the diagonal of F_3.
    pub fn adapt(
        &mut self,
        plant: &Transformation,
        f_3: Vector2<f64>,
        z_3: Vector2<f64>,
        period_s: f64,
    ) {
        let effect = f_3.component_mul(&plant.m_3.tr_mul(&z_3));
        for (i, own) in self.gains.iter().enumerate() {
            let sigma = -own.learning_rate_m8s2_per_n3 * effect[i];
            self.theta_hat[i] = projected(self.theta_hat[i] + sigma * period_s, own);
        }
    }
}

/// Clamps an estimate to its limits.
fn projected(estimate: f64, own: &AdaptationGains) -> f64 {
    if estimate < own.estimate_min_m3ps_per_sqrt_pa {
        own.estimate_min_m3ps_per_sqrt_pa
    } else if estimate > own.estimate_max_m3ps_per_sqrt_pa {
        own.estimate_max_m3ps_per_sqrt_pa
    } else {
        estimate
    }
}

#[cfg(test)]
mod tests {
    use super::super::trajectory::tests::{assert_close, uneven};
    use super::*;

    fn gains() -> [AdaptationGains; 2] {
        let second = AdaptationGains {
            learning_rate_m8s2_per_n3: 3e-37,
            ..AdaptationGains::default()
        };
        [AdaptationGains::default(), second]
    }

    #[test]
    fn the_estimate_moves_along_the_published_direction() {
        // M_3 = [[a, b], [a, -b]] with a = 1.1e8/50 = 2.2e6, b = 0.9e8/55; z_3 = [-3e9, 1e9]:
        // M_3^T z_3 = [-2e9 a, -4e9 b]
        let plant = Transformation::new(&uneven());
        let mut estimate = LeakageEstimate::new(gains()).expect("legal");
        let (f_3, z_3) = (Vector2::new(9e13, 5e13), Vector2::new(-3e9, 1e9));
        estimate.adapt(&plant, f_3, z_3, 1e-4);
        let estimate_now = estimate.theta_hat();
        assert_close(estimate_now[0], 1e-37 * 9e13 * 2e9 * 2.2e6 * 1e-4, 1e-13);
        assert_close(
            estimate_now[1],
            3e-37 * 5e13 * 4e9 * (0.9e8 / 55.0) * 1e-4,
            1e-13,
        );
    }

    #[test]
    fn the_estimate_stays_within_its_limits() {
        let plant = Transformation::new(&uneven());
        let mut estimate = LeakageEstimate::new(gains()).expect("legal");
        let f_3 = Vector2::new(1e14, 1e14);
        for _ in 0..10 {
            estimate.adapt(&plant, f_3, Vector2::new(-1e16, 0.0), 1e-4);
        }
        assert_eq!(estimate.theta_hat(), Vector2::new(5e-6, 5e-6));
        for _ in 0..20 {
            estimate.adapt(&plant, f_3, Vector2::new(1e16, 0.0), 1e-4);
        }
        assert_eq!(estimate.theta_hat(), Vector2::zeros());
    }

    #[test]
    fn an_estimate_starts_at_its_smallest_possible_value() {
        let mut gains = gains();
        gains[1].estimate_min_m3ps_per_sqrt_pa = 2e-9;
        let estimate = LeakageEstimate::new(gains).expect("legal");
        assert_eq!(estimate.theta_hat(), Vector2::new(0.0, 2e-9));
    }

    #[test]
    fn crossed_bounds_are_refused_by_name() {
        let mut gains = gains();
        gains[1].estimate_min_m3ps_per_sqrt_pa = 1e-5;
        let Invalid(text) = LeakageEstimate::new(gains).expect_err("1e-5 is above 5e-6");
        assert!(
            text.contains("adaptation2.estimate_max_m3ps_per_sqrt_pa = 5e-6"),
            "{text}"
        );
    }
}

//! Design parameters shared by NRSC and FTSC (Table 2), and their conditions.
//!
//! The paper's pairs of gains belong to the transformed coordinates of eq. (34), not to the actuators: component 1 is
//! the sum of the two stiffness-weighted positions, component 2 their difference. The groups are named accordingly.

use nalgebra::Vector2;
use shared_types::describe::Invalid;
use shared_types::number::exact;

use crate::laws::limit::UNLIMITED;

shared_types::table! {
    /// Gains of the trajectory generator, which turns the surface's error into the wanted sum of
    /// the spring forces.
    pub struct TrajectoryGains {
        /// k_1 (eq. 28). Higher follows the angle more tightly.
        angle_gain_per_s: "1/s" = 300.0 in 1e-6..=1e9 [tunable],
        /// k_2 (eq. 25). Higher follows the angular rate more tightly.
        rate_gain_per_s: "1/s" = 300.0 in 1e-6..=1e9 [tunable],
    }
}

shared_types::table! {
    /// Gains of one component of the transformed system.
    pub struct ComponentGains {
        /// k_11 or k_12, the gain on z_1 (after eq. 41).
        position_gain_per_s: "1/s" = 1000.0 in 1e-6..=1e9 [tunable],
        /// k_2s11 or k_2s12, the gain on z_2 (eq. 45).
        velocity_gain_per_s: "1/s" = 1000.0 in 1e-6..=1e9 [tunable],
        /// k_3s11 or k_3s12, the gain on z_3 (eq. 52).
        force_gain_per_s: "1/s" = 1000.0 in 1e-6..=1e9 [tunable],
        /// Largest expected effect of the disturbance, d-bar (eq. 36).
        disturbance_bound_n_per_s2: "N/s2" = 1.8e9 in 0.0..=1e100 [tunable],
        /// h_21 or h_22, at least the square of that bound (eqs. 47, 48). Higher resists
        /// disturbances more.
        disturbance_weight_n2_per_s4: "N2/s4" = 3.4e18 in 0.0..=1e200 [tunable],
        /// epsilon_1 or epsilon_2 (eq. 46). Lower resists disturbances more.
        disturbance_margin_n2_per_s3: "N2/s3" = 1e14 in 1e-100..=1e100 [tunable],
        /// Largest leakage effect to be tolerated without adaptation, q-bar (eq. 53).
        leakage_bound_n_per_s3: "N/s3" = 4.5e11 in 0.0..=1e100 [tunable],
        /// h_31 or h_32, at least the square of that bound (eqs. 55, 56). Higher resists leakage
        /// more.
        leakage_weight_n2_per_s6: "N2/s6" = 2.5e23 in 0.0..=1e200 [tunable],
        /// xi_1 or xi_2 (eq. 54). Lower resists leakage more, and lowers the bound V_r.
        leakage_margin_n2_per_s5: "N2/s5" = 1e21 in 1e-100..=1e100 [tunable],
    }
}

shared_types::table! {
    /// Limits of one actuator's command.
    pub struct Output {
        /// Largest magnitude of the current; infinite means no limit.
        command_limit_a: "A" = UNLIMITED in 0.0..=UNLIMITED [tunable],
    }
}

shared_types::table! {
    /// Judgement of the performance indicator.
    pub struct Performance {
        /// Time for which V_3 must stay above V_r to count as a detected fault (Remark 16). V_3
        /// exceeds V_r for single samples after every start, whether there is a fault or not.
        detection_hold_s: "s" = 0.010 in 0.0..=1e6 [tunable],
    }
}

/// Shared parameters, in the form that the law's core uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// k_1 and k_2.
    pub trajectory: TrajectoryGains,
    /// Gains of the sum and of the difference.
    pub components: [ComponentGains; 2],
    /// Limits of the two commands.
    pub outputs: [Output; 2],
    /// Detection.
    pub performance: Performance,
}

impl Gains {
    /// Checks the conditions of the design.
    ///
    /// `h_2 >= d-bar^2` (eq. 48) and `h_3 >= q-bar^2` (eq. 56), for either component.
    ///
    /// # Errors
    /// If a condition is violated; the error states both sides of the condition and the key to change.
    pub fn check(&self) -> Result<(), Invalid> {
        for (group, own) in ["force_sum", "force_difference"]
            .iter()
            .zip(self.components)
        {
            let conditions = [
                (
                    "disturbance_weight_n2_per_s4",
                    own.disturbance_weight_n2_per_s4,
                    "disturbance_bound_n_per_s2",
                    own.disturbance_bound_n_per_s2,
                    48,
                ),
                (
                    "leakage_weight_n2_per_s6",
                    own.leakage_weight_n2_per_s6,
                    "leakage_bound_n_per_s3",
                    own.leakage_bound_n_per_s3,
                    56,
                ),
            ];
            for (weight_name, weight, bound_name, bound, equation) in conditions {
                if weight < bound * bound {
                    return Err(Invalid(format!(
                        "{group}.{weight_name} = {} must be at least the square of \
                         {group}.{bound_name} = {}, which is {} (paper eq. {equation})",
                        exact(weight),
                        exact(bound),
                        exact(bound * bound)
                    )));
                }
            }
        }
        Ok(())
    }

    /// Collects a gain of both components as a vector.
    pub(super) fn vector(&self, gain: fn(&ComponentGains) -> f64) -> Vector2<f64> {
        let [sum, difference] = &self.components;
        Vector2::new(gain(sum), gain(difference))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Returns the gains of Table 2.
    pub(in super::super) fn table_2() -> Gains {
        Gains {
            trajectory: TrajectoryGains::default(),
            components: [ComponentGains::default(); 2],
            outputs: [Output::default(); 2],
            performance: Performance::default(),
        }
    }

    #[test]
    fn the_papers_gains_meet_the_conditions() {
        assert_eq!(table_2().check(), Ok(()));
    }

    #[test]
    fn a_disturbance_weight_below_the_bounds_square_is_refused_by_name() {
        let mut gains = table_2();
        gains.components[1].disturbance_bound_n_per_s2 = 2e9;
        let Err(Invalid(text)) = gains.check() else {
            panic!("4e18 is above 3.4e18");
        };
        for part in [
            "force_difference.disturbance_weight_n2_per_s4 = 3.4e18",
            "4e18",
            "eq. 48",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }

    #[test]
    fn a_leakage_weight_below_the_bounds_square_is_refused_by_name() {
        let mut gains = table_2();
        gains.components[0].leakage_weight_n2_per_s6 = 2e23;
        let Err(Invalid(text)) = gains.check() else {
            panic!("2e23 is below 2.025e23");
        };
        for part in [
            "force_sum.leakage_weight_n2_per_s6 = 2e23",
            "2.025e23",
            "eq. 56",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}

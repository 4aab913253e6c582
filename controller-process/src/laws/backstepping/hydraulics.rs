//! Hydraulics of an actuator in the law's model (eqs. 10, 11, 18, 20-22).
//!
//! The rate of the hydraulic force `x_3 = A_1 P_h1 - A_2 P_h2` is `x_3' = f_h1 u - f_h2 - f_h3 C_t` (eqs. 19, 23); the
//! law solves it for the current u.

use super::model::ActuatorModel;
use super::signals::PistonState;

/// Smallest effect of the current used as a divisor. The effect vanishes where a chamber reaches the supply or the
/// return pressure; in the paper's runs it stays above 2.5e7 N/(s A).
const MIN_CURRENT_EFFECT_N_PER_S_A: f64 = 1e-9;

/// Terms of eq. (19) at a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hydraulics {
    /// `A_1 beta_e / V_h1` in N/m3.
    chamber1_n_per_m3: f64,
    /// `A_2 beta_e / V_h2` in N/m3.
    chamber2_n_per_m3: f64,
}

/// `x_3 = A_1 P_h1 - A_2 P_h2`, the force of the oil on the piston (eq. 18).
#[must_use]
pub fn hydraulic_force_n(model: &ActuatorModel, piston: &PistonState) -> f64 {
    model.area1_m2 * piston.pressure1_pa - model.area2_m2 * piston.pressure2_pa
}

impl Hydraulics {
    /// The state of the chambers at a piston position.
    ///
    /// `V_h1 = V_10 + A_1 x_h`, `V_h2 = V_20 - A_2 x_h` (after eq. 4).
    #[must_use]
    pub fn at(model: &ActuatorModel, piston: &PistonState) -> Self {
        let x_h = piston.position_m;
        let v_h1 = model.volume1_m3 + model.area1_m2 * x_h;
        let v_h2 = model.volume2_m3 - model.area2_m2 * x_h;
        Self {
            chamber1_n_per_m3: model.area1_m2 * model.bulk_modulus_pa / v_h1,
            chamber2_n_per_m3: model.area2_m2 * model.bulk_modulus_pa / v_h2,
        }
    }

    /// Effect of the current on the rate of force, limited to a small positive minimum.
    ///
    /// `f_h1 = A_1 beta_e / V_h1 k_q k_i R_h1 + A_2 beta_e / V_h2 k_q k_i R_h2` (eq. 20).
    #[must_use]
    pub fn current_effect_n_per_s_a(
        &self,
        model: &ActuatorModel,
        piston: &PistonState,
        opens: bool,
    ) -> f64 {
        let (r_h1, r_h2) = if opens {
            opening_roots_sqrt_pa(model, piston)
        } else {
            closing_roots_sqrt_pa(model, piston)
        };
        let k = model.flow_gain_m2ps_per_sqrt_pa * model.valve_gain_m_per_a;
        let f_h1 = k * (self.chamber1_n_per_m3 * r_h1 + self.chamber2_n_per_m3 * r_h2);
        if f_h1 < MIN_CURRENT_EFFECT_N_PER_S_A {
            MIN_CURRENT_EFFECT_N_PER_S_A
        } else {
            f_h1
        }
    }

    /// Loss of force rate by the piston's motion and the normal leakage.
    ///
    /// `f_h2 = A_1 beta_e / V_h1 [A_1 x_h' + C_i (P_h1 - P_h2)] + A_2 beta_e / V_h2 [A_2 x_h' + C_i (P_h1 - P_h2)]`
    /// (eq. 21).
    #[must_use]
    pub fn motion_effect_n_per_s(&self, model: &ActuatorModel, piston: &PistonState) -> f64 {
        let v = piston.velocity_mps;
        let leak = model.internal_leakage_m3ps_per_pa * (piston.pressure1_pa - piston.pressure2_pa);
        self.chamber1_n_per_m3 * (model.area1_m2 * v + leak)
            + self.chamber2_n_per_m3 * (model.area2_m2 * v + leak)
    }

    /// Loss of force rate per unit of the fault's leakage coefficient, in N/s per m3/s/sqrt(Pa).
    ///
    /// `f_h3 = (A_1 beta_e / V_h1 + A_2 beta_e / V_h2) sqrt(|P_h1 - P_h2|) sgn(P_h1 - P_h2)`
    /// (eq. 22 without beta and C_t, which eq. 23 multiplies with it).
    #[must_use]
    pub fn leakage_effect(&self, piston: &PistonState) -> f64 {
        let drop_pa = piston.pressure1_pa - piston.pressure2_pa;
        let root = drop_pa.abs().sqrt();
        let signed = if drop_pa < 0.0 { -root } else { root };
        (self.chamber1_n_per_m3 + self.chamber2_n_per_m3) * signed
    }

    /// Returns the current for a rate of force from which the model's own terms are already subtracted.
    ///
    /// `u = [..] / f_h1` (eq. 52). f_h1 depends on the sign of u (eqs. 10, 11) and is positive, so that u has the sign
    /// of the bracket.
    #[must_use]
    pub fn current_a(
        &self,
        model: &ActuatorModel,
        piston: &PistonState,
        bracket_n_per_s: f64,
    ) -> f64 {
        let opens = bracket_n_per_s >= 0.0;
        bracket_n_per_s / self.current_effect_n_per_s_a(model, piston, opens)
    }
}

/// Returns R_h1 and R_h2 for u >= 0: the supply feeds the active chamber.
///
/// `R_h1 = sqrt(P_s - P_h1)`, `R_h2 = sqrt(P_h2 - P_r)` (eqs. 10, 11 with s(u) = 1, s(-u) = 0; at u = 0, where both
/// would be 1, the flow is zero whatever R is).
fn opening_roots_sqrt_pa(model: &ActuatorModel, piston: &PistonState) -> (f64, f64) {
    (
        root_sqrt_pa(model.supply_pressure_pa - piston.pressure1_pa),
        root_sqrt_pa(piston.pressure2_pa - model.return_pressure_pa),
    )
}

/// Returns R_h1 and R_h2 for u < 0: the supply feeds the passive chamber.
///
/// `R_h1 = sqrt(P_h1 - P_r)`, `R_h2 = sqrt(P_s - P_h2)` (eqs. 10, 11 with s(u) = 0, s(-u) = 1).
fn closing_roots_sqrt_pa(model: &ActuatorModel, piston: &PistonState) -> (f64, f64) {
    (
        root_sqrt_pa(piston.pressure1_pa - model.return_pressure_pa),
        root_sqrt_pa(model.supply_pressure_pa - piston.pressure2_pa),
    )
}

/// Root of a pressure drop across an opening; 0 for a negative drop, because no oil flows against it.
fn root_sqrt_pa(drop_pa: f64) -> f64 {
    if drop_pa < 0.0 { 0.0 } else { drop_pa.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::super::trajectory::tests::assert_close;
    use super::*;

    fn piston(position_m: f64, velocity_mps: f64, pressures_pa: [f64; 2]) -> PistonState {
        PistonState {
            position_m,
            velocity_mps,
            pressure1_pa: pressures_pa[0],
            pressure2_pa: pressures_pa[1],
        }
    }

    /// Numbers that make every root and quotient of Table 1 exact by hand: A beta_e / V = 1.47e-3 * 8e8 / 7.35e-5 =
    /// 1.6e10 N/m3 at position 0.
    const CHAMBER: f64 = 1.6e10;

    #[test]
    fn the_force_is_that_of_both_chambers() {
        let model = ActuatorModel {
            area2_m2: 1e-3,
            ..ActuatorModel::default()
        };
        let force_n = hydraulic_force_n(&model, &piston(0.0, 0.0, [10e6, 4e6]));
        assert_close(force_n, 14_700.0 - 4000.0, 1e-14);
    }

    #[test]
    fn an_opening_valve_feeds_the_active_chamber() {
        let model = ActuatorModel::default();
        let state = piston(0.0, 0.0, [19e6, 4e6]); // roots 3000 and 2000
        let effect = Hydraulics::at(&model, &state).current_effect_n_per_s_a(&model, &state, true);
        assert_close(effect, 7.5e-5 * 3.04e-3 * CHAMBER * 5000.0, 1e-14);
    }

    #[test]
    fn a_closing_valve_feeds_the_passive_chamber() {
        let model = ActuatorModel {
            return_pressure_pa: 3e6,
            ..ActuatorModel::default()
        };
        let state = piston(0.0, 0.0, [19e6, 27e6]); // roots 4000 and 1000
        let effect = Hydraulics::at(&model, &state).current_effect_n_per_s_a(&model, &state, false);
        assert_close(effect, 7.5e-5 * 3.04e-3 * CHAMBER * 5000.0, 1e-14);
    }

    #[test]
    fn the_current_has_the_sign_of_the_bracket_and_uses_the_roots_of_that_sign() {
        let model = ActuatorModel::default();
        let state = piston(0.0, 0.0, [19e6, 4e6]);
        let hydraulics = Hydraulics::at(&model, &state);
        let gain = 7.5e-5 * 3.04e-3 * CHAMBER;
        assert_close(
            hydraulics.current_a(&model, &state, 1e7),
            1e7 / (gain * 5000.0),
            1e-14,
        );
        let roots = 19e6_f64.sqrt() + 24e6_f64.sqrt();
        assert_close(
            hydraulics.current_a(&model, &state, -1e7),
            -1e7 / (gain * roots),
            1e-14,
        );
    }

    #[test]
    fn chambers_outside_the_supply_leave_a_small_positive_effect() {
        let model = ActuatorModel::default();
        let state = piston(0.0, 0.0, [29e6, -1e6]);
        let hydraulics = Hydraulics::at(&model, &state);
        assert_eq!(
            hydraulics.current_effect_n_per_s_a(&model, &state, true),
            1e-9
        );
    }

    #[test]
    fn motion_and_normal_leakage_reduce_the_force() {
        // x_h = 0.01: V_h1 = 8.82e-5, V_h2 = 5.88e-5; A beta_e / V = 4e10/3 and 2e10.
        let model = ActuatorModel::default();
        let state = piston(0.01, 0.2, [12e6, 7e6]);
        let flow = 1.47e-3 * 0.2 + 1e-12 * 5e6;
        let effect = Hydraulics::at(&model, &state).motion_effect_n_per_s(&model, &state);
        assert_close(effect, (4e10 / 3.0 + 2e10) * flow, 1e-14);
    }

    #[test]
    fn leakage_reduces_the_force_in_the_direction_of_the_pressure_drop() {
        let model = ActuatorModel::default();
        for (pressures_pa, expected) in [
            ([13e6, 4e6], 2.0 * CHAMBER * 3000.0),
            ([4e6, 13e6], -2.0 * CHAMBER * 3000.0),
            ([4e6, 4e6], 0.0),
        ] {
            let state = piston(0.0, 0.0, pressures_pa);
            let effect = Hydraulics::at(&model, &state).leakage_effect(&state);
            assert_close(effect, expected, 1e-14);
        }
    }
}

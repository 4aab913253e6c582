//! The electro-hydraulic servo valve: from the spool's position to the flows of the chambers (eqs. 7 to 13).
//!
//! Called by the right-hand side of the hydraulic system with the position from [`spool`](super::spool). The valve's
//! edges neither overlap nor leak, as in the paper. The paper's `s(u)` is written `s(x_v)` here, which is the same
//! while `x_v = k_i u` and remains valid for other spool positions.

use super::actuators::{ActuatorStates, Actuators};
use super::pair::Pair;

/// Edges held open by the spools, and the lines behind them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenEdges {
    /// Positions x_v of the spools.
    pub spool_m: Pair,
    /// `k_q x_v`.
    flow_per_root_m3ps_per_sqrt_pa: Pair,
    /// Pressure of the line that feeds or drains the active chamber.
    active_line_pa: Pair,
    /// Pressure of the line that drains or feeds the passive chamber.
    passive_line_pa: Pair,
}

impl OpenEdges {
    /// Returns the open edges at a position of the spools.
    ///
    /// `x_v > 0` connects the active chamber to the supply and the passive one to the return, `x_v < 0` the reverse
    /// (eq. 9). At `x_v = 0`, where the paper counts both edges, nothing flows whatever the roots are, and one edge
    /// stands for both.
    #[inline]
    #[must_use]
    pub fn at(p: &Actuators, spool_m: Pair) -> Self {
        let (p_s, p_r) = (p.supply_pressure_pa, p.return_pressure_pa);
        let feeds_active = spool_m.is_above(Pair::both(0.0));
        Self {
            spool_m,
            flow_per_root_m3ps_per_sqrt_pa: p.flow_gain_m2ps_per_sqrt_pa * spool_m,
            active_line_pa: feeds_active.choose(p_s, p_r),
            passive_line_pa: feeds_active.choose(p_r, p_s),
        }
    }

    /// Flow `Q_h1` from the valve into the active chamber.
    ///
    /// `Q_h1 = k_q x_v R_h1` (eqs. 7 and 12).
    #[inline]
    #[must_use]
    pub fn active_flow_m3ps(&self, state: &ActuatorStates) -> Pair {
        self.flow_per_root_m3ps_per_sqrt_pa * self.active_root_sqrt_pa(state)
    }

    /// Flow `Q_h2` from the passive chamber back through the valve.
    ///
    /// `Q_h2 = k_q x_v R_h2` (eqs. 8 and 13).
    #[inline]
    #[must_use]
    pub fn passive_flow_m3ps(&self, state: &ActuatorStates) -> Pair {
        self.flow_per_root_m3ps_per_sqrt_pa * self.passive_root_sqrt_pa(state)
    }

    /// Root of the pressure drop over the edge that is open to the active chamber.
    ///
    /// `R_h1 = sqrt(P_s - P_h1)` for `x_v > 0` and `sqrt(P_h1 - P_r)` for `x_v < 0` (eq. 10). A root
    /// of a negative drop is 0: no oil flows against the spool's direction.
    #[inline]
    #[must_use]
    pub fn active_root_sqrt_pa(&self, state: &ActuatorStates) -> Pair {
        root((self.active_line_pa - state.pressure1_pa).flipped_where_negative(self.spool_m))
    }

    /// Root of the pressure drop over the edge that is open to the passive chamber.
    ///
    /// `R_h2 = sqrt(P_h2 - P_r)` for `x_v > 0` and `sqrt(P_s - P_h2)` for `x_v < 0` (eq. 11). A root
    /// of a negative drop is 0.
    #[inline]
    #[must_use]
    pub fn passive_root_sqrt_pa(&self, state: &ActuatorStates) -> Pair {
        root((state.pressure2_pa - self.passive_line_pa).flipped_where_negative(self.spool_m))
    }
}

/// Flow from a compliant supply, computed from the flow `q_0` of a stiff one.
///
/// `q = k sqrt(P_s - R q - P)` with `k = k_q |x_v|`, so that `q^2 + k^2 R q - q_0^2 = 0` and
/// `q = 2 q_0^2 / (k^2 R + sqrt((k^2 R)^2 + 4 q_0^2))`, the form without cancellation: a line or pump whose pressure
/// falls in proportion to its flow (Merritt, Hydraulic Control Systems, 1967, on laminar flow and on power supplies)
/// upstream of the orifice of eqs. 10 and 11. `R = 0` is the paper's stiff supply. The sign is that of `q_0`.
#[inline]
#[must_use]
pub fn flow_of_soft_supply_m3ps(p: &Actuators, spool_m: Pair, stiff_m3ps: Pair) -> Pair {
    let (k, r) = (
        p.flow_gain_m2ps_per_sqrt_pa * spool_m,
        p.supply_droop_pa_s_per_m3,
    );
    let (q_0, k2_r) = (stiff_m3ps, k * k * r);
    let soft = q_0 * (q_0.abs() * 2.0 / (k2_r + (k2_r * k2_r + q_0 * 4.0 * q_0).sqrt()));
    k2_r.is_equal(Pair::both(0.0)).choose(q_0, soft)
}

/// Square root of a pressure drop; 0 if the drop is negative.
#[inline]
fn root(drop_pa: Pair) -> Pair {
    drop_pa.or_zero_if_negative().sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::ActuatorState;
    use super::super::actuators::tests::{alike, of_each, together};
    use super::super::tables::ActuatorParameters;
    use super::*;

    const STATE: ActuatorState = ActuatorState {
        position_m: 0.0,
        velocity_mps: 0.0,
        pressure1_pa: 12e6,
        pressure2_pa: 9e6,
    };

    /// Table 1, except for a non-zero return pressure.
    fn parameters() -> ActuatorParameters {
        ActuatorParameters {
            return_pressure_pa: 5e6,
            ..ActuatorParameters::default()
        }
    }

    /// Returns both roots at this opening.
    fn roots_sqrt_pa(spool_m: f64) -> [f64; 2] {
        let edges = OpenEdges::at(&alike(&parameters()), Pair::both(spool_m));
        let state = together(&STATE);
        [
            edges.active_root_sqrt_pa(&state),
            edges.passive_root_sqrt_pa(&state),
        ]
        .map(of_each)
    }

    fn flows_m3ps(state: &ActuatorState, spool_m: f64) -> [f64; 2] {
        let edges = OpenEdges::at(&alike(&parameters()), Pair::both(spool_m));
        let state = together(state);
        [
            edges.active_flow_m3ps(&state),
            edges.passive_flow_m3ps(&state),
        ]
        .map(of_each)
    }

    #[test]
    fn a_positive_spool_connects_supply_to_the_active_chamber() {
        // sqrt(28e6 - 12e6) = 4000, sqrt(9e6 - 5e6) = 2000.
        assert_eq!(roots_sqrt_pa(3e-4), [4000.0, 2000.0]);
    }

    #[test]
    fn a_negative_spool_connects_supply_to_the_passive_chamber() {
        // sqrt(12e6 - 5e6) and sqrt(28e6 - 9e6).
        let [r_1, r_2] = roots_sqrt_pa(-3e-4);
        assert!((r_1 - 2645.7513110645905).abs() < 1e-9, "{r_1}");
        assert!((r_2 - 4358.898943540674).abs() < 1e-9, "{r_2}");
    }

    #[test]
    fn at_zero_nothing_flows() {
        assert_eq!(flows_m3ps(&STATE, 0.0), [0.0; 2]);
    }

    #[test]
    fn flows_are_gains_times_roots() {
        // 7.5e-5 * 3e-4 = 2.25e-8, times 4000 and 2000.
        let [q_1, q_2] = flows_m3ps(&STATE, 3e-4);
        assert!((q_1 - 9e-5).abs() < 1e-18, "{q_1}");
        assert!((q_2 - 4.5e-5).abs() < 1e-18, "{q_2}");
    }

    #[test]
    fn each_spool_opens_its_own_edges() {
        let spools_m = Pair::from([3e-4, -3e-4]);
        let edges = OpenEdges::at(&alike(&parameters()), spools_m);
        let [q_1, q_2] = edges.active_flow_m3ps(&together(&STATE)).to_array();
        assert_eq!(q_1, flows_m3ps(&STATE, 3e-4)[0]);
        assert_eq!(q_2, flows_m3ps(&STATE, -3e-4)[0]);
        assert!(q_1 > 0.0 && q_2 < 0.0);
    }

    #[test]
    fn a_negative_spool_reverses_both_flows() {
        assert!(flows_m3ps(&STATE, -3e-4).iter().all(|&flow| flow < 0.0));
    }

    #[test]
    fn no_oil_flows_against_the_pressure() {
        let beyond = ActuatorState {
            pressure1_pa: 29e6,
            pressure2_pa: 4e6,
            ..STATE
        };
        assert_eq!(flows_m3ps(&beyond, 3e-4), [0.0; 2]);
    }

    /// Returns the flow through a compliant supply.
    fn soft_m3ps(p: &ActuatorParameters, spool_m: f64, stiff_m3ps: f64) -> f64 {
        let (x_v, q_0) = (Pair::both(spool_m), Pair::both(stiff_m3ps));
        of_each(flow_of_soft_supply_m3ps(&alike(p), x_v, q_0))
    }

    #[test]
    fn a_compliant_supply_settles_where_flow_and_drop_agree() {
        // With k = 2.25e-8, R = 6000 / k and D = 16e6: q = k r and r^2 + 6000 r - 16e6 = 0, r = 2000. The supply drops
        // by R q = 12 MPa to 16 MPa, and sqrt(16e6 - 12e6) = 2000 again.
        let soft = ActuatorParameters {
            supply_droop_pa_s_per_m3: 6000.0 / 2.25e-8,
            ..parameters()
        };
        for sign in [1.0, -1.0] {
            let stiff_m3ps = sign * 2.25e-8 * 4000.0;
            let q = soft_m3ps(&soft, sign * 3e-4, stiff_m3ps);
            assert!((q / (sign * 4.5e-5) - 1.0).abs() < 1e-14, "{q}");
        }
        assert_eq!(soft_m3ps(&soft, 3e-4, 0.0), 0.0);
        assert_eq!(soft_m3ps(&soft, 0.0, 0.0), 0.0);
    }

    #[test]
    fn a_slightly_compliant_supply_gives_the_flow_of_a_stiff_one() {
        for (droop, off) in [(0.0, 0.0), (1e-3, 1e-13)] {
            let soft = ActuatorParameters {
                supply_droop_pa_s_per_m3: droop,
                ..parameters()
            };
            let q = soft_m3ps(&soft, 3e-4, 9e-5);
            assert!((q / 9e-5 - 1.0).abs() <= off, "{q}");
        }
    }
}

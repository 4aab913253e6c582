//! The electro-hydraulic servo valve: from the commanded current to the flows of the chambers
//! (eqs. 1, 7 to 13).
//!
//! Called by the right-hand side of the hydraulic system. The valve has no dynamics of its own and
//! never saturates, and its edges neither overlap nor leak, as in the paper.

use super::ActuatorState;
use super::tables::ActuatorParameters;

/// Displacement of the spool.
///
/// `x_v = k_i u` (eq. 1; any current).
#[inline]
#[must_use]
pub fn spool_displacement_m(p: &ActuatorParameters, current_a: f64) -> f64 {
    let (k_i, u) = (p.valve_gain_m_per_a, current_a);
    k_i * u
}

/// Flow `Q_h1` from the valve into the active chamber.
///
/// `Q_h1 = k_q x_v R_h1` with `x_v = k_i u` (eqs. 7 and 12).
#[inline]
#[must_use]
pub fn active_flow_m3ps(p: &ActuatorParameters, state: &ActuatorState, current_a: f64) -> f64 {
    let k_q = p.flow_gain_m2ps_per_sqrt_pa;
    k_q * spool_displacement_m(p, current_a) * active_root_sqrt_pa(p, state, current_a)
}

/// Flow `Q_h2` from the passive chamber back through the valve.
///
/// `Q_h2 = k_q x_v R_h2` with `x_v = k_i u` (eqs. 8 and 13).
#[inline]
#[must_use]
pub fn passive_flow_m3ps(p: &ActuatorParameters, state: &ActuatorState, current_a: f64) -> f64 {
    let k_q = p.flow_gain_m2ps_per_sqrt_pa;
    k_q * spool_displacement_m(p, current_a) * passive_root_sqrt_pa(p, state, current_a)
}

/// Root of the pressure drop over the edge that is open to the active chamber.
///
/// `R_h1 = s(u) sqrt(P_s - P_h1) + s(-u) sqrt(P_h1 - P_r)` (eq. 10), where `s(x)` is 1 for
/// `x >= 0` and 0 otherwise (eq. 9). A root of a negative drop is 0: no oil flows against the
/// spool's direction.
#[inline]
#[must_use]
pub fn active_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, current_a: f64) -> f64 {
    let (p_s, p_r, p_h1) = (
        p.supply_pressure_pa,
        p.return_pressure_pa,
        state.pressure1_pa,
    );
    roots_of_open_edges(current_a, p_s - p_h1, p_h1 - p_r)
}

/// Root of the pressure drop over the edge that is open to the passive chamber.
///
/// `R_h2 = s(u) sqrt(P_h2 - P_r) + s(-u) sqrt(P_s - P_h2)` (eq. 11), with `s` of eq. 9. A root of a
/// negative drop is 0.
#[inline]
#[must_use]
pub fn passive_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, current_a: f64) -> f64 {
    let (p_s, p_r, p_h2) = (
        p.supply_pressure_pa,
        p.return_pressure_pa,
        state.pressure2_pa,
    );
    roots_of_open_edges(current_a, p_h2 - p_r, p_s - p_h2)
}

/// `s(u) sqrt(forward) + s(-u) sqrt(backward)`; a root that `s` switches off is not computed.
#[inline]
fn roots_of_open_edges(current_a: f64, forward_pa: f64, backward_pa: f64) -> f64 {
    if current_a > 0.0 {
        root(forward_pa)
    } else if current_a < 0.0 {
        root(backward_pa)
    } else {
        root(forward_pa) + root(backward_pa)
    }
}

/// Square root of a pressure drop, 0 if the drop is negative.
#[inline]
fn root(drop_pa: f64) -> f64 {
    if drop_pa > 0.0 { drop_pa.sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: ActuatorState = ActuatorState {
        position_m: 0.0,
        velocity_mps: 0.0,
        pressure1_pa: 12e6,
        pressure2_pa: 9e6,
    };

    /// Table 1, except a return pressure that shows.
    fn parameters() -> ActuatorParameters {
        ActuatorParameters {
            return_pressure_pa: 5e6,
            ..ActuatorParameters::default()
        }
    }

    #[test]
    fn the_spool_follows_the_current() {
        assert_eq!(spool_displacement_m(&parameters(), 2.0), 6.08e-3);
        assert_eq!(spool_displacement_m(&parameters(), -0.5), -1.52e-3);
    }

    #[test]
    fn a_positive_current_joins_supply_to_the_active_chamber() {
        // sqrt(28e6 - 12e6) = 4000, sqrt(9e6 - 5e6) = 2000.
        assert_eq!(active_root_sqrt_pa(&parameters(), &STATE, 0.1), 4000.0);
        assert_eq!(passive_root_sqrt_pa(&parameters(), &STATE, 0.1), 2000.0);
    }

    #[test]
    fn a_negative_current_joins_supply_to_the_passive_chamber() {
        // sqrt(12e6 - 5e6) and sqrt(28e6 - 9e6).
        let r_1 = active_root_sqrt_pa(&parameters(), &STATE, -0.1);
        let r_2 = passive_root_sqrt_pa(&parameters(), &STATE, -0.1);
        assert!((r_1 - 2645.7513110645905).abs() < 1e-9, "{r_1}");
        assert!((r_2 - 4358.898943540674).abs() < 1e-9, "{r_2}");
    }

    #[test]
    fn at_zero_current_both_edges_count_and_nothing_flows() {
        // s(0) = 1 on both sides of eqs. 10 and 11.
        let r_1 = active_root_sqrt_pa(&parameters(), &STATE, 0.0);
        assert!((r_1 - 6645.7513110645905).abs() < 1e-9, "{r_1}");
        assert_eq!(active_flow_m3ps(&parameters(), &STATE, 0.0), 0.0);
        assert_eq!(passive_flow_m3ps(&parameters(), &STATE, 0.0), 0.0);
    }

    #[test]
    fn flows_are_gains_times_roots() {
        // 7.5e-5 * 3.04e-3 * 0.1 = 2.28e-8, times 4000 and 2000.
        let q_1 = active_flow_m3ps(&parameters(), &STATE, 0.1);
        let q_2 = passive_flow_m3ps(&parameters(), &STATE, 0.1);
        assert!((q_1 - 9.12e-5).abs() < 1e-18, "{q_1}");
        assert!((q_2 - 4.56e-5).abs() < 1e-18, "{q_2}");
    }

    #[test]
    fn a_negative_current_reverses_both_flows() {
        assert!(active_flow_m3ps(&parameters(), &STATE, -0.1) < 0.0);
        assert!(passive_flow_m3ps(&parameters(), &STATE, -0.1) < 0.0);
    }

    #[test]
    fn no_oil_flows_against_the_pressure() {
        let beyond = ActuatorState {
            pressure1_pa: 29e6,
            pressure2_pa: 4e6,
            ..STATE
        };
        assert_eq!(active_flow_m3ps(&parameters(), &beyond, 0.1), 0.0);
        assert_eq!(passive_flow_m3ps(&parameters(), &beyond, 0.1), 0.0);
    }
}

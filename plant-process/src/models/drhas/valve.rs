//! The electro-hydraulic servo valve: from the spool's position to the flows of the chambers
//! (eqs. 7 to 13).
//!
//! Called by the right-hand side of the hydraulic system with the position from
//! [`spool`](super::spool). The valve's edges neither overlap nor leak, as in the paper. The paper's
//! `s(u)` is `s(x_v)` here, which is the same while `x_v = k_i u` and still holds where the spool is
//! elsewhere.

use super::ActuatorState;
use super::tables::ActuatorParameters;

/// Flow `Q_h1` from the valve into the active chamber.
///
/// `Q_h1 = k_q x_v R_h1` (eqs. 7 and 12).
#[inline]
#[must_use]
pub fn active_flow_m3ps(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let (k_q, x_v) = (p.flow_gain_m2ps_per_sqrt_pa, spool_m);
    k_q * x_v * active_root_sqrt_pa(p, state, spool_m)
}

/// Flow `Q_h2` from the passive chamber back through the valve.
///
/// `Q_h2 = k_q x_v R_h2` (eqs. 8 and 13).
#[inline]
#[must_use]
pub fn passive_flow_m3ps(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let (k_q, x_v) = (p.flow_gain_m2ps_per_sqrt_pa, spool_m);
    k_q * x_v * passive_root_sqrt_pa(p, state, spool_m)
}

/// Root of the pressure drop over the edge that is open to the active chamber.
///
/// `R_h1 = s(x_v) sqrt(P_s - P_h1) + s(-x_v) sqrt(P_h1 - P_r)` (eq. 10), where `s(x)` is 1 for
/// `x >= 0` and 0 otherwise (eq. 9). A root of a negative drop is 0: no oil flows against the
/// spool's direction.
#[inline]
#[must_use]
pub fn active_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let (p_s, p_r, p_h1) = (
        p.supply_pressure_pa,
        p.return_pressure_pa,
        state.pressure1_pa,
    );
    roots_of_open_edges(spool_m, p_s - p_h1, p_h1 - p_r)
}

/// Root of the pressure drop over the edge that is open to the passive chamber.
///
/// `R_h2 = s(x_v) sqrt(P_h2 - P_r) + s(-x_v) sqrt(P_s - P_h2)` (eq. 11), with `s` of eq. 9. A root
/// of a negative drop is 0.
#[inline]
#[must_use]
pub fn passive_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let (p_s, p_r, p_h2) = (
        p.supply_pressure_pa,
        p.return_pressure_pa,
        state.pressure2_pa,
    );
    roots_of_open_edges(spool_m, p_h2 - p_r, p_s - p_h2)
}

/// Flow from a supply that gives way to it, from the flow `q_0` that a stiff one would give.
///
/// `q = k sqrt(P_s - R q - P)` with `k = k_q |x_v|`, so that `q^2 + k^2 R q - q_0^2 = 0` and
/// `q = 2 q_0^2 / (k^2 R + sqrt((k^2 R)^2 + 4 q_0^2))`, the form without cancellation: a line or pump
/// whose pressure falls in proportion to its flow (Merritt, Hydraulic Control Systems, 1967, on laminar
/// flow and on power supplies) in front of the orifice of eqs. 10 and 11. `R = 0` is the paper's stiff
/// supply. The sign is that of `q_0`.
#[inline]
#[must_use]
pub fn flow_of_soft_supply_m3ps(p: &ActuatorParameters, spool_m: f64, stiff_m3ps: f64) -> f64 {
    let (k, r) = (
        p.flow_gain_m2ps_per_sqrt_pa * spool_m,
        p.supply_droop_pa_s_per_m3,
    );
    let (q_0, k2_r) = (stiff_m3ps, k * k * r);
    if k2_r == 0.0 {
        return q_0;
    }
    q_0 * (2.0 * q_0.abs() / (k2_r + (k2_r * k2_r + 4.0 * q_0 * q_0).sqrt()))
}

/// `s(x) sqrt(forward) + s(-x) sqrt(backward)`; a root that `s` switches off is not computed.
#[inline]
fn roots_of_open_edges(spool_m: f64, forward_pa: f64, backward_pa: f64) -> f64 {
    if spool_m > 0.0 {
        root(forward_pa)
    } else if spool_m < 0.0 {
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
    fn a_positive_spool_joins_supply_to_the_active_chamber() {
        // sqrt(28e6 - 12e6) = 4000, sqrt(9e6 - 5e6) = 2000.
        assert_eq!(active_root_sqrt_pa(&parameters(), &STATE, 3e-4), 4000.0);
        assert_eq!(passive_root_sqrt_pa(&parameters(), &STATE, 3e-4), 2000.0);
    }

    #[test]
    fn a_negative_spool_joins_supply_to_the_passive_chamber() {
        // sqrt(12e6 - 5e6) and sqrt(28e6 - 9e6).
        let r_1 = active_root_sqrt_pa(&parameters(), &STATE, -3e-4);
        let r_2 = passive_root_sqrt_pa(&parameters(), &STATE, -3e-4);
        assert!((r_1 - 2645.7513110645905).abs() < 1e-9, "{r_1}");
        assert!((r_2 - 4358.898943540674).abs() < 1e-9, "{r_2}");
    }

    #[test]
    fn at_zero_both_edges_count_and_nothing_flows() {
        // s(0) = 1 on both sides of eqs. 10 and 11.
        let r_1 = active_root_sqrt_pa(&parameters(), &STATE, 0.0);
        assert!((r_1 - 6645.7513110645905).abs() < 1e-9, "{r_1}");
        assert_eq!(active_flow_m3ps(&parameters(), &STATE, 0.0), 0.0);
        assert_eq!(passive_flow_m3ps(&parameters(), &STATE, 0.0), 0.0);
    }

    #[test]
    fn flows_are_gains_times_roots() {
        // 7.5e-5 * 3e-4 = 2.25e-8, times 4000 and 2000.
        let q_1 = active_flow_m3ps(&parameters(), &STATE, 3e-4);
        let q_2 = passive_flow_m3ps(&parameters(), &STATE, 3e-4);
        assert!((q_1 - 9e-5).abs() < 1e-18, "{q_1}");
        assert!((q_2 - 4.5e-5).abs() < 1e-18, "{q_2}");
    }

    #[test]
    fn a_negative_spool_reverses_both_flows() {
        assert!(active_flow_m3ps(&parameters(), &STATE, -3e-4) < 0.0);
        assert!(passive_flow_m3ps(&parameters(), &STATE, -3e-4) < 0.0);
    }

    #[test]
    fn no_oil_flows_against_the_pressure() {
        let beyond = ActuatorState {
            pressure1_pa: 29e6,
            pressure2_pa: 4e6,
            ..STATE
        };
        assert_eq!(active_flow_m3ps(&parameters(), &beyond, 3e-4), 0.0);
        assert_eq!(passive_flow_m3ps(&parameters(), &beyond, 3e-4), 0.0);
    }

    #[test]
    fn a_supply_that_gives_way_settles_where_flow_and_drop_agree() {
        // With k = 2.25e-8, R = 6000 / k and D = 16e6: q = k r and r^2 + 6000 r - 16e6 = 0, r = 2000. The
        // supply sinks by R q = 12 MPa to 16 MPa, and sqrt(16e6 - 12e6) = 2000 again.
        let soft = ActuatorParameters {
            supply_droop_pa_s_per_m3: 6000.0 / 2.25e-8,
            ..parameters()
        };
        for sign in [1.0, -1.0] {
            let stiff_m3ps = sign * 2.25e-8 * 4000.0;
            let q = flow_of_soft_supply_m3ps(&soft, sign * 3e-4, stiff_m3ps);
            assert!((q / (sign * 4.5e-5) - 1.0).abs() < 1e-14, "{q}");
        }
        assert_eq!(flow_of_soft_supply_m3ps(&soft, 3e-4, 0.0), 0.0);
        assert_eq!(flow_of_soft_supply_m3ps(&soft, 0.0, 0.0), 0.0);
    }

    #[test]
    fn a_supply_that_hardly_gives_way_gives_what_a_stiff_one_does() {
        for (droop, off) in [(0.0, 0.0), (1e-3, 1e-13)] {
            let soft = ActuatorParameters {
                supply_droop_pa_s_per_m3: droop,
                ..parameters()
            };
            let q = flow_of_soft_supply_m3ps(&soft, 3e-4, 9e-5);
            assert!((q / 9e-5 - 1.0).abs() <= off, "{q}");
        }
    }
}

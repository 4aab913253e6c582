//! The electro-hydraulic servo valve: from the spool's position to the flows of the chambers
//! (eqs. 7 to 13).
//!
//! Called by the right-hand side of the hydraulic system with the position from
//! [`spool`](super::spool). The valve never saturates, and its edges neither overlap nor leak, as in
//! the paper. The paper's `s(u)` is `s(x_v)` here, which is the same while `x_v = k_i u` and still
//! holds where the spool is elsewhere.

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
/// spool's direction. The first root is [`supply_root_sqrt_pa`].
#[inline]
#[must_use]
pub fn active_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let p_h1 = state.pressure1_pa;
    roots_of_open_edges(
        spool_m,
        || supply_root_sqrt_pa(p, p_h1, spool_m),
        || root(p_h1 - p.return_pressure_pa),
    )
}

/// Root of the pressure drop over the edge that is open to the passive chamber.
///
/// `R_h2 = s(x_v) sqrt(P_h2 - P_r) + s(-x_v) sqrt(P_s - P_h2)` (eq. 11), with `s` of eq. 9. A root
/// of a negative drop is 0. The second root is [`supply_root_sqrt_pa`].
#[inline]
#[must_use]
pub fn passive_root_sqrt_pa(p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> f64 {
    let p_h2 = state.pressure2_pa;
    roots_of_open_edges(
        spool_m,
        || root(p_h2 - p.return_pressure_pa),
        || supply_root_sqrt_pa(p, p_h2, spool_m),
    )
}

/// Root of the pressure drop from the supply to a chamber, where the supply gives way to its flow.
///
/// `r = sqrt(P_s - R q - P)` with `q = k r` and `k = k_q |x_v|`, so that `r^2 + k R r - D = 0` for
/// `D = P_s - P` and `r = 2 D / (k R + sqrt((k R)^2 + 4 D))`, the form without cancellation. A
/// supply line or pump whose pressure falls in proportion to its flow (Merritt, Hydraulic Control
/// Systems, 1967, on laminar lines and power supplies) in front of the orifice of eq. 10. `R = 0` is
/// the paper's stiff supply, `r = sqrt(D)`; 0 for a negative `D`.
#[inline]
#[must_use]
pub fn supply_root_sqrt_pa(p: &ActuatorParameters, pressure_pa: f64, spool_m: f64) -> f64 {
    let (drop_pa, droop) = (
        p.supply_pressure_pa - pressure_pa,
        p.supply_droop_pa_s_per_m3,
    );
    if droop == 0.0 {
        return root(drop_pa);
    }
    if drop_pa <= 0.0 {
        return 0.0;
    }
    let k_r = p.flow_gain_m2ps_per_sqrt_pa * spool_m.abs() * droop;
    2.0 * drop_pa / (k_r + (k_r * k_r + 4.0 * drop_pa).sqrt())
}

/// `s(x) forward + s(-x) backward`; a root that `s` switches off is not computed.
#[inline]
fn roots_of_open_edges(
    spool_m: f64,
    forward_sqrt_pa: impl FnOnce() -> f64,
    backward_sqrt_pa: impl FnOnce() -> f64,
) -> f64 {
    if spool_m > 0.0 {
        forward_sqrt_pa()
    } else if spool_m < 0.0 {
        backward_sqrt_pa()
    } else {
        forward_sqrt_pa() + backward_sqrt_pa()
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
        // With k R = 7.5e-5 * 3e-4 * R = 6000 and D = 16e6: r^2 + 6000 r - 16e6 = 0, r = 2000; the
        // supply sinks by R q = 12 MPa to 16 MPa, and sqrt(16e6 - 12e6) = 2000 again.
        let soft = ActuatorParameters {
            supply_droop_pa_s_per_m3: 6000.0 / (7.5e-5 * 3e-4),
            ..parameters()
        };
        let q_1 = active_flow_m3ps(&soft, &STATE, 3e-4);
        assert!((q_1 / 4.5e-5 - 1.0).abs() < 1e-14, "{q_1}");
        let at_valve_pa = 28e6 - soft.supply_droop_pa_s_per_m3 * q_1;
        assert!((at_valve_pa / 16e6 - 1.0).abs() < 1e-14, "{at_valve_pa}");
        // The edge to the return does not know of it.
        let q_2 = passive_flow_m3ps(&soft, &STATE, 3e-4);
        assert_eq!(q_2, passive_flow_m3ps(&parameters(), &STATE, 3e-4));
    }

    #[test]
    fn a_supply_that_hardly_gives_way_is_the_papers() {
        let soft = ActuatorParameters {
            supply_droop_pa_s_per_m3: 1e-3,
            ..parameters()
        };
        for spool_m in [3e-4, -3e-4] {
            for flow in [active_flow_m3ps, passive_flow_m3ps] {
                let (with, without) = (
                    flow(&soft, &STATE, spool_m),
                    flow(&parameters(), &STATE, spool_m),
                );
                assert!((with / without - 1.0).abs() < 1e-13, "{with} {without}");
            }
        }
    }
}

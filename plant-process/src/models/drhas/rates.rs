//! The right-hand side of the hydraulic system: the equations of its parts put together.
//!
//! Called by the substeps, 4 times each. It comes in two forms, the paper's and one that also has what
//! the paper does not have; where that is neutral both give the same bits. They are compiled apart
//! because conditions inside the paper's form would cost it up to a quarter of its speed.

use super::tables::{ActuatorParameters, SurfaceParameters};
use super::{ActuatorState, STATES, State, cylinder, friction, leakage, surface, valve};

/// What acts on the actuators at one time whatever their state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inputs {
    /// Positions x_v of the spools.
    pub spools_m: [f64; 2],
    /// Disturbances d of the pistons.
    pub disturbances_n: [f64; 2],
}

/// What an actuator is given during one substep.
pub(super) struct Channel<'a> {
    /// Its parameters.
    pub parameters: &'a ActuatorParameters,
    /// `beta C_t` of the leak that the right-hand side contains.
    pub leakage_coefficient_m3ps_per_sqrt_pa: f64,
}

impl Channel<'_> {
    /// Rates of an actuator's state, in its order (eqs. 2 to 4).
    #[inline]
    fn rates<const BEYOND_PAPER: bool>(
        &self,
        state: &ActuatorState,
        rod_force_n: f64,
        spool_m: f64,
        disturbance_n: f64,
    ) -> [f64; 4] {
        let p = self.parameters;
        let q_h = leakage::normal_leakage_m3ps(p, state)
            + leakage::fault_leakage_m3ps(self.leakage_coefficient_m3ps_per_sqrt_pa, state);
        let mut now = Influences {
            acceleration_mps2: cylinder::piston_acceleration_mps2(
                p,
                state,
                rod_force_n,
                disturbance_n,
            ),
            inflow_m3ps: valve::active_flow_m3ps(p, state, spool_m),
            outflow_m3ps: valve::passive_flow_m3ps(p, state, spool_m),
        };
        if BEYOND_PAPER {
            now = now.beyond_paper(p, state, spool_m);
        }
        [
            state.velocity_mps,
            now.acceleration_mps2,
            cylinder::active_pressure_rate_paps(p, state, q_h, now.inflow_m3ps),
            cylinder::passive_pressure_rate_paps(p, state, q_h, now.outflow_m3ps),
        ]
    }
}

/// What drives an actuator: the acceleration of its piston and the flows of its chambers.
struct Influences {
    acceleration_mps2: f64,
    inflow_m3ps: f64,
    outflow_m3ps: f64,
}

impl Influences {
    /// The same with what the paper does not have: a supply that gives way, external leaks, dry
    /// friction and seizure.
    #[inline]
    fn beyond_paper(self, p: &ActuatorParameters, state: &ActuatorState, spool_m: f64) -> Self {
        let v_h = state.velocity_mps;
        let (mut inflow, mut outflow) = (self.inflow_m3ps, self.outflow_m3ps);
        if spool_m > 0.0 {
            inflow = valve::flow_of_soft_supply_m3ps(p, spool_m, inflow);
        } else {
            outflow = valve::flow_of_soft_supply_m3ps(p, spool_m, outflow);
        }
        let [q_e1, q_e2] = leakage::external_leakages_m3ps(p, state);
        let slowed =
            self.acceleration_mps2 - friction::coulomb_friction_n(p, v_h) / p.piston_mass_kg;
        Self {
            acceleration_mps2: friction::seized_acceleration_mps2(p, v_h, slowed),
            inflow_m3ps: inflow - q_e1,
            outflow_m3ps: outflow + q_e2,
        }
    }
}

/// Whether an actuator has something in [`Influences::beyond_paper`].
pub(super) fn is_beyond_paper(p: &ActuatorParameters) -> bool {
    [
        p.supply_droop_pa_s_per_m3,
        p.external_leakage1_m3ps_per_sqrt_pa,
        p.external_leakage2_m3ps_per_sqrt_pa,
        p.coulomb_friction_n,
        p.motion_blocked,
    ]
    .iter()
    .any(|&value| value != 0.0)
}

/// Rates of the whole state, in its order: the right-hand side of the model, the paper's or the one
/// with [`Influences::beyond_paper`].
#[inline]
pub(super) fn rates<const BEYOND_PAPER: bool>(
    surface: &SurfaceParameters,
    channels: &[Channel<'_>; 2],
    inputs: &Inputs,
    state: &State,
) -> [f64; STATES] {
    let [one, two] = channels;
    let [state1, state2] = &state.actuators;
    let x_d = surface::linear_displacement_m(surface, state.angle_rad);
    let f_h1 = surface::rod_force_n(one.parameters, state1.position_m, x_d);
    let f_h2 = surface::rod_force_n(two.parameters, state2.position_m, x_d);
    let t_l = surface::load_torque_nm(surface, x_d);
    let ([x_v1, x_v2], [d_1, d_2]) = (inputs.spools_m, inputs.disturbances_n);
    let [x_1, v_1, p_11, p_12] = one.rates::<BEYOND_PAPER>(state1, f_h1, x_v1, d_1);
    let [x_2, v_2, p_21, p_22] = two.rates::<BEYOND_PAPER>(state2, f_h2, x_v2, d_2);
    let omega = surface::angular_acceleration_radps2(surface, state.rate_radps, [f_h1, f_h2], t_l);
    [
        state.rate_radps,
        omega,
        x_1,
        v_1,
        p_11,
        p_12,
        x_2,
        v_2,
        p_21,
        p_22,
    ]
}

//! Right-hand side of the hydraulic system: the equations of its parts combined.
//!
//! Called four times by each substep. The right-hand side has two forms, the paper's form and one with the effects
//! beyond the paper; if those effects are neutral, both give the same bits. The forms are compiled separately because
//! conditions inside the paper's form would cost up to a quarter of its speed.

use super::actuators::{ActuatorStates, Actuators};
use super::pair::Pair;
use super::tables::{ActuatorParameters, SurfaceParameters};
use super::valve::OpenEdges;
use super::{State, cylinder, friction, leakage, surface, valve};

/// Inputs of the actuators at one time, independent of their state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inputs {
    /// Edges held open by the spools.
    pub edges: OpenEdges,
    /// Disturbances d of the pistons.
    pub disturbances_n: Pair,
}

/// State or rates in the form for integration: the actuators as pairs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// Angle and rate of the surface.
    pub surface: [f64; 2],
    /// Both actuators.
    pub actuators: ActuatorStates,
}

/// Number of pairs in a motion.
const PAIRS: usize = size_of::<Motion>() / size_of::<Pair>();

impl Motion {
    /// Converts to a vector.
    #[inline]
    pub(super) fn to_vector(self) -> [Pair; PAIRS] {
        let Self { surface, actuators } = self;
        [
            surface.into(),
            actuators.position_m,
            actuators.velocity_mps,
            actuators.pressure1_pa,
            actuators.pressure2_pa,
        ]
    }

    /// Converts from a vector.
    #[inline]
    pub(super) fn from_vector(vector: [Pair; PAIRS]) -> Self {
        let [
            surface,
            position_m,
            velocity_mps,
            pressure1_pa,
            pressure2_pa,
        ] = vector;
        Self {
            surface: surface.to_array(),
            actuators: ActuatorStates {
                position_m,
                velocity_mps,
                pressure1_pa,
                pressure2_pa,
            },
        }
    }
}

impl From<&State> for Motion {
    #[inline]
    fn from(state: &State) -> Self {
        Self {
            surface: [state.angle_rad, state.rate_radps],
            actuators: ActuatorStates::of(state.actuators.each_ref()),
        }
    }
}

impl From<&Motion> for State {
    #[inline]
    fn from(motion: &Motion) -> Self {
        let [angle_rad, rate_radps] = motion.surface;
        Self {
            angle_rad,
            rate_radps,
            actuators: motion.actuators.split(),
        }
    }
}

/// Influences that drive the actuators: accelerations of the pistons and flows of the chambers.
struct Influences {
    acceleration_mps2: Pair,
    inflow_m3ps: Pair,
    outflow_m3ps: Pair,
}

impl Influences {
    /// Adds the effects beyond the paper: droop of the supply, external leaks, dry friction and seizure.
    #[inline]
    fn beyond_paper(self, p: &Actuators, state: &ActuatorStates, spool_m: Pair) -> Self {
        let v_h = state.velocity_mps;
        let (inflow, outflow) = (self.inflow_m3ps, self.outflow_m3ps);
        let feeds_active = spool_m.is_above(Pair::both(0.0));
        let supplied = feeds_active.choose(inflow, outflow);
        let supplied = valve::flow_of_soft_supply_m3ps(p, spool_m, supplied);
        let [q_e1, q_e2] = leakage::external_leakages_m3ps(p, state);
        let slowed =
            self.acceleration_mps2 - friction::coulomb_friction_n(p, v_h) / p.piston_mass_kg;
        Self {
            acceleration_mps2: friction::seized_acceleration_mps2(p, v_h, slowed),
            inflow_m3ps: feeds_active.choose(supplied, inflow) - q_e1,
            outflow_m3ps: feeds_active.choose(outflow, supplied) + q_e2,
        }
    }
}

/// Returns `true` if an actuator has an effect in [`Influences::beyond_paper`].
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

/// Returns the rates of the whole state: the right-hand side of the model, the paper's or the one with
/// [`Influences::beyond_paper`].
#[inline]
pub(super) fn rates<const BEYOND_PAPER: bool>(
    surface: &SurfaceParameters,
    actuators: &Actuators,
    inputs: &Inputs,
    motion: &Motion,
) -> Motion {
    let (p, state) = (actuators, &motion.actuators);
    let [angle_rad, rate_radps] = motion.surface;
    let x_d = surface::linear_displacement_m(surface, angle_rad);
    let f_h = surface::rod_force_n(p, state.position_m, x_d);
    let t_l = surface::load_torque_nm(surface, x_d);
    let (edges, d) = (&inputs.edges, inputs.disturbances_n);
    let c_t = p.leakage_coefficient_m3ps_per_sqrt_pa;
    let q_h = leakage::normal_leakage_m3ps(p, state) + leakage::fault_leakage_m3ps(c_t, state);
    let mut now = Influences {
        acceleration_mps2: cylinder::piston_acceleration_mps2(p, state, f_h, d),
        inflow_m3ps: edges.active_flow_m3ps(state),
        outflow_m3ps: edges.passive_flow_m3ps(state),
    };
    if BEYOND_PAPER {
        now = now.beyond_paper(p, state, edges.spool_m);
    }
    Motion {
        surface: [
            rate_radps,
            surface::angular_acceleration_radps2(surface, rate_radps, f_h, t_l),
        ],
        actuators: ActuatorStates {
            position_m: state.velocity_mps,
            velocity_mps: now.acceleration_mps2,
            pressure1_pa: cylinder::active_pressure_rate_paps(p, state, q_h, now.inflow_m3ps),
            pressure2_pa: cylinder::passive_pressure_rate_paps(p, state, q_h, now.outflow_m3ps),
        },
    }
}

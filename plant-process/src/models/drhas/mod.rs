//! The dual redundant hydraulic actuation system: two valve-controlled cylinders that hold one control surface,
//! active/active, with leaking seals as a common-mode fault.
//!
//! Source: "Adaptive Robust Fault-Tolerant Synchronization Control for a Dual Redundant Hydraulic Actuation System with
//! Common-Mode Fault", Mathematical Problems in Engineering, 2018, article 6570104. Equation numbers are its own. One
//! file per physical part:
//!
//! 1. [`spool`]: current to the position of the valve's spool, eq. 1;
//! 2. [`valve`]: its position to flows, eqs. 7 to 13;
//! 3. [`leakage`]: flow past the seal, eq. 5, with its closed form near equal pressures, and outwards;
//! 4. [`cylinder`]: pressures and piston, eqs. 2 to 4;
//! 5. [`friction`]: dry friction and seizure of the piston;
//! 6. [`disturbance`]: disturbance forces on the pistons, eq. 74;
//! 7. [`surface`]: rods, surface and load, eqs. 14 to 17, 24 and 33;
//! 8. `rates`: all of these as one right-hand side.
//!
//! Parameters beyond the paper (null bias, stops, lag and sticking of the spool, droop of the supply, external leaks,
//! dry friction, seizure, a constant load) are neutral by default: the paper's runs are the same to the last bit with
//! and without them. [`faults`] lists the possible faults and the parameters that each moves; the equations are unaware
//! of faults.
//!
//! Assumptions: one bulk modulus per actuator; no end stops; small angles; below the vapour pressure oil becomes vapour
//! that leaves no bubble behind. Oil never flows against the valve's spool (the root of a negative pressure drop is 0).
//! The paper's state-space form, eqs. 18 to 24, is equivalent to these equations.

pub mod actuators;
pub mod cylinder;
pub mod disturbance;
pub mod faults;
pub mod friction;
pub mod leakage;
pub mod pair;
mod rates;
pub mod spool;
mod state_row;
pub mod surface;
pub mod tables;
pub mod valve;

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use shared_types::describe::{FaultDescription, Invalid};
use shared_types::number::{exact, exact_in};
use shared_types::state::StateOf;
use shared_types::time::Interval;
use zerocopy::{FromBytes, Immutable, IntoBytes, transmute};

use self::actuators::{ActuatorStates, Actuators};
use self::pair::Pair;
use self::rates::{Inputs, Motion, is_beyond_paper, rates};
use self::spool::Spool;
use self::state_row::StateRow;
pub use self::tables::{
    ActuatorParameters, Command, Measured, Parameters, SurfaceParameters, Truth,
};
use self::valve::OpenEdges;
use crate::integrate::rk4_step;
use crate::plant::Plant;

/// State of one actuator.
#[derive(
    Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, Serialize, Deserialize,
)]
#[repr(C)]
pub struct ActuatorState {
    /// Position x_h of the piston.
    pub position_m: f64,
    /// Velocity of the piston.
    pub velocity_mps: f64,
    /// Pressure P_h1 of the active chamber.
    pub pressure1_pa: f64,
    /// Pressure P_h2 of the passive chamber.
    pub pressure2_pa: f64,
}

/// State of the system.
#[derive(
    Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, Serialize, Deserialize,
)]
#[repr(C)]
pub struct State {
    /// Angle theta_d of the surface.
    pub angle_rad: f64,
    /// Rate of theta_d.
    pub rate_radps: f64,
    /// Actuators in order.
    pub actuators: [ActuatorState; 2],
}

/// Parts of a substep in which the fault's leak alone would empty a pressure difference.
///
/// In such parts the leak is applied outside the Runge-Kutta step, which is coarse where the valve drives the
/// difference through zero. Largest errors with substeps of 25 us in the golden window of such crossings: 8.7e-6 rad
/// and 1500 Pa uncut, 6.1e-8 rad and 7.9 Pa in 4 parts, 8.7e-10 rad and 0.64 Pa in 16; Runge-Kutta alone 4.7e-7 rad and
/// 4100 Pa.
const PARTS_OF_EMPTYING_SUBSTEP: u32 = 4;

/// The hydraulic system: its current parameters, the integrated state, and the spools, whose course has a closed form.
pub struct Drhas {
    parameters: Parameters,
    state: State,
    spools: [Spool; 2],
    /// The actuators' parameters, as pairs.
    actuators: Actuators,
    /// `true` if the seal of an actuator leaks.
    leaks: bool,
    /// `true` if the spool of an actuator has a lag.
    lags: bool,
    /// `true` if an actuator has an effect beyond the paper's model.
    beyond_paper: bool,
}

/// Inputs of the actuators over an interval, as far as it has been simulated.
struct Course {
    /// Target positions of the spools.
    wanted_m: [f64; 2],
    /// Edges that stay open once no spool moves any more.
    still: Option<[OpenEdges; 3]>,
    /// Present disturbances.
    disturbances_n: Pair,
}

impl Drhas {
    /// Creates the system with these parameters, in this state and with these spools.
    fn new(parameters: &Parameters, state: State, spools: [Spool; 2]) -> Self {
        let actuators = parameters.actuators();
        Self {
            parameters: *parameters,
            state,
            spools,
            actuators: Actuators::of(actuators),
            leaks: (actuators.iter()).any(|p| p.leakage_coefficient_m3ps_per_sqrt_pa != 0.0),
            lags: actuators.iter().any(|p| p.valve_lag_s != 0.0),
            beyond_paper: actuators.into_iter().any(is_beyond_paper),
        }
    }

    /// Integrates a step: a substep or a part of one.
    ///
    /// Inlined, so that the right-hand side can reuse the roots and quotients that decide whether the substep must be
    /// cut.
    #[inline(always)]
    fn substep<const BEYOND_PAPER: bool>(
        &self,
        actuators: &Actuators,
        motion: &mut Motion,
        step_s: f64,
        inputs: &[Inputs; 3],
    ) {
        let mut x = motion.to_vector();
        let surface = &self.parameters.surface;
        rk4_step(&mut x, step_s, inputs, |now, x| {
            let motion = Motion::from_vector(*x);
            rates::<BEYOND_PAPER>(surface, actuators, now, &motion).to_vector()
        });
        *motion = Motion::from_vector(x);
    }

    /// Integrates a substep in which the fault's leak alone would empty a pressure difference, in parts.
    ///
    /// The leak is part of the right-hand side, unless the leak alone would make an actuator's pressures equal within
    /// the part (see [`leakage`]): then its exact flow is applied instead, half before and half after the rest.
    #[cold]
    fn emptying_substep<const BEYOND_PAPER: bool>(
        &mut self,
        motion: &mut Motion,
        course: &mut Course,
        start_s: f64,
        substep_s: f64,
    ) {
        let part_s = substep_s / f64::from(PARTS_OF_EMPTYING_SUBSTEP);
        for part in 0..PARTS_OF_EMPTYING_SUBSTEP {
            let inputs = self.inputs(course, start_s + f64::from(part) * part_s, part_s);
            let empties = leakage::empties_within(&self.actuators, &motion.actuators, part_s);
            let c_t = self.actuators.leakage_coefficient_m3ps_per_sqrt_pa;
            let without_leak = Actuators {
                leakage_coefficient_m3ps_per_sqrt_pa: empties.choose(Pair::both(0.0), c_t),
                ..self.actuators
            };
            let leak_half_a_part = |states: &mut ActuatorStates| {
                let (p, before) = (&self.actuators, *states);
                let after = leakage::fault_leak_alone(p, &before, 0.5 * part_s);
                states.pressure1_pa = empties.choose(after.pressure1_pa, before.pressure1_pa);
                states.pressure2_pa = empties.choose(after.pressure2_pa, before.pressure2_pa);
            };
            leak_half_a_part(&mut motion.actuators);
            self.substep::<BEYOND_PAPER>(&without_leak, motion, part_s, &inputs);
            leak_half_a_part(&mut motion.actuators);
            self.let_oil_boil(motion);
        }
    }

    /// Raises every chamber to at least the vapour pressure.
    #[inline]
    fn let_oil_boil(&self, motion: &mut Motion) {
        // No vapour pressure is above 0: one condition in the common case.
        let none = Pair::both(0.0);
        let lowest_pa = motion.actuators.lowest_pressures_pa();
        if lowest_pa.is_below(none).any() {
            motion.actuators = cylinder::boiled(&self.actuators, &motion.actuators);
        }
    }

    /// Returns the target positions of both spools under a command.
    fn wanted_spools_m(&self, command: &Command) -> [f64; 2] {
        let [p_1, p_2] = self.parameters.actuators();
        let [one, two] = &self.spools;
        [
            one.wanted_m(p_1, command.actuator1_valve_current_a),
            two.wanted_m(p_2, command.actuator2_valve_current_a),
        ]
    }

    /// Advances both spools, and returns the open edges at the beginning, middle and end.
    #[inline]
    fn move_spools(&mut self, wanted_m: [f64; 2], duration_s: f64) -> [OpenEdges; 3] {
        let [p_1, p_2] = self.parameters.actuators();
        let [one, two] = &mut self.spools;
        let one_m = one.travel(p_1, wanted_m[0], duration_s);
        let two_m = two.travel(p_2, wanted_m[1], duration_s);
        std::array::from_fn(|node| {
            OpenEdges::at(&self.actuators, [one_m[node], two_m[node]].into())
        })
    }

    /// Integrates over an interval under a constant command.
    fn integrate<const BEYOND_PAPER: bool>(&mut self, interval: &Interval, command: &Command) {
        let h = interval.substep_s();
        let wanted_m = self.wanted_spools_m(command);
        let mut course = Course {
            wanted_m,
            // Spools without a lag arrive at once and stay.
            still: (!self.lags).then(|| self.move_spools(wanted_m, h)),
            disturbances_n: self.disturbances_n(interval.start_s),
        };
        let mut motion = Motion::from(&self.state);
        for substep in 0..interval.substeps {
            let start_s = interval.start_s + f64::from(substep) * h;
            let (p, states) = (&self.actuators, &motion.actuators);
            if self.leaks && leakage::empties_within(p, states, h).any() {
                self.emptying_substep::<BEYOND_PAPER>(&mut motion, &mut course, start_s, h);
            } else {
                let inputs = self.inputs(&mut course, start_s, h);
                self.substep::<BEYOND_PAPER>(&self.actuators, &mut motion, h, &inputs);
                self.let_oil_boil(&mut motion);
            }
        }
        self.state = State::from(&motion);
    }

    /// Returns the inputs at the beginning, middle and end of an integration step.
    #[inline(always)]
    fn inputs(&mut self, course: &mut Course, start_s: f64, step_s: f64) -> [Inputs; 3] {
        let [begin, middle, end] =
            (course.still).unwrap_or_else(|| self.move_spools(course.wanted_m, step_s));
        let inputs = |edges, disturbances_n| Inputs {
            edges,
            disturbances_n,
        };
        // Each end is the next beginning: two new sines per step, not three.
        let begin = inputs(begin, course.disturbances_n);
        let middle = inputs(middle, self.disturbances_n(start_s + 0.5 * step_s));
        course.disturbances_n = self.disturbances_n(start_s + step_s);
        [begin, middle, inputs(end, course.disturbances_n)]
    }

    /// Disturbances of both pistons (eq. 74).
    fn disturbances_n(&self, time_s: f64) -> Pair {
        (self.parameters.actuators())
            .map(|p| disturbance::disturbance_n(p, time_s))
            .into()
    }
}

impl Plant for Drhas {
    const NAME: &'static str = "drhas";
    const SUMMARY: &'static str = "Dual redundant hydraulic actuation system: two valve-controlled \
                                   cylinders on one control surface.";
    type Parameters = Parameters;
    type Truth = Truth;
    type Measured = Measured;
    type Command = Command;

    fn faults() -> Vec<FaultDescription> {
        faults::all()
    }

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(
            |plant: &Self| (plant.state, plant.spools),
            |plant, (state, spools)| (plant.state, plant.spools) = (state, spools),
        );
        Some(state.named(StateRow::of, StateRow::restore))
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        let start = |name, p| start_of_actuator(p).map_err(|e| Invalid(format!("{name}: {e}")));
        let state = State {
            angle_rad: parameters.surface.initial_angle_rad,
            rate_radps: parameters.surface.initial_rate_radps,
            actuators: [
                start("actuator1", &parameters.actuator1)?,
                start("actuator2", &parameters.actuator2)?,
            ],
        };
        let spools = parameters.actuators().map(Spool::at_null);
        Ok(Self::new(parameters, state, spools))
    }

    fn retune(&mut self, parameters: &Parameters) {
        *self = Self::new(parameters, self.state, self.spools);
    }

    fn measure(&self) -> Measured {
        transmute!(self.state)
    }

    fn truth(&self, time_s: f64, _command: &Command) -> Truth {
        let p = &self.actuators;
        let [state1, state2] = &self.state.actuators;
        let states = ActuatorStates::of([state1, state2]);
        let x_d = surface::linear_displacement_m(&self.parameters.surface, self.state.angle_rad);
        let f_h = surface::rod_force_n(p, states.position_m, x_d);
        let c_t = p.leakage_coefficient_m3ps_per_sqrt_pa;
        let q_t = leakage::fault_leakage_m3ps(c_t, &states);
        let [[f_h1, f_h2], [q_t1, q_t2], [c_t1, c_t2]] = [f_h, q_t, c_t].map(Pair::to_array);
        let [d_1, d_2] = self.disturbances_n(time_s).to_array();
        Truth {
            surface_angle_rad: self.state.angle_rad,
            surface_rate_radps: self.state.rate_radps,
            actuator1_position_m: state1.position_m,
            actuator1_velocity_mps: state1.velocity_mps,
            actuator1_pressure1_pa: state1.pressure1_pa,
            actuator1_pressure2_pa: state1.pressure2_pa,
            actuator1_rod_force_n: f_h1,
            actuator1_leakage_flow_m3ps: q_t1,
            actuator1_leakage_coefficient_m3ps_per_sqrt_pa: c_t1,
            actuator1_disturbance_n: d_1,
            actuator2_position_m: state2.position_m,
            actuator2_velocity_mps: state2.velocity_mps,
            actuator2_pressure1_pa: state2.pressure1_pa,
            actuator2_pressure2_pa: state2.pressure2_pa,
            actuator2_rod_force_n: f_h2,
            actuator2_leakage_flow_m3ps: q_t2,
            actuator2_leakage_coefficient_m3ps_per_sqrt_pa: c_t2,
            actuator2_disturbance_n: d_2,
            force_fight_n: surface::force_fight_n(f_h),
        }
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        if self.beyond_paper {
            self.integrate::<true>(interval, command);
        } else {
            self.integrate::<false>(interval, command);
        }
    }
}

/// Returns the state of an actuator at step 0, or refuses inconsistent parameters.
fn start_of_actuator(p: &ActuatorParameters) -> Result<ActuatorState, Invalid> {
    let (supply_pa, return_pa) = (p.supply_pressure_pa, p.return_pressure_pa);
    if return_pa >= supply_pa {
        return Err(Invalid(format!(
            "return_pressure_pa = {} must be below supply_pressure_pa = {}",
            exact(return_pa),
            exact(supply_pa)
        )));
    }
    let position_m = p.initial_position_m;
    let (lowest_m, highest_m) = (-p.volume1_m3 / p.area1_m2, p.volume2_m3 / p.area2_m2);
    if !(lowest_m < position_m && position_m < highest_m) {
        return Err(Invalid(format!(
            "initial_position_m = {} is outside the piston's travel, which is \
             -volume1_m3 / area1_m2 = {} to volume2_m3 / area2_m2 = {}",
            exact(position_m),
            exact(lowest_m),
            exact(highest_m)
        )));
    }
    let pressure_pa = |name: &str, ratio: f64| {
        let pressure_pa = ratio * supply_pa;
        if pressure_pa < return_pa {
            return Err(Invalid(format!(
                "{name} = {} of supply_pressure_pa is {}, below \
                 return_pressure_pa = {}; {name} must be at least {}",
                exact(ratio),
                exact_in(pressure_pa, "Pa"),
                exact(return_pa),
                exact(return_pa / supply_pa)
            )));
        }
        Ok(pressure_pa)
    };
    Ok(ActuatorState {
        position_m,
        velocity_mps: p.initial_velocity_mps,
        pressure1_pa: pressure_pa("initial_pressure1_ratio", p.initial_pressure1_ratio)?,
        pressure2_pa: pressure_pa("initial_pressure2_ratio", p.initial_pressure2_ratio)?,
    })
}

//! The dual redundant hydraulic actuation system: two valve-controlled cylinders that hold one
//! control surface, active/active, with leaking seals as a common-mode fault.
//!
//! Source: "Adaptive Robust Fault-Tolerant Synchronization Control for a Dual Redundant Hydraulic
//! Actuation System with Common-Mode Fault", Mathematical Problems in Engineering, 2018, article
//! 6570104. Equation numbers are its own. One file per physical part:
//!
//! 1. [`valve`]: current to flows, eqs. 1 and 7 to 13;
//! 2. [`leakage`]: flow past the seal, eq. 5, and its closed form near equal pressures;
//! 3. [`cylinder`]: pressures and piston, eqs. 2 to 4;
//! 4. [`disturbance`]: what shakes the pistons, eq. 74;
//! 5. [`surface`]: rods, surface and load, eqs. 14 to 17, 24 and 33.
//!
//! Assumptions: one bulk modulus per actuator and no vapour below 0 Pa; constant supply and return
//! pressures; no friction but viscous; no end stops; small angles. Oil never flows against the
//! valve's spool (the root of a negative pressure drop is 0). The paper's state-space form, eqs. 18
//! to 24, is these equations again.

pub mod cylinder;
pub mod disturbance;
pub mod leakage;
pub mod surface;
pub mod tables;
pub mod valve;

#[cfg(test)]
mod tests;

use shared_types::describe::{
    FaultDescription, Invalid, MoveBy, Operation, ParameterMove, ProfileDescription,
};
use shared_types::table::Field;
use shared_types::time::Interval;
use zerocopy::{FromBytes, Immutable, IntoBytes, transmute};

pub use self::tables::{
    ActuatorParameters, Command, Measured, Parameters, SurfaceParameters, Truth,
};
use crate::integrate::rk4_step;
use crate::plant::Plant;

/// State of one actuator.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
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
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct State {
    /// Angle theta_d of the surface.
    pub angle_rad: f64,
    /// Rate of theta_d.
    pub rate_radps: f64,
    /// The actuators in order.
    pub actuators: [ActuatorState; 2],
}

/// Number of state variables.
const STATES: usize = size_of::<State>() / size_of::<f64>();

/// Parts of a substep in which the fault's leak alone would empty a pressure difference.
///
/// There the leak acts beside the Runge-Kutta step and not inside it, which is coarse where the
/// valve drives the difference through zero. Largest errors with substeps of 25 us in the golden
/// window of such crossings: 8.7e-6 rad and 1500 Pa uncut, 6.1e-8 rad and 7.9 Pa in 4 parts,
/// 8.7e-10 rad and 0.64 Pa in 16; Runge-Kutta alone 4.7e-7 rad and 4100 Pa.
const PARTS_OF_EMPTYING_SUBSTEP: u32 = 4;

/// The hydraulic system: its parameters as they are now and its state.
pub struct Drhas {
    parameters: Parameters,
    state: State,
}

/// What an actuator is given during one substep.
struct Channel<'a> {
    parameters: &'a ActuatorParameters,
    current_a: f64,
    /// `beta C_t` of the leak that the right-hand side contains.
    leakage_coefficient_m3ps_per_sqrt_pa: f64,
}

impl Channel<'_> {
    /// Rates of an actuator's state, in its order (eqs. 2 to 4).
    #[inline]
    fn rates(&self, state: &ActuatorState, rod_force_n: f64, disturbance_n: f64) -> [f64; 4] {
        let (p, u) = (self.parameters, self.current_a);
        let q_h = leakage::normal_leakage_m3ps(p, state)
            + leakage::fault_leakage_m3ps(self.leakage_coefficient_m3ps_per_sqrt_pa, state);
        let q_h1 = valve::active_flow_m3ps(p, state, u);
        let q_h2 = valve::passive_flow_m3ps(p, state, u);
        [
            state.velocity_mps,
            cylinder::piston_acceleration_mps2(p, state, rod_force_n, disturbance_n),
            cylinder::active_pressure_rate_paps(p, state, q_h, q_h1),
            cylinder::passive_pressure_rate_paps(p, state, q_h, q_h2),
        ]
    }
}

/// Rates of the whole state, in its order: the right-hand side of the model.
#[inline]
fn rates(
    surface: &SurfaceParameters,
    channels: &[Channel<'_>; 2],
    disturbances_n: &[f64; 2],
    state: &State,
) -> [f64; STATES] {
    let [one, two] = channels;
    let [state1, state2] = &state.actuators;
    let x_d = surface::linear_displacement_m(surface, state.angle_rad);
    let f_h1 = surface::rod_force_n(one.parameters, state1.position_m, x_d);
    let f_h2 = surface::rod_force_n(two.parameters, state2.position_m, x_d);
    let t_l = surface::load_torque_nm(surface, x_d);
    let [x_1, v_1, p_11, p_12] = one.rates(state1, f_h1, disturbances_n[0]);
    let [x_2, v_2, p_21, p_22] = two.rates(state2, f_h2, disturbances_n[1]);
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

impl Drhas {
    /// One integration step: a substep or a part of one.
    ///
    /// The fault's leak is part of the right-hand side, except where it alone would make an
    /// actuator's pressures equal within the step (see [`leakage`]): there its exact flow is
    /// applied instead, half before and half after the rest.
    #[inline]
    fn substep(&mut self, step_s: f64, currents_a: [f64; 2], disturbances_n: &[[f64; 2]; 3]) {
        let actuators = self.parameters.actuators();
        let empties = self.empties_within(step_s);
        let channels: [Channel<'_>; 2] = std::array::from_fn(|i| Channel {
            parameters: actuators[i],
            current_a: currents_a[i],
            leakage_coefficient_m3ps_per_sqrt_pa: if empties[i] {
                0.0
            } else {
                actuators[i].leakage_coefficient_m3ps_per_sqrt_pa
            },
        });
        let leak_half_a_step = |state: &mut State| {
            for i in [0, 1] {
                if empties[i] {
                    state.actuators[i] =
                        leakage::fault_leak_alone(actuators[i], &state.actuators[i], 0.5 * step_s);
                }
            }
        };

        leak_half_a_step(&mut self.state);
        let mut x: [f64; STATES] = transmute!(self.state);
        rk4_step(&mut x, step_s, disturbances_n, |d, x| {
            rates(&self.parameters.surface, &channels, d, &transmute!(*x))
        });
        self.state = transmute!(x);
        leak_half_a_step(&mut self.state);
    }

    /// For each actuator, whether the fault's leak alone would make its pressures equal.
    #[inline]
    fn empties_within(&self, duration_s: f64) -> [bool; 2] {
        let (actuators, states) = (self.parameters.actuators(), &self.state.actuators);
        std::array::from_fn(|i| leakage::empties_within(actuators[i], &states[i], duration_s))
    }

    /// Disturbances of both pistons (eq. 74).
    fn disturbances_n(&self, time_s: f64) -> [f64; 2] {
        self.parameters
            .actuators()
            .map(|p| disturbance::disturbance_n(p, time_s))
    }
}

impl Plant for Drhas {
    const NAME: &'static str = "drhas";
    const SUMMARY: &'static str = "Dual redundant hydraulic actuation system: two valve-controlled \
                                   cylinders on one control surface, with leaking seals as fault.";
    type Parameters = Parameters;
    type Truth = Truth;
    type Measured = Measured;
    type Command = Command;

    fn faults() -> Vec<FaultDescription> {
        let field = |name, unit, text, max| Field {
            min: 0.0,
            max,
            ..Field::signal(name, unit, text)
        };
        vec![FaultDescription {
            kind: "leakage".into(),
            summary: "Leak past the piston's seal that sets in exponentially (eqs. 5 and 6)."
                .into(),
            equation: "q_t = C_t g sqrt(|P_h1 - P_h2|) sign(P_h1 - P_h2), g = 1 - exp(-mu t)"
                .into(),
            selector: Some("actuator".into()),
            sizes: vec![field(
                "coefficient_m3ps_per_sqrt_pa",
                "m3/s/sqrt(Pa)",
                "Leakage coefficient C_t at the end.",
                1e-4,
            )],
            moves: vec![ParameterMove {
                parameter: "leakage_coefficient_m3ps_per_sqrt_pa".into(),
                operation: Operation::Add,
                by: MoveBy::Size("coefficient_m3ps_per_sqrt_pa".into()),
            }],
            profile: ProfileDescription::Exponential {
                speed: field(
                    "speed_per_s",
                    "1/s",
                    "Speed mu at which the leak sets in.",
                    1e6,
                ),
            },
        }]
    }

    fn start(parameters: &Parameters) -> Result<Self, Invalid> {
        let start = |name, p| start_of_actuator(p).map_err(|e| Invalid(format!("{name}: {e}")));
        Ok(Self {
            parameters: *parameters,
            state: State {
                angle_rad: parameters.surface.initial_angle_rad,
                rate_radps: parameters.surface.initial_rate_radps,
                actuators: [
                    start("actuator1", &parameters.actuator1)?,
                    start("actuator2", &parameters.actuator2)?,
                ],
            },
        })
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.parameters = *parameters;
    }

    fn measure(&self) -> Measured {
        transmute!(self.state)
    }

    fn truth(&self, time_s: f64, _command: &Command) -> Truth {
        let [p_1, p_2] = self.parameters.actuators();
        let [state1, state2] = &self.state.actuators;
        let x_d = surface::linear_displacement_m(&self.parameters.surface, self.state.angle_rad);
        let f_h1 = surface::rod_force_n(p_1, state1.position_m, x_d);
        let f_h2 = surface::rod_force_n(p_2, state2.position_m, x_d);
        let [d_1, d_2] = self.disturbances_n(time_s);
        let [c_t1, c_t2] = [p_1, p_2].map(|p| p.leakage_coefficient_m3ps_per_sqrt_pa);
        Truth {
            surface_angle_rad: self.state.angle_rad,
            surface_rate_radps: self.state.rate_radps,
            actuator1_position_m: state1.position_m,
            actuator1_velocity_mps: state1.velocity_mps,
            actuator1_pressure1_pa: state1.pressure1_pa,
            actuator1_pressure2_pa: state1.pressure2_pa,
            actuator1_rod_force_n: f_h1,
            actuator1_leakage_flow_m3ps: leakage::fault_leakage_m3ps(c_t1, state1),
            actuator1_leakage_coefficient_m3ps_per_sqrt_pa: c_t1,
            actuator1_disturbance_n: d_1,
            actuator2_position_m: state2.position_m,
            actuator2_velocity_mps: state2.velocity_mps,
            actuator2_pressure1_pa: state2.pressure1_pa,
            actuator2_pressure2_pa: state2.pressure2_pa,
            actuator2_rod_force_n: f_h2,
            actuator2_leakage_flow_m3ps: leakage::fault_leakage_m3ps(c_t2, state2),
            actuator2_leakage_coefficient_m3ps_per_sqrt_pa: c_t2,
            actuator2_disturbance_n: d_2,
            force_fight_n: surface::force_fight_n([f_h1, f_h2]),
        }
    }

    fn advance(&mut self, interval: &Interval, command: &Command) {
        let h = interval.substep_s();
        let currents_a = [
            command.actuator1_valve_current_a,
            command.actuator2_valve_current_a,
        ];
        // A part's end is the next one's begin: two new sines for each, not four.
        let mut begin_n = self.disturbances_n(interval.start_s);
        for substep in 0..interval.substeps {
            let substep_start_s = interval.start_s + f64::from(substep) * h;
            let parts = if self.empties_within(h).contains(&true) {
                PARTS_OF_EMPTYING_SUBSTEP
            } else {
                1
            };
            let part_s = h / f64::from(parts);
            for part in 0..parts {
                let time_s = substep_start_s + f64::from(part) * part_s;
                let middle_n = self.disturbances_n(time_s + 0.5 * part_s);
                let end_n = self.disturbances_n(time_s + part_s);
                self.substep(part_s, currents_a, &[begin_n, middle_n, end_n]);
                begin_n = end_n;
            }
        }
    }
}

/// The state of an actuator at step 0, if its parameters go together.
fn start_of_actuator(p: &ActuatorParameters) -> Result<ActuatorState, Invalid> {
    let (supply_pa, return_pa) = (p.supply_pressure_pa, p.return_pressure_pa);
    if return_pa >= supply_pa {
        return Err(Invalid(format!(
            "return_pressure_pa = {return_pa} must be below supply_pressure_pa = {supply_pa}"
        )));
    }
    let position_m = p.initial_position_m;
    let (lowest_m, highest_m) = (-p.volume1_m3 / p.area1_m2, p.volume2_m3 / p.area2_m2);
    if !(lowest_m < position_m && position_m < highest_m) {
        return Err(Invalid(format!(
            "initial_position_m = {position_m} is outside the piston's travel, which is \
             -volume1_m3 / area1_m2 = {lowest_m} to volume2_m3 / area2_m2 = {highest_m}"
        )));
    }
    let pressure_pa = |name: &str, ratio: f64| {
        let pressure_pa = ratio * supply_pa;
        if pressure_pa < return_pa {
            return Err(Invalid(format!(
                "{name} = {ratio} of supply_pressure_pa is {pressure_pa} Pa, below \
                 return_pressure_pa = {return_pa}; {name} must be at least {}",
                return_pa / supply_pa
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

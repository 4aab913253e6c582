//! Physics of the whole system: equilibrium, conservation, symmetry and a leak that does not chatter; `golden` tests
//! the order of convergence and the agreement with an independent solver, `paper` the paper's experiment under its
//! proportional law.

mod faults;
mod golden;
mod paper;

use hil_config::plan::Waveform;
use shared_types::table::Table;
use shared_types::time::{Rate, Step};

use super::*;
use crate::stimulus::evaluate;

const CLOSED: Command = Command {
    actuator1_valve_current_a: 0.0,
    actuator2_valve_current_a: 0.0,
};

/// Table 1 without disturbances.
fn undisturbed() -> Parameters {
    let mut parameters = Parameters::default();
    for p in [&mut parameters.actuator1, &mut parameters.actuator2] {
        p.disturbance_constant_n = 0.0;
        p.disturbance_amplitude_n = 0.0;
    }
    parameters
}

/// The paper's command theta_r.
fn paper_command_rad(time_s: f64) -> f64 {
    let waveform = Waveform::Paper {
        amplitude: 0.2,
        frequency_hz: 1.0,
        onset_per_s3: 0.1,
    };
    let mut row = [0.0; 6];
    evaluate(&waveform, time_s, &mut row);
    row[0]
}

/// The paper's proportional law, `u_i = 90 A/m (r_d theta_r - x_h,i)`.
fn proportional_law(reference_rad: f64, measured: &Measured) -> Command {
    let wanted_m = 0.15 * reference_rad;
    Command {
        actuator1_valve_current_a: 90.0 * (wanted_m - measured.actuator1_position_m),
        actuator2_valve_current_a: 90.0 * (wanted_m - measured.actuator2_position_m),
    }
}

/// Applies the same change to both actuators.
fn both(mut parameters: Parameters, change: impl Fn(&mut ActuatorParameters)) -> Parameters {
    change(&mut parameters.actuator1);
    change(&mut parameters.actuator2);
    parameters
}

fn start(parameters: &Parameters) -> Drhas {
    Drhas::start(parameters).unwrap()
}

/// Number of state variables.
const STATES: usize = size_of::<State>() / size_of::<f64>();

/// Returns the right-hand side at a plant's state, in the order of the state.
fn rates_of_state<const BEYOND_PAPER: bool>(
    plant: &Drhas,
    edges: OpenEdges,
    disturbances_n: Pair,
) -> [f64; STATES] {
    let inputs = Inputs {
        edges,
        disturbances_n,
    };
    let (surface, motion) = (&plant.parameters.surface, Motion::from(&plant.state));
    let rates = rates::<BEYOND_PAPER>(surface, &plant.actuators, &inputs, &motion);
    transmute!(State::from(&rates))
}

/// Advances at 10 kHz with 4 substeps; `look` is called with the plant after every step.
fn run(plant: &mut Drhas, steps: u64, command: &Command, mut look: impl FnMut(&Drhas)) {
    let rate = Rate::new(10_000.0).unwrap();
    for k in 0..steps {
        let interval = Interval {
            start_s: rate.seconds(Step(k)),
            length_s: rate.period_s(),
            substeps: 4,
        };
        plant.advance(&interval, command);
        look(plant);
    }
}

#[test]
fn an_undisturbed_system_stays_exactly_at_rest() {
    let mut plant = start(&undisturbed());
    let before = plant.state;
    assert_eq!(before.actuators[1].pressure2_pa, 14e6);
    run(&mut plant, 1000, &CLOSED, |_| {});
    assert_eq!(plant.state, before);
}

#[test]
fn constant_disturbances_settle_against_load_and_rods() {
    // With closed valves and a wide bypass the pressures become equal, so that F_hi = -d_i and K_d r_d theta_d = F_h1 +
    // F_h2.
    let parameters = both(Parameters::default(), |p| {
        p.disturbance_amplitude_n = 0.0;
        p.internal_leakage_m3ps_per_pa = 1e-9;
    });
    let mut plant = start(&parameters);
    run(&mut plant, 40_000, &CLOSED, |_| {});
    let truth = plant.truth(4.0, &CLOSED);
    let angle_rad = -500.0 / (9.14e5 * 0.15);
    assert!((truth.surface_angle_rad / angle_rad - 1.0).abs() < 1e-6);
    assert!((truth.actuator1_rod_force_n + 100.0).abs() < 1e-3);
    assert!((truth.actuator2_rod_force_n + 400.0).abs() < 1e-3);
    assert!((truth.force_fight_n - 300.0).abs() < 1e-3);
    assert!((truth.actuator1_position_m - (0.15 * angle_rad - 1e-6)).abs() < 1e-9);
}

#[test]
fn positive_currents_extend_both_rods_and_raise_the_surface() {
    let mut plant = start(&undisturbed());
    let open = Command {
        actuator1_valve_current_a: 0.5,
        actuator2_valve_current_a: 0.5,
    };
    run(&mut plant, 500, &open, |_| {});
    let truth = plant.truth(0.05, &open);
    assert!(truth.actuator1_position_m > 1e-3 && truth.actuator1_velocity_mps > 0.0);
    assert!(truth.actuator1_pressure1_pa > truth.actuator1_pressure2_pa);
    assert!(truth.surface_angle_rad > 0.0);
    assert_eq!(truth.force_fight_n, 0.0, "equal actuators do not fight");
}

#[test]
fn the_mirrored_system_has_the_mirrored_motion() {
    let moving = |sign: f64| {
        let mut parameters = Parameters::default();
        parameters.surface.initial_rate_radps = sign * 0.3;
        parameters.actuator1.disturbance_constant_n = sign * 100.0;
        parameters.actuator2.disturbance_constant_n = sign * 400.0;
        parameters.actuator1.disturbance_amplitude_n = 0.0;
        parameters.actuator1.leakage_coefficient_m3ps_per_sqrt_pa = 2e-8;
        let mut plant = start(&parameters);
        let command = Command {
            actuator1_valve_current_a: sign * 0.2,
            actuator2_valve_current_a: sign * -0.1,
        };
        run(&mut plant, 300, &command, |_| {});
        plant.state
    };
    let (one, other) = (moving(1.0), moving(-1.0));
    assert_eq!(one.angle_rad, -other.angle_rad);
    for (one, other) in one.actuators.iter().zip(&other.actuators) {
        assert_eq!(one.position_m, -other.position_m);
        assert_eq!(one.pressure1_pa, other.pressure2_pa);
        assert_eq!(one.pressure2_pa, other.pressure1_pa);
    }
}

#[test]
fn swapping_the_actuators_changes_nothing_else() {
    // The leak empties the pressure difference of one actuator only, again and again.
    let ringing = |leaking: usize| {
        let mut parameters = both(undisturbed(), |p| p.initial_velocity_mps = 0.2);
        let actuators = [&mut parameters.actuator1, &mut parameters.actuator2];
        actuators[leaking].leakage_coefficient_m3ps_per_sqrt_pa = 5e-7;
        let mut plant = start(&parameters);
        run(&mut plant, 300, &CLOSED, |_| {});
        plant.state
    };
    let (one, other) = (ringing(0), ringing(1));
    assert_eq!(one.angle_rad, other.angle_rad);
    assert_eq!(one.actuators[0], other.actuators[1]);
    assert_eq!(one.actuators[1], other.actuators[0]);
    assert_ne!(one.actuators[0], one.actuators[1]);
}

/// A moving system whose chambers are all closed.
fn closed_chambers() -> Parameters {
    let mut parameters = both(undisturbed(), |p| {
        p.internal_leakage_m3ps_per_pa = 0.0;
        p.initial_velocity_mps = 0.4;
        p.area2_m2 = 1.2e-3;
        p.initial_pressure1_ratio = 0.4;
    });
    parameters.actuator2.piston_mass_kg = 40.0;
    parameters.actuator2.connection_stiffness_n_per_m = 0.7e8;
    parameters
}

#[test]
fn a_closed_chamber_keeps_its_oil() {
    // P' = -beta_e V' / V is d(V exp(P / beta_e)) / dt = 0.
    let parameters = closed_chambers();
    let oil = |plant: &Drhas| -> Vec<f64> {
        let mut oil = Vec::new();
        for (p, s) in parameters.actuators().iter().zip(&plant.state.actuators) {
            let volume1_m3 = p.volume1_m3 + p.area1_m2 * s.position_m;
            let volume2_m3 = p.volume2_m3 - p.area2_m2 * s.position_m;
            oil.push(volume1_m3 * libm::exp(s.pressure1_pa / p.bulk_modulus_pa));
            oil.push(volume2_m3 * libm::exp(s.pressure2_pa / p.bulk_modulus_pa));
        }
        oil
    };
    let mut plant = start(&parameters);
    let before = oil(&plant);
    let mut travel_m = 0.0;
    run(&mut plant, 1000, &CLOSED, |plant| {
        travel_m += (plant.state.actuators[0].velocity_mps * 1e-4).abs();
        for (now, before) in oil(plant).iter().zip(&before) {
            assert!((now / before - 1.0).abs() < 1e-9, "{now} is not {before}");
        }
    });
    assert!(travel_m > 1e-3, "the pistons moved: {travel_m} m");
}

/// Energy of masses, springs and oil. The oil of a closed chamber has `U = -V (P + beta_e)` up to a constant, so that
/// `dU = -P dV`.
fn energy_j(parameters: &Parameters, state: &State) -> f64 {
    let surface = &parameters.surface;
    let x_d = surface.radial_distance_m * state.angle_rad;
    let mut energy_j = 0.5 * surface.inertia_kg_m2 * state.rate_radps * state.rate_radps
        + 0.5 * surface.load_stiffness_n_per_m * x_d * x_d;
    for (p, s) in parameters.actuators().iter().zip(&state.actuators) {
        let stretch_m = s.position_m - x_d;
        let volume1_m3 = p.volume1_m3 + p.area1_m2 * s.position_m;
        let volume2_m3 = p.volume2_m3 - p.area2_m2 * s.position_m;
        energy_j += 0.5 * p.piston_mass_kg * s.velocity_mps * s.velocity_mps
            + 0.5 * p.connection_stiffness_n_per_m * stretch_m * stretch_m
            - volume1_m3 * (s.pressure1_pa + p.bulk_modulus_pa)
            - volume2_m3 * (s.pressure2_pa + p.bulk_modulus_pa);
    }
    energy_j
}

#[test]
fn without_damping_valve_and_leak_energy_is_conserved() {
    let mut parameters = both(closed_chambers(), |p| p.damping_n_s_per_m = 0.0);
    parameters.surface.damping_n_m_s_per_rad = 0.0;
    let mut plant = start(&parameters);
    let before_j = energy_j(&parameters, &plant.state);
    run(&mut plant, 1000, &CLOSED, |plant| {
        let change_j = energy_j(&parameters, &plant.state) - before_j;
        // The pistons start with 7.6 J.
        assert!(change_j.abs() < 1e-5, "{change_j} J");
    });
}

#[test]
fn damping_only_removes_energy() {
    let parameters = closed_chambers();
    let mut plant = start(&parameters);
    let start_j = energy_j(&parameters, &plant.state);
    let mut before_j = start_j;
    run(&mut plant, 300, &CLOSED, |plant| {
        let now_j = energy_j(&parameters, &plant.state);
        assert!(now_j < before_j, "{now_j} J after {before_j} J");
        before_j = now_j;
    });
    assert!(start_j - before_j > 1.0, "{} J lost", start_j - before_j);
}

#[test]
fn a_leak_moves_oil_from_one_chamber_to_the_other() {
    // At rest and with closed valves V_1 P_1' + V_2 P_2' = 0, and oil flows from high to low pressure.
    let parameters = both(undisturbed(), |p| {
        p.volume1_m3 = 1e-4;
        p.leakage_coefficient_m3ps_per_sqrt_pa = 3e-7;
        p.initial_pressure1_ratio = 0.7;
    });
    let plant = start(&parameters);
    let closed = OpenEdges::at(&plant.actuators, Pair::both(0.0));
    let rates = rates_of_state::<false>(&plant, closed, Pair::both(0.0));
    for i in [4, 8] {
        let (gained1, gained2) = (1e-4 * rates[i], 0.735e-4 * rates[i + 1]);
        assert!(gained1 < -1e5, "{gained1}");
        assert!(
            (gained1 + gained2).abs() < 1e-9 * gained2,
            "{gained1} {gained2}"
        );
    }
}

#[test]
fn pressures_that_a_leak_makes_equal_stay_equal() {
    // Heavy pistons that nothing else moves: sqrt(y) falls by a / 2 per second, then y stays 0.
    let parameters = both(undisturbed(), |p| {
        p.piston_mass_kg = 1e6;
        p.connection_stiffness_n_per_m = 0.0;
        p.internal_leakage_m3ps_per_pa = 0.0;
        p.leakage_coefficient_m3ps_per_sqrt_pa = 1e-7;
        p.initial_pressure1_ratio = 0.51;
    });
    let a = 1e-7 * 2.0 * 800e6 / 0.735e-4;
    let mut plant = start(&parameters);
    let mut step = 0;
    run(&mut plant, 20, &CLOSED, |plant| {
        step += 1;
        let root = 280e3_f64.sqrt() - 0.5 * a * f64::from(step) * 1e-4;
        let expected_pa = if root > 0.0 { root * root } else { 0.0 };
        for s in &plant.state.actuators {
            let y = s.pressure1_pa - s.pressure2_pa;
            assert!(
                (y - expected_pa).abs() < 10.0,
                "step {step}: {y} Pa, not {expected_pa} Pa"
            );
        }
    });
}

#[test]
fn a_leaking_system_that_rings_down_comes_to_rest() {
    // Runge-Kutta steps alone make y oscillate here, by 4 kPa for ever.
    let parameters = both(undisturbed(), |p| {
        p.leakage_coefficient_m3ps_per_sqrt_pa = 5e-7;
        p.initial_velocity_mps = 0.2;
    });
    let mut plant = start(&parameters);
    run(&mut plant, 30_000, &CLOSED, |_| {});
    run(&mut plant, 100, &CLOSED, |plant| {
        for s in &plant.state.actuators {
            assert!((s.pressure1_pa - s.pressure2_pa).abs() < 1e-3, "{s:?}");
        }
    });
}

#[test]
fn a_fault_acts_from_the_retuned_step_on() {
    let mut plant = start(&both(undisturbed(), |p| p.initial_pressure1_ratio = 0.6));
    assert_eq!(plant.truth(0.0, &CLOSED).actuator2_leakage_flow_m3ps, 0.0);
    let mut faulty = plant.parameters;
    faulty.actuator2.leakage_coefficient_m3ps_per_sqrt_pa = 5e-7;
    plant.retune(&faulty);
    let truth = plant.truth(0.0, &CLOSED);
    // 5e-7 sqrt(0.1 * 28e6)
    assert!((truth.actuator2_leakage_flow_m3ps - 8.366600265340756e-4).abs() < 1e-15);
    assert_eq!(truth.actuator2_leakage_coefficient_m3ps_per_sqrt_pa, 5e-7);
    assert_eq!(truth.actuator1_leakage_flow_m3ps, 0.0);
}

#[test]
fn the_sensors_report_every_state_under_its_name() {
    let mut parameters = Parameters::default();
    parameters.surface.initial_angle_rad = 0.1;
    parameters.surface.initial_rate_radps = 0.2;
    for (p, n) in [
        (&mut parameters.actuator1, 1.0),
        (&mut parameters.actuator2, 2.0),
    ] {
        p.initial_position_m = n * 1e-3;
        p.initial_velocity_mps = n * 1e-1;
        p.initial_pressure1_ratio = n * 0.25;
        p.initial_pressure2_ratio = n * 0.125;
    }
    let plant = start(&parameters);
    let measured = Plant::measure(&plant);
    assert_eq!(
        measured,
        Measured {
            surface_angle_rad: 0.1,
            surface_rate_radps: 0.2,
            actuator1_position_m: 1e-3,
            actuator1_velocity_mps: 0.1,
            actuator1_pressure1_pa: 7e6,
            actuator1_pressure2_pa: 3.5e6,
            actuator2_position_m: 2e-3,
            actuator2_velocity_mps: 0.2,
            actuator2_pressure1_pa: 14e6,
            actuator2_pressure2_pa: 7e6,
        }
    );
    let truth = plant.truth(0.0, &CLOSED);
    for (field, value) in Measured::fields().iter().zip(measured.row()) {
        let at = Truth::fields().iter().position(|f| f.name == field.name);
        assert_eq!(truth.row()[at.unwrap()], *value, "{}", field.name);
    }
}

#[test]
fn every_default_is_in_its_range() {
    for field in Parameters::fields() {
        assert!(
            field.admits(field.default.expect("a default")),
            "{}",
            field.name
        );
    }
}

/// Returns the refusal of a change of actuator 2.
fn refusal(change: impl Fn(&mut ActuatorParameters)) -> String {
    let mut parameters = Parameters::default();
    change(&mut parameters.actuator2);
    Drhas::start(&parameters).err().expect("refused").0
}

#[test]
fn a_return_pressure_above_the_supply_is_refused() {
    let text = refusal(|p| p.return_pressure_pa = 28e6);
    assert!(
        text.starts_with("actuator2: return_pressure_pa = 2.8e7 must be below"),
        "{text}"
    );
}

#[test]
fn a_piston_outside_its_cylinder_is_refused() {
    let text = refusal(|p| {
        p.volume2_m3 = 0.3e-4;
        p.initial_position_m = 0.021;
    });
    assert!(
        text.contains("initial_position_m = 0.021 is outside the piston's travel"),
        "{text}"
    );
    let text = refusal(|p| {
        p.volume1_m3 = 0.3e-4;
        p.initial_position_m = -0.021;
    });
    assert!(
        text.contains("initial_position_m = -0.021 is outside"),
        "{text}"
    );
}

#[test]
fn a_chamber_below_the_return_pressure_is_refused() {
    let text = refusal(|p| {
        p.return_pressure_pa = 7e6;
        p.initial_pressure2_ratio = 0.2;
    });
    assert!(
        text.contains("initial_pressure2_ratio must be at least 0.25"),
        "{text}"
    );
}

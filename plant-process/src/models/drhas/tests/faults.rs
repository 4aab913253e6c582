//! The named faults as a table: the moved parameters exist, are faultable, have room for the move and are documented.
//! Also tests the whole system under effects beyond the paper, where several equations interact; the equations
//! themselves are tested in their files and in `golden`.

use shared_types::describe::{MoveBy, Operation, ProfileDescription};
use shared_types::table::{Field, Table};
use shared_types::time::{Rate, Step};

use super::super::*;
use super::{CLOSED, STATES, both, paper_command_rad, proportional_law, run, start, undisturbed};

const PAGE: &str = include_str!("../../../../../docs/faults-drhas.md");

/// Lists the parameters that a move of a fault reaches, one for each target.
fn reached(fault: &FaultDescription, parameter: &str) -> Vec<Field> {
    let names = match &fault.selector {
        Some(selector) => vec![
            format!("{selector}1.{parameter}"),
            format!("{selector}2.{parameter}"),
        ],
        None => vec![parameter.into()],
    };
    let fields = Parameters::fields();
    let field_of = |name: String| fields.iter().find(|f| f.name == name).expect(&name).clone();
    names.into_iter().map(field_of).collect()
}

#[test]
fn every_fault_moves_parameters_that_are_open_to_faults_and_have_room() {
    for fault in Drhas::faults() {
        assert!(!fault.moves.is_empty(), "{}", fault.kind);
        for moved in &fault.moves {
            let amounts = match &moved.by {
                MoveBy::Constant(constant) => vec![*constant],
                MoveBy::Size(key) => {
                    let size = fault.sizes.iter().find(|size| size.name == *key);
                    let size = size.unwrap_or_else(|| panic!("{}: no {key}", fault.kind));
                    assert!(size.min.is_finite() && size.max.is_finite());
                    let default = size.default.into_iter();
                    default.chain([size.min, size.max]).collect()
                }
            };
            for field in reached(&fault, &moved.parameter) {
                assert!(field.faultable, "{}", field.name);
                let healthy = field.default.unwrap();
                for &amount in &amounts {
                    let value = match moved.operation {
                        Operation::Add => healthy + amount,
                        Operation::Scale => healthy * amount,
                        Operation::Set => amount,
                    };
                    assert!(
                        field.admits(value),
                        "{}: {value} in {}",
                        fault.kind,
                        field.name
                    );
                }
            }
        }
    }
}

#[test]
fn every_size_moves_something_in_its_own_unit() {
    for fault in Drhas::faults() {
        for size in &fault.sizes {
            let moves: Vec<_> = (fault.moves.iter())
                .filter(|moved| moved.by == MoveBy::Size(size.name.clone()))
                .collect();
            assert!(!moves.is_empty(), "{}: {}", fault.kind, size.name);
            for moved in moves {
                for field in reached(&fault, &moved.parameter) {
                    let unit = match moved.operation {
                        Operation::Scale => "1",
                        Operation::Add | Operation::Set => &field.unit,
                    };
                    assert_eq!(size.unit, unit, "{}: {}", fault.kind, size.name);
                }
            }
        }
    }
}

#[test]
fn every_fault_and_every_key_is_on_its_page() {
    for fault in Drhas::faults() {
        let heading = format!("## {}\n", fault.kind);
        let (_, section) = PAGE.split_once(&heading).expect(&heading);
        let section = section.split("\n## ").next().unwrap();
        let example = format!("kind = \"{}\"", fault.kind);
        assert!(section.contains(&example), "{example}");
        let live = format!("hil inject {} ", fault.kind);
        assert!(section.contains(&live), "{live}");
        let profile = match &fault.profile {
            ProfileDescription::Exponential { speed } => Some(speed),
            ProfileDescription::Step => None,
        };
        for key in fault.sizes.iter().chain(profile) {
            let start = format!("| `{}` | {} | ", key.name, key.unit);
            let (_, row) = section.split_once(&start).expect(&start);
            let mut cells = row.split('|').map(str::trim);
            let (min, max) = cells.next().unwrap().split_once(" to ").unwrap();
            assert_eq!(min.parse(), Ok(key.min), "{start}");
            assert_eq!(max.parse(), Ok(key.max), "{start}");
            let default = cells.next().unwrap().parse().ok();
            assert_eq!(default, key.default, "{start}");
        }
        for moved in &fault.moves {
            let parameter = format!("`{}`", moved.parameter);
            assert!(section.contains(&parameter), "{}: {parameter}", fault.kind);
        }
    }
}

/// Runs the plant under the proportional law from the start.
fn controlled(parameters: &Parameters, duration_s: f64, substeps: u32) -> Truth {
    let rate = Rate::new(10_000.0).unwrap();
    let mut plant = start(parameters);
    let last = rate.step_at_or_after(duration_s);
    for k in 0..last.0 {
        let time_s = rate.seconds(Step(k));
        let command = proportional_law(paper_command_rad(1.0 + time_s), &plant.measure());
        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps,
        };
        plant.advance(&interval, &command);
    }
    plant.truth(rate.seconds(last), &CLOSED)
}

#[test]
fn the_ends_of_every_range_are_stable_with_substeps_of_25_us() {
    type Change = fn(&mut ActuatorParameters);
    let cases: [(&str, Change); 9] = [
        ("bias", |p| p.valve_null_bias_m = 0.02),
        ("lag", |p| p.valve_lag_s = 10.0),
        ("short lag", |p| p.valve_lag_s = 1e-9),
        ("stuck", |p| p.valve_stuck = 1.0),
        ("droop", |p| p.supply_droop_pa_s_per_m3 = 1e12),
        ("leak 1", |p| p.external_leakage1_m3ps_per_sqrt_pa = 1e-6),
        ("leak 2", |p| p.external_leakage2_m3ps_per_sqrt_pa = 1e-6),
        ("friction", |p| {
            p.coulomb_friction_n = 4e4;
            p.friction_velocity_mps = 1e-2;
            p.damping_n_s_per_m = 1.01e6;
        }),
        ("seizure", |p| p.motion_blocked = 1.0),
    ];
    for (name, change) in cases {
        for duration_s in [0.01, 0.02, 0.04] {
            let mut parameters = undisturbed();
            change(&mut parameters.actuator1);
            let [coarse, fine] = [4, 64].map(|n| controlled(&parameters, duration_s, n));
            let off = |index: usize| (coarse.row()[index] - fine.row()[index]).abs();
            for (index, field) in Truth::fields().iter().enumerate() {
                // A thousandth of full travel or supply, or of the usual magnitude.
                let allowed = match field.unit.as_str() {
                    "rad" | "m" => 1e-5,
                    "rad/s" | "m/s" => 1e-3,
                    "Pa" => 2.8e4,
                    "N" => 1e2,
                    _ => continue,
                };
                let (field, off) = (&field.name, off(index));
                assert!(off < allowed, "{name}, {duration_s} s: {field} by {off}");
            }
        }
    }
}

#[test]
fn a_chamber_pulled_empty_boils_and_holds_its_vapour_pressure() {
    // A load of 66 kN for each piston against closed valves: more than 14 MPa can hold.
    let mut parameters = both(undisturbed(), |p| p.internal_leakage_m3ps_per_pa = 0.0);
    parameters.surface.load_torque_nm = -2e4;
    let mut plant = start(&parameters);
    let (mut boiling, mut last_pa) = (0, 14e6);
    run(&mut plant, 200, &CLOSED, |plant| {
        for s in &plant.state.actuators {
            assert!(s.pressure1_pa >= -1e5, "{s:?}");
            boiling += u32::from(s.pressure1_pa == -1e5);
            // The other chamber is closed and full: V exp(P / beta_e) stays constant.
            let volume2_m3 = 0.735e-4 - 1.47e-3 * s.position_m;
            let expected_pa = 14e6 + 800e6 * libm::log(0.735e-4 / volume2_m3);
            assert!((s.pressure2_pa - expected_pa).abs() < 1e3, "{s:?}");
            last_pa = s.pressure1_pa;
        }
    });
    assert!(boiling > 100, "{boiling}");
    // Pushed back, the chamber fills and its pressure rises.
    let mut unloaded = parameters;
    unloaded.surface.load_torque_nm = 0.0;
    plant.retune(&unloaded);
    run(&mut plant, 200, &CLOSED, |plant| {
        let pressure1_pa = plant.state.actuators[0].pressure1_pa;
        last_pa = if pressure1_pa > last_pa {
            pressure1_pa
        } else {
            last_pa
        };
    });
    assert!(last_pa > 1e6, "{last_pa}");
}

#[test]
fn a_seized_piston_holds_against_the_load_and_the_other_actuator() {
    let mut parameters = undisturbed();
    parameters.actuator1.motion_blocked = 1.0;
    parameters.actuator1.initial_velocity_mps = 0.2;
    let mut plant = start(&parameters);
    let push = Command {
        actuator1_valve_current_a: -1.0,
        actuator2_valve_current_a: 1.0,
    };
    run(&mut plant, 300, &push, |_| {});
    let truth = plant.truth(0.03, &push);
    // It moved on by v tau = 0.2 * 50 us; Runge-Kutta at half a time constant is accurate to 4 digits.
    let position_m = truth.actuator1_position_m;
    assert!((position_m / 1e-5 - 1.0).abs() < 1e-3, "{position_m}");
    assert!(truth.actuator1_velocity_mps.abs() < 1e-12);
    assert!(truth.actuator1_rod_force_n < -1e4, "{truth:?}");
}

#[test]
fn no_command_moves_a_hard_over_valve() {
    let hard_over = |current_a: f64| {
        let mut parameters = undisturbed();
        parameters.actuator1.valve_gain_m_per_a = 0.0;
        parameters.actuator1.valve_null_bias_m = 1e-3;
        let mut plant = start(&parameters);
        let command = Command {
            actuator1_valve_current_a: current_a,
            ..CLOSED
        };
        run(&mut plant, 200, &command, |_| {});
        plant.state
    };
    // The effect of 1e-3 m / 3.04e-3 m/A on an intact valve.
    let mut sound = start(&undisturbed());
    let command = Command {
        actuator1_valve_current_a: 1e-3 / 3.04e-3,
        ..CLOSED
    };
    run(&mut sound, 200, &command, |_| {});
    let position_m = sound.state.actuators[0].position_m;
    assert!(position_m > 1e-3, "{position_m}");
    for current_a in [0.0, 3.0, -3.0] {
        let off_m = hard_over(current_a).actuators[0].position_m - position_m;
        assert!(off_m.abs() < 1e-15, "{off_m}");
    }
}

#[test]
fn a_spool_that_jams_stays_at_the_last_command_until_it_is_free() {
    let command = |current_a: f64| Command {
        actuator1_valve_current_a: current_a,
        ..CLOSED
    };
    let free = undisturbed();
    let mut stuck = free;
    stuck.actuator1.valve_stuck = 1.0;
    let (mut jams, mut sound) = (start(&free), start(&free));
    for (parameters, commanded_a, effective_a) in [
        (&free, 0.2, 0.2),
        (&stuck, -0.4, 0.2),
        (&stuck, 0.3, 0.2),
        (&free, -0.1, -0.1),
        (&stuck, 0.5, -0.1),
    ] {
        jams.retune(parameters);
        run(&mut jams, 20, &command(commanded_a), |_| {});
        run(&mut sound, 20, &command(effective_a), |_| {});
        assert_eq!(jams.state, sound.state);
    }
}

/// State after 30 ms of motion, with parameters changed at 20 ms.
fn moved_at_20_ms(changed: &Parameters) -> State {
    let rate = Rate::new(10_000.0).unwrap();
    let mut plant = start(&Parameters::default());
    for k in 0..300 {
        if k == 200 {
            plant.retune(changed);
        }
        let time_s = rate.seconds(Step(k));
        let command = proportional_law(paper_command_rad(1.0 + time_s), &plant.measure());
        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps: 4,
        };
        plant.advance(&interval, &command);
    }
    plant.state
}

#[test]
fn every_move_of_every_fault_changes_the_motion() {
    let healthy = moved_at_20_ms(&Parameters::default());
    for fault in Drhas::faults() {
        for moved in &fault.moves {
            for field in reached(&fault, &moved.parameter) {
                let size = |key: &String| fault.sizes.iter().find(|size| size.name == *key);
                let amount = match (&moved.by, moved.operation) {
                    (MoveBy::Constant(constant), _) => *constant,
                    (MoveBy::Size(key), Operation::Scale) => size(key).unwrap().min,
                    (MoveBy::Size(key), _) => size(key).unwrap().max,
                };
                let mut changed = Parameters::default();
                let index = Parameters::fields().iter().position(|f| *f == field);
                let value = &mut changed.row_mut()[index.unwrap()];
                *value = match moved.operation {
                    Operation::Add => *value + amount,
                    Operation::Scale => *value * amount,
                    Operation::Set => amount,
                };
                let state = moved_at_20_ms(&changed);
                assert_ne!(state, healthy, "{}: {}", fault.kind, field.name);
                let row: [f64; STATES] = transmute!(state);
                assert!(
                    row.iter().all(|x| x.is_finite()),
                    "{}: {state:?}",
                    fault.kind
                );
            }
        }
    }
}

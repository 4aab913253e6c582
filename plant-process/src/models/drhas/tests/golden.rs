//! Comparison with an independent reference: right-hand sides at 50 digits, and trajectories of SciPy's DOP853
//! (`tests/golden/make.py` at the root of the repository).

use serde_json::Value;
use shared_types::table::Table;
use shared_types::time::{Rate, Step};

use super::super::*;
use super::{STATES, paper_command_rad, proportional_law, rates_of_state};

const RIGHT_HAND_SIDES: &str = include_str!("../../../../../tests/golden/plant_rhs.json");
const TRAJECTORIES: &str = include_str!("../../../../../tests/golden/plant_windows.json");
const FAULTS: &str = include_str!("../../../../../tests/golden/plant_faults.json");

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list: Vec<f64> = value
        .as_array()
        .expect("a list")
        .iter()
        .map(number)
        .collect();
    list.try_into().expect("as many numbers as expected")
}

/// Reads the parameters of a case; each must be a parameter of the plant.
fn parameters(case: &Value) -> Parameters {
    let mut parameters = Parameters::default();
    let fields = Parameters::fields();
    for (group, values) in case.as_object().expect("groups") {
        for (key, value) in values.as_object().expect("values") {
            let name = format!("{group}.{key}");
            let at = fields.iter().position(|field| field.name == name);
            parameters.row_mut()[at.expect(&name)] = number(value);
        }
    }
    parameters
}

/// Creates the plant in a state, with its spools at null.
fn plant(parameters: &Parameters, state: State) -> Drhas {
    let spools = parameters.actuators().map(Spool::at_null);
    Drhas::new(parameters, state, spools)
}

fn assert_state_order(file: &Value) {
    let names: Vec<String> = Measured::fields().into_iter().map(|f| f.name).collect();
    assert_eq!(file["state"], Value::from(names));
}

fn assert_close(value: f64, expected: &Value, rounding: f64, what: &str) {
    let expected = number(expected);
    let allowed = 1e-12 * expected.abs() + rounding;
    assert!(
        (value - expected).abs() <= allowed,
        "{what}: {value} is not {expected}"
    );
}

/// Rounding of sums whose terms cancel, by the size of the terms.
const ROUNDING: [f64; STATES] = [0.0, 1e-9, 0.0, 1e-9, 1e-4, 1e-4, 0.0, 1e-9, 1e-4, 1e-4];

#[test]
fn the_right_hand_side_matches_50_digits() {
    let file: Value = serde_json::from_str(RIGHT_HAND_SIDES).unwrap();
    assert_state_order(&file);
    let cases = file["cases"].as_array().unwrap();
    assert!(cases.len() >= 40);
    for (n, case) in cases.iter().enumerate() {
        let parameters = parameters(&case["parameters"]);
        let state: State = transmute!(numbers::<STATES>(&case["state"]));
        let currents_a: [f64; 2] = numbers(&case["command_a"]);
        let time_s = number(&case["t_s"]);
        let plant = plant(&parameters, state);
        let command = Command::from_row(&currents_a);
        let edges = OpenEdges::at(&plant.actuators, plant.wanted_spools_m(&command).into());
        let disturbances_n = plant.disturbances_n(time_s);
        let rates = rates_of_state::<false>(&plant, edges, disturbances_n);
        for i in 0..STATES {
            let what = format!("case {n}, rate {i}");
            assert_close(rates[i], &case["derivative"][i], ROUNDING[i], &what);
        }
        let neutral = rates_of_state::<true>(&plant, edges, disturbances_n);
        assert_eq!(neutral, rates, "what is neutral changes no bit");
        let (p, s) = (
            &plant.actuators,
            &ActuatorStates::of(state.actuators.each_ref()),
        );
        for (key, pair) in [
            ("valve_root1_sqrt_pa", edges.active_root_sqrt_pa(s)),
            ("valve_root2_sqrt_pa", edges.passive_root_sqrt_pa(s)),
            ("flow1_m3ps", edges.active_flow_m3ps(s)),
            ("flow2_m3ps", edges.passive_flow_m3ps(s)),
            ("normal_leakage_m3ps", leakage::normal_leakage_m3ps(p, s)),
            ("volume1_m3", cylinder::active_volume_m3(p, s.position_m)),
            ("volume2_m3", cylinder::passive_volume_m3(p, s.position_m)),
        ] {
            for (i, value) in pair.to_array().into_iter().enumerate() {
                // The paper counts both edges of a centred spool, where nothing flows.
                if !(key.contains("root") && currents_a[i] == 0.0) {
                    let expected = &case[["actuator1", "actuator2"][i]];
                    assert_close(value, &expected[key], 0.0, key);
                }
            }
        }
        let truth = plant.truth(time_s, &command);
        assert_close(
            truth.force_fight_n,
            &case["force_fight_n"],
            1e-8,
            "force fight",
        );
        let [one, two] = [&case["actuator1"], &case["actuator2"]];
        assert_close(
            truth.actuator1_rod_force_n,
            &one["rod_force_n"],
            1e-8,
            "rod 1",
        );
        assert_close(
            truth.actuator2_rod_force_n,
            &two["rod_force_n"],
            1e-8,
            "rod 2",
        );
        assert_close(
            truth.actuator1_leakage_flow_m3ps,
            &one["fault_leakage_m3ps"],
            0.0,
            "leak 1",
        );
        assert_close(
            truth.actuator2_leakage_flow_m3ps,
            &two["fault_leakage_m3ps"],
            0.0,
            "leak 2",
        );
        assert_close(
            truth.actuator1_disturbance_n,
            &one["disturbance_n"],
            1e-11,
            "d_1",
        );
        assert_close(
            truth.actuator2_disturbance_n,
            &two["disturbance_n"],
            1e-11,
            "d_2",
        );
    }
}

/// Returns `beta C_t` at a step, from the leak of a window that is evaluated once per tick.
fn leak_now(leak: &Value, effect: usize, time_s: f64) -> f64 {
    let since_s = time_s - number(&leak["onset_s"]);
    let effect = &leak["effects"][effect];
    if since_s < 0.0 {
        return 0.0;
    }
    let (c_t, mu) = (
        &effect["coefficient_m3ps_per_sqrt_pa"],
        &effect["speed_per_s"],
    );
    number(c_t) * -libm::expm1(-number(mu) * since_s)
}

/// Simulates the plant at the samples of a window, with the given substeps.
fn replay(window: &Value, substeps: u32) -> Vec<[f64; STATES]> {
    let leak = &window["leak"];
    let mut parameters = parameters(&window["parameters"]);
    let state = transmute!(numbers::<STATES>(&window["initial_state"]));
    let mut plant = plant(&parameters, state);
    if let Some(spools_m) = window.get("initial_spools_m") {
        plant.spools = numbers::<2>(spools_m).map(|spool_m| Spool {
            position_m: spool_m,
            stuck_m: spool_m,
        });
    }
    let steps = |sample: &Value| sample["step"].as_u64().expect("a step");
    let samples = window["samples"].as_array().unwrap();
    let (first, last) = (steps(&samples[0]), steps(&samples[samples.len() - 1]));
    let rate = Rate::new(number(&window["rate_hz"])).unwrap();
    let mut states = Vec::new();
    for step in first..=last {
        if steps(&samples[states.len()]) == step {
            states.push(transmute!(plant.state));
        }
        let time_s = rate.seconds(Step(step));
        if !leak.is_null() {
            parameters.actuator1.leakage_coefficient_m3ps_per_sqrt_pa = leak_now(leak, 0, time_s);
            parameters.actuator2.leakage_coefficient_m3ps_per_sqrt_pa = leak_now(leak, 1, time_s);
            plant.retune(&parameters);
        }
        // Commands of the proportional law, computed from the state.
        let command = match window["command_a"].get((step - first) as usize) {
            Some(command_a) => Command::from_row(&numbers::<2>(command_a)),
            None if step == last => break,
            None => proportional_law(paper_command_rad(time_s), &plant.measure()),
        };
        let interval = Interval {
            start_s: time_s,
            length_s: rate.period_s(),
            substeps,
        };
        plant.advance(&interval, &command);
    }
    states
}

/// Returns the largest difference from a window's samples, by state.
fn errors(window: &Value, substeps: u32) -> [f64; STATES] {
    let samples = window["samples"].as_array().unwrap();
    let states = replay(window, substeps);
    assert!(states.len() == samples.len() && samples.len() > 20);
    let mut errors = [0.0; STATES];
    for (state, sample) in states.iter().zip(samples) {
        for (i, expected) in numbers::<STATES>(&sample["state"]).iter().enumerate() {
            let error = (state[i] - expected).abs();
            assert!(error.is_finite());
            if error > errors[i] {
                errors[i] = error;
            }
        }
    }
    errors
}

fn assert_below(errors: &[f64; STATES], angle: [f64; 2], actuator: [f64; 4], what: &str) {
    let [x, v, p_1, p_2] = actuator;
    let allowed = [angle[0], angle[1], x, v, p_1, p_2, x, v, p_1, p_2];
    for (error, allowed) in errors.iter().zip(&allowed) {
        assert!(error < allowed, "{what}: {errors:?}");
    }
}

fn window<'a>(file: &'a Value, name: &str) -> &'a Value {
    let windows = file["windows"].as_array().unwrap();
    windows.iter().find(|w| w["name"] == name).expect(name)
}

#[test]
fn trajectories_match_an_adaptive_method_of_order_eight() {
    let file: Value = serde_json::from_str(TRAJECTORIES).unwrap();
    assert_state_order(&file);
    for name in [
        "pid from rest",
        "pid, leak evaluated once per tick",
        "ftsc, unequal actuators",
        "ftsc, unequal actuators, moving",
    ] {
        let errors = errors(window(&file, name), 4);
        assert_below(&errors, [5e-12, 1e-8], [5e-12, 1e-8, 0.2, 0.2], name);
    }
}

#[test]
fn pressure_differences_driven_through_zero_against_a_leak_are_followed_and_converge() {
    // Runge-Kutta alone is off by 4.7e-7 rad and 4100 Pa here with 4 substeps.
    let file: Value = serde_json::from_str(TRAJECTORIES).unwrap();
    let name = "pid, severe leak, pressure differences pass through zero";
    let coarse = errors(window(&file, name), 4);
    assert_below(&coarse, [1.5e-7, 6e-6], [2e-8, 1.3e-5, 20.0, 20.0], name);
    let fine = errors(window(&file, name), 64);
    assert_below(&fine, [1.2e-11, 7e-10], [2e-12, 1e-9, 8e-3, 8e-3], name);
}

#[test]
fn halving_the_substep_divides_the_error_by_sixteen() {
    let file: Value = serde_json::from_str(TRAJECTORIES).unwrap();
    for name in ["pid from rest", "pid, leak evaluated once per tick"] {
        let [coarse, fine] = [4, 8].map(|substeps| errors(window(&file, name), substeps));
        for i in 0..STATES {
            let ratio = coarse[i] / fine[i];
            assert!((14.0..20.0).contains(&ratio), "{name}, state {i}: {ratio}");
        }
    }
}

#[test]
fn the_right_hand_side_beyond_the_paper_matches_50_digits() {
    let file: Value = serde_json::from_str(FAULTS).unwrap();
    assert_state_order(&file);
    let cases = file["cases"].as_array().unwrap();
    assert!(cases.len() >= 24);
    for (n, case) in cases.iter().enumerate() {
        let parameters = parameters(&case["parameters"]);
        let state: State = transmute!(numbers::<STATES>(&case["state"]));
        let plant = plant(&parameters, state);
        assert!(plant.beyond_paper);
        let edges = OpenEdges::at(&plant.actuators, numbers(&case["spools_m"]).into());
        let disturbances_n = plant.disturbances_n(number(&case["t_s"]));
        let rates = rates_of_state::<true>(&plant, edges, disturbances_n);
        for i in 0..STATES {
            let what = format!("case {n}, rate {i}");
            assert_close(rates[i], &case["derivative"][i], ROUNDING[i], &what);
        }
    }
}

#[test]
fn trajectories_beyond_the_paper_match_an_adaptive_method_of_order_eight() {
    let file: Value = serde_json::from_str(FAULTS).unwrap();
    let windows = file["windows"].as_array().unwrap();
    assert!(windows.len() >= 5);
    for window in windows {
        let name = window["name"].as_str().unwrap();
        let [coarse, fine] = [4, 8].map(|substeps| errors(window, substeps));
        assert_below(&coarse, [5e-12, 1e-8], [5e-12, 3e-8, 0.3, 0.3], name);
        for i in 0..STATES {
            let ratio = coarse[i] / fine[i];
            assert!((12.0..24.0).contains(&ratio), "{name}, state {i}: {ratio}");
        }
    }
}

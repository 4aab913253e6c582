//! FMU with 500 variables, in both versions of the standard: each variable as generated, and its numbers.

use serde_json::Value;

use super::{Place, scenario};
use crate::support::mcap_reader::Recording;
use crate::support::vendor_fmu::{
    INNER, INPUTS, OUTPUTS, PARAMETERS, Role, Variable, rate, variables, vendor,
};

/// Returns the variables of some roles, in the order of the FMU.
fn of(is: impl Fn(Role) -> bool) -> Vec<Variable> {
    variables().into_iter().filter(|one| is(one.role)).collect()
}

fn list<'a>(all: &'a Value, name: &str) -> &'a [Value] {
    all[name].as_array().expect("a list")
}

/// Compares a table with the variables it is made from.
fn assert_table(table: &[Value], expected: &[Variable]) {
    assert_eq!(table.len(), expected.len());
    for (field, variable) in table.iter().zip(expected) {
        let name = &variable.name;
        assert_eq!(field["name"], variable.here.as_str(), "{name}");
        assert_eq!(field["unit"], variable.unit, "{name}");
        let text = field["description"].as_str().expect("text");
        assert!(text.contains("of the circuit"), "{name}: {text}");
        let Role::Parameter { is_tunable } = variable.role else {
            // Inputs have the start value of their variable, all others have none.
            let start = field["default"].as_f64();
            let expected = (variable.role == Role::Input).then_some(variable.start);
            assert_eq!(start, expected, "{name}");
            continue;
        };
        let start = field["default"].as_f64().expect("a number");
        assert_eq!(start.to_bits(), variable.start.to_bits(), "{name}");
        assert_eq!(field["min"], 0.0, "{name}");
        assert_eq!(field["max"], 20.0, "{name}");
        let can_be_faulted = field["faultable"].as_bool().unwrap_or(false);
        assert_eq!(can_be_faulted, is_tunable, "{name}");
    }
}

#[test]
fn each_of_500_variables_has_its_position_unit_and_start_value() {
    let parameters = of(|role| matches!(role, Role::Parameter { .. }));
    let inputs = of(|role| role == Role::Input);
    let outputs = of(|role| role == Role::Output);
    let inner = of(|role| role == Role::Inner);
    let counts = [&parameters, &inputs, &outputs, &inner].map(Vec::len);
    assert_eq!(counts, [PARAMETERS, INPUTS, OUTPUTS, INNER]);
    assert_eq!(counts.iter().sum::<usize>(), 500);
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("vendor.fmu", &vendor(version));
        let report = place
            .hil(&["describe", "--json", "vendor.fmu"])
            .expect(0)
            .json();
        let (plant, imported) = (
            &report["description"]["plants"][0],
            &report["description"]["imported"],
        );
        assert_eq!(plant["name"], "vendor");
        assert_table(list(plant, "parameters"), &parameters);
        assert_table(list(plant, "commands"), &inputs);
        assert_table(list(plant, "measured"), &outputs);
        assert_table(list(plant, "truth"), &outputs);
        let names: Vec<&str> = inner.iter().map(|one| one.here.as_str()).collect();
        assert_eq!(list(imported, "locals"), names);
        assert_eq!(list(imported, "left_out").len(), 0);
        assert_eq!(list(imported, "direct").len(), 0);
        let bar = list(imported, "units")
            .iter()
            .find(|unit| unit["name"] == "bar");
        assert_eq!(bar.expect("defined")["base"], "kg m-1 s-2");
        assert_eq!(bar.expect("defined")["factor"], 1e5);
    }
}

#[test]
fn all_signals_follow_the_closed_form_in_both_versions() {
    let (rate_hz, steps) = (10.0, 20_u16);
    let mut digests = Vec::new();
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu("vendor.fmu", &vendor(version));
        let text = scenario("vendor", "vendor.fmu", rate_hz, steps.into());
        let run = place.run(&text, "--set plant.locals=[\"*\"]").expect(0);
        let recording = Recording::open(&run.recording());
        for (place, pair) in of(|role| role == Role::Inner).chunks(2).enumerate() {
            let [state, derivative] = pair else {
                panic!("a state has a derivative")
            };
            // Euler's method on x' = k (1 - x) from 0.
            let (k, h) = (rate(place % PARAMETERS), 1.0 / rate_hz);
            let rest = |step: u16| (0..step).fold(1.0, |rest, _| rest * (1.0 - k * h));
            let column = |variable: &Variable| {
                recording.column(&format!("truth.{}", variable.here.replace('.', "_")))
            };
            let (states, derivatives) = (column(state), column(derivative));
            assert_eq!(states.len(), usize::from(steps) + 1);
            for step in 0..=steps {
                let x = states[usize::from(step)];
                let expected = 1.0 - rest(step);
                assert!((x - expected).abs() < 1e-14, "{}: {x}", state.name);
                let dx = derivatives[usize::from(step)];
                let expected = if step == 0 { 0.0 } else { k * rest(step - 1) };
                assert!((dx - expected).abs() < 1e-14, "{}: {dx}", derivative.name);
            }
            if place < OUTPUTS {
                let output = recording.column(&format!("measured.sensors_pressure__{}", place + 1));
                assert_eq!(output, states);
            }
        }
        digests.push(run.digest());
    }
    assert_eq!(digests[0], digests[1]);
}

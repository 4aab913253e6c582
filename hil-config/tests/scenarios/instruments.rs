//! `[[sensors]]` and `[[actuators]]`: their meaning, refusals, and the way in which they are shown.

use hil_config::plan::{DerivedSource, Instrument, Plan};
use hil_config::problem::ProblemKind::{
    self, Duplicate, Mismatch, MissingKey, OutOfRange, UnknownKey, UnknownName, WrongType,
};
use hil_config::problem::Problems;
use shared_types::table::Field;

use crate::bad::assert_found;
use crate::{BASE, descriptions, only, plan, problems};

const ANGLE: &str = "surface_angle_rad";
const PISTON: &str = "actuator1_position_m";
const CURRENT: &str = "actuator1_valve_current_a";

/// The base, whose run has 1000 steps a second, with more text.
fn with(text: &str) -> String {
    format!("{BASE}\n{text}\n")
}

fn sensor(keys: &str) -> String {
    with(&format!("[[sensors]]\nsignal = \"{ANGLE}\"\n{keys}"))
}

fn only_sensor(keys: &str) -> Instrument {
    let Plan { mut sensors, .. } = plan(&sensor(keys));
    assert_eq!(sensors.len(), 1);
    sensors.remove(0)
}

#[test]
fn values_count_in_the_unit_of_the_signal() {
    let degree = std::f64::consts::PI / 180.0;
    let sensor = only_sensor(
        "range = [\"-30 deg\", \"30 deg\"]\nbits = 12\nnoise_sigma = \"2 LSB\"\nbias = \"1 % of range\"\nrate_hz = \"0.5 kHz\"\nphase_steps = 1\ndelay_s = \"3 ms\"\nscale = \"100.2 %\"\nlag_hz = 200",
    );
    let near = |key: &str, expected: f64| {
        let value = sensor.get(key).unwrap_or_else(|| panic!("{key}"));
        assert!(
            (value - expected).abs() <= 1e-15 * expected.abs(),
            "{key}: {value}"
        );
    };
    near("range_min", -30.0 * degree);
    near("range_max", 30.0 * degree);
    near("noise_sigma", 2.0 * 60.0 * degree / 4096.0);
    near("bias", 0.6 * degree);
    near("rate_hz", 500.0);
    near("delay_s", 0.003);
    near("scale", 1.002);
    near("lag_hz", 200.0);
    assert_eq!(sensor.get("phase_steps"), Some(1.0));
}

#[test]
fn the_stages_have_the_order_of_the_hardware() {
    let text = with(&format!(
        "[[sensors]]\nsignal = \"{ANGLE}\"\nrange = [-2, 2]\nbits = 16\ndelay_s = 0.004\nrate_hz = 250\nnoise_sigma = 1e-3\nlag_hz = 100\nnoise_density = \"1 mrad/sqrt(Hz)\"\nbias_walk = 1e-6\nbias_sigma = \"1 mrad\"\nbias_tau_s = 100\nbias = 1e-4\ncross = {{ {PISTON} = 0.01 }}\nscale = 1.001\n[[actuators]]\nsignal = \"{CURRENT}\"\nrate_hz = 500\nresolution = 1e-6\nrange = [-0.01, 0.01]\nbacklash = 1e-5\ndead_band = 1e-5\nlag_hz = 100\nlag_damping = 0.7\nrate_limit_per_s = \"200 mA/ms\"\ndead_time_s = 0.003"
    ));
    let plan = plan(&text);
    let plants = descriptions::plants();
    let plant = plants
        .iter()
        .find(|plant| plant.name == "drhas")
        .expect("described");
    let kinds = |stages: Vec<hil_config::plan::Stage>| {
        stages
            .into_iter()
            .map(|stage| stage.kind)
            .collect::<Vec<_>>()
    };
    assert_eq!(
        kinds(plan.sensors[0].sensor_stages(plan.run.rate, &plant.measured)),
        [
            "scale",
            "cross-coupling",
            "bias",
            "gauss-markov",
            "random-walk",
            "noise",
            "lag",
            "noise",
            "sample-hold",
            "delay",
            "quantisation",
            "saturation"
        ]
    );
    assert_eq!(
        kinds(plan.actuators[0].actuator_stages(plan.run.rate)),
        [
            "delay",
            "rate-limit",
            "second-order-lag",
            "dead-band",
            "backlash",
            "saturation",
            "quantisation",
            "sample-hold"
        ]
    );
    let drive = plan.actuators[0].get("rate_limit_per_s").expect("limited");
    assert!((drive - 200.0).abs() < 1e-12, "{drive}");
}

#[test]
fn instruments_are_shown_as_they_are_read() {
    let text = with(&format!(
        "[[sensors]]\nsignal = \"{ANGLE}\"\nrange = [-0.5, 0.5]\nbits = 12\nrate_hz = 500\nphase_steps = 1\nnoise_sigma = \"2 LSB\"\ncross = {{ {PISTON} = -0.25 }}\n[[actuators]]\nsignal = \"{CURRENT}\"\ndead_time_s = 0.003\nresolution = 1e-6"
    ));
    let expected = plan(&text);
    let shown = descriptions::shown(&expected);
    assert_eq!(plan(&shown), expected, "{shown}");
}

#[test]
fn a_scenario_without_instruments_has_none() {
    let plan = plan(BASE);
    assert!(plan.sensors.is_empty() && plan.actuators.is_empty());
}

#[rustfmt::skip] // a table reads best with a case on a line
const REFUSED: &[(&str, ProblemKind, &str, &[&str])] = &[
    ("rate_hz = 300", Mismatch, "sensors[0].rate_hz", &["not a whole fraction of `run.rate_hz` = 1000", "250 and 333.3"]),
    ("rate_hz = 2000", Mismatch, "sensors[0].rate_hz", &["the highest is 1000"]),
    ("rate_hz = 250\nphase_steps = 4", OutOfRange, "sensors[0].phase_steps", &["samples are 4 steps apart", "from 0 to 3"]),
    ("phase_steps = 1", Mismatch, "sensors[0].phase_steps", &["needs `rate_hz`"]),
    ("range = [1, 1]", OutOfRange, "sensors[0].range", &["the width 0", "two different bounds in rad"]),
    ("range = [1, -1]", OutOfRange, "sensors[0].range", &["[1, -1]"]),
    ("range = [1]", WrongType, "sensors[0].range", &["1 entries"]),
    ("range = [\"-1 m\", 1]", Mismatch, "sensors[0].range[0]", &["`m` does not convert to rad"]),
    ("range = [-1, 1]\nbits = 54", OutOfRange, "sensors[0].bits", &["`sensors[0].bits` is 54", "from 1 to 53"]),
    ("range = [-1, 1]\nbits = 0", OutOfRange, "sensors[0].bits", &["from 1 to 53"]),
    ("bits = 12", Mismatch, "sensors[0].bits", &["needs `range`"]),
    ("range = [-1, 1]\nbits = 12\nresolution = 0.1", Mismatch, "sensors[0].resolution", &["either `bits` or `resolution`"]),
    ("noise_density = \"0.3 deg/sqrt(h)\"", Mismatch, "sensors[0].noise_density", &["does not convert to rad/sqrt(Hz)", "applies to a rate"]),
    ("noise_density = \"1 kg\"", Mismatch, "sensors[0].noise_density", &["`kg` does not convert to rad/sqrt(Hz)", "a number from 0 to 1e30 in rad/sqrt(Hz)"]),
    ("noise_sigma = \"2 LSB\"", Mismatch, "sensors[0].noise_sigma", &["`LSB` needs `bits` and `range`, or `resolution`"]),
    ("bias = \"1 % of range\"", Mismatch, "sensors[0].bias", &["needs `range`"]),
    ("noise_sigma = \"2 bits\"", Mismatch, "sensors[0].noise_sigma", &["written `LSB`", "in rad, or text with a unit of it, `LSB` or `% of range`"]),
    ("bias = \"0.1 %FS\"", Mismatch, "sensors[0].bias", &["written `% of range`"]),
    ("bias = \"1 deg per h\"", Mismatch, "sensors[0].bias", &["written with `/`"]),
    ("noise_sigma = \"-1 mrad\"", OutOfRange, "sensors[0].noise_sigma", &["out of range"]),
    ("noise_sigma = \"many\"", Mismatch, "sensors[0].noise_sigma", &["does not begin with a number"]),
    ("noise_sigma = true", WrongType, "sensors[0].noise_sigma", &["a number"]),
    ("bias_tau_s = 1", Mismatch, "sensors[0].bias_tau_s", &["needs `bias_sigma`"]),
    ("lag_damping = 1", Mismatch, "sensors[0].lag_damping", &["needs `lag_hz`"]),
    ("delay_s = 0.0005", OutOfRange, "sensors[0].delay_s", &["0.5 steps of 0.001 s", "the nearest are 0 and 0.001 s"]),
    ("delay_s = 1000", OutOfRange, "sensors[0].delay_s", &["at most 100000"]),
    ("cross = { surface_angle_rad = 0.1 }", Mismatch, "sensors[0].cross.surface_angle_rad", &["the signal itself", "`scale`"]),
    ("cross = { actuator1_position = 0.1 }", UnknownName, "sensors[0].cross.actuator1_position", &["nearest: `actuator1_position_m`"]),
    ("dead_time_s = 1", UnknownKey, "sensors[0].dead_time_s", &["unknown key `dead_time_s`"]),
    ("", MissingKey, "sensors[0]", &["has no effect", "`noise_density`"]),
    ("scale = 2\n[[sensors]]\nsignal = \"surface_angle_rad\"\nbias = 1", Duplicate, "sensors[1].signal", &["`sensors` has two entries"]),
    ("scale = 2\n[[sensors]]\nsignal = \"surface_angle\"\nbias = 1", UnknownName, "sensors[1].signal", &["nearest: `surface_angle_rad`"]),
    ("scale = 2\n[[actuators]]\nsignal = \"surface_angle_rad\"\nbacklash = 1", UnknownName, "actuators[0].signal", &["`surface_angle_rad` is a measured signal of the plant; use [[sensors]]", "actuator1_valve_current_a"]),
    ("scale = 2\n[[actuators]]\nsignal = \"surface_angel\"\nbacklash = 1", UnknownName, "actuators[0].signal", &["which is not a signal of the plant", "actuator1_valve_current_a"]),
    ("scale = 2\n[[sensors]]\nsignal = \"actuator1_valve_current_a\"\nbias = 1", UnknownName, "sensors[1].signal", &["`actuator1_valve_current_a` is a command of the plant; use [[actuators]]"]),
];

#[test]
fn an_impossible_instrument_is_refused_with_its_place_and_the_alternatives() {
    for (keys, kind, key, fragments) in REFUSED {
        let problem = only(problems(&sensor(keys)));
        assert_eq!(problem.key, *key, "{keys}: {problem}");
        assert_found(&problem, *kind, fragments);
        let excerpt = problem.excerpt.as_ref().unwrap_or_else(|| panic!("{keys}"));
        assert!(excerpt.line > BASE.lines().count(), "{keys}");
    }
}

/// Checks a text against the plants, of which each signal has passed through `alter`, and which measure one more.
fn checked_with(
    text: &str,
    alter: impl Fn(&mut Field),
    further: Option<Field>,
) -> Result<Plan, Problems> {
    let mut plants = descriptions::plants();
    for plant in &mut plants {
        let signals = plant.measured.iter_mut().chain(&mut plant.commands);
        signals.for_each(&alter);
        plant.measured.extend(further.clone());
    }
    let scenario = crate::parse(text).expect("TOML");
    scenario.check(&plants, &descriptions::laws(), &descriptions::kinds())
}

#[test]
fn stages_that_change_the_values_of_an_enumeration_are_refused() {
    let check = |text: &str| {
        let alter = |field: &mut Field| {
            field.is_discrete = [ANGLE, CURRENT].contains(&field.name.as_str());
        };
        checked_with(text, alter, None)
    };
    let keys = "delay_s = 0.01\nrate_hz = 500\nphase_steps = 1";
    check(&sensor(keys)).expect("a delay and a rate keep the values");
    for (keys, reason) in [
        ("noise_sigma = 0.1", "cannot have noise"),
        ("scale = 2", "has no other values"),
        ("bias = 1", "has no other values"),
        ("lag_hz = 10", "has no other values"),
        ("range = [0, 1]", "has no other values"),
        ("resolution = 0.5", "has no other values"),
    ] {
        let text = check(&sensor(keys)).expect_err(keys).to_string();
        let reason = format!("is an enumeration or a Boolean, which {reason}");
        assert!(text.contains(&reason), "{text}");
        assert!(text.contains("`phase_steps` or `delay_s`"), "{text}");
    }
    let actuator = |keys: &str| with(&format!("[[actuators]]\nsignal = \"{CURRENT}\"\n{keys}"));
    check(&actuator("dead_time_s = 0.01")).expect("a dead time keeps the values");
    for key in ["rate_limit_per_s", "lag_hz", "dead_band", "backlash"] {
        let text = check(&actuator(&format!("{key} = 1"))).expect_err(key);
        let text = text.to_string();
        assert!(text.contains("which has no other values"), "{text}");
        assert!(text.contains("`phase_steps` or `dead_time_s`"), "{text}");
    }
}

#[test]
fn two_inputs_of_stages_with_one_column_name_are_refused() {
    let text = sensor(&format!(
        "scale = 2\nbias = 1\n[[sensors]]\nsignal = \"bias_{ANGLE}\"\nscale = 3"
    ));
    let check = |text: &str| {
        let further = Field::signal(&format!("bias_{ANGLE}"), "rad", "x");
        checked_with(text, |_| {}, Some(further))
    };
    let problems = check(&text).expect_err("one column for two signals");
    let problem = only(problems.0);
    assert_eq!(
        (problem.kind, &*problem.key),
        (Duplicate, "sensors[1].signal")
    );
    let message = problem.to_string();
    for name in [
        "sensor.bias.surface_angle_rad",
        "sensor.bias_surface_angle_rad",
    ] {
        assert!(message.contains(&format!("`{name}`")), "{message}");
    }
    check(&text.replace("scale = 2\n", "")).expect("the first stage has the name of its signal");
}

#[test]
fn the_inputs_of_stages_have_the_aliases_of_their_signals() {
    let derived =
        "[[derived]]\nname = \"e\"\nexpression = \"sensor.other.out + sensor.bias.other.out\"";
    let text = format!("{}\n{derived}", sensor("scale = 2\nbias = 1"));
    let alter = |field: &mut Field| {
        if field.name == ANGLE {
            field.aliases = vec!["other.out".into()];
        }
    };
    let plan = checked_with(&text, alter, None);
    let plan = plan.expect("aliases are names");
    let names = [ANGLE.to_owned(), format!("bias.{ANGLE}")];
    assert_eq!(plan.sensors[0].taps, names);
    let Some(DerivedSource::Expression(expression)) = plan.derived.last().map(|one| &one.source)
    else {
        panic!("no expression");
    };
    let signals: Vec<&str> = expression.signals().collect();
    assert_eq!(signals, names.map(|name| format!("sensor.{name}")));
}

#[test]
fn shares_of_other_signals_are_named_with_dots_and_aliases_but_once() {
    let check = |cross: &str| {
        let further = Field {
            aliases: vec!["other".into()],
            ..Field::signal("rig.n", "1", "x")
        };
        let text = sensor(&format!("cross = {cross}"));
        checked_with(&text, |_| {}, Some(further))
    };
    for cross in [
        "{ rig.n = 0.25 }",
        "{ \"rig.n\" = 0.25 }",
        "{ other = 0.25 }",
        "{ rig.n = 0.25, other = 0.25 }",
    ] {
        let plan = check(cross).expect(cross);
        assert_eq!(plan.sensors[0].cross["rig.n"], 0.25);
    }
    let problem = only(
        check("{ rig.n = 0.25, other = 0.5 }")
            .expect_err("two values")
            .0,
    );
    assert_eq!(problem.kind, Duplicate);
    let message = problem.to_string();
    assert!(message.contains("names of one variable"), "{message}");
}

#[test]
fn the_inputs_of_stages_that_a_scenario_names_become_columns() {
    let chain = sensor("noise_sigma = 1e-3\nrate_hz = 500\nbits = 12\nrange = [-1, 1]");
    let named = |more: &str| {
        let plan = plan(&format!("{chain}\n{more}"));
        let (plants, laws) = (descriptions::plants(), descriptions::laws());
        let plant = plan.plant_among(&plants).expect("described");
        let law = plan.law_among(&laws).expect("described");
        let layout = plan.record_layout(&plant, &law);
        let names = layout.sensor.iter().map(|field| {
            assert_eq!(field.unit, "rad");
            field.name.clone()
        });
        assert!(layout.actuator.is_empty());
        names.collect::<Vec<_>>()
    };
    assert!(named("").is_empty());
    let derived = |text: &str| {
        named(&format!(
            "[[derived]]\nname = \"e\"\nexpression = \"{text}\""
        ))
    };
    assert_eq!(derived("2 * sensor.surface_angle_rad"), [ANGLE]);
    // In the order of the chain.
    assert_eq!(
        derived("sensor.range.surface_angle_rad - sensor.rate_hz.surface_angle_rad"),
        ["rate_hz.surface_angle_rad", "range.surface_angle_rad"]
    );
    assert!(derived("sensed.surface_angle_rad").is_empty());
    let plotted = "[[plots]]\ntitle = \"x\"\nsignals = [\"sensor.bits.surface_angle_rad\"]";
    assert_eq!(named(plotted), ["bits.surface_angle_rad"]);
    let found = problems(&format!(
        "{chain}\n[[derived]]\nname = \"e\"\nexpression = \"sensor.lag_hz.surface_angle_rad\""
    ));
    assert_eq!(found[0].kind, ProblemKind::Expression);
    assert!(
        found[0]
            .to_string()
            .contains("sensor.range.surface_angle_rad"),
        "{}",
        found[0]
    );
}

#[test]
fn inputs_of_stages_are_recorded_for_a_pattern_in_addition() {
    let text = sensor(
        "noise_sigma = 1e-3\nrate_hz = 500\n[[actuators]]\nsignal = \"actuator1_valve_current_a\"\nbacklash = 1e-3\nrange = [-1, 1]",
    );
    let mut plan = plan(&text);
    let plants = descriptions::plants();
    let plant = plan.plant_among(&plants).expect("described").clone();
    plan.tap(&plant, |name| name.starts_with("actuator.range"));
    plan.tap(&plant, |name| !name.starts_with("sensor.rate_hz"));
    plan.tap(&plant, |_| false);
    let names = plan.tap_fields(&plant).map(|fields| {
        fields
            .into_iter()
            .map(|field| field.name)
            .collect::<Vec<_>>()
    });
    assert_eq!(names[0], [ANGLE]);
    assert_eq!(names[1], [CURRENT.to_owned(), format!("range.{CURRENT}")]);
}

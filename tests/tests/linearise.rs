//! Linear models of plants, laws and loops: against closed forms, against an independent program with equations of its
//! own, and refused by name where there is none.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::foreign::{compiled, has};
use crate::support::harness::Rig;
use crate::support::programs::workspace;
use crate::support::python::{python, succeeds};

const SPRING_MASS: &str = "scenarios/spring-mass.toml";

/// Linearises and returns the file.
fn linear(rig: &Rig, arguments: &[&str]) -> Value {
    let file = rig.path("model.json");
    let path = file.display().to_string();
    rig.hil(&[&["linearise"], arguments, &["--force", "-o", &path]].concat())
        .expect(0);
    let text = fs::read_to_string(file).expect("a model");
    serde_json::from_str(&text).expect("JSON")
}

fn matrix(value: &Value) -> Vec<Vec<f64>> {
    let rows = value.as_array().expect("a matrix").iter();
    let row = |row: &Value| {
        let row = row.as_array().expect("a row").iter();
        row.map(|number| number.as_f64().expect("a number"))
            .collect()
    };
    rows.map(row).collect()
}

fn names(value: &Value) -> Vec<&str> {
    let all = value.as_array().expect("a list").iter();
    all.map(|one| one["name"].as_str().expect("a name"))
        .collect()
}

#[track_caller]
fn assert_near(actual: &[Vec<f64>], expected: &[&[f64]], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    for (row, expected) in actual.iter().zip(expected) {
        assert_eq!(row.len(), expected.len());
        for (value, expected) in row.iter().zip(*expected) {
            assert!(
                (value - expected).abs() <= tolerance,
                "{actual:?} {expected:?}"
            );
        }
    }
}

#[test]
fn spring_mass_has_the_matrices_of_its_matrix_exponential() {
    let rig = Rig::new();
    let model = linear(&rig, &[SPRING_MASS, "--of", "plant", "--at", "0.7"]);
    // m = 1 kg, c = 2 N s/m, k = 100 N/m, T = 1 ms: exp(A T) in closed form.
    let (t, w) = (1e-3, libm::sqrt(99.0));
    let (e, c, s) = (libm::exp(-t), libm::cos(w * t), libm::sin(w * t) / w);
    let phi = [[e * (c + s), e * s], [-100.0 * e * s, e * (c - s)]];
    let gamma = [(1.0 - phi[0][0]) / 100.0, -phi[1][0] / 100.0];
    let discrete = &model["discrete"];
    // RK4 in 4 substeps, and differences of it.
    assert_near(&matrix(&discrete["A"]), &[&phi[0], &phi[1]], 1e-12);
    assert_near(&matrix(&discrete["B"]), &[&gamma[..1], &gamma[1..]], 1e-14);
    assert_near(&matrix(&discrete["C"]), &[&[1.0, 0.0], &[0.0, 1.0]], 1e-11);
    assert_near(&matrix(&discrete["D"]), &[&[0.0], &[0.0]], 0.0);
    let continuous = &model["continuous"];
    assert_near(
        &matrix(&continuous["A"]),
        &[&[0.0, 1.0], &[-100.0, -2.0]],
        1e-8,
    );
    assert_near(&matrix(&continuous["B"]), &[&[0.0], &[1.0]], 1e-10);
    assert_eq!(names(&model["states"]), ["position_m", "velocity_mps"]);
    assert_eq!(names(&model["inputs"]), ["force_n"]);
    assert_eq!(model["states"][1]["unit"], "m/s");
    assert_eq!(
        (&model["step"], &model["is_stable"]),
        (&700.into(), &true.into())
    );
    for mode in model["eigenvalues"].as_array().expect("a list") {
        // 10 rad/s, damping 0.1.
        let hz = mode["frequency_hz"].as_f64().expect("a number");
        let damping = mode["damping"].as_f64().expect("a number");
        assert!((hz - 10.0 / std::f64::consts::TAU).abs() < 1e-9, "{mode}");
        assert!((damping - 0.1).abs() < 1e-9, "{mode}");
    }
}

/// Scenario of the paper's plant at 10 kHz under `hold`, from this state.
fn paper_plant(point: &Value) -> String {
    let number = |list: &str, place: usize| point[list][place].as_f64().expect("a number");
    let x = |place: usize| number("state", place);
    let value = number("command_a", 0);
    let mut text = format!(
        "schema = 1\nname = \"point\"\n[run]\nduration_s = 1\nrate_hz = 10000\n[plant]\nmodel = \"drhas\"\n\
         substeps = 4\n[plant.parameters]\nsurface.initial_angle_rad = {:?}\nsurface.initial_rate_radps = {:?}\n",
        x(0),
        x(1)
    );
    for actuator in [1, 2] {
        let at = 4 * actuator - 2;
        let leak = number("leakage_coefficient_m3ps_per_sqrt_pa", actuator - 1);
        let keys = [
            ("initial_position_m", x(at)),
            ("initial_velocity_mps", x(at + 1)),
            ("initial_pressure1_ratio", x(at + 2) / 28e6),
            ("initial_pressure2_ratio", x(at + 3) / 28e6),
            ("leakage_coefficient_m3ps_per_sqrt_pa", leak),
        ];
        for (key, value) in keys {
            let _ = writeln!(text, "actuator{actuator}.{key} = {value:?}");
        }
    }
    let _ = write!(
        text,
        "[controller]\nlaw = \"hold\"\n[controller.hold]\nvalue = {value:?}\n"
    );
    text
}

#[test]
fn the_map_of_the_papers_plant_is_that_of_an_independent_program() {
    let golden = workspace().join("tests/golden/plant_maps.json");
    let golden = fs::read_to_string(golden).expect("golden maps");
    let golden: Value = serde_json::from_str(&golden).expect("JSON");
    let rig = Rig::new();
    for point in golden["points"].as_array().expect("a list") {
        let scenario = rig.write("point.toml", &paper_plant(point));
        let scenario = scenario.display().to_string();
        let model = linear(&rig, &[&scenario, "--of", "plant"]);
        let [a, b] = ["A", "B"].map(|name| matrix(&model["discrete"][name]));
        let columns = matrix(&point["columns"]);
        assert_eq!((a.len(), b[0].len(), columns.len()), (10, 2, 12));
        let row = |name: &str| matrix(&Value::Array(vec![point[name].clone()])).remove(0);
        let (x, u) = (row("state"), row("command_a"));
        for (row, (a, b)) in a.iter().zip(&b).enumerate() {
            for (column, value) in a.iter().chain(b).enumerate() {
                let expected = columns[column][row];
                // A derivative whose effect is below the rounding of the state, and of the rod force in it, has no digit
                // to compare; a current cannot be moved across 0, where the valve's other edges open.
                let size = match column {
                    ..10 => x[column].abs(),
                    _ => u[column - 10].abs(),
                };
                let rounding = 3e-14 * x[row].abs() / size;
                let off = (value - expected).abs();
                assert!(
                    off <= 1e-6 * expected.abs() + rounding,
                    "{}: row {row}, column {column}: {value:e} {expected:e}",
                    point["name"]
                );
            }
        }
    }
}

#[test]
fn the_loop_has_the_eigenvalues_of_its_closed_form() {
    let rig = Rig::new();
    let model = linear(&rig, &[SPRING_MASS, "--of", "loop", "--at", "0.6"]);
    // 1 + L(z) = 0 times the denominators, of the plant with a hold and of the law with trapezoid and backward
    // difference: evaluated at each eigenvalue.
    let (t, w) = (1e-3, libm::sqrt(99.0));
    let (e, c, s) = (libm::exp(-t), libm::cos(w * t), libm::sin(w * t) / w);
    let phi = [[e * (c + s), e * s], [-100.0 * e * s, e * (c - s)]];
    let gamma = [(1.0 - phi[0][0]) / 100.0, -phi[1][0] / 100.0];
    let (trace, det) = (phi[0][0] + phi[1][1], e * e);
    let (k_p, k_i, k_d) = (300.0, 2000.0, 30.0);
    type Complex = (f64, f64);
    let mul = |a: Complex, b: Complex| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let poly = |coefficients: &[f64], z: Complex| {
        coefficients.iter().fold((0.0, 0.0), |sum, coefficient| {
            let next = mul(sum, z);
            (next.0 + coefficient, next.1)
        })
    };
    // Position over force: (g_0 z + g_1 phi_01 - g_0 phi_11) / (z^2 - trace z + det).
    let zeros = [gamma[0], gamma[1] * phi[0][1] - gamma[0] * phi[1][1]];
    // Law: k_p + k_i T/2 (z + 1)/(z - 1) + k_d/T (z - 1)/z, over z (z - 1).
    let (i, d) = (k_i * t / 2.0, k_d / t);
    let law = [k_p + i + d, -k_p + i - 2.0 * d, d];
    let modes = model["eigenvalues"].as_array().expect("a list");
    assert_eq!(modes.len(), 4);
    for mode in modes {
        let part = |name: &str| mode[name].as_f64().expect("a number");
        let z = (part("re"), part("im"));
        let open = mul(poly(&[1.0, -trace, det], z), poly(&[1.0, -1.0, 0.0], z));
        let closed = mul(poly(&zeros, z), poly(&law, z));
        let rest = (open.0 + closed.0, open.1 + closed.1);
        assert!(libm::hypot(rest.0, rest.1) < 1e-11, "{mode}: {rest:?}");
    }
    assert_eq!(
        names(&model["states"]),
        [
            "plant.position_m",
            "plant.velocity_mps",
            "law.error_integral_m_s",
            "law.last_error_m"
        ]
    );
    assert_eq!(
        names(&model["inputs"]),
        ["reference.position_m", "disturbance.force_n"]
    );
    assert_eq!(
        names(&model["outputs"]),
        [
            "measured.position_m",
            "measured.velocity_mps",
            "command.force_n"
        ]
    );
    assert_eq!(model["is_stable"], true);
}

#[test]
fn the_law_has_the_matrices_of_its_difference_equation() {
    let rig = Rig::new();
    let model = linear(&rig, &[SPRING_MASS, "--of", "law", "--at", "0.6"]);
    let discrete = &model["discrete"];
    let t = 1e-3;
    // e = r - y: integral' = integral + T/2 (last + e), last' = e.
    assert_near(
        &matrix(&discrete["A"]),
        &[&[1.0, t / 2.0], &[0.0, 0.0]],
        1e-11,
    );
    assert_near(
        &matrix(&discrete["B"]),
        &[&[-t / 2.0, t / 2.0], &[-1.0, 1.0]],
        1e-11,
    );
    let gain = 300.0 + 1.0 + 30_000.0;
    assert_near(&matrix(&discrete["C"]), &[&[2000.0, 1.0 - 30_000.0]], 1e-5);
    assert_near(&matrix(&discrete["D"]), &[&[-gain, gain]], 1e-5);
    assert_eq!(
        names(&model["inputs"]),
        ["measured.position_m", "reference.position_m"]
    );
    // The derivative's memory is a pure delay.
    assert!(model["continuous"].is_null());
    let reason = model["continuous_refused"].as_str().expect("a reason");
    assert!(reason.contains("an eigenvalue of A is 0"), "{reason}");
}

#[test]
fn a_point_without_a_linear_model_is_refused_by_name() {
    let rig = Rig::new();
    // At this current the spool of actuator 1 reaches its stop.
    let changes = [
        "controller.law=hold",
        "controller.hold.value=1",
        "plant.parameters.actuator1.valve_travel_m=3.04e-3",
    ];
    let mut arguments = vec![
        "linearise",
        "scenarios/severe-leakage.toml",
        "--of",
        "plant",
    ];
    arguments.extend(changes.iter().flat_map(|change| ["--set", change]));
    rig.hil(&arguments).expect(1).says(&[
        "no linear model",
        "has a kink at `actuator1_valve_current_a` = 1 A",
        "to the left and 0e0 to the right",
    ]);
    for (change, words) in [
        (
            "controller.command_delay_steps=1",
            "controller.command_delay_steps",
        ),
        ("controller.rate_hz=500", "controller.rate_hz"),
    ] {
        rig.hil(&[
            "linearise",
            SPRING_MASS,
            "--of",
            "loop",
            "--at",
            "1",
            "--set",
            change,
        ])
        .expect(1)
        .says(&[words, "--of plant"]);
    }
    rig.hil(&["linearise", SPRING_MASS, "--of", "plant", "--at", "5"])
        .expect(2)
        .says(&["--at 5 is not in the run, whose last step is at 4.999 s"]);
    rig.hil(&["linearise", SPRING_MASS, "--of", "law"])
        .expect(2)
        .says(&["no past before its first sample", "--at"]);
}

#[test]
fn a_loop_is_refused_while_a_fault_acts_between_plant_and_law() {
    let rig = Rig::new();
    let text = fs::read_to_string(workspace().join(SPRING_MASS)).expect("a scenario");
    let of_loop = |begin: &str, [kind, target, parameter]: [&str; 3]| {
        let fault = format!(
            "\n[[faults]]\nkind = \"{kind}\"\n{begin}\n[[faults.effects]]\ntarget = \"{target}\"\n{parameter}\n"
        );
        let scenario = rig.write("faulty.toml", &(text.clone() + &fault));
        let scenario = scenario.display().to_string();
        rig.hil(&["linearise", &scenario, "--of", "loop", "--at", "0.6"])
    };
    let scale = ["scale", "measured.position_m", "factor = 0.5"];
    for fault in [
        scale,
        ["delay", "command.force_n", "steps = 3"],
        ["dead-band", "command.force_n", "dead_band = 0.1"],
        ["dropout", "measured.position_m", ""],
        ["message-delay", "link.sample", "steps = 2"],
        ["skip", "controller", "steps = 1\nperiod_steps = 10"],
    ] {
        let [kind, target, _] = fault;
        let name = format!("fault 1 ({kind}) acts on {target}, between plant and law");
        of_loop("at_s = 0.1", fault).expect(1).says(&[
            &name,
            "choose an --at",
            "--of plant and --of law",
        ]);
    }
    of_loop("when = \"truth.position_m > 100\"", scale)
        .expect(1)
        .says(&["fault 1 (scale) may act on measured.position_m"]);
    // Before its beginning, after its end, and on the reference, which comes from outside.
    of_loop("at_s = 0.7", scale).expect(0);
    of_loop("at_s = 0.1\nend_s = 0.6", scale).expect(0);
    of_loop("at_s = 0.1\nduration_s = 0.2", scale).expect(0);
    let reference = ["scale", "reference.position_m", "factor = 0.5"];
    of_loop("at_s = 0.1", reference).expect(0);
}

#[test]
fn a_jump_exactly_at_the_point_is_refused_with_the_state_and_the_number_that_moves_it() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let text = fs::read_to_string(workspace().join("examples/c-plant/pendulum.c"));
    // A motor of 25 N m that starts beyond the angle at step 0.
    let kicked = text.expect("the example").replace(
        "+ q->torque_nm) / (m * l * l);",
        "+ q->torque_nm + (x[0] > 0.2 ? 25.0 : 0.0)) / (m * l * l);",
    );
    let source = rig.write("kicked.c", &kicked).display().to_string();
    let plant = compiled(&rig, "cc", &source, "kicked", &[]);
    let plant = plant.display().to_string();
    let scenario = "schema = 1\nname = \"kicked\"\n[run]\nduration_s = 1\nrate_hz = 1000\n[plant]\nmodel = \"pendulum\"\n[controller]\nlaw = \"hold\"\n";
    let scenario = rig.write("kicked.toml", scenario).display().to_string();
    let of = |angle: &str| {
        let set = format!("plant.parameters.initial_angle_rad={angle}");
        let command = [
            "linearise",
            &scenario,
            "--of",
            "plant",
            "--plant-bin",
            &plant,
        ];
        rig.hil(&[&command[..], &["--set", &set]].concat())
    };
    of("0.2")
        .expect(1)
        .says(&["no linear model", "jumps at `angle_rad` = 0.2 rad, by"]);
    of("0.1").expect(0);
}

#[test]
fn a_plant_behind_a_port_is_refused_as_one_that_is_not_simulated() {
    let rig = Rig::new();
    for verb in [&["linearise", "--of", "plant"][..], &["trim"]] {
        let run = rig.hil(&[verb, &["examples/ports/rig.toml"]].concat());
        let run = run
            .expect(1)
            .says(&["plant `spring-mass` is behind a port"]);
        assert!(!run.stderr.contains("StateOf"), "{}", run.stderr);
    }
}

#[test]
fn describe_shows_the_numbers_of_a_state() {
    let rig = Rig::new();
    for (name, parts) in [
        ("spring-mass", ["state: 2", "Position x."]),
        ("ftsc", ["state: 4", "leakage_estimate2_m3ps_per_sqrt_pa"]),
    ] {
        let described = rig.hil(&["describe", name]).expect(0);
        for part in parts {
            assert!(described.stdout.contains(part), "{name}: {part}");
        }
    }
}

#[test]
fn a_plant_in_c_names_its_state_and_one_that_does_not_is_refused() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let source = "examples/c-plant/pendulum.c";
    let named = compiled(&rig, "cc", source, "pendulum", &[]);
    let text = fs::read_to_string(workspace().join(source)).expect("the example");
    let members = [".state = HIL_TABLE(motion), ", ".tell_state = measure, "];
    let without = members
        .iter()
        .fold(text, |text, member| text.replace(member, ""));
    let without = without
        .replace(".take_state = take_state", "")
        .replace(".restore = restore,", ".restore = restore");
    let bytes = rig.write(
        "bytes.c",
        &without.replace("static int take_state", "int take_state"),
    );
    let bytes = compiled(
        &rig,
        "cc",
        &bytes.display().to_string(),
        "bytes",
        &["-Wno-missing-prototypes"],
    );
    let scenario = "schema = 1\nname = \"up\"\n[run]\nduration_s = 1\nrate_hz = 1000\n[plant]\nmodel = \"pendulum\"\n[controller]\nlaw = \"hold\"\n";
    let scenario = rig.write("up.toml", scenario).display().to_string();
    let of = |program: &Path| {
        let program = program.display().to_string();
        rig.hil(&[
            "linearise",
            &scenario,
            "--of",
            "plant",
            "--json",
            "--at",
            "0.002",
            "--plant-bin",
            &program,
        ])
    };
    let result = of(&named).expect(0);
    let model: Value = serde_json::from_str(&result.stdout).expect("JSON");
    assert_eq!(names(&model["states"]), ["angle_rad", "rate_radps"]);
    // m g l sin a - c a' + T with m l^2 = 0.25 kg m2, near 0.2 rad.
    let angle = model["states"][0]["value"].as_f64().expect("a number");
    let expected = [9.80665 / 0.5 * libm::cos(angle), -0.05 / 0.25];
    let a = matrix(&model["continuous"]["A"]);
    // The cosine changes over the period.
    assert!((a[1][0] - expected[0]).abs() < 1e-4, "{a:?} {expected:?}");
    assert!((a[1][1] - expected[1]).abs() < 1e-6, "{a:?} {expected:?}");
    let b = matrix(&model["continuous"]["B"]);
    assert!((b[1][0] - 4.0).abs() < 1e-6, "{b:?}");
    of(&bytes).expect(1).says(&[
        "plant `pendulum` does not name the numbers of its state",
        "no linear model",
    ]);
}

#[test]
fn python_control_opens_the_file_with_two_lines() {
    let Some(python) = python("control, scipy") else {
        eprintln!("skipped: no Python with python-control; HIL_TEST_PYTHON=1 makes one");
        return;
    };
    let rig = Rig::new();
    let file = rig.path("plant.json").display().to_string();
    rig.hil(&["linearise", SPRING_MASS, "--of", "plant", "-o", &file])
        .expect(0);
    let script = workspace().join("tests/python/judge_linear.py");
    succeeds(Command::new(python).arg(script).arg(file));
}

#[test]
fn a_file_on_a_full_disk_is_named() {
    let rig = Rig::new();
    let plant = ["linearise", SPRING_MASS, "--of", "plant", "--at", "1"];
    rig.hil(&[&plant[..], &["-o", "/dev/full"]].concat())
        .expect(3)
        .says(&["cannot write /dev/full", "No space left"]);
}

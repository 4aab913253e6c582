//! Plants and laws in Python: the numbers, the checks and the ends of those in Rust.

mod declarations;
mod mistakes;
mod projects;

use std::path::{Path, PathBuf};

use crate::support::harness::{Rig, Run};
use crate::support::programs::{program, shipped, skip, works};
use crate::support::python::succeeds;

const SPRING_MASS: &str = "examples/python-plant/spring_mass.py";
/// Scenario whose programs are the shipped ones.
const BUILT_IN: &str = "scenarios/spring-mass.toml";

/// Returns `true` if there is an interpreter; otherwise the test is reported as skipped.
fn has_python() -> bool {
    let is_there = works(&["python3", "--version"]);
    if !is_there {
        skip("there is no `python3`", "HIL_TEST_PYTHON");
    }
    is_there
}

/// Writes the plant and the law of the example, with a change of its text.
fn side(rig: &Rig, from: &str, to: &str) -> PathBuf {
    let text = shipped(SPRING_MASS);
    assert!(text.contains(from), "{from}");
    rig.write("side.py", &text.replace(from, to))
}

/// Returns the arguments that run a scenario with both sides of a file.
fn both(scenario: &Path, file: &Path) -> Vec<String> {
    let [scenario, file] = [scenario, file].map(|path| path.display().to_string());
    let flags = ["--plant-bin", "--controller-bin"];
    let programs = flags.map(|flag| format!("{flag}={file}"));
    [vec!["run".into(), scenario], programs.to_vec()].concat()
}

/// Runs a scenario with both sides of a file and further options, in the test's session and folder.
fn run_both(rig: &Rig, scenario: &Path, file: &Path, options: &str) -> Run {
    let [scenario, file] = [scenario, file].map(|path| path.display().to_string());
    rig.run(&format!(
        "{scenario} --plant-bin {file} --controller-bin {file} {options}"
    ))
}

/// Scenario with faults on a signal, on a parameter and on the link, a change of parameters and an instrument.
fn disturbed(rig: &Rig) -> PathBuf {
    let text = shipped(BUILT_IN).replace("duration_s = 5.0", "duration_s = 2.0");
    let text = text
        .split_once("\n[[derived]]")
        .expect("figures")
        .0
        .to_owned();
    let more = r#"
[[changes]]
at_s = 0.4
ramp_s = 0.3
set.plant.parameters.mass_kg = 1.5

[[faults]]
kind = "scale"
at_s = 0.6
effects = [{ target = "parameter.stiffness_n_per_m", factor = 0.5 }]

[[faults]]
kind = "bias"
at_s = 0.8
duration_s = 0.3
effects = [{ target = "measured.position_m", bias = 1e-3 }]

[[faults]]
kind = "message-loss"
at_s = 1.2
duration_s = 0.1
effects = [{ target = "link.sample", probability = 0.5 }]

[[sensors]]
signal = "position_m"
noise_sigma = 1e-5
"#;
    rig.write("disturbed.toml", &format!("{text}{more}"))
}

#[test]
fn a_plant_and_a_law_in_python_have_the_digest_of_those_in_rust() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let expected = rig.run(BUILT_IN).expect(0).digest();
    let run = rig.run("examples/python-plant/spring-mass.toml").expect(0);
    assert_eq!(run.digest(), expected);
    // With a fault that the plant names.
    let breaks = rig.run("scenarios/spring-breaks.toml");
    let file = Path::new(SPRING_MASS);
    let in_python = run_both(&rig, Path::new("scenarios/spring-breaks.toml"), file, "");
    assert_eq!(in_python.digest(), breaks.digest());
    for flag in ["--plant-bin", "--controller-bin"] {
        let run = rig.run(&format!("{BUILT_IN} {flag} {SPRING_MASS}"));
        assert_eq!(run.expect(0).digest(), expected, "{flag}");
    }
    rig.assert_nothing_left();
}

#[test]
fn faults_changes_and_instruments_act_as_on_a_plant_in_rust() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let scenario = disturbed(&rig);
    let in_rust = rig.run(&scenario.display().to_string()).expect(0);
    assert_ne!(in_rust.digest(), rig.run(BUILT_IN).expect(0).digest());
    let in_python = run_both(&rig, &scenario, Path::new(SPRING_MASS), "");
    assert_eq!(in_python.expect(0).digest(), in_rust.digest());
}

#[test]
fn a_run_in_python_resumes_from_a_checkpoint_with_the_digest_of_the_whole() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let scenario = disturbed(&rig);
    let file = Path::new(SPRING_MASS);
    let whole = run_both(&rig, &scenario, file, "--checkpoint-at 1.25").expect(0);
    let checkpoint = whole.folder.join("checkpoint-1250");
    let resumed = rig
        .run(&format!("--from {}", checkpoint.display()))
        .expect(0);
    let summary = whole.summary();
    let check = summary["checkpoints"][0]["check"]["text"].as_str();
    assert_eq!(check, Some("exact for 100 steps"));
    assert_eq!(resumed.digest(), whole.digest());
}

#[test]
fn trim_and_linearise_give_the_numbers_of_the_plant_in_rust() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let program = format!("--plant-bin={SPRING_MASS}");
    for (verb, flag) in [("trim", "--out"), ("linearise", "-o")] {
        let [rust, python] = ["rust", "python"].map(|name| {
            let out = rig.path(&format!("{verb}-{name}")).display().to_string();
            let mut words = vec![verb, BUILT_IN, flag, &out, "--json"];
            words.extend(
                (verb == "linearise")
                    .then_some(["--of", "loop", "--at", "0.7"])
                    .into_iter()
                    .flatten(),
            );
            words.extend((name == "python").then_some(&*program));
            rig.hil(&words).expect(0).stdout.replace(&out, "")
        });
        let numbers = |text: &str| {
            let words = text.split(|c: char| !"0123456789.e-+".contains(c));
            let numbers = words.filter_map(|word| word.parse::<f64>().ok());
            numbers.map(f64::to_bits).collect::<Vec<u64>>()
        };
        assert!(!numbers(&rust).is_empty(), "{verb}");
        assert_eq!(numbers(&python), numbers(&rust), "{verb}");
    }
}

#[test]
fn the_functions_of_hil_math_have_the_bits_of_those_of_plants_in_rust() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let xs = [0.1, 0.7, 1.3, 2.5, 1e-9, 37.25, 1e5];
    let script = "import sys; sys.path.insert(0, 'tools/python'); import hil.math as m\n\
        for x in map(float, sys.argv[1:]):\n    \
        print(*[v.hex() for v in (m.sin(x), m.cos(x), m.tan(x), m.exp(-x), m.log(x), m.pow(x, 0.3), m.tanh(x), m.atan2(x, 2.0), m.hypot(x, 3.0))])\n\
        print(m.sqrt(-1.0), m.log(0.0), m.exp(1e4))";
    let mut python = rig.command("python3");
    python.env("HIL_BIN", program("hil")).args(["-c", script]);
    let text = succeeds(python.args(xs.map(|x| format!("{x:?}"))));
    let lines: Vec<&str> = text.lines().collect();
    for (line, x) in lines.iter().zip(xs) {
        let expected = [
            libm::sin(x),
            libm::cos(x),
            libm::tan(x),
            libm::exp(-x),
            libm::log(x),
            libm::pow(x, 0.3),
            libm::tanh(x),
            libm::atan2(x, 2.0),
            libm::hypot(x, 3.0),
        ];
        let words: Vec<u64> = line.split(' ').map(bits).collect();
        assert_eq!(words, expected.map(f64::to_bits), "{x}");
    }
    assert_eq!(lines.last(), Some(&"nan -inf inf"));
}

/// Returns the bits of a number as Python's `float.hex` writes it.
fn bits(word: &str) -> u64 {
    let (sign, word) = word
        .strip_prefix('-')
        .map_or((1.0, word), |rest| (-1.0, rest));
    let (digits, exponent) = word.split_once('p').expect("an exponent");
    let digits = digits
        .strip_prefix("0x")
        .expect("a prefix")
        .replace('.', "");
    // One digit before the point, thirteen behind it.
    let mantissa = u64::from_str_radix(&format!("{digits:0<14}"), 16).expect("digits");
    let exponent: i32 = exponent.parse().expect("an exponent");
    (sign * libm::ldexp(mantissa as f64, exponent - 52)).to_bits()
}

#[test]
fn a_running_plant_and_law_take_changes_and_a_rerun_repeats_them() {
    if !has_python() {
        return;
    }
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{BUILT_IN} --plant-bin {SPRING_MASS} --controller-bin {SPRING_MASS} --pause-at 2.5 --wait-limit 60"
    ));
    rig.until_held_at(2500);
    let change = "set controller.pid.proportional_n_per_m=400 plant.parameters.mass_kg=1.2";
    rig.in_session(change).expect(0);
    let wrong = rig
        .in_session("set controller.pid.proportional=400")
        .expect(2);
    assert!(
        wrong.stderr.contains("proportional_n_per_m"),
        "{}",
        wrong.stderr
    );
    rig.in_session("inject scale parameter.stiffness_n_per_m 0.5")
        .expect(0);
    rig.in_session("resume").expect(0);
    let run = running.finish();
    let digest = run.digest();
    assert_ne!(digest, rig.run(BUILT_IN).expect(0).digest());
    let again = rig.rerun(&run.folder, &[]);
    assert!(
        again.stdout.contains(&digest),
        "{}{}",
        again.stdout,
        again.stderr
    );
}

//! Sobol' indices of a campaign, against SALib.

use std::process::Command;

use serde_json::Value;
use shared_types::number::short;

use super::{planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

/// Study of three values, of which stiffness matters most to a slow integral.
const STUDY: &str = r#"
schema = 1
scenario = "SCENARIO"
cases = 32
seed = 5
sampling = "saltelli"
set = ["controller.pid.integral_n_per_m_s=300"]

[[vary]]
key = "plant.parameters.mass_kg"
kind = "uniform"
min = 0.8
max = 1.2

[[vary]]
key = "plant.parameters.stiffness_n_per_m"
kind = "uniform"
min = 80
max = 120

[[vary]]
key = "plant.parameters.damping_n_s_per_m"
kind = "normal"
mean = 2.0
deviation = 0.2
min = 1.0
max = 3.0
"#;

/// Names of the varied values.
const NAMES: [&str; 3] = ["mass_kg", "stiffness_n_per_m", "damping_n_s_per_m"];

fn numbers(requirement: &Value, key: &str) -> Vec<f64> {
    let indices = requirement["indices"].as_array().expect("a list");
    let names: Vec<&str> = { indices.iter() }
        .filter_map(|one| one["name"].as_str())
        .collect();
    assert_eq!(names, NAMES, "{requirement}");
    let number = |one: &Value| one[key].as_f64().expect("a number");
    indices.iter().map(number).collect()
}

#[test]
fn the_indices_of_a_margin_are_shown_and_grow_with_the_campaign() {
    let rig = Rig::new();
    let folder = planned(&rig, &study(&rig, STUDY), "indices");
    folder.on("run").expect(0).prints(&[
        "160 cases, 160 draws (saltelli)",
        "stiffness_n_per_m explains",
        "of the variance alone",
        "with its interactions",
    ]);
    let few = folder.on("show --json").expect(0).json();
    let page = rig.path("page.html");
    rig.hil(&["report", text(&folder), "-o", page.to_str().expect("plain")])
        .expect(0);
    let page = std::fs::read_to_string(page).expect("a page");
    for index in few["variants"][0]["requirements"][0]["indices"]
        .as_array()
        .expect("a list")
    {
        for key in ["first", "total"] {
            let value = |key: &str| index[key].as_f64().expect("a number");
            let within = value(&format!("{key}_within"));
            let cell = format!(
                "{} <span class=\"hint\">({} to {})</span>",
                short(value(key)),
                short(value(key) - within),
                short(value(key) + within)
            );
            assert!(page.contains(&cell), "{cell}");
        }
    }
    folder
        .on("grow --cases 31")
        .expect(2)
        .says(&["already has 32 rows"]);
    folder.on("grow --cases 64").expect(0);
    folder.on("run").expect(0);
    let many = folder.on("show --json").expect(0).json();
    assert_eq!((&many["draws"], &few["draws"]), (&320.into(), &160.into()));
    let within = |answers: &Value| {
        let requirement = &answers["variants"][0]["requirements"][0];
        numbers(requirement, "total_within")
            .into_iter()
            .sum::<f64>()
    };
    assert!(within(&many) < within(&few), "{many}");
    let straight = STUDY.replace("cases = 32", "cases = 64");
    let straight = planned(&rig, &study(&rig, &straight), "straight");
    straight.on("run").expect(0);
    assert_eq!(straight.digest(), folder.digest());
}

#[test]
fn salib_computes_the_same_indices() {
    let Some(python) = python("SALib, polars, numpy") else {
        return skip(
            "python3 with SALib, polars and numpy is missing",
            "HIL_TEST_PYTHON",
        );
    };
    let rig = Rig::new();
    let folder = planned(&rig, &study(&rig, STUDY), "indices");
    let answers = folder.on("run --json").expect(0).json();
    let script = workspace().join("tests/python/sobol_indices.py");
    let mut salib = Command::new(python);
    let output = succeeds(salib.arg(script).arg(text(&folder)).args(NAMES));
    let salib: Value = serde_json::from_str(&output).expect("JSON");
    let requirement = &answers["variants"][0]["requirements"][0];
    for (key, of_salib) in [("first", "S1"), ("total", "ST")] {
        let expected = salib[of_salib].as_array().expect("a list");
        for (value, expected) in numbers(requirement, key).into_iter().zip(expected) {
            let expected = expected.as_f64().expect("a number");
            assert!((value - expected).abs() < 1e-9, "{key}: {answers}\n{salib}");
        }
        // Both resample 32 rows at random, so the widths of the intervals agree only roughly.
        let expected = salib[format!("{of_salib}_conf")]
            .as_array()
            .expect("a list");
        let widths = numbers(requirement, &format!("{key}_within"));
        for (value, expected) in widths.into_iter().zip(expected) {
            let expected = expected.as_f64().expect("a number");
            assert!(
                value < 2.0 * expected + 1e-3 && value > expected / 2.0 - 1e-3,
                "{key}: {answers}\n{salib}"
            );
        }
    }
}

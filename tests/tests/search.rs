//! Searches: the smallest fault that breaks a requirement, and the worst case, against closed forms and the paper's run.

mod judges;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::Value;

use crate::support::harness::{Rig, Run, text, until};
use crate::support::programs::{program, shipped, workspace};

/// Requirement that holds while the measured position is wrong by less than 10 mm: a bias of 10 mm breaks it.
const TRUSTS: &str = "always(abs(measured.position_m - truth.position_m) < 0.01)";

/// Search for the size of one bias from 0 to 30 mm.
const ONE: &str =
    "\n[[vary]]\nkey = \"faults[0].effects[0].bias\"\nkind = \"uniform\"\nmin = 0.0\nmax = 0.03\n";
/// Search for the sizes of two biases, each from 0 to 20 mm.
const TWO: &str = r#"
[[vary]]
name = "a"
key = "faults[0].effects[0].bias"
kind = "uniform"
min = 0.0
max = 0.02
[[vary]]
name = "b"
key = "faults[1].effects[0].bias"
kind = "uniform"
min = 0.0
max = 0.02
"#;

/// Writes a scenario of the spring with two biases of its sensor and one requirement, and a study of it.
fn study(rig: &Rig, formula: &str, duration_s: f64, study: &str) -> PathBuf {
    let bias = "[[faults]]\nkind = \"bias\"\nat_s = 0.1\n[[faults.effects]]\ntarget = \"measured.position_m\"\nbias = 0.0\n";
    let scenario = format!(
        "schema = 1\n[run]\nduration_s = {duration_s}\nrate_hz = 1000\n[plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"hold\"\n\
         {bias}{bias}[[requirements]]\nname = \"trusts\"\nformula = \"{formula}\"\n"
    );
    rig.write("scenario.toml", &scenario);
    let search = if study.contains("[search]") {
        ""
    } else {
        "[search]\n"
    };
    let text = format!("schema = 1\nscenario = \"scenario.toml\"\n{study}{search}");
    rig.write("study.toml", &text)
}

fn search(rig: &Rig, kind: &str, study: &Path, folder: &str) -> Run {
    let folder = rig.path(folder);
    rig.hil(&["search", kind, text(study), "-o", text(&folder), "--json"])
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

/// Returns the exit code of a scenario that the search wrote.
fn code(rig: &Rig, path: &Value) -> Option<i32> {
    let path = path.as_str().expect("a path");
    rig.hil(&["run", path, "--no-record"]).code
}

#[test]
fn the_papers_leakage_may_grow_by_nine_to_ten_percent_and_no_more() {
    let rig = Rig::new();
    let study = workspace().join("studies/leakage-margin.toml");
    let result = search(&rig, "smallest", &study, "out").expect(0).json();
    let [passes, fails] = ["passes", "fails"].map(|key| number(&result[key]));
    // By nine runs of bisection by hand.
    assert!(passes >= 1.093 && fails <= 1.102, "{result}");
    assert!(fails - passes <= 0.01, "{result}");
    assert_eq!(result["requirement"], "transient_force_fight");
    assert!(number(&result["runs"]) <= 12.0, "{result}");
    assert_eq!(code(&rig, &result["scenario"]), Some(1));
    assert_eq!(code(&rig, &result["neighbour"]), Some(0));
}

#[test]
fn one_bias_breaks_the_requirement_at_its_limit() {
    let rig = Rig::new();
    let study = study(
        &rig,
        TRUSTS,
        1.0,
        &format!("{ONE}[search]\ntolerance = 1e-6\n"),
    );
    let result = search(&rig, "smallest", &study, "out").expect(0).json();
    let [passes, fails] = ["passes", "fails"].map(|key| number(&result[key]));
    assert!(passes < 0.01 && 0.01 <= fails, "{result}");
    assert!(fails - passes <= 0.03 * 1e-6, "{result}");
    assert!(number(&result["margin"]) <= 0.0 && number(&result["neighbour_margin"]) > 0.0);
}

#[test]
fn a_nominal_value_inside_the_range_is_left_in_both_directions() {
    let rig = Rig::new();
    // From 4 mm the lower limit is 14 mm away, and the upper one 6 mm.
    let range = ONE.replace("min = 0.0", "min = -0.03\nnominal = 0.004");
    let both = study(&rig, TRUSTS, 1.0, &range);
    let result = search(&rig, "smallest", &both, "up").expect(0).json();
    assert!((number(&result["fails"]) - 0.01).abs() < 1e-3, "{result}");
    let range = range.replace("nominal = 0.004", "nominal = -0.004");
    let both = study(&rig, TRUSTS, 1.0, &range);
    let result = search(&rig, "smallest", &both, "down").expect(0).json();
    assert!((number(&result["fails"]) + 0.01).abs() < 1e-3, "{result}");
}

#[test]
fn the_nearest_failing_point_of_two_biases_has_half_the_limit_in_each() {
    let rig = Rig::new();
    let study = study(&rig, TRUSTS, 1.0, TWO);
    let result = search(&rig, "smallest", &study, "out").expect(0).json();
    // The nearest point of a + b = 0.01 to the origin, in units of the ranges.
    let expected = 0.005 / 0.02 * 2.0_f64.sqrt();
    assert!(
        (number(&result["fails"]) - expected).abs() < 0.01,
        "{result}"
    );
    assert!(
        (number(&result["at"]["a"]) - 0.005).abs() < 5e-4,
        "{result}"
    );
    assert!(
        (number(&result["at"]["b"]) - 0.005).abs() < 5e-4,
        "{result}"
    );
    assert_eq!(code(&rig, &result["scenario"]), Some(1));
    assert_eq!(code(&rig, &result["neighbour"]), Some(0));
}

#[test]
fn the_worst_case_of_a_box_is_the_corner_with_both_biases() {
    let rig = Rig::new();
    let corner = study(&rig, TRUSTS, 1.0, TWO);
    let result = search(&rig, "worst", &corner, "corner").expect(1).json();
    assert_eq!(
        (number(&result["at"]["a"]), number(&result["at"]["b"])),
        (0.02, 0.02)
    );
    assert!((number(&result["margin"]) + 0.03).abs() < 1e-9, "{result}");
    assert_eq!(code(&rig, &result["scenario"]), Some(1));
    // Inside of the box: the error is worst where the biases add up to 12 mm.
    let formula = "always(abs(measured.position_m - truth.position_m - 0.012) > -1)";
    let inside = study(&rig, formula, 1.0, TWO);
    let result = search(&rig, "worst", &inside, "inside").expect(0).json();
    let sum = number(&result["at"]["a"]) + number(&result["at"]["b"]);
    assert!((sum - 0.012).abs() < 5e-4, "{result}");
    assert!(number(&result["margin"]) - 1.0 < 5e-4, "{result}");
}

#[test]
fn a_narrow_valley_beside_a_wide_one_is_found() {
    let rig = Rig::new();
    // Biases of 10 mm together leave 1 mm; those of 35 mm, near a corner, are worse by 5 mm in a tenth of the width.
    let error = "measured.position_m - truth.position_m";
    let formula =
        format!("always(abs({error} - 0.01) > -0.001 and 10 * abs({error} - 0.035) > 0.004)");
    let range = TWO.to_owned() + "[search]\nruns = 1000\n";
    let valleys = study(&rig, &formula, 1.0, &range);
    let worst = search(&rig, "worst", &valleys, "worst").expect(1).json();
    let sum = number(&worst["at"]["a"]) + number(&worst["at"]["b"]);
    assert!((sum - 0.035).abs() < 5e-5, "{worst}");
    assert!((number(&worst["margin"]) + 0.004).abs() < 5e-4, "{worst}");
    // Failures begin at 34.6 mm, half of it in each.
    let least = search(&rig, "smallest", &valleys, "least").expect(0).json();
    let expected = 0.0173 / 0.02 * 2.0_f64.sqrt();
    assert!((number(&least["fails"]) - expected).abs() < 0.01, "{least}");
}

#[test]
fn an_empty_search_says_what_was_tried_and_what_to_do() {
    let rig = Rig::new();
    let far = ONE.replace("max = 0.03", "max = 0.009");
    let started = ONE.replace("min = 0.0", "min = 0.02");
    let island = "always(abs(measured.position_m - truth.position_m - 0.012) > 0.005)";
    let infinite = "always(-1 / (truth.position_m - truth.position_m) < 1)";
    let few = ONE.to_owned() + "[search]\nprobes = 3\nruns = 5\n";
    let never = ONE.replace("bias\"", "bias\"\nname = \"size\"") + "[search]\nprobes = 0\n";
    #[rustfmt::skip] // a table
    let rows: [(&str, &str, &str, &str, &[&str]); 7] = [
        ("smallest", "far", TRUSTS, &far, &["none of 5 runs in bias 0 to 0.009 fails", "nearest to failing is bias 0.009", "widen the range", "tried"]),
        ("smallest", "started", TRUSTS, &started, &["the nominal case already fails", "margin -0.01 m at bias 0.02", "move `nominal` or `min`"]),
        ("smallest", "island", island, ONE, &["not monotone", "bias 0.0225", "raise `probes`", "fails.toml"]),
        ("smallest", "unreached", "always(abs(truth.velocity_mps) < 1)", ONE, &["`trusts` has the same margin", "whatever bias is", "either no signal of its formula is reached"]),
        ("smallest", "few", TRUSTS, &few, &["bias 0.015 breaks trusts, bias 0.0075 does not", "the 5 runs allowed ended while the neighbours were 25 % of the ranges apart", "raise `runs`"]),
        ("worst", "infinite", infinite, TWO, &["no finite margin (NaN or infinite)", "nothing says which way failures lie"]),
        ("smallest", "unprobed", "always(abs(truth.position_m) < 1)", &never, &["`trusts` has the same margin in all 2 runs, whatever size is"]),
    ];
    for (kind, name, formula, ranges, messages) in rows {
        let study = study(&rig, formula, 1.0, ranges);
        let folder = rig.path(name);
        let arguments = ["search", kind, text(&study), "-o", text(&folder)];
        rig.hil(&arguments).expect(1).prints(messages);
        let json = search(&rig, kind, &study, name).expect(1).json();
        assert!(json["reason"].is_string(), "{name}: {json}");
        assert!(!json["tried"].as_array().expect("a list").is_empty());
    }
}

#[test]
fn an_expression_that_is_equal_at_both_ends_has_an_effect_between() {
    let rig = Rig::new();
    let peak = "\n[[vary]]\nname = \"f\"\nkind = \"uniform\"\nmin = 0.0\nmax = 4.0\n\
                [[vary]]\nkey = \"faults[0].effects[0].bias\"\nkind = \"expression\"\n\
                expression = \"0.001 + 0.012 * max(0, 1 - abs(f - 2))\"\n";
    let study = study(&rig, TRUSTS, 1.0, peak);
    let result = search(&rig, "worst", &study, "peak").expect(1).json();
    // The bias is largest at f = 2: 13 mm, of which 10 mm are allowed.
    assert!((number(&result["at"]["f"]) - 2.0).abs() < 0.01, "{result}");
    assert!((number(&result["margin"]) + 0.003).abs() < 1e-4, "{result}");
}

#[test]
fn what_cannot_be_searched_is_refused_at_its_place_before_any_run() {
    let rig = Rig::new();
    let onset = ONE
        .replace("faults[0].effects[0].bias", "faults[0].at_s")
        .replace("max = 0.03", "max = 1e9");
    let list =
        "\n[[vary]]\nkey = \"faults[0].effects[0].bias\"\nkind = \"list\"\nvalues = [0.0, 1.0]\n";
    let unused = ONE.replace(
        "faults[0].effects[0].bias",
        "controller.pid.integral_n_per_m_s",
    );
    let variants = format!("{ONE}[[variants]]\nname = \"one\"\n[[variants]]\nname = \"two\"\n");
    let other = format!("{ONE}[search]\nrequirement = \"trust\"\n");
    let rows: [(&str, &[&str]); 6] = [
        (
            &onset,
            &[
                "the run is already over at 1e9 s",
                "study.toml:5",
                "in the case at_s 1e9",
            ],
        ),
        (list, &["`bias` has no range", "make it uniform"]),
        (&unused, &["study.toml:5", "has no effect"]),
        (&variants, &["several variants", "one, two"]),
        (
            &other,
            &["no requirement `trust`", "its requirements: trusts"],
        ),
        ("", &["nothing varies"]),
    ];
    for (ranges, messages) in rows {
        let study = study(&rig, TRUSTS, 1.0, ranges);
        for kind in ["smallest", "worst"] {
            let refused = search(&rig, kind, &study, "refused").expect(2);
            for message in messages {
                assert!(
                    refused.stderr.contains(message),
                    "{message}\n{}",
                    refused.stderr
                );
            }
        }
        let left = fs::read_dir(rig.path("refused")).map_or(0, Iterator::count);
        assert_eq!(left, 0, "{ranges}");
    }
    rig.hil(&["search", "smallest", "no.toml"]).expect(2);
    let scenario = workspace().join("scenarios/spring-mass.toml");
    rig.hil(&["search", "smallest", text(&scenario)])
        .expect(2)
        .says(&["is a scenario and not a study"]);
}

#[test]
fn a_case_without_a_verdict_ends_the_search_with_the_reason() {
    let rig = Rig::new();
    // The run diverges where the bias is large, which is a failure even of a requirement that was not decided.
    let formula = "always(abs(measured.position_m - truth.position_m) < 1)";
    let mut scenario = shipped("scenarios/spring-mass.toml");
    scenario.truncate(scenario.find("[[requirements]]").expect("requirements"));
    scenario += "[plant.limits]\nposition_m = [-1.0, 0.02]\n[[faults]]\nkind = \"bias\"\nat_s = 1.0\n[[faults.effects]]\ntarget = \"measured.position_m\"\nbias = 0.0\n";
    scenario += &format!("[[requirements]]\nname = \"trusts\"\nformula = \"{formula}\"\n");
    rig.write("limited.toml", &scenario);
    let range = ONE
        .replace("min = 0.0", "min = -0.5\nnominal = 0")
        .replace("0.03", "0");
    let study = rig.write(
        "limited-study.toml",
        &format!("schema = 1\nscenario = \"limited.toml\"\n{range}[search]\n"),
    );
    let result = search(&rig, "smallest", &study, "out").expect(0).json();
    let mut trials = result["tried"].as_array().expect("a list").iter();
    assert!(trials.any(|one| one["class"] == "diverged"), "{result}");
    assert_eq!(result["margin"], "-inf", "{result}");
    assert_eq!(code(&rig, &result["scenario"]), Some(1));
}

#[test]
fn an_interrupted_search_continues_and_gives_the_same_answer() {
    let rig = Rig::new();
    let study = study(&rig, TRUSTS, 30.0, &format!("{ONE}[search]\nprobes = 60\n"));
    let straight = search(&rig, "smallest", &study, "straight")
        .expect(0)
        .json();
    let folder = rig.path("broken");
    let arguments = [
        "search",
        "smallest",
        text(&study),
        "-o",
        text(&folder),
        "--json",
    ];
    // A row may be in two journals, until the first one is removed.
    let rows = || -> usize {
        let journals = fs::read_dir(&folder).into_iter().flatten().flatten();
        let texts = journals.filter_map(|entry| fs::read_to_string(entry.path()).ok());
        let mut cases = BTreeSet::new();
        for text in texts {
            let rows = text.split("\"cells\":[").skip(1);
            cases.extend(rows.filter_map(|row| Some(row.split_once(',')?.0.to_owned())));
        }
        cases.len()
    };
    let mut before = 0;
    for signal in [Signal::INT, Signal::KILL] {
        let running = rig.start_hil(&arguments);
        until("two more runs are over", || rows() >= before + 2);
        running.signal(signal);
        let ended = running.finish();
        if signal == Signal::INT {
            ended
                .expect(130)
                .says(&["interrupted", "the same command continues"]);
        }
        before = rows();
    }
    let continued = rig.hil(&arguments).expect(0).json();
    for key in ["passes", "fails", "runs", "tried"] {
        assert_eq!(continued[key], straight[key], "{key}");
    }
    let journals = fs::read_dir(&folder).expect("a folder").flatten();
    let texts = journals.filter_map(|entry| fs::read_to_string(entry.path()).ok());
    let kept: usize = texts.map(|text| text.matches("\"by\"").count()).sum();
    assert!(kept >= before, "{kept} of {before} rows were kept");
}

#[test]
fn external_programs_give_the_digests_of_one_process() {
    let rig = Rig::new();
    let study = study(&rig, TRUSTS, 0.2, ONE);
    let inside = search(&rig, "smallest", &study, "inside").expect(0).json();
    let [plant, controller] = ["plant-process", "controller-process"].map(program);
    let folder = rig.path("outside");
    let outside = rig.hil(&[
        "search",
        "smallest",
        text(&study),
        "--plant-bin",
        text(&plant),
        "--controller-bin",
        text(&controller),
        "-o",
        text(&folder),
        "--json",
    ]);
    assert_eq!(outside.expect(0).json()["tried"], inside["tried"]);
    assert!(rig.processes().is_empty(), "{:?}", rig.processes());
}

#[test]
fn a_requirement_whose_value_is_no_number_is_named_as_such() {
    let rig = Rig::new();
    let of_nan = "always(sqrt(truth.position_m - 1) < 1)";
    let study = study(&rig, of_nan, 0.5, ONE);
    let folder = rig.path("nan");
    let run = rig.hil(&["search", "smallest", text(&study), "-o", text(&folder)]);
    run.expect(1).prints(&[
        "the nominal case already fails: `trusts` fails without a margin, because a value in its formula is missing or no number",
    ]);
}

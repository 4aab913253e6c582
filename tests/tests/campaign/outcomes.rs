//! The table of faults by outcomes: rows with figures from hand calculations, refusals, and the same rows however the
//! workers end.

use serde_json::{Value, json};

use super::{Planned, campaign, planned, study, text};
use crate::support::harness::Rig;
use crate::support::python::{python, succeeds};

/// The mass that `hold` leaves alone stays at 0, so everything about these faults follows by hand.
const FAULTS: &str = r#"
schema = 1
scenario = "SCENARIO"

[[variants]]
name = "hold"
set = ["controller.law=hold"]

[[variants]]
name = "deaf"
set = ["controller.law=hold"]
detected = "none"

[faults]
onsets_s = [2.0, 2.5]
detected = "measured.position_m > 0.05"
held_s = 0.01
recovered = "measured.position_m < 0.05"

[[faults.kinds]]
kind = "bias"
targets = ["measured.position_m"]
sizes = ["bias = 0.1", "bias = 0.01"]
duration_s = 0.5

[[faults.kinds]]
kind = "message-loss"
sizes = ["probability = 0"]
onsets_s = [1.0]
"#;

fn rows(planned: &Planned<'_>) -> Vec<Value> {
    let answers = planned.on("show --json").expect(0).json();
    answers["faults"].as_array().expect("a list").clone()
}

#[test]
fn each_fault_is_a_row_of_every_variant_with_margin_detection_and_recovery() {
    let rig = Rig::new();
    let planned = planned(&rig, &study(&rig, FAULTS), "faults");
    planned.on("run").expect(0).prints(&[
        "fault",
        "worst margin",
        "recovered after [s]",
        "settles -0.0098 m",
        "not tried",
        "hil campaign case",
    ]);
    let rows = rows(&planned);
    // Two sizes at two onsets and two directions of the link, in two variants.
    let tried: Vec<&Value> = rows.iter().filter(|row| row["case"].is_u64()).collect();
    assert_eq!(tried.len(), (2 * 2 + 2) * 2);
    let expected = [
        ("bias = 0.1", 2.0, "hold", json!(0.01), json!(0.5)),
        ("bias = 0.1", 2.0, "deaf", Value::Null, json!(0.5)),
        ("bias = 0.1", 2.5, "hold", json!(0.01), json!(0.5)),
        ("bias = 0.1", 2.5, "deaf", Value::Null, json!(0.5)),
        ("bias = 0.01", 2.0, "hold", Value::Null, json!(0.0)),
        ("bias = 0.01", 2.0, "deaf", Value::Null, json!(0.0)),
    ];
    for (row, (size, onset_s, variant, detected, recovered)) in tried.iter().zip(expected) {
        assert_eq!(row["kind"], "bias", "{row}");
        assert_eq!(row["target"], "measured.position_m", "{row}");
        assert_eq!(
            (&row["size"], &row["variant"]),
            (&json!(size), &json!(variant))
        );
        assert_eq!(row["onset_s"], json!(onset_s), "{row}");
        assert_eq!(row["detected_after_s"], detected, "{row}");
        assert_eq!(row["recovered_after_s"], recovered, "{row}");
        // The mass is 0.01 m from its target; 0.2 mm would be near enough.
        assert_eq!(
            (&row["outcome"], &row["requirement"]),
            (&json!("fail"), &json!("settles"))
        );
        let margin = row["margin"].as_f64().expect("a number");
        assert!((margin - (2e-4 - 0.01)).abs() < 1e-12, "{row}");
    }
    assert_eq!(tried[8]["target"], "link.sample");
    assert_eq!(tried[10]["target"], "link.command");
    // Kinds and targets that nobody tried are rows, not omissions.
    let untried = |kind: &str| {
        let mut untried = rows.iter().filter(|row| row["outcome"] == "not-tried");
        untried.find(|row| row["kind"] == kind).cloned()
    };
    let bias = untried("bias").expect("a row");
    assert_eq!(
        (&bias["case"], &bias["command"]),
        (&Value::Null, &json!(""))
    );
    let names = bias["targets"].as_array().expect("a list");
    assert!(names.contains(&json!("command.force_n")), "{bias}");
    assert!(!names.contains(&json!("measured.position_m")), "{bias}");
    let late = untried("late").expect("a row");
    assert_eq!(late["target"], "controller, plant");
    assert!(untried("message-loss").is_none());
}

#[test]
fn the_command_of_a_row_repeats_its_run() {
    let rig = Rig::new();
    let planned = planned(&rig, &study(&rig, FAULTS), "faults");
    planned.on("run").expect(0);
    let rows = rows(&planned);
    let command = format!("hil campaign case {} 2", text(&planned));
    assert_eq!(rows[2]["command"], command);
    let out = rig.path("again");
    campaign(&rig, &["case", text(&planned), "2", "--out", text(&out)])
        .expect(1)
        .says(&["case 2 reproduced the campaign's digest"]);
    // The shown scenario is one that hil run takes, with the fault in it.
    let case = planned.on("case 2 --show").expect(0);
    let scenario = rig.write("case.toml", &case.stdout);
    let alone = rig.run(text(&scenario)).expect(1);
    let row = |number: usize| {
        let table = rig.hil(&[
            "campaign",
            "case",
            text(&planned),
            &number.to_string(),
            "--json",
            "--in-process",
            "--out",
            text(&rig.path(&format!("in{number}"))),
        ]);
        table.expect(1).json()["digest"].clone()
    };
    assert_eq!(row(2), json!(alone.digest()));
    assert_ne!(row(8), json!(alone.digest()));
}

#[test]
fn the_exported_tables_have_the_rows_of_the_shown_one() {
    let rig = Rig::new();
    let planned = planned(&rig, &study(&rig, FAULTS), "faults");
    planned.on("run").expect(0);
    let rows = rows(&planned);
    let script = "import csv, json, sys; print(json.dumps(list(csv.DictReader(open(sys.argv[1], newline='')))))";
    let read = |python: &std::path::Path, script: &str, name: &str| {
        let mut command = rig.command(python);
        let text = succeeds(command.args(["-c", script]).arg(planned.join(name)));
        let table: Vec<Value> = serde_json::from_str(&text).expect("JSON");
        table
    };
    let csv = read("python3".as_ref(), script, "faults.csv");
    assert_eq!(csv.len(), rows.len());
    for (cells, row) in csv.iter().zip(&rows) {
        for key in [
            "kind",
            "target",
            "size",
            "variant",
            "outcome",
            "requirement",
            "command",
        ] {
            assert_eq!(cells[key], row[key], "{key} of {row}");
        }
        let number = |key: &str| cells[key].as_str().expect("a text").parse().ok();
        for key in [
            "onset_s",
            "margin",
            "detected_after_s",
            "recovered_after_s",
            "case",
        ] {
            assert_eq!(number(key), row[key].as_f64(), "{key} of {row}");
        }
    }
    let page = rig.path("page.html");
    rig.hil(&["report", text(&planned), "-o", text(&page)])
        .expect(0);
    let page = std::fs::read_to_string(page).expect("written");
    assert!(page.contains("Faults and their outcomes") && page.contains("not tried"));
    let Some(python) = python("polars") else {
        return;
    };
    let script =
        "import polars, sys; print(polars.read_parquet(sys.argv[1]).fill_nan(None).write_json())";
    let parquet = read(&python, script, "faults.parquet");
    assert_eq!(parquet.len(), rows.len());
    for (cells, row) in parquet.iter().zip(&rows) {
        for key in ["kind", "outcome", "margin", "recovered_after_s"] {
            assert_eq!(cells[key], row[key], "{key} of {row}");
        }
    }
}

#[test]
fn shards_and_stopped_workers_give_the_rows_of_one_worker() {
    let rig = Rig::new();
    let study = study(&rig, FAULTS);
    let whole = planned(&rig, &study, "whole");
    whole.on("run --jobs 1").expect(0);
    let parts = planned(&rig, &study, "parts");
    parts.on("work --shards 1,5").expect(0);
    let running = rig.start_hil(&["campaign", "run", text(&parts), "--jobs", "2"]);
    running.signal(rustix::process::Signal::INT);
    running.finish_beside_another();
    parts.on("run --jobs 2").expect(0);
    assert_eq!(parts.digest(), whole.digest());
    let without_folder = |planned: &Planned<'_>| {
        let rows = rows(planned).into_iter();
        let rows = rows.map(|mut row| {
            row["command"].take();
            row
        });
        rows.collect::<Vec<_>>()
    };
    assert_eq!(without_folder(&parts), without_folder(&whole));
}

/// The first variant ends before the fault begins, and the second does not.
const SHORT: &str = r#"
schema = 1
scenario = "SCENARIO"

[[variants]]
name = "short"
set = ["run.duration_s=4.5"]

[[variants]]
name = "long"

[faults]
onsets_s = [4.7]

[[faults.kinds]]
kind = "stuck"
targets = ["measured.position_m"]
"#;

#[test]
fn a_fault_that_a_variant_cannot_have_is_a_row_with_the_reason() {
    let rig = Rig::new();
    // A requirement over 5 s would refuse the short run by itself.
    let own = crate::support::programs::shipped("scenarios/spring-mass.toml")
        .replace("always[4s,5s]", "always[4s,4.4s]")
        .replace("[4, 5]", "[4, 4.4]");
    let scenario = rig.write("own.toml", &own);
    let path = rig.write("demo.toml", &SHORT.replace("SCENARIO", text(&scenario)));
    let planned = planned(&rig, &path, "short");
    planned.on("run").expect(0).prints(&["not possible"]);
    let rows = rows(&planned);
    assert_eq!(
        (&rows[0]["outcome"], &rows[0]["variant"]),
        (&json!("not-possible"), &json!("short"))
    );
    let reason = rows[0]["reason"].as_str().expect("a text");
    assert!(reason.contains("already over at 4.7 s"), "{reason}");
    assert_eq!(rows[1]["outcome"], "pass", "{}", rows[1]);
    let answers = planned.on("show --json").expect(0).json();
    let passes = &answers["variants"][0]["passes"];
    assert_eq!((&passes["count"], &passes["of"]), (&json!(0), &json!(0)));
    // A case that cannot be lacks no margin.
    let settles = &answers["variants"][0]["requirements"][0];
    assert_eq!(
        (&settles["name"], &settles["without"]),
        (&json!("settles"), &json!(0))
    );
    planned.on("case 0").expect(2).says(&[reason]);
}

#[test]
fn a_mistake_in_the_faults_of_a_study_is_reported_at_its_place() {
    let rig = Rig::new();
    #[rustfmt::skip] // a table
    let rows = [
        ("kind = \"bias\"", "kind = \"bais\"", vec!["offer no fault `bais`", "bias", "demo.toml:21"]),
        ("kind = \"bias\"", "kin = \"bias\"", vec!["nearest: `kind`"]),
        ("sizes = [\"probability = 0\"]", "sizes = [\"probability = 1.5\"]", vec!["probability", "out of range", "demo.toml:27"]),
        ("sizes = [\"probability = 0\"]", "sizes = [\"probability 0\"]", vec!["keys of an effect as TOML"]),
        ("sizes = [\"probability = 0\"]", "sizes = [\"probability = 0\", \"probability = 0\"]", vec!["listed twice"]),
        ("sizes = [\"bias = 0.1\", \"bias = 0.01\"]", "sizes = [\"bias = 1e-1\", \"bias = 0.1\"]", vec!["bias target = \"measured.position_m\", bias = 0.1 at 2.0 s is the same fault as bias target = \"measured.position_m\", bias = 1e-1 at 2.0 s", "demo.toml:21"]),
        ("kind = \"message-loss\"", "kind = \"message-loss\"\n[[faults.kinds]]\nkind = \"bias\"\ntargets = [\"measured.position_m\"]\nduration_s = 0.5\nsizes = [\"bias = 1e-2\"]\nonsets_s = [2]\n[[faults.kinds]]\nkind = \"message-delay\"\ntargets = [\"link.sample\"]\nsizes = [\"steps = 1\"]\nonsets_s = [1.0]\n[[faults.kinds]]\nkind = \"message-loss\"", vec!["is the same fault as"]),
        ("detected = \"none\"", "detected = \"internal.alarm > 0\"", vec!["unknown signal `internal.alarm`", "in variant `deaf`; a variant whose law lacks a signal of the alarm", "`detected = \"none\"`"]),
        ("sizes = [\"bias = 0.1\", \"bias = 0.01\"]", "", vec!["`faults[0].effects[0].bias` is missing", "demo.toml:21"]),
        ("onsets_s = [1.0]", "onsets_s = [9.0]", vec!["the run is already over at 9 s", "demo.toml:27"]),
        ("onsets_s = [1.0]", "onsets_s = [-1.0]", vec!["below 0"]),
        ("onsets_s = [2.0, 2.5]\n", "", vec!["`faults.kinds[0].onsets_s` is missing"]),
        ("targets = [\"measured.position_m\"]", "targets = [\"measured.speed_m\"]", vec!["has no signal `measured.speed_m`", "demo.toml:21"]),
        ("targets = [\"measured.position_m\"]", "targets = [\"link.sample\"]", vec!["cannot act on `link.sample`"]),
        ("detected = \"measured.position_m > 0.05\"", "detected = \"measured.speed > 0.05\"", vec!["speed"]),
        ("recovered = \"measured.position_m < 0.05\"", "recovered = \"measured.position_m <\"", vec!["recovered"]),
        ("schema = 1", "schema = 1\nsampling = \"sobol\"", vec!["[faults] with sampling = \"sobol\""]),
        ("schema = 1", "schema = 1\ncases = 3", vec!["as many cases as points"]),
        ("[[faults.kinds]]\nkind = \"message-loss\"\nsizes = [\"probability = 0\"]\nonsets_s = [1.0]", "[[faults.kinds]]\nkind = \"late\"\ntargets = [\"controller\"]\nsizes = [\"busy_us = 1, file = 'x'\"]", vec!["without target and file"]),
        ("[faults]", "[search]\n[faults]", vec!["[search] beside [faults]"]),
        ("[faults]", "[[vary]]\nname = \"fault\"\nkind = \"list\"\nvalues = [1, 2]\n[faults]", vec!["`fault` is the column of the fault that [faults] tries"]),
    ];
    for (from, to, expected) in rows {
        let wrong = FAULTS.replace(from, to);
        assert_ne!(wrong, FAULTS, "{from}");
        let path = study(&rig, &wrong);
        campaign(&rig, &["check", text(&path)])
            .expect(2)
            .says(&expected);
    }
}

#[test]
fn names_of_the_scenario_that_the_table_of_faults_needs_are_refused_with_the_remedy() {
    let rig = Rig::new();
    let shipped = crate::support::programs::shipped("scenarios/spring-mass.toml");
    for own in [
        "[[faults]]\nname = \"tried\"\nkind = \"bias\"\nat_s = 1\neffects = [{ target = \"measured.position_m\", bias = 1e-4 }]\n",
        "[[derived]]\nname = \"fault\"\nexpression = \"truth.position_m\"\n",
    ] {
        let scenario = rig.write("own.toml", &format!("{shipped}{own}"));
        let study = rig.write(
            "own-names.toml",
            &FAULTS.replace("SCENARIO", text(&scenario)),
        );
        campaign(&rig, &["check", text(&study)]).expect(2).says(&[
            "already named",
            "[faults] gives its fault and its metric these names: choose others in the scenario",
        ]);
    }
}

/// The scenario's own bias of 0.04 m, beside which a tried one of 0.02 m on the same signal passes the alarm at 0.05 m.
const COLLISION: &str = r#"
schema = 1
scenario = "own.toml"
set = ["controller.law=hold"]

[faults]
onsets_s = [2.0]
detected = "measured.position_m > 0.05"
recovered = "measured.position_m < 0.05"

[[faults.kinds]]
kind = "bias"
targets = ["measured.position_m"]
sizes = ["bias = 0.02", "bias = 0.005"]

[[faults.kinds]]
kind = "stuck-at"
targets = ["measured.position_m"]
sizes = ["value = 0.06"]

[[faults.kinds]]
kind = "scale"
targets = ["measured.position_m"]
sizes = ["factor = 2"]
"#;

#[test]
fn a_tried_fault_acts_on_what_a_fault_of_the_scenario_on_the_same_signal_left() {
    let rig = Rig::new();
    let own = crate::support::programs::shipped("scenarios/spring-mass.toml")
        + "[[faults]]\nkind = \"bias\"\nat_s = 1\nduration_s = 2\neffects = [{ target = \"measured.position_m\", bias = 0.04 }]\n";
    rig.write("own.toml", &own);
    let study = rig.write("collision.toml", COLLISION);
    let planned = planned(&rig, &study, "collision");
    planned.on("run").expect(0);
    // The mass stays at 0. The sum of both biases is 0.06 m until the first one ends at 3 s, and then 0.02 m; the
    // smaller sum never passes the alarm. The other two act on the sum so far: 0.06 m for good, and 0.08 m until 3 s.
    let expected = [
        (json!(0.01), json!(1.0)),
        (Value::Null, json!(0.0)),
        (json!(0.01), Value::Null),
        (json!(0.01), json!(1.0)),
    ];
    for (row, (detected, recovered)) in rows(&planned).iter().zip(expected) {
        assert_eq!(
            (&row["detected_after_s"], &row["recovered_after_s"]),
            (&detected, &recovered),
            "{row}"
        );
    }
}

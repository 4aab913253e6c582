//! Evidence of runs for the documents that their requirements come from: `hil export --evidence`.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::support::harness::{Rig, Run};
use crate::support::programs::{shipped, skip, workspace};
use crate::support::python::{python, succeeds};

const LISTED: &str = "\
id,title,owner
SYS_1,\"settles, in time\",A
SYS_2,answers,A
SYS_3,is never tested,B
";

/// Runs the spring-mass scenario with linked requirements twice: once as it is, and once with the law `hold`, which leaves the mass where it is.
fn runs(rig: &Rig) -> [Run; 2] {
    let text = shipped("scenarios/spring-mass.toml")
        .replace(
            "name = \"settles\"\n",
            "name = \"settles\"\nid = \"T-1\"\nverifies = [\"SYS_1\", \"SYS_9\"]\n",
        )
        .replace(
            "name = \"answers_the_step\"\n",
            "name = \"answers_the_step\"\nverifies = [\"SYS_2\"]\n",
        );
    let scenario = rig.write("linked.toml", &text);
    let scenario = scenario.to_str().expect("plain");
    let set = "controller.law=hold";
    [
        rig.run(&format!("{scenario} --link in-process --no-record"))
            .expect(0),
        rig.run(&format!(
            "{scenario} --link in-process --no-record --set {set}"
        ))
        .expect(1),
    ]
}

/// Runs `hil export --evidence --json` and returns its result.
fn evidence(rig: &Rig, runs: &[Run], more: &[&str]) -> Run {
    let folders = runs.iter().map(|run| run.folder.to_str().expect("plain"));
    let folder = rig.path("evidence");
    let folder = folder.to_str().expect("plain");
    let mut arguments = vec!["export"];
    arguments.extend(folders);
    arguments.extend(["--evidence", folder]);
    arguments.extend(more);
    rig.hil(&arguments)
}

#[test]
fn each_requirement_of_the_list_is_a_row_whether_or_not_a_run_verifies_it() {
    let rig = Rig::new();
    let runs = runs(&rig);
    let list = rig.write("list.csv", LISTED);
    let list = list.to_str().expect("plain");
    let written = evidence(&rig, &runs, &["--needs", list, "--json"]).expect(0);
    let written = written.json();
    let passed = |run: &Run| {
        let summary = run.summary();
        let requirements = summary["requirements"].as_array().expect("list").clone();
        requirements
            .iter()
            .filter(|one| one["verdict"] == "pass")
            .count()
    };
    let all_passed = passed(&runs[0]) + passed(&runs[1]);
    assert!(all_passed < 6, "`hold` passes everything");
    assert_eq!(
        (&written["untested"], &written["unknown"]),
        (&json!(["SYS_3"]), &json!(["SYS_9"]))
    );
    assert_eq!(
        (&written["runs"], &written["passed"]),
        (&json!(2), &json!(all_passed))
    );

    // Read by a program that knows nothing of ours.
    let script = "import csv, json, sys; print(json.dumps(list(csv.DictReader(open(sys.argv[1], newline='')))))";
    let table = rig.path("evidence").join("evidence.csv");
    let rows = succeeds(rig.command("python3").args(["-c", script]).arg(table));
    let rows: Vec<Value> = serde_json::from_str(&rows).expect("JSON");
    for run in &runs {
        let summary = run.summary();
        let folder = run.folder.display().to_string();
        for requirement in summary["requirements"].as_array().expect("list") {
            let ids: Vec<&str> = match requirement["name"].as_str().expect("text") {
                "settles" => vec!["SYS_1", "SYS_9"],
                "answers_the_step" => vec!["SYS_2"],
                _ => vec![""],
            };
            for id in ids {
                let row = rows.iter().find(|row| {
                    row["run"] == *folder
                        && row["test"] == requirement["name"]
                        && row["requirement"] == id
                });
                let row = row.unwrap_or_else(|| panic!("{id} of {requirement} in {rows:#?}"));
                assert_eq!(row["verdict"], requirement["verdict"]);
                assert_eq!(row["formula"], requirement["formula"]);
                assert_eq!(row["digest"], summary["digest"]);
                let robustness = requirement["robustness"].as_f64();
                let cell = row["robustness"].as_str().expect("text");
                assert_eq!(cell.parse().ok(), robustness);
            }
        }
    }
    let find = |id: &str| {
        rows.iter()
            .find(|row| row["requirement"] == id)
            .expect("a row")
    };
    assert_eq!(find("SYS_1")["title"], "settles, in time");
    assert_eq!(find("SYS_3")["verdict"], "untested");
    assert_eq!(find("SYS_3")["run"], "");
}

#[test]
fn other_programs_read_the_links_between_tests_and_requirements() {
    let Some(python) = python("junitparser, sphinx_needs") else {
        return skip(
            "there is no Python with junitparser and sphinx-needs",
            "HIL_TEST_PYTHON",
        );
    };
    let rig = Rig::new();
    let runs = runs(&rig);
    let list = rig.write("list.csv", LISTED);
    evidence(&rig, &runs, &["--needs", list.to_str().expect("plain")]).expect(0);
    let mut judge = Command::new(python);
    judge.arg(workspace().join("tests/python/judge_evidence.py"));
    judge.args([rig.path("evidence"), rig.path("site")]);
    let read: Value = serde_json::from_str(&succeeds(&mut judge)).expect("JSON");

    let cases = read["cases"].as_array().expect("list");
    let named =
        |name: &str| -> Vec<&Value> { cases.iter().filter(|case| case["name"] == name).collect() };
    let settles = named("settles");
    assert_eq!(settles.len(), 2);
    for (case, run) in settles.iter().zip(&runs) {
        let summary = run.summary();
        let verdict = &summary["requirements"][0]["verdict"];
        assert_eq!(summary["requirements"][0]["name"], "settles");
        let expected = if verdict == "pass" {
            json!([])
        } else {
            json!(["Failure"])
        };
        assert_eq!(case["result"], expected, "{verdict}");
        let properties = case["properties"].as_array().expect("list");
        for property in [["id", "T-1"], ["verifies", "SYS_1"], ["verifies", "SYS_9"]] {
            assert!(
                properties.contains(&json!(property)),
                "{property:?} in {case}"
            );
        }
    }
    assert_eq!(named("SYS_3")[0]["result"], json!(["Skipped"]));

    let needs = &read["needs"];
    let tests = needs["SYS_2"]["links_back"].as_array().expect("list");
    assert_eq!(tests.len(), 2, "{needs}");
    for (test, run) in tests.iter().zip(&runs) {
        let summary = run.summary();
        let requirements = summary["requirements"].as_array().expect("list");
        let answers = requirements
            .iter()
            .find(|one| one["name"] == "answers_the_step");
        let need = &needs[test.as_str().expect("text")];
        assert_eq!(need["type"], "test");
        assert_eq!(need["status"], answers.expect("there")["verdict"]);
    }
    assert_eq!(needs["SYS_3"]["links_back"], json!([]));
}

#[test]
fn evidence_is_refused_by_name_without_a_summary_or_a_usable_list() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --link in-process --no-record")
        .expect(0);
    let runs = [run];
    #[rustfmt::skip] // a table
    let cases = [
        ("a.csv", "name\nx\n", "its first line lacks the column `id`: name"),
        ("b.csv", "id\n", "it has no rows"),
        ("c.csv", "id,title\n,x\n", "a row has no `id`"),
        ("d.csv", "id\nA_1\nA_1\n", "`A_1` is listed twice"),
        ("e.json", "{}", "it has no needs of the current version"),
        ("f.json", "{\"current_version\": \"1\", \"versions\": {\"1\": {\"needs\": {\"A_1\": {\"type\": \"spec\"}}}}}", "none of its needs has a type that contains `req`"),
        ("g.json", "[", "EOF while parsing"),
    ];
    for (name, text, piece) in cases {
        let list = rig.write(name, text);
        let refused = evidence(&rig, &runs, &["--needs", list.to_str().expect("plain")]).expect(2);
        assert!(refused.stderr.contains(piece), "{name}: {}", refused.stderr);
    }
    let missing = rig.path("missing.csv");
    let refused = evidence(&rig, &runs, &["--needs", missing.to_str().expect("plain")]).expect(2);
    assert!(refused.stderr.contains("cannot read requirements from"));
    assert!(!rig.path("evidence").exists(), "something was written");

    evidence(&rig, &runs, &[]).expect(0);
    let again = evidence(&rig, &runs, &[]).expect(2);
    assert!(
        again.stderr.contains("already exists; --force replaces it"),
        "{}",
        again.stderr
    );
    evidence(&rig, &runs, &["--force"]).expect(0);

    let summary = runs[0].folder.join("summary.json");
    std::fs::write(&summary, "{\"scenario\": 1}").expect("written");
    let refused = evidence(&rig, &runs, &["--force"]).expect(2);
    assert!(
        refused.stderr.contains("is not a summary"),
        "{}",
        refused.stderr
    );
    remove(&summary);
    let refused = evidence(&rig, &runs, &["--force"]).expect(2);
    assert!(
        (refused.stderr).contains("it has neither a summary nor a recording"),
        "{}",
        refused.stderr
    );

    let folder = rig.path("evidence").display().to_string();
    let nowhere = rig.path("nowhere").display().to_string();
    let refused = rig.hil(&["export", &nowhere, "--evidence", &folder]);
    let refused = refused.expect(2);
    assert!(
        refused.stderr.contains("there is no run"),
        "{}",
        refused.stderr
    );
    assert!(!refused.stderr.contains("recover"), "{}", refused.stderr);

    let folder = runs[0].folder.to_str().expect("plain");
    let refused = rig.hil(&["export", folder, folder]).expect(2);
    assert!(
        refused
            .stderr
            .contains("a table is of one run; --evidence takes several")
    );
}

#[test]
fn a_run_that_is_given_twice_is_refused() {
    let rig = Rig::new();
    let run = rig
        .run("scenarios/spring-mass.toml --link in-process")
        .expect(0);
    let folder = run.folder.to_str().expect("plain");
    let dotted = run.folder.join(".").display().to_string();
    let recording = run.recording().display().to_string();
    let out = rig.path("evidence").display().to_string();
    for other in [folder, &dotted, &recording] {
        let refused = rig.hil(&["export", folder, other, "--evidence", &out]);
        refused.expect(2).says(&["is given twice"]);
    }
}

fn remove(path: &Path) {
    std::fs::remove_file(path).expect("removed");
}

#[test]
fn a_copy_of_a_run_counts_once_and_is_named() {
    let rig = Rig::new();
    let runs = runs(&rig);
    let copy = rig.path("copy");
    std::fs::create_dir(&copy).expect("a folder");
    let summary = runs[0].folder.join("summary.json");
    std::fs::copy(summary, copy.join("summary.json")).expect("copied");
    let [first, second] = [0, 1].map(|place| runs[place].folder.to_str().expect("plain"));
    let copy = copy.to_str().expect("plain");
    let out = rig.path("evidence").display().to_string();
    let words = ["export", first, copy, second, "--evidence", &out, "--force"];
    let written = rig
        .hil(&[&words[..], &["--json"]].concat())
        .expect(0)
        .json();
    assert_eq!(
        (&written["runs"], &written["tests"]),
        (&json!(2), &json!(4))
    );
    assert_eq!(written["copies"], json!([{ "folder": copy, "of": first }]));
    let line = format!("{copy} is a copy of {first}; its tests count once");
    rig.hil(&words).expect(0).prints(&[&line]);
}

//! Several runs in one command: one table of verdicts, one exit code, independent runs.

use std::fs;
use std::path::Path;

use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::Value;

use crate::support::harness::{Rig, Running, names, until};
use crate::support::programs::program_of_tests;

/// Writes a quarter of a second of the teaching plant at 1 kHz, or one that leaves its limits.
fn scenario(name: &str, law: &str, limit_m: f64) -> String {
    format!(
        "schema = 1\nname = \"{name}\"\n[run]\nduration_s = 0.25\nrate_hz = 1000\n\
         [plant]\nmodel = \"spring-mass\"\n[plant.limits]\nposition_m = [-1.0, {limit_m}]\n\
         [controller]\nlaw = \"{law}\"\n[[stimuli]]\ntarget = \"position_m\"\nkind = \"step\"\nafter = 0.01\n"
    )
}

fn verdicts(all: &Value) -> Vec<(&str, &str)> {
    let mut verdicts = Vec::new();
    for run in all["runs"].as_array().expect("a list of runs") {
        let text = |key| run[key].as_str().unwrap_or_default();
        verdicts.push((text("label"), text("verdict")));
    }
    verdicts
}

#[test]
fn several_runs_have_one_table_and_the_exit_code_of_the_worst() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let bad = rig.write("bad.toml", &scenario("bad", "pid", 1e-9));
    let (xml, text) = (rig.path("all.xml"), rig.path("all.md"));
    let run = rig.run(&format!(
        "{} {} --repeat 2 --jobs 2 --json --junit {} --markdown {}",
        good.display(),
        bad.display(),
        xml.display(),
        text.display()
    ));
    let run = run.expect(1);
    let all = run.json();
    assert_eq!(all["verdict"], "fail");
    let expected = [
        ("good-1", "pass"),
        ("bad-1", "fail"),
        ("good-2", "pass"),
        ("bad-2", "fail"),
    ];
    assert_eq!(verdicts(&all), expected);
    assert_eq!(all["runs"][0]["digest"], all["runs"][2]["digest"]);
    assert_ne!(all["runs"][0]["digest"], all["runs"][1]["digest"]);
    for (label, _) in expected {
        assert!(run.folder.join(label).join("run.mcap").exists(), "{label}");
    }
    let xml = std::fs::read_to_string(xml).expect("JUnit");
    assert_eq!(xml.matches("<testsuite ").count(), 4);
    assert_eq!(xml.matches("<failure ").count(), 2);
    assert!(
        xml.contains("position_m"),
        "the limit that was left is named: {xml}"
    );
    let text = std::fs::read_to_string(text).expect("Markdown");
    assert!(
        text.contains("0 of 4 runs pass; 2 completed, no requirements"),
        "{text}"
    );
    assert!(text.contains("| bad-1 | pid | **fail** |"), "{text}");
}

#[test]
fn numbering_never_makes_two_runs_share_a_name() {
    let rig = Rig::new();
    let named = ["a", "a", "a-1", "a-2-1"].map(|name| scenario(name, "pid", 1.0));
    let files = (1..).zip(&named).map(|(number, text)| {
        let path = rig.write(&format!("{number}.toml"), text);
        path.display().to_string()
    });
    let files: Vec<String> = files.collect();
    for (repeat, labels) in [
        ("", vec!["a-2", "a-3", "a-1", "a-2-1"]),
        (
            "--repeat 2",
            vec![
                "a-1", "a-2", "a-1-1", "a-2-1-1", "a-3", "a-4", "a-1-2", "a-2-1-2",
            ],
        ),
    ] {
        let given = format!("{} {repeat} --link in-process --json", files.join(" "));
        let all = rig.run(&given).expect(0).json();
        let output: Vec<&str> = verdicts(&all).iter().map(|(label, _)| *label).collect();
        assert_eq!(output, labels, "{repeat}");
    }
}

#[test]
fn a_repetition_with_another_digest_fails_with_the_first_difference() {
    let rig = Rig::new();
    let scenario = rig.write("clock.toml", &scenario("clock", "reads-clock", 1.0));
    let controller = program_of_tests("clock-reading-controller");
    let run = rig.run(&format!(
        "{} --repeat 2 --controller-bin {}",
        scenario.display(),
        controller.display()
    ));
    run.expect(1).prints(&[
        "clock-2: digest differs from that of clock-1: first difference at step",
        "command.force_n",
        "2 runs: 1 completed, no requirements, 1 fail",
    ]);
}

#[test]
fn impossible_suites_are_refused_before_anything_starts() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let wrong = rig.write("wrong.toml", &scenario("wrong", "pdi", 1.0));
    let (good, wrong) = (good.display(), wrong.display());
    let missing = rig.path("none").join("all.xml");
    #[rustfmt::skip] // a table
    let cases = [
        (format!("{good} {wrong}"), "pdi"),
        (format!("{good} {good} --jobs 100000"), "exceeds the"),
        (format!("{good} --repeat 2 --pause-at 0.1"), "--pause-at requires a single run"),
        (format!("{good} --junit {}", missing.display()), "its folder does not exist"),
        (format!("{good} {good} --audit"), "--audit requires a single scenario"),
        (format!("{good} --repeat 0"), "a whole number from 1 to 10000"),
    ];
    for (arguments, message) in cases {
        let run = rig.run(&arguments).expect(2).says(&[message]);
        assert!(!run.folder.exists(), "{arguments}");
    }
}

#[test]
fn a_scenario_that_cannot_be_run_is_an_error_in_the_reports() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let wrong = rig.write("wrong.toml", &scenario("wrong", "pdi", 1.0));
    let none = rig.path("none.toml");
    let (xml, text) = (rig.path("all.xml"), rig.path("all.md"));
    let arguments = format!(
        "{} {} {} --junit {} --markdown {}",
        good.display(),
        wrong.display(),
        none.display(),
        xml.display(),
        text.display()
    );
    rig.run(&arguments).expect(2).says(&["pdi", "none.toml"]);
    let xml = fs::read_to_string(xml).expect("JUnit");
    for part in [
        "tests=\"2\" failures=\"0\" errors=\"2\"",
        "classname=\"wrong\"",
        "classname=\"none\"",
        "unknown law `pdi`",
    ] {
        assert!(xml.contains(part), "{part}: {xml}");
    }
    let text = fs::read_to_string(text).expect("Markdown");
    assert!(text.contains("0 of 2 runs pass"), "{text}");
}

fn summary_in(folder: &Path) -> Value {
    let text = fs::read(folder.join("summary.json")).expect("it is there");
    serde_json::from_slice(&text).expect("JSON")
}

/// Returns the parts of a summary that do not depend on time and other runs.
fn lasting(summary: &Value) -> Value {
    let mut lasting = summary.clone();
    let parts = lasting.as_object_mut().expect("an object");
    for passing in [
        "session",
        "started_utc",
        "wall_time_s",
        "realtime_factor",
        "latency_ns",
        "spikes",
        "grade",
        "company",
    ] {
        parts.remove(passing);
    }
    lasting
}

/// Lists the existing sessions of a suite, by their common prefix.
fn sessions(rig: &Rig) -> Vec<SessionInfo> {
    let all = rig.session_folder();
    let entries = fs::read_dir(all.parent().expect("a folder")).into_iter();
    let own = format!("{}-", rig.session());
    (entries.flatten().flatten())
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(&own))
        .filter_map(|entry| SessionInfo::read(&entry.path()).ok())
        .collect()
}

/// Counts page faults of the processes that a process has waited for: more with each child.
fn faults_of_children(running: &Running<'_>) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{}/stat", running.pid())).expect("it runs");
    let (_, behind_name) = stat.rsplit_once(')').expect("a name");
    let field = behind_name.split_ascii_whitespace().nth(8);
    field.and_then(|count| count.parse().ok()).expect("a count")
}

#[test]
fn concurrent_runs_in_one_process_equal_separate_ones() {
    let rig = Rig::new();
    let scenarios = [
        ("good", "pid", 1.0),
        ("bad", "pid", 1e-9),
        ("idle", "hold", 1.0),
    ];
    let paths = scenarios.map(|(name, law, limit_m)| {
        let file = format!("{name}.toml");
        rig.write(&file, &scenario(name, law, limit_m))
            .display()
            .to_string()
    });
    for recorded in ["", "--no-record"] {
        let link = format!("--link in-process {recorded}");
        let all = rig.run(&format!(
            "{} {link} --json --repeat 3 --jobs 2",
            paths.join(" ")
        ));
        let all = all.expect(1);
        assert!(sessions(&rig).is_empty(), "{:?}", sessions(&rig));
        let report = all.json();
        let runs = report["runs"].as_array().expect("a list of runs");
        assert_eq!(runs.len(), 9);
        for (number, path) in paths.iter().enumerate() {
            let alone = rig.run(&format!("{path} {link}"));
            let expected = lasting(&alone.summary());
            assert_eq!(expected["evidence"], "in-process");
            for run in runs.iter().skip(number).step_by(3) {
                let folder = all.folder.join(run["label"].as_str().expect("a label"));
                assert_eq!(lasting(&summary_in(&folder)), expected, "{path}");
                assert_eq!(names(&folder), names(&alone.folder));
            }
        }
    }
}

#[test]
fn a_suite_in_one_process_starts_no_process_for_a_run() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let suite = rig.start(&format!(
        "{} --repeat 3 --jobs 1 --pace 1 --set run.duration_s=1 --link in-process",
        good.display()
    ));
    let begun = |label: &str| suite.folder().join(label).join("scenario.toml").exists();
    until("the first run goes on", || begun("good-1"));
    let before = faults_of_children(&suite);
    assert!(
        before > 0,
        "both programs were asked for their descriptions"
    );
    until("the last run goes on", || begun("good-3"));
    assert_eq!(faults_of_children(&suite), before);
    suite.finish().expect(0);
}

#[test]
fn a_suite_in_one_process_accepts_requests_and_ends_on_ctrl_c() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let endless = "--set run.duration_s=1000 --pace 1 --no-record --link in-process";
    let suite = rig.start(&format!("{} {endless} --repeat 4 --jobs 2", good.display()));
    let has_stepped = |info: &SessionInfo| {
        let at = ["inject", "--active", "--json", "--session", &info.name];
        let report: Value = serde_json::from_str(&rig.beside(&at).stdout).unwrap_or_default();
        report["status"]["step"].as_u64() > Some(0)
    };
    until("two of four go on", || {
        let there = sessions(&rig);
        there.len() == 2 && there.iter().all(has_stepped)
    });
    let listed = rig.beside(&["sessions", "--json"]).expect(0).stdout;
    for info in sessions(&rig) {
        assert!(listed.contains(&info.name), "{listed}");
        assert_eq!(info.owner, ProcessId::of(suite.pid()).expect("alive"));
        assert_eq!((info.children.len(), info.segments().len()), (0, 0));
        let fault = ["inject", "bias", "measured.position_m", "0.001"];
        let session = ["--session", &info.name];
        rig.beside(&[&fault[..], &session].concat()).expect(0);
    }
    suite.signal(Signal::INT);
    let suite = suite.finish().expect(130);
    assert!(sessions(&rig).is_empty());
    assert_eq!(
        names(&suite.folder),
        ["good-1", "good-2"].map(String::from).into()
    );
    let ended = summary_in(&suite.folder.join("good-2"));
    assert_eq!(ended["verdict"], "aborted");
    let reason = ended["reason"].as_str().expect("a reason");
    assert!(reason.starts_with("interrupted; "), "{reason}");
}

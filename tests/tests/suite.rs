//! Several runs by one command: one verdict table, one exit code, runs that do not disturb each other.

use serde_json::Value;

use crate::support::harness::Rig;
use crate::support::programs::program_of_tests;

/// A quarter of a second of the teaching plant at 1 kHz, or one that leaves its limits.
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
    let all: Value = serde_json::from_str(&run.stdout).expect("JSON");
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
    assert!(text.contains("2 of 4 runs pass"), "{text}");
    assert!(text.contains("| bad-1 | pid | **fail** |"), "{text}");
}

#[test]
fn a_repetition_with_another_digest_fails_and_says_where_it_differs() {
    let rig = Rig::new();
    let scenario = rig.write("clock.toml", &scenario("clock", "reads-clock", 1.0));
    let controller = program_of_tests("clock-reading-controller");
    let run = rig.run(&format!(
        "{} --repeat 2 --controller-bin {}",
        scenario.display(),
        controller.display()
    ));
    let run = run.expect(1);
    assert!(
        run.stdout
            .contains("clock-2: another digest than clock-1: first difference at step")
    );
    assert!(run.stdout.contains("command.force_n"), "{}", run.stdout);
    assert!(
        run.stdout.contains("2 runs: 1 pass, 1 fail"),
        "{}",
        run.stdout
    );
}

#[test]
fn what_cannot_be_run_is_refused_before_anything_starts() {
    let rig = Rig::new();
    let good = rig.write("good.toml", &scenario("good", "pid", 1.0));
    let wrong = rig.write("wrong.toml", &scenario("wrong", "pdi", 1.0));
    let (good, wrong) = (good.display(), wrong.display());
    let missing = rig.path("none").join("all.xml");
    for (arguments, message) in [
        (format!("{good} {wrong}"), "pdi"),
        (format!("{good} {good} --jobs 100000"), "more than the"),
        (
            format!("{good} --repeat 2 --pause-at 0.1"),
            "--pause-at is for a single run",
        ),
        (
            format!("{good} --junit {}", missing.display()),
            "no such folder",
        ),
        (
            format!("{good} {good} --audit"),
            "--audit takes one scenario",
        ),
        (
            format!("{good} --repeat 0"),
            "a whole number from 1 to 10000",
        ),
    ] {
        let run = rig.run(&arguments).expect(2);
        assert!(run.stderr.contains(message), "{arguments}: {}", run.stderr);
        assert!(!run.folder.exists(), "{arguments}");
    }
}

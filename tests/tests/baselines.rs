//! Runs compared with baselines: by digest, by samples, by figures, and updates of baselines.

use std::path::PathBuf;

use serde_json::Value;

use crate::support::harness::{Rig, Run};

const SCENARIO: &str =
    "tests/scenarios/leakage.toml --set run.duration_s=0.1 --set faults[0].at_s=0.05";
/// Scenario change: a piston heavier by a hundredth of a millionth.
const OTHER: &str = "--set plant.parameters.piston_mass_kg=55.0000005";

/// File with the scenario's run as baseline `leakage`.
struct Kept {
    rig: Rig,
    file: PathBuf,
    folder: String,
}

impl Kept {
    fn new() -> Self {
        let rig = Rig::new();
        let file = rig.path("baselines.toml");
        let run = rig.run(SCENARIO).expect(0);
        let kept = Self {
            file,
            folder: run.folder.display().to_string(),
            rig,
        };
        kept.compare(&kept.folder, &["--update"]).expect(0);
        kept
    }

    fn compare(&self, run: &str, arguments: &[&str]) -> Run {
        let file = self.file.to_str().expect("plain text");
        let common = ["compare", run, "--baseline", "leakage", "--baselines", file];
        self.rig.hil(&[&common[..], arguments].concat())
    }

    #[track_caller]
    fn judged(&self, run: &str, code: i32) -> Value {
        self.compare(run, &["--json"]).expect(code).json()
    }

    fn text(&self) -> String {
        std::fs::read_to_string(&self.file).expect("the file is there")
    }

    /// Allows a relative deviation of every signal and metric.
    fn allow(&self, tolerance: &str) {
        let text = self
            .text()
            .replace("tolerance = 0.0", &format!("tolerance = {tolerance}"));
        std::fs::write(&self.file, text).expect("written");
    }

    fn other(&self) -> String {
        let run = self.rig.run(&format!("{SCENARIO} {OTHER}")).expect(0);
        run.folder.display().to_string()
    }
}

#[test]
fn a_repeated_run_is_the_same_and_a_changed_one_is_not() {
    let kept = Kept::new();
    let again = kept.rig.run(SCENARIO).expect(0);
    let text = kept.judged(&again.folder.display().to_string(), 0);
    assert_eq!(
        (&text["verdict"], &text["compared_by"]),
        (&"same".into(), &"digest".into())
    );
    assert_eq!(text["identity"], serde_json::json!([]));

    let other = kept.other();
    let text = kept.judged(&other, 1);
    assert_eq!(
        (&text["verdict"], &text["compared_by"]),
        (&"different".into(), &"samples".into())
    );
    let signals = text["comparison"]["signals"].as_array().expect("a list");
    let angle = (signals.iter()).find(|signal| signal["name"] == "truth.surface_angle_rad");
    let angle = angle.expect("it moves with the piston");
    assert!(
        angle["first_beyond_step"]
            .as_u64()
            .is_some_and(|step| step > 0),
        "{angle}"
    );
    let what: Vec<&str> = (text["identity"].as_array().expect("a list").iter())
        .filter_map(|change| change["what"].as_str())
        .collect();
    assert_eq!(what, ["digest", "scenario_blake3"]);
    let output = kept.compare(&other, &[]).expect(1).stdout;
    assert!(
        output.contains("DIFFERENT from baseline leakage"),
        "{output}"
    );

    // The Lyapunov function differs most, by far less than its own magnitude of 1e18.
    kept.allow("1e18");
    let text = kept.judged(&other, 0);
    assert_eq!(text["verdict"], "within-tolerance");
}

#[test]
fn without_a_recording_the_figures_decide_and_a_note_says_so() {
    let kept = Kept::new();
    std::fs::remove_file(kept.rig.path("baselines/leakage.mcap")).expect("it was kept");
    assert_eq!(kept.judged(&kept.folder, 0)["compared_by"], "digest");
    let other = kept.other();
    let output = kept.judged(&other, 1);
    assert_eq!(output["compared_by"], "figures");
    assert!(
        output["note"]
            .as_str()
            .expect("a note")
            .contains("only the digest and the figures"),
        "{output}"
    );
    let figures = output["figures"].as_array().expect("a list");
    let names: Vec<&str> = figures
        .iter()
        .filter_map(|figure| figure["name"].as_str())
        .collect();
    assert!(
        names.contains(&"truth.surface_angle_rad final"),
        "{names:?}"
    );
    assert!(
        names.contains(&"max_abs_tracking_error_rad 0 s to 0.1 s"),
        "{names:?}"
    );
    kept.allow("1e18");
    assert_eq!(kept.judged(&other, 0)["verdict"], "within-tolerance");
}

#[test]
fn an_update_shows_what_changes_and_a_dry_one_writes_nothing() {
    let kept = Kept::new();
    kept.allow("0.125");
    let before = kept.text();
    let other = kept.other();
    let text = kept
        .compare(&other, &["--update", "--dry-run"])
        .expect(1)
        .stdout;
    assert_eq!(kept.text(), before);
    assert!(
        text.contains("would change") && text.contains("digest: "),
        "{text}"
    );
    assert!(text.contains("truth.surface_angle_rad final"), "{text}");
    kept.compare(&kept.folder, &["--update", "--dry-run"])
        .expect(0);

    kept.compare(&other, &["--update"]).expect(0);
    let now = kept.text();
    assert_ne!(now, before);
    assert_eq!(
        now.matches("tolerance = 0.125").count(),
        before.matches("tolerance = 0.125").count()
    );
    assert_eq!(kept.judged(&other, 0)["compared_by"], "digest");
    // The kept recording is the new one.
    let recording = kept.rig.path("baselines/leakage.mcap");
    assert_eq!(
        kept.judged(recording.to_str().expect("plain text"), 0)["compared_by"],
        "digest"
    );
    assert_eq!(kept.judged(&kept.folder, 1)["compared_by"], "samples");
}

#[test]
fn incomparable_runs_and_baselines_are_refused() {
    let kept = Kept::new();
    let file = kept.file.to_str().expect("plain text");
    let folder = kept.folder.as_str();
    let mass = kept
        .rig
        .run("scenarios/spring-mass.toml --set run.duration_s=0.6 --set metrics=[] --set requirements=[]")
        .expect(0);
    let mass = mass.folder.display().to_string();
    let other = kept.other();
    #[rustfmt::skip] // a table
    let cases = [
        (vec![folder, "--baseline", "leekage", "--baselines", file], "nearest: `leakage`"),
        (vec![folder, "--baseline", "a/b", "--baselines", file], "is not a valid baseline name"),
        (vec![folder, "--baseline", "leakage", "--baselines", "nowhere.toml"], "--update creates one"),
        (vec![&mass, "--baseline", "leakage", "--baselines", file], "belongs to scenario `leakage`"),
        (vec![folder], "<B>"),
        (vec![folder, &other, "--baseline", "leakage"], "cannot be used with"),
        (vec![folder, &other, "--update"], "cannot be used with"),
    ];
    for (arguments, expected) in cases {
        kept.rig
            .hil(&[&["compare"], &arguments[..]].concat())
            .expect(2)
            .says(&[expected]);
    }
    // The kept recording was replaced by another one.
    let recording = kept.rig.path("baselines/leakage.mcap");
    std::fs::copy(format!("{other}/run.mcap"), recording).expect("copied");
    let third = kept
        .rig
        .run(&format!("{SCENARIO} --set controller.law=pid"))
        .expect(0);
    kept.compare(&third.folder.display().to_string(), &[])
        .expect(2)
        .says(&["is not the recording of baseline `leakage`"]);
}

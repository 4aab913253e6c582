//! The band of a baseline behind the curves of a run and of a session, and what a cursor reads of it.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::browser::{Play, begun};
use super::{Panel, SCENARIO, heavy};
use crate::support::harness::{Rig, text};
use crate::support::mcap_reader::Recording;

pub(crate) const SIGNAL: &str = "truth.position_m";
pub(crate) const TOLERANCE: f64 = 1e-3;

/// Baseline `spring` with a tolerance on one signal.
pub(crate) struct Baseline {
    file: PathBuf,
    pub(crate) recording: PathBuf,
}

impl Baseline {
    pub(crate) fn new(rig: &Rig) -> Self {
        let file = rig.path("baselines.toml");
        let run = rig.run(SCENARIO).expect(0);
        let folder = run.folder.to_str().expect("text");
        let update = [
            "--baseline",
            "spring",
            "--baselines",
            text(&file),
            "--update",
        ];
        rig.hil(&[&["compare", folder][..], &update].concat())
            .expect(0);
        let baseline = Self {
            file,
            recording: run.recording(),
        };
        let begin = format!("\"{SIGNAL}\" = {{ unit = \"m\", tolerance = ");
        baseline.edit(&format!("{begin}0.0"), &format!("{begin}{TOLERANCE}"));
        baseline
    }

    pub(crate) fn edit(&self, old: &str, new: &str) {
        let content = std::fs::read_to_string(&self.file).expect("the file");
        assert!(content.contains(old), "no {old} in {content}");
        std::fs::write(&self.file, content.replace(old, new)).expect("written");
    }

    pub(crate) fn arguments(&self) -> [&str; 4] {
        ["--baseline", "spring", "--baselines", text(&self.file)]
    }
}

/// Returns the cells of a signal in a copied table, behind name and unit.
fn cells(output: &Value, name: &str) -> Vec<String> {
    let table = output["text"].as_str().expect("text");
    let row = table.lines().find(|line| line.starts_with(name));
    let row = row.unwrap_or_else(|| panic!("no {name} in {table}"));
    row.split('\t').skip(2).map(Into::into).collect()
}

/// Fails unless the page says what the band is, and that derived signals and times of the computer have none.
fn assert_label(output: &Value, basis: &str) {
    let label = output["label"].as_str().expect("text");
    let begin = format!("band of baseline spring: {basis}");
    assert!(label.starts_with(&begin), "{label}");
    let end = " and 3 more are not in the baseline";
    assert!(label.ends_with(end), "{label}");
}

/// Fails unless the cells are a value, a band and how far the value is outside.
fn assert_cells(output: &Value, value: f64, [low, high]: [f64; 2], outside: f64) {
    let cells = cells(output, SIGNAL);
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let (least, greatest) = cells[1].split_once(" to ").expect("a band");
    let numbers = [&cells[0], least, greatest, &cells[2]].map(number);
    assert_eq!(numbers, [value, low, high, outside], "{output}");
}

#[test]
fn the_band_of_a_baseline_is_shaded_and_read_at_a_cursor() {
    let rig = Rig::new();
    let baseline = Baseline::new(&rig);
    let heavy = heavy(&rig);
    let played = || {
        let panel = Panel::recorded(&rig, &heavy.folder, &baseline.arguments());
        Some(Play::closer("banded", &panel.url)?.result())
    };
    let Some(output) = played() else { return };
    assert_label(&output, "its recording and the tolerance of each signal; ");
    assert_eq!(output["over"], false);
    // The tolerance is some 20 pixels high.
    assert!(output["ink"].as_u64() > Some(1000), "{output}");
    let column = |recording: &Path| Recording::open(recording).column(SIGNAL);
    let own = column(&heavy.recording())[550];
    let kept = column(&baseline.recording);
    let other = kept[550];
    assert!((own - other).abs() > TOLERANCE, "{own} {other}");
    let outside = own - other - TOLERANCE.copysign(own - other);
    assert_cells(
        &output,
        own,
        [other - TOLERANCE, other + TOLERANCE],
        outside,
    );

    // Without the recording only the range of the whole run is known, and the page says so.
    baseline.edit("recording = ", "# recording = ");
    let Some(output) = played() else { return };
    assert_label(
        &output,
        "the range of each signal over the whole run, wider by its tolerance, because the baseline has no recording; ",
    );
    assert!(output["ink"].as_u64() > Some(1000), "{output}");
    let least = kept.iter().copied().min_by(f64::total_cmp).expect("values");
    let greatest = kept.iter().copied().max_by(f64::total_cmp).expect("values");
    assert!((least..=greatest).contains(&own));
    assert_cells(&output, own, [least - TOLERANCE, greatest + TOLERANCE], 0.0);
}

#[test]
fn a_session_has_the_band_of_a_baseline_behind_it() {
    let rig = Rig::new();
    let baseline = Baseline::new(&rig);
    let (run, panel) = begun(&rig, "", &baseline.arguments());
    let Some(play) = Play::closer("banded", &panel.url) else {
        return;
    };
    let output = play.result();
    let value = Recording::open(&baseline.recording).column(SIGNAL)[550];
    assert!(output["ink"].as_u64() > Some(1000), "{output}");
    assert_cells(&output, value, [value - TOLERANCE, value + TOLERANCE], 0.0);
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn a_baseline_that_does_not_fit_is_refused_with_its_reason() {
    let rig = Rig::new();
    let baseline = Baseline::new(&rig);
    let run = rig.held();
    let recorded = baseline.recording.to_str().expect("text").to_owned();
    let session = ["panel", "--no-open", "--session", rig.session()];
    let of_run = ["panel", "--no-open", &recorded];
    let report = ["report", "-o", "-", &recorded];
    let refused = |expected: &str| {
        for words in [&session[..], &of_run, &report] {
            rig.beside(&[words, &baseline.arguments()].concat())
                .expect(2)
                .says(&[expected]);
        }
    };
    let content = std::fs::read_to_string(&baseline.file).expect("the file");
    let other = content.replace("rate_hz = 1000.0", "rate_hz = 500.0");
    for (changed, expected) in [
        (
            other,
            "baseline `spring` was recorded at 500 Hz, but the run has 1000 Hz, so their steps differ in time",
        ),
        (
            content.replace(
                &format!("\"{SIGNAL}\" = {{ unit = \"m\""),
                &format!("\"{SIGNAL}\" = {{ unit = \"mm\""),
            ),
            "baseline `spring` has truth.position_m in `mm`, but the run in `m`",
        ),
        (
            content.replace("\n\"", "\n\"other."),
            "baseline `spring`, of scenario `spring-mass`, has no signal of the run",
        ),
        (
            content.replace("digest = \"", "digest = \"0"),
            "is not the recording of baseline `spring`, because its digest is ",
        ),
        (
            content.replace("[baselines.spring", "[baselines.sprint"),
            "has no baseline `spring`; nearest: `sprint`",
        ),
    ] {
        std::fs::write(&baseline.file, changed).expect("written");
        refused(expected);
    }
    rig.beside(&[&of_run[..], &baseline.arguments(), &["--over", &recorded]].concat())
        .expect(2)
        .says(&["cannot be used with"]);
    rig.beside(
        &[
            &["report", &recorded, "--figures", "figures"][..],
            &baseline.arguments(),
        ]
        .concat(),
    )
    .expect(2)
    .says(&["'--figures <DIR>' cannot be used with", "--baseline"]);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

use std::path::PathBuf;

use tempfile::TempDir;

use super::figures::{Metric, STATISTICS, Signal};
use super::*;

fn figures() -> Figures {
    Figures {
        scenario: "s".into(),
        digest: "d1".into(),
        records: 11,
        rate_hz: 1000.0,
        scenario_blake3: "b1".into(),
        hil_version: "1".into(),
        plant_blake3: "p".into(),
        controller_blake3: "c".into(),
        metrics: vec![Metric {
            name: "max_abs_x_m 0 s to 1 s".into(),
            unit: "m".into(),
            value: 0.1 + 0.2,
        }],
        signals: vec![
            Signal {
                name: "truth.x_m".into(),
                unit: "m".into(),
                values: [-1.0, 2.0, 1e-300, 0.5],
            },
            Signal {
                name: "internal.never".into(),
                unit: "1".into(),
                values: [f64::NAN; 4],
            },
        ],
    }
}

/// Creates a folder with a recording of arbitrary content.
fn folder() -> (TempDir, PathBuf, PathBuf) {
    let folder = TempDir::new().expect("a folder");
    let (run, path) = (
        folder.path().join("run.mcap"),
        folder.path().join("baselines.toml"),
    );
    std::fs::write(&run, "one").expect("written");
    (folder, run, path)
}

fn write_baseline(path: &Path, run: &Path, figures: &Figures) -> BaselineFile {
    let mut file = BaselineFile::read(path, true).expect("reads");
    file.update("a", run, figures).expect("written");
    BaselineFile::read(path, false).expect("reads again")
}

fn recording_of(file: &BaselineFile) -> Option<PathBuf> {
    file.recording(file.find("a").expect("there"))
}

#[test]
fn figures_are_read_back_exactly_and_the_recording_is_copied() {
    let (folder, run, path) = folder();
    let file = write_baseline(&path, &run, &figures());
    let baseline = file.find("a").expect("there");
    assert!(metric_changes(baseline, &figures()).is_empty());
    assert!(signal_changes(baseline, &figures()).is_empty());
    assert!(identity_changes(baseline, &figures()).is_empty());
    let copy = file.recording(baseline).expect("kept");
    assert_eq!(copy, folder.path().join("baselines/a.mcap"));
    assert_eq!(std::fs::read_to_string(copy).expect("there"), "one");
}

#[test]
fn each_baselines_file_has_its_own_recordings() {
    let (folder, run, path) = folder();
    let expected = [
        ("baselines.toml", "baselines/a.mcap"),
        ("other.toml", "other/a.mcap"),
        ("third", "third.d/a.mcap"),
    ];
    for (name, recording) in expected {
        let path = path.with_file_name(name);
        std::fs::write(&run, name).expect("written");
        let file = write_baseline(&path, &run, &figures());
        let copy = recording_of(&file).expect("kept");
        assert_eq!(copy, folder.path().join(recording));
    }
    for (name, recording) in expected {
        let copy = std::fs::read_to_string(folder.path().join(recording));
        assert_eq!(copy.expect("there"), name);
    }
}

#[test]
fn an_update_preserves_comments_order_and_tolerances() {
    let (_folder, run, path) = folder();
    write_baseline(&path, &run, &figures());
    let text = std::fs::read_to_string(&path).expect("read");
    let line = "\"truth.x_m\" = { unit = \"m\", tolerance = 0.0, min = -1.0, max = 2.0, rms = 1e-300, final = 0.5 }";
    assert!(text.contains(line), "{text}");
    let edited = line.replace("tolerance = 0.0", "tolerance = 1e-3");
    let edited = text
        .replace(
            line,
            &format!("# The sensor is that good.\n{edited} # agreed"),
        )
        .replace("digest = ", "# Since the new valve.\ndigest = ");
    std::fs::write(&path, edited).expect("written");

    let mut now = figures();
    now.digest = "d2".into();
    now.signals[0].values[1] = 2.5;
    now.signals[1].name = "internal.new".into();
    std::fs::write(&run, "two").expect("written");
    let file = write_baseline(&path, &run, &now);
    let text = std::fs::read_to_string(&path).expect("read");
    let expected = "# The sensor is that good.\n\"truth.x_m\" = { unit = \"m\", tolerance = 1e-3, min = -1.0, max = 2.5, rms = 1e-300, final = 0.5 } # agreed\n";
    assert!(text.contains(expected), "{text}");
    assert!(
        text.contains("# Since the new valve.\ndigest = \"d2\"\n"),
        "{text}"
    );
    assert!(
        !text.contains("internal.never") && text.contains("internal.new"),
        "{text}"
    );
    let copy = recording_of(&file).expect("kept");
    assert_eq!(std::fs::read_to_string(copy).expect("there"), "two");
}

#[test]
fn a_recording_removed_by_hand_is_not_restored() {
    let (_folder, run, path) = folder();
    let file = write_baseline(&path, &run, &figures());
    let copy = recording_of(&file).expect("kept");
    std::fs::remove_file(&copy).expect("removed");
    let text = std::fs::read_to_string(&path).expect("read");
    let lines: Vec<&str> = text
        .lines()
        .filter(|line| !line.starts_with("recording"))
        .collect();
    std::fs::write(&path, lines.join("\n") + "\n").expect("written");
    let file = write_baseline(&path, &run, &figures());
    assert_eq!(recording_of(&file), None);
    assert!(!copy.exists());
}

#[test]
fn a_baseline_can_be_updated_from_its_own_recording() {
    let (_folder, run, path) = folder();
    let file = write_baseline(&path, &run, &figures());
    let copy = recording_of(&file).expect("kept");
    write_baseline(&path, &copy, &figures());
    assert_eq!(std::fs::read_to_string(copy).expect("there"), "one");
}

#[test]
fn figures_differ_within_or_beyond_their_tolerance() {
    let (_folder, run, path) = folder();
    write_baseline(&path, &run, &figures());
    let text = std::fs::read_to_string(&path).expect("read");
    let text = text.replacen("tolerance = 0.0, min", "tolerance = 0.25, min", 1);
    std::fs::write(&path, text).expect("written");
    let file = BaselineFile::read(&path, false).expect("reads");
    let baseline = file.find("a").expect("there");
    assert!(!baseline.is_exact());
    let changes = |spoil: &dyn Fn(&mut Figures)| {
        let mut now = figures();
        spoil(&mut now);
        let mut changes = signal_changes(baseline, &now);
        changes.extend(metric_changes(baseline, &now));
        changes
            .into_iter()
            .map(|change| (change.name, change.within))
            .collect::<Vec<_>>()
    };
    let of = |name: &str, within| vec![(name.to_owned(), within)];
    let x = |statistic: &str, within| of(&format!("truth.x_m {statistic}"), within);
    assert_eq!(
        changes(&|now| now.signals[0].values[0] = -1.25),
        x("min", true)
    );
    assert_eq!(
        changes(&|now| now.signals[0].values[2] = 0.26),
        x("rms", false)
    );
    assert_eq!(
        changes(&|now| now.signals[0].values[3] = f64::NAN),
        x("final", false)
    );
    assert_eq!(
        changes(&|now| now.metrics[0].value = 0.3),
        of("max_abs_x_m 0 s to 1 s", false)
    );
    assert_eq!(
        changes(&|now| now.metrics[0].unit = "mm".into()),
        of("max_abs_x_m 0 s to 1 s", false)
    );
    assert_eq!(
        changes(&|now| now.metrics.clear()),
        of("max_abs_x_m 0 s to 1 s", false)
    );
    let differences = changes(&|now| {
        now.signals.pop();
    });
    assert_eq!(differences.len(), STATISTICS.len());
    assert!(
        differences
            .iter()
            .all(|(name, within)| name.starts_with("internal.never ") && !within)
    );
}

#[test]
fn a_file_without_baselines_is_refused_with_its_location() {
    let (_folder, run, path) = folder();
    let message = BaselineFile::read(&path, false)
        .err()
        .expect("not there")
        .to_string();
    assert!(
        message.contains("cannot read") && message.contains("--update"),
        "{message}"
    );
    write_baseline(&path, &run, &figures());
    let text = std::fs::read_to_string(&path).expect("read");
    for (before, now, expected) in [
        ("schema = 1", "schema = 2", "schema 2 is not supported"),
        ("schema = 1", "schema = 1\nplan = 2", "unknown field `plan`"),
        (
            "tolerance = 0.0, min",
            "tolerance = -1.0, min",
            "`truth.x_m`: a tolerance must be at least 0",
        ),
        ("digest = ", "digest ", "line"),
        ("rms = 1e-300", "rms = \"x\"", "line"),
    ] {
        let spoilt = text.replacen(before, now, 1);
        assert_ne!(spoilt, text);
        std::fs::write(&path, spoilt).expect("written");
        let message = BaselineFile::read(&path, true)
            .err()
            .expect("refused")
            .to_string();
        assert!(
            message.contains(expected),
            "`{expected}` is not in {message}"
        );
    }
    std::fs::write(&path, text).expect("written");
    let file = BaselineFile::read(&path, false).expect("reads");
    let message = file.find("aa").expect_err("no such").to_string();
    assert!(
        message.contains("no baseline `aa`; nearest: `a`"),
        "{message}"
    );
}

//! The band of a baseline behind the curves of a report, and what a cursor reads of it.

use std::path::Path;

use serde_json::Value;
use shared_types::extremes::{larger, smaller};

use super::closer::cells;
use crate::panel::bands::{Baseline, SIGNAL, TOLERANCE};
use crate::panel::browser::Play;
use crate::panel::heavy;
use crate::support::harness::{Rig, text};
use crate::support::mcap_reader::Recording;

/// Returns the least and the greatest of some values.
fn reach(values: &[f64]) -> [f64; 2] {
    let least = values.iter().copied().fold(f64::INFINITY, smaller);
    [
        least,
        values.iter().copied().fold(f64::NEG_INFINITY, larger),
    ]
}

/// Fails unless a row of the table of a page has these pairs of numbers, of seven digits.
fn assert_cells(page: &Value, name: &str, expected: &[[f64; 2]]) {
    let row = cells(page["text"].as_str().expect("text"), name);
    assert_eq!(row.len(), expected.len(), "{row:?}");
    let pairs = row.as_flattened().iter().zip(expected.as_flattened());
    for (cell, expected) in pairs {
        // Differences keep the error of what they are made of, here below 0.1 m.
        assert!((cell - expected).abs() < 2e-8, "{row:?} {expected}");
    }
}

#[test]
fn the_band_of_a_baseline_is_shaded_and_read_at_a_cursor() {
    let rig = Rig::new();
    let baseline = Baseline::new(&rig);
    let heavy = heavy(&rig).recording();
    let written = |name: &str, runs: &[&Path]| {
        let path = rig.path(name);
        let file = ["-o", text(&path)];
        let runs: Vec<&str> = runs.iter().map(|run| text(run)).collect();
        rig.hil(&[&["report"], &runs[..], &file, &baseline.arguments()].concat())
            .expect(0);
        format!("file://{}", path.display())
    };
    // Five seconds at 1 kHz: a bucket has one to three steps.
    let url = written("course.html", &[&heavy]);
    written("both.html", &[&baseline.recording, &heavy]);
    // Without the recording only the range of the whole run is known.
    baseline.edit("recording = ", "# recording = ");
    written("range.html", &[&heavy]);
    let Some(play) = Play::of("report_closer.py", "banded", &url) else {
        return;
    };
    let output = play.result();

    let kept = Recording::open(&baseline.recording).column(SIGNAL);
    let own = Recording::open(&heavy).column(SIGNAL);
    let begin = "Shaded behind the curves: band of baseline spring: its recording and the tolerance of each signal; ";
    for name in ["course", "both"] {
        let label = output[name]["label"].as_str().expect("text");
        assert!(label.starts_with(begin), "{label}");
    }
    let label = output["range"]["label"].as_str().expect("text");
    assert!(
        label.contains("the range of each signal over the whole run"),
        "{label}"
    );
    for name in ["course", "range"] {
        let page = &output[name];
        assert!(page["ink"].as_u64() > Some(1000), "{page}");
        let legend = page["legend"].as_str().expect("text");
        assert!(legend.contains("shaded: baseline spring"), "{legend}");
    }

    // In the steps of its bucket each value is only known to lie between two numbers, and so is the distance.
    let by = |difference: f64| match difference.abs() > TOLERANCE {
        true => difference - TOLERANCE.copysign(difference),
        false => 0.0,
    };
    let expected = |page: &Value| {
        let step = |nth: usize| page["steps"][nth].as_u64().expect("a step") as usize;
        let steps = step(0)..=step(1);
        assert!(steps.contains(&700), "{steps:?}");
        let [value, other] = [&own, &kept].map(|signal| reach(&signal[steps.clone()]));
        let band = [other[0] - TOLERANCE, other[1] + TOLERANCE];
        let between = [value[0] - other[1], value[1] - other[0]];
        [value, band, between.map(by), between]
    };
    let [value, band, outside, _] = expected(&output["course"]);
    assert!(outside[1] > 0.0, "{outside:?}");
    assert_cells(&output["course"], SIGNAL, &[value, band, outside]);
    // Of two runs the difference from the first is read too; that one is the baseline.
    let table = output["both"]["text"].as_str().expect("text");
    let of_it = |line: &&str| line.contains(&format!(": {SIGNAL}\t"));
    let row = table.lines().filter(of_it).nth(1).expect("the second run");
    let (name, _) = row.split_once('\t').expect("cells");
    assert_cells(&output["both"], name, &expected(&output["both"]));

    let [value, ..] = expected(&output["range"]);
    let [least, greatest] = reach(&kept);
    let band = [least - TOLERANCE, greatest + TOLERANCE];
    assert!(band[0] < value[0] && value[1] < band[1]);
    assert_cells(&output["range"], SIGNAL, &[value, band, [0.0; 2]]);
}

//! Zoom, cursors, names and print of a report in a headless Chromium, compared with the records.

use serde_json::{Value, json};
use shared_types::extremes::larger;

use super::page::Page;
use crate::panel::browser::Play;
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

/// The teaching run, 5 s at 1 kHz: the report has three steps in a bucket, and one near what decides a margin.
const SCENARIO: &str = "scenarios/spring-mass.toml";

/// Plays a script on the report of a run; `None` without a browser.
fn played(rig: &Rig, run: &Run, play: &str) -> Option<Value> {
    let page = Page::of(rig, &[run], &[]);
    let url = format!("file://{}", page.path.display());
    Some(Play::of("report_closer.py", play, &url)?.result())
}

/// Returns the two ends of a range.
fn range(result: &Value) -> [f64; 2] {
    [0, 1].map(|nth| result[nth].as_f64().unwrap_or_else(|| panic!("{result}")))
}

fn assert_near(range: [f64; 2], expected: [f64; 2], tolerance: f64) {
    let mut pairs = range.into_iter().zip(expected);
    let is_near = pairs.all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(is_near, "{range:?} is not {expected:?}");
}

#[test]
fn every_plot_follows_a_zoom_by_any_means() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "zoom") else {
        return;
    };
    let dragged = range(&output["dragged"]);
    assert_near(dragged, [2.0, 3.0], 0.02);
    assert_near(range(&output["fields"]), dragged, 1e-6);
    let wheeled = range(&output["wheeled"]);
    assert_near([(wheeled[0] + wheeled[1]) / 2.0; 2], [2.5; 2], 0.02);
    let panned = range(&output["panned"]);
    let width = wheeled[1] - wheeled[0];
    assert_near(panned, wheeled.map(|end| end - width / 4.0), width / 50.0);
    assert_eq!(
        output["beside"], output["panned"],
        "keys are those of plots"
    );
    assert_near(range(&output["keyed"]), [1.75, 2.75], 1e-9);
    assert_near(range(&output["moved"]), [1.85, 2.85], 1e-9);
    assert_near(range(&output["double"]), [0.0, 5.0], 1e-9);
    assert_eq!(output["cursors"], false, "a double click leaves no cursor");
    assert_eq!(output["overflow"], 0);
    // Each finger moved by a quarter of the width: a tenth of it is now six tenths.
    assert_near(range(&output["pinched"]), [2.5 - 0.417, 2.5 + 0.417], 0.15);
}

/// Returns the cells of a signal in a copied table, each with the values between which it is.
fn cells(text: &str, name: &str) -> Vec<[f64; 2]> {
    let row = text.lines().find(|line| line.starts_with(name));
    let row = row.unwrap_or_else(|| panic!("no {name} in {text}"));
    let number = |text: &str| text.parse().unwrap_or_else(|_| panic!("{text} in {row}"));
    let cells = row.split('\t').skip(2);
    let cells = cells.map(|cell| match cell.split_once(" to ") {
        Some((low, high)) => [low, high].map(number),
        None => [number(cell); 2],
    });
    cells.collect()
}

#[test]
fn cursors_measure_from_every_step_and_say_what_the_buckets_leave_open() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "cursors") else {
        return;
    };
    let text = |key: &str| {
        let text = output[key].as_str();
        text.unwrap_or_else(|| panic!("no {key}: {output}"))
    };
    assert!(text("single").contains("at A") && !text("single").contains("mean"));
    assert!(text("one").contains("truth.position_m"), "{output}");
    let number = |key: &str| output[key].as_f64().expect("a number");
    assert!((number("clicked") - 1.5).abs() < 0.02, "{output}");
    assert!((number("middle") - 2.5).abs() < 0.01, "{output}");
    // One bucket on.
    let moved = number("next") - number("middle");
    assert!((0.001..0.0031).contains(&moved), "{output}");
    let [first, last] = range(&output["steps"]).map(|step| step as usize);
    assert!((1248..=1250).contains(&first), "{output}");
    assert!((1750..=1752).contains(&last), "{output}");
    let steps = last - first + 1;
    let basis = format!(
        "mean, RMS and peak to peak from every step from {} s to {} s ({steps})",
        first as f64 / 1000.0,
        last as f64 / 1000.0
    );
    assert!(text("basis").starts_with(&basis), "{basis}: {output}");
    let recording = Recording::open(&run.recording());
    for name in [
        "truth.position_m",
        "command.force_n",
        "reference.position_m",
    ] {
        let part = &recording.column(name)[first..=last];
        let [at_a, at_b, difference, mean, rms, height] = cells(text("text"), name)[..] else {
            panic!("{output}");
        };
        let count = part.len() as f64;
        let ends = |values: &[f64]| {
            let least = values.iter().copied().min_by(f64::total_cmp).expect("some");
            [
                least,
                values.iter().copied().max_by(f64::total_cmp).expect("some"),
            ]
        };
        let [least, greatest] = ends(part);
        // Single precision, and seven digits of a mean.
        let room = 6e-7 * larger(least.abs(), greatest.abs()) + 1e-18;
        let holds = |cell: [f64; 2], value: f64| cell[0] - room <= value && value <= cell[1] + room;
        assert!(
            holds(at_a, part[0]) && at_a[1] - at_a[0] <= greatest - least,
            "{name}"
        );
        let is_in_last = part[part.len() - 3..]
            .iter()
            .any(|value| holds(at_b, *value));
        assert!(is_in_last, "{name}: {at_b:?}");
        let between = part[part.len() - 1] - part[0];
        assert!(
            difference[0] - 2.0 * room <= between && between <= difference[1] + 2.0 * room,
            "{name}: {difference:?}"
        );
        let expected = part.iter().sum::<f64>() / count;
        let tolerance = room + 1e-5 * (greatest - least);
        assert!(
            (mean[0] - expected).abs() <= tolerance,
            "{name}: {mean:?} {expected}"
        );
        let expected = (part.iter().map(|value| value * value).sum::<f64>() / count).sqrt();
        assert!(
            (rms[0] - expected).abs() <= tolerance,
            "{name}: {rms:?} {expected}"
        );
        assert!(
            (height[0] - (greatest - least)).abs() <= 3.0 * room,
            "{name}"
        );
    }
    assert_eq!(output["cleared"], true);
    assert!(text("legend").ends_with('m'), "the value at A: {output}");

    // Pasted into the scenario, the requirement is valid, holds, and has next to no margin left.
    let requirement = text("requirement");
    let pasted = format!("{}\n{requirement}", shipped(SCENARIO));
    let scenario = rig.write("pasted.toml", &pasted);
    let path = scenario.to_str().expect("text");
    let judged = rig.run(path).expect(0);
    let judged = judged.summary()["requirements"][2].clone();
    assert_eq!(judged["verdict"], "pass");
    let margin = judged["robustness"].as_f64().expect("a margin");
    assert!((0.0..1e-8).contains(&margin), "{judged}");
}

#[test]
fn everything_is_found_by_its_name_without_a_pointer() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "palette") else {
        return;
    };
    assert_eq!(output["signal"], json!(["applied.force_n", "signal"]));
    assert_eq!(output["added"], "applied.force_n [N]");
    assert_eq!(output["focused"], "Plot: applied.force_n [N]");
    assert_eq!(output["requirement"][1], "requirement");
    let settles = &run.summary()["requirements"][0];
    let at_s = settles["at_s"].as_f64().expect("a time");
    let [from, to] = range(&output["range"]);
    assert!((from..=to).contains(&at_s) && to - from < 0.2, "{output}");
    assert_eq!(output["whole"], json!(["Whole run", "action"]));
    assert_near(range(&output["all"]), [0.0, 5.0], 1e-9);
}

#[test]
fn a_print_is_black_on_white_without_controls() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "print") else {
        return;
    };
    assert_ne!(output["before"], "rgb(255, 255, 255)", "a dark page");
    assert_eq!(
        output["after"],
        json!(["rgb(255, 255, 255)", "rgb(0, 0, 0)"])
    );
    assert_eq!(output["controls"], json!([]));
    assert_eq!(output["unbroken"], true);
}

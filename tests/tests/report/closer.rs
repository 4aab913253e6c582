//! Zoom, cursors, names and print of a report in a headless Chromium, compared with the records.

use serde_json::{Value, json};
use shared_types::extremes::larger;

use super::page::Page;
use crate::panel::browser::Play;
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::{Recording, intervals};
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
pub(super) fn cells(text: &str, name: &str) -> Vec<[f64; 2]> {
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
    assert!((0.0009..0.0031).contains(&moved), "{output}");
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
        let [at_a, at_b, difference, mean, rms, height, low, high] = cells(text("text"), name)[..]
        else {
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
        assert!((low[0] - least).abs() <= room, "{name}: {low:?} {least}");
        assert!(
            (high[0] - greatest).abs() <= room,
            "{name}: {high:?} {greatest}"
        );
    }
    assert_eq!(output["cleared"], true);
    for pair in output["pointer"].as_array().expect("readings") {
        assert_eq!(pair[0], pair[1], "the bucket of the pointer: {output}");
    }
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
fn a_formula_of_the_command_line_lists_and_marks_the_intervals_in_which_it_holds() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let formula = "abs(tracking_error_m) > 2e-3 and truth.position_m < 0.011";
    let page = Page::of(
        &rig,
        &[&run],
        &["--where", formula, "--where", "truth.position_m > 1"],
    );
    let recording = Recording::open(&run.recording());
    let truth = recording.column("truth.position_m");
    let reference = recording.column("reference.position_m");
    let both = truth.iter().zip(&reference);
    let holds = both.map(|(truth, reference)| (truth - reference).abs() > 2e-3 && *truth < 0.011);
    let holds: Vec<bool> = holds.collect();
    let count = holds.iter().filter(|holds| **holds).count();
    let intervals = intervals(0, &holds);
    assert!(!intervals.is_empty());
    let time = |step: u64| step as f64 / 1000.0;
    // The second formula holds nowhere.
    let searches = &page.data["where"];
    assert_eq!(
        (&searches[0]["formula"], &searches[1]["runs"]),
        (&json!(formula), &json!([[]]))
    );
    assert_eq!(searches[0]["count"], intervals.len());
    let spans: Vec<[f64; 2]> = intervals
        .iter()
        .map(|[a, b]| [time(*a), time(b + 1)])
        .collect();
    assert_eq!(searches[0]["runs"], json!([spans]));
    let url = format!("file://{}", page.path.display());
    let Some(play) = Play::of("report_closer.py", "where", &url) else {
        return;
    };
    let output = play.result();
    let texts = intervals.iter().map(|[first, last]| match first == last {
        true => format!("{} s", time(*first)),
        false => format!("{} s to {} s", time(*first), time(*last)),
    });
    assert_eq!(output["list"], json!(texts.collect::<Vec<_>>()));
    let says = output["says"].as_str().expect("text");
    assert!(
        says.ends_with(&format!("% of {} steps", truth.len())),
        "{says}"
    );
    // The row of the first formula is the lowest one.
    let share = count as f64 / truth.len() as f64;
    let marked = output["marked"].as_array().expect("plots");
    assert!(!marked.is_empty());
    for marked in marked {
        let marked = marked.as_f64().expect("a share");
        assert!(
            (marked - share).abs() < 0.02,
            "{marked} of {share}: {output}"
        );
    }
    assert_eq!(output["entry"][0], formula);
    let [from, to] = range(&output["range"]);
    assert!(
        from <= spans[0][0] && spans[0][1] <= to && to - from < 5.0,
        "{output}"
    );
    assert_eq!(output["overflow"], 0);
}

#[test]
fn a_wrong_formula_of_the_command_line_is_refused_with_the_text_of_the_panel() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let folder = run.folder.to_str().expect("text");
    for (formula, part) in [
        ("truth.nothing > 1", "truth.nothing"),
        ("truth.postion_m > 1", "nearest: `truth.position_m`"),
        ("always(truth.position_m < 1)", "give it bounds"),
        ("truth.position_m >", "expected"),
        ("truth.position_m < 3 N", "compared"),
    ] {
        let out = rig.path("none.html");
        let file = out.to_str().expect("text");
        let refusal = rig
            .hil(&["report", folder, "-o", file, "--where", formula])
            .expect(2);
        refusal.says(&[&format!("--where `{formula}`"), part]);
        assert!(!out.exists());
    }
    let many: Vec<&str> = ["--where", "truth.position_m > 1"].repeat(9);
    rig.hil(&[&["report", folder], &many[..]].concat())
        .expect(2)
        .says(&["9 formulas are too many"]);
}

#[test]
fn a_legend_stands_still_under_the_mouse_and_bars_of_several_runs_are_told_apart() {
    let rig = Rig::new();
    let light = rig.run(SCENARIO).expect(0);
    let heavy = rig
        .run(&format!("{SCENARIO} --set plant.parameters.mass_kg=1.2"))
        .expect(0);
    let page = Page::of(&rig, &[&light, &heavy], &[]);
    let url = format!("file://{}", page.path.display());
    let Some(play) = Play::of("report_closer.py", "legend", &url) else {
        return;
    };
    let output = play.result();
    assert_eq!(output["heights"], 1, "{output}");
    assert_ne!(output["value"], "", "the value under the mouse");
    assert_eq!(output["hidden"], json!(["1", "line-through", "1px"]));
    // Both requirements pass in both runs: each bar names its run, and has its colour.
    let bars = output["bars"].as_array().expect("bars");
    let runs = |name: &str| -> Vec<(&Value, &Value)> {
        let of_it = bars.iter().filter(|bar| bar[0] == name);
        of_it.map(|bar| (&bar[1], &bar[2])).collect()
    };
    let settles = runs("settles");
    let [(a, first), (b, second)] = settles[..] else {
        panic!("{output}");
    };
    assert!(a != b && first != second, "{output}");
    assert!(a.is_string() && b.is_string(), "{output}");
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

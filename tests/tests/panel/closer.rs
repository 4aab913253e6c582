//! Zoom and search in a headless Chromium, compared with the records.

use serde_json::{Value, json};

use super::browser::{Play, assert_drawn, begun};
use super::stream::held;
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, Run, until};
use crate::support::mcap_reader::{Recording, intervals};
use crate::support::programs::shipped;

/// Plays a script on the page of a recorded run; `None` without a browser.
pub(super) fn played(rig: &Rig, run: &Run, script: &str, arguments: &[&str]) -> Option<Value> {
    let panel = Panel::recorded(rig, &run.folder, arguments);
    Some(Play::closer(script, &panel.url)?.result())
}

/// Returns the two ends of a range.
pub(super) fn range(result: &Value) -> [f64; 2] {
    [0, 1].map(|nth| result[nth].as_f64().unwrap_or_else(|| panic!("{result}")))
}

pub(super) fn assert_near(range: [f64; 2], expected: [f64; 2], tolerance: f64) {
    let is_near = |(a, b): (f64, f64)| (a - b).abs() <= tolerance;
    let is_so = range.into_iter().zip(expected).all(is_near);
    assert!(is_so, "{range:?} is not {expected:?}");
}

#[test]
fn every_plot_follows_a_zoom_by_any_means_down_to_each_step() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "zoom", &[]) else {
        return;
    };
    assert_eq!(output["controls"], json!([]), "{output}");
    assert_drawn(&output["ink"]);
    assert_near(range(&output["whole"]), [0.0, 5.0], 1e-9);
    let dragged = range(&output["dragged"]);
    assert_near(dragged, [2.0, 3.0], 0.02);
    let tied = output["tied"].as_array().expect("plots");
    assert!(tied.len() > 2, "{output}");
    for plot in tied {
        assert_near(range(plot), dragged, 1e-9);
    }
    // About the pointer, which was in the middle until the labels of the axis became longer.
    let wheeled = range(&output["wheeled"]);
    assert!(wheeled[1] - wheeled[0] < 0.1, "{output}");
    assert_near([(wheeled[0] + wheeled[1]) / 2.0; 2], [2.5; 2], 0.1);
    assert_eq!(
        output["after scroll"], output["wheeled"],
        "a wheel alone scrolls"
    );
    let width = wheeled[1] - wheeled[0];
    let panned = range(&output["panned"]);
    assert_near(panned, wheeled.map(|end| end - width / 4.0), width / 50.0);
    assert_near(range(&output["typed"]), [1.2345, 1.2645], 1e-9);
    assert_near(range(&output["key panned"]), [1.2375, 1.2675], 1e-9);
    assert_near(range(&output["key zoomed"]), [1.2225, 1.2825], 1e-9);
    assert_eq!(
        output["refused"],
        json!(["a range ends after it begins", "1.2825"])
    );
    assert_eq!(
        output["no number"],
        json!(["`7,5` is no number of seconds", "1.2825"])
    );
    assert_near(range(&output["beyond"]), [1.2225, 5.0], 1e-9);
    assert_near(range(&output["double"]), [0.0, 5.0], 1e-9);
    assert_eq!(output["cursors"], false, "a double click leaves no cursor");
    assert_eq!(output["log"], json!(["true", 3]));
    assert_eq!(output["overflow"], 0);
    // Each finger moved by a quarter of the width: a tenth of it is now six tenths.
    let pinched = range(&output["pinched"]);
    assert_near(pinched, [2.5 - 0.417, 2.5 + 0.417], 0.15);
    let swiped = range(&output["swiped"]);
    let moved = 0.3 * (pinched[1] - pinched[0]);
    assert_near(swiped, pinched.map(|end| end + moved), 0.05);

    // What is drawn is what was recorded.
    let recording = Recording::open(&run.recording());
    assert_eq!(assert_recorded(&output["exact"], &recording), 1);
    assert!(assert_recorded(&output["overview"], &recording) > 1);
}

/// Compares what a plot draws of a signal with its records; returns the steps of a stretch.
fn assert_recorded(drawn: &Value, recording: &Recording) -> usize {
    let column = recording.column(drawn["name"].as_str().expect("a name"));
    let [first, length] = ["first", "length"].map(|key| {
        let number = drawn[key].as_u64().expect("a number");
        usize::try_from(number).expect("small")
    });
    let [least, greatest] =
        ["least", "greatest"].map(|key| drawn[key].as_array().expect("numbers"));
    assert!(least.len() > 10, "{drawn}");
    for (nth, (least, greatest)) in (first..).zip(least.iter().zip(greatest)) {
        let values = &column[nth * length..((nth + 1) * length).min(column.len())];
        let values = || values.iter().copied().filter(|value| value.is_finite());
        assert_eq!(least.as_f64(), values().min_by(f64::total_cmp));
        assert_eq!(greatest.as_f64(), values().max_by(f64::total_cmp));
    }
    length
}

#[test]
fn everything_is_found_by_its_name_and_a_fault_asks_before_it_is_injected() {
    let rig = Rig::new();
    let dropout = "dropout measured.position_m --duration 0.05";
    let (run, panel) = begun(&rig, "", &["--inject", dropout]);
    let Some(play) = Play::closer("palette", &panel.url) else {
        return;
    };
    let output = play.result();
    assert_eq!(output["dropout"], json!([dropout, "prepared", "fault"]));
    assert_eq!(output["dropouts"][0], "prepared", "{output}");
    assert_eq!(output["armed"], json!([true, dropout]));
    assert_eq!(output["let go"], false, "Enter does not confirm");
    assert_eq!(output["escaped"], json!([0, false]));
    assert_eq!(output["kind"][0], "stuck");
    let kind = output["kind armed"].as_str().expect("words");
    assert!(kind.starts_with("stuck"), "{output}");
    assert_eq!(output["mass"][0], "plant.parameters.mass_kg");
    assert_eq!(output["plot"][0], "Force");
    assert_eq!(output["second"], 1);
    assert_eq!(output["focused"][0], "Plot: Force");
    assert_ne!(output["focused"][1], "none", "the focus is visible");
    assert_eq!(output["nothing"], json!([]));
    drop(panel);
    rig.in_session("resume").expect(0);
    let summary = run.finish().summary();
    let faults = summary["faults"].as_array().expect("faults");
    assert_eq!(faults.len(), 1, "the rest was let go: {summary}");
    assert_eq!(faults[0]["kind"], "dropout");
    assert_eq!(summary["changes"][0]["set"][0]["value"], 1.5);
}

#[test]
fn any_signal_of_a_recorded_run_is_drawn_and_a_requirement_leads_to_its_time() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "names", &[]) else {
        return;
    };
    assert_eq!(output["entry"][0], "applied.force_n");
    assert_eq!(output["plot"]["name"], "applied.force_n");
    assert_recorded(&output["plot"], &Recording::open(&run.recording()));
    let settles = &run.summary()["requirements"][0];
    let at_s = settles["at_s"].as_f64().expect("a time");
    let cursor = output["cursor"].as_str().expect("a time");
    assert_eq!(cursor.parse::<f64>().expect("a number"), at_s);
    let [from, to] = range(&output["range"]);
    assert!((from..=to).contains(&at_s) && to - from < 2.0, "{output}");
}

#[test]
fn a_formula_lists_and_marks_the_intervals_in_which_it_holds() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let Some(output) = played(&rig, &run, "where", &[]) else {
        return;
    };
    let recording = Recording::open(&run.recording());
    let (truth, reference) = (
        recording.column("truth.position_m"),
        recording.column("reference.position_m"),
    );
    let both = truth.iter().zip(&reference);
    let holds = both.map(|(truth, reference)| (truth - reference).abs() > 2e-3 && *truth < 0.011);
    let holds: Vec<bool> = holds.collect();
    let count = holds.iter().filter(|holds| **holds).count();
    let intervals = intervals(0, &holds);
    assert!(!intervals.is_empty());
    let text = |step: u64| format!("{}", step as f64 / 1000.0);
    let expected = intervals.iter().map(|[first, last]| match first == last {
        true => format!("{} s", text(*first)),
        false => format!("{} s to {} s", text(*first), text(*last)),
    });
    let expected: Vec<String> = expected.collect();
    assert_eq!(output["list"], json!(expected));
    let says = output["says"].as_str().expect("text");
    let plural = if intervals.len() == 1 { "" } else { "s" };
    let begins = format!("{} interval{plural}, ", intervals.len());
    assert!(
        says.starts_with(&begins) && says.ends_with("% of 5001 steps"),
        "{says}"
    );
    let share = count as f64 / truth.len() as f64;
    for marked in output["marked"].as_array().expect("plots") {
        let marked = marked.as_f64().expect("a share");
        assert!(
            (marked - share).abs() < 0.02,
            "{marked} of {share}: {output}"
        );
    }
    let range = range(&output["range"]);
    let [first, last] = intervals[0].map(|step| step as f64 / 1000.0);
    assert!(range[0] <= first && last <= range[1], "{output}");
    for (formula, part) in [
        ("truth.nothing > 1", "truth.nothing"),
        ("always(truth.position_m < 1)", "give it bounds"),
        ("truth.position_m >", "expected"),
        ("truth.position_m < 3 N", "compared"),
    ] {
        assert_eq!(output[formula][0], "error", "{output}");
        let text = output[formula][1].as_str().expect("text");
        assert!(text.contains(part), "{formula}: {text}");
    }
    assert_eq!(output["top"], json!([0, true]), "the first interval first");
    assert_eq!(output["toast"], "", "an answer in sight is not repeated");
    let hidden = &output["out of sight"];
    assert_eq!(hidden[0], hidden[1], "{output}");
    assert!(hidden[1].as_str().expect("text").contains("interval"));
    assert_ne!(output["example"], "error", "the example is of this run");
}

#[test]
fn a_checkpoint_before_a_cursor_has_its_command_and_its_branch_which_asks_first() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} --checkpoint-at 1.2 --checkpoint-at 3"));
    let run = run.expect(0);
    let Some(output) = played(&rig, &run, "branch", &[]) else {
        return;
    };
    let folder = |step: u64| run.folder.join(format!("checkpoint-{step}"));
    let ends_with = |key: &str, step: u64, more: &str| {
        let text = output[key].as_str().expect("text").trim_end();
        let path = folder(step).display().to_string();
        let is_plain = path
            .chars()
            .all(|one| one.is_ascii_alphanumeric() || "_.,:+/-".contains(one));
        let word = if is_plain { path } else { format!("'{path}'") };
        assert_eq!(text, format!("hil run --from {word}{more}"));
    };
    ends_with("last", 3000, "");
    ends_with("command", 1200, " --pause-at 1.5 --panel");
    ends_with("clipboard", 1200, " --pause-at 1.5 --panel");
    assert_eq!(
        output["armed"],
        "Branch from step 1500 (1.5 s)?\ny starts a new run that is held there, any other key cancels."
    );
    assert_eq!(output["let go"], json!([false, "no branch", 0]));
    let held = output["held"].as_str().expect("text");
    let expected = "step 1500: repeated from the checkpoint before step 1200";
    assert!(held.contains(expected), "{held}");
    let url = output["panel"].as_str().expect("an address");
    assert!(
        url.starts_with("http://127.0.0.1:") && url.contains("/#"),
        "{url}"
    );
    assert_eq!(output["again"], true, "one branch at a time");
    until("the branch ends with its panel", || {
        rig.processes().is_empty()
    });
    assert_eq!(
        output["says"],
        "From step 1200 (1.2 s): 0.3 s before cursor A."
    );
    assert_eq!(output["none"][1], false);
    let path = folder(1200).display().to_string();
    let again = rig.path("again");
    let words = [
        "run",
        "--from",
        &path,
        "--out",
        again.to_str().expect("text"),
    ];
    rig.hil(&words).expect(0);
    let summary = std::fs::read_to_string(again.join("summary.json")).expect("a summary");
    let summary: Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["digest"], run.digest());
}

#[test]
fn log_and_answers_are_in_sight_groups_fold_and_legends_stand_still() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &[]);
    let Some(play) = Play::closer("fold", &panel.url) else {
        return;
    };
    let output = play.result();
    assert!(output["log"].as_f64() <= Some(800.0), "{output}");
    let toast = &output["toast"];
    let bottom = toast["y"].as_f64().zip(toast["height"].as_f64());
    assert!(
        bottom.is_some_and(|(y, height)| y > 0.0 && y + height <= 800.0),
        "{output}"
    );
    assert!(
        output["text"]
            .as_str()
            .expect("text")
            .starts_with("paused before step")
    );
    assert_eq!(output["heights"], 1, "a legend moved: {output}");
    assert_eq!(
        [&output["folded"], &output["again"], &output["opened"]],
        [&json!(false), &json!(false), &json!(true)]
    );
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn nothing_moves_under_the_pointer_however_long_values_units_and_notes_become() {
    let rig = Rig::new();
    // Long names; values that change their sign, their length and their prefix, and ripple on a large one.
    let position = "\"truth.position_m\", \"measured.position_m\", \"reference.position_m\"";
    let signals = [
        (
            "grows_from_nothing_to_a_large_value_m",
            "m",
            "-1e-9 - truth.position_m * 123.45678",
            position,
        ),
        (
            "swings_about_zero_with_every_digit_mps",
            "m/s",
            "-123.45678 * truth.velocity_mps",
            "\"truth.velocity_mps\"",
        ),
        (
            "ripples_on_something_large_pa",
            "Pa",
            "1e5 + 100 * truth.velocity_mps",
            "",
        ),
    ];
    let mut text = shipped(SCENARIO);
    for (name, unit, expression, _) in signals {
        text += &format!(
            "\n[[derived]]\nname = \"{name}\"\nunit = \"{unit}\"\nexpression = \"{expression}\"\n"
        );
    }
    for (name, _, _, others) in signals {
        text += &format!(
            "\n[[plots]]\ntitle = \"{name} beside others\"\nsignals = [\"{name}\", {others}]\n"
        );
    }
    let scenario = rig.write("long.toml", &text);
    let run = held(&rig, &scenario, "--pause-at 0.001");
    let panel = Panel::start(&rig, &[]);
    let Some(play) = Play::closer("still", &panel.url) else {
        return;
    };
    let output = play.result();
    for width in ["1280", "700", "390"] {
        let output = &output[width];
        let places = output["places"].as_array().expect("places");
        assert_eq!(places.len(), 1, "{width}: {output}");
        let values = output["values"].as_array().expect("values");
        let values = || values.iter().filter_map(Value::as_str);
        assert!(values().any(|one| one.starts_with('-')), "{output}");
        assert!(values().any(|one| one.contains(" to ")), "{output}");
        assert_eq!(output["overflow"], 0, "{width}");
    }
    assert!(output["1280"]["notes"].as_array().is_some_and(|notes| {
        notes.iter().any(|one| {
            one.as_str()
                .is_some_and(|one| one.contains("plus the number"))
        })
    }));
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

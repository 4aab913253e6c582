//! Plots arranged on a page and kept with the scenario: what its file gets, and what new runs draw of it.

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::browser::{Play, assert_drawn, begun};
use super::recorded::Page;
use super::{Panel, SCENARIO};
use crate::report;
use crate::support::harness::{Rig, Run};
use crate::support::programs::shipped;

/// Copies the teaching scenario, and runs the copy.
fn run_of_copy(rig: &Rig) -> (PathBuf, Run) {
    let path = rig.write("own.toml", &shipped(SCENARIO));
    let run = rig.run(path.to_str().expect("text")).expect(0);
    (path, run)
}

/// Returns titles and signals of plots over signals, as pages and reports have them.
fn plots<'a>(all: impl IntoIterator<Item = &'a Value>, names: impl Fn(&Value) -> Value) -> Value {
    let of_signals = all.into_iter().filter(|plot| plot["section"] != "Loop");
    let plots = of_signals.map(|plot| {
        let signals = plot["signals"].as_array().expect("signals").iter();
        let signals: Vec<Value> = signals.map(&names).collect();
        json!({ "title": plot["title"], "signals": signals })
    });
    plots.collect()
}

#[test]
fn plots_arranged_by_hand_are_those_of_the_next_run() {
    let rig = Rig::new();
    let (path, run) = run_of_copy(&rig);
    let mode = std::fs::Permissions::from_mode(0o640);
    std::fs::set_permissions(&path, mode).expect("our file");
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let Some(play) = Play::closer("arrange", &panel.url) else {
        return;
    };
    let output = play.result();
    drop(panel);
    let list = |key: &str| output[key].as_array().expect("plots").clone();
    let before = list("before");
    assert_eq!(
        output["closed"], 0,
        "plots have controls only when asked for"
    );
    let mut moved = before.clone();
    moved.swap(0, 1);
    assert_eq!(list("moved"), moved);
    assert_eq!(output["focus"], "Plot: Position, wanted and true");
    let count = before.len();
    let says = format!("Position, wanted and true: place 2 of {count}");
    assert_eq!(output["says"], says);
    assert_eq!(output["added"], "Add a signal to Force of the actuator");

    let mut expected = vec![
        json!({ "title": "Force of the actuator", "signals": ["command.force_n", "applied.force_n"] }),
        json!({ "title": "truth.velocity_mps", "signals": ["truth.velocity_mps"] }),
        json!({ "title": "Position, wanted and true", "signals": ["truth.position_m"] }),
    ];
    expected.extend_from_slice(&before[2..count - 1]);
    assert_eq!(list("after"), expected);
    assert_eq!(list("removed"), expected);
    assert_eq!(output["undone"], output["last"]);
    assert_eq!(output["last"], before[count - 1]["title"]);
    assert_drawn(&output["ink"]);
    assert_eq!(list("reloaded"), expected);
    assert_eq!(list("reset"), before);
    assert_eq!(output["overflow"], 0);

    // What is copied is what is written.
    assert_eq!(output["toml"], output["clipboard"]);
    let toml = output["toml"].as_str().expect("text");
    assert!(toml.starts_with("further_plots = false\n"), "{toml}");
    let armed = output["armed"].as_str().expect("text");
    assert!(armed.contains(path.to_str().expect("text")), "{armed}");
    assert_eq!(output["let go"], json!([false, "not written", "shown"]));
    let says = output["written"].as_str().expect("text");
    assert!(says.starts_with("Written to"), "{says}");

    // Everything else of the file is as it was, comments and permissions too.
    let text = std::fs::read_to_string(&path).expect("text");
    let (of_others, _) = shipped(SCENARIO)
        .split_once("# What `hil report`")
        .map(|(a, b)| (a.to_owned(), b.to_owned()))
        .expect("plots");
    assert!(
        text.replacen("further_plots = false\n", "", 1)
            .starts_with(&of_others),
        "{text}"
    );
    assert!(text.contains("# What `hil report` begins with."), "{text}");
    let mode = std::fs::metadata(&path)
        .expect("a file")
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o640);

    // New runs draw these plots in this order, and no others of signals.
    expected.swap(0, 1);
    assert_eq!(list("again"), expected);
    let run = rig.run(path.to_str().expect("text")).expect(0);
    let page = report::page::Page::of(&rig, &[&run], &[]);
    assert_eq!(plots(page.plots(), Value::clone), json!(expected));
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let about = Page::open(&panel.url).about;
    let name =
        |place: &Value| about["signals"][place.as_u64().expect("a place") as usize]["name"].clone();
    let drawn = plots(about["plots"].as_array().expect("plots"), name);
    assert_eq!(drawn, json!(expected));
}

/// Asks a panel to keep a single plot of the force.
fn keep(page: &mut Page, title: &str, write: bool) -> Value {
    let signals = page.about["signals"].as_array().expect("signals");
    let place = signals
        .iter()
        .position(|one| one["name"] == "command.force_n");
    let plot = json!({ "title": title, "was": "Force", "signals": [place.expect("a force")], "log": true });
    page.say(&json!({ "ask": "keep", "number": 3, "plots": [plot], "write": write }));
    let answer = page.hear("kept");
    assert_eq!(answer["number"], 3);
    answer
}

fn assert_refused(page: &mut Page, path: &Path, reason: &str) {
    let text = std::fs::read_to_string(path).ok();
    let answer = keep(page, "Power", true);
    let why = answer["refused"].as_str().expect("a reason");
    assert!(why.contains(reason), "{why}");
    assert_eq!(answer["is_written"], false);
    // It can still be copied.
    let toml = answer["toml"].as_str().expect("text");
    assert!(toml.contains("title = \"Power\""), "{toml}");
    assert_eq!(std::fs::read_to_string(path).ok(), text);
}

#[test]
fn a_file_that_is_not_the_runs_own_is_not_written() {
    let rig = Rig::new();
    let (path, run) = run_of_copy(&rig);
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let mut page = Page::open(&panel.url);
    let set_mode = |mode| {
        let mode = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(&path, mode).expect("our file");
    };
    set_mode(0o444);
    assert_refused(&mut page, &path, "is read-only");
    set_mode(0o644);
    // Only the superuser can give a file away.
    if chown(&path, Some(65_533), None).is_ok() {
        assert_refused(&mut page, &path, "belongs to another user");
        chown(&path, Some(0), None).expect("ours again");
    }
    let own = std::fs::read_to_string(&path).expect("text");
    std::fs::write(&path, format!("{own}# a note\n")).expect("written");
    assert_refused(&mut page, &path, "has changed since the run");
    std::fs::remove_file(&path).expect("our file");
    assert_refused(&mut page, &path, "cannot be read: No such file");
    std::fs::write(&path, &own).expect("written");
    let answer = keep(&mut page, "Power", false);
    assert_eq!(
        (&answer["refused"], &answer["is_written"]),
        (&Value::Null, &json!(false))
    );
    assert_eq!(std::fs::read_to_string(&path).expect("text"), own);

    // A run that repeats another has no file of its own.
    let folder = run.folder.to_str().expect("text");
    let twice = json!([
        { "title": "A", "was": null, "signals": [0], "log": false },
        { "title": "A", "was": null, "signals": [1], "log": false },
    ]);
    page.say(&json!({ "ask": "keep", "number": 4, "plots": twice, "write": true }));
    let error = page.hear("kept")["error"].to_string();
    assert!(error.contains("two plots are called `A`"), "{error}");
    drop((page, panel));
    let out = rig.path("again");
    rig.hil(&["rerun", folder, "--out", out.to_str().expect("text")])
        .expect(0);
    let panel = Panel::recorded(&rig, &out, &[]);
    assert_refused(
        &mut Page::open(&panel.url),
        &path,
        "names no file of a scenario",
    );
}

#[test]
fn a_session_keeps_plots_with_its_scenario_too() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &[]);
    let mut page = Page::open(&panel.url);
    let answer = keep(&mut page, "Power", false);
    let file = answer["file"]
        .as_str()
        .unwrap_or_else(|| panic!("{answer}"));
    assert!(file.ends_with(SCENARIO), "{answer}");
    let toml = answer["toml"].as_str().expect("text");
    assert!(
        toml.contains("title = \"Power\"\nsignals = [\"command.force_n\"]\nscale = \"log\""),
        "{toml}"
    );
    drop((page, panel));
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

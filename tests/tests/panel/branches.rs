//! Branches: new runs that repeat another one up to a step, with the same bits or with a reason, and leave nothing.

use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::{Value, json};

use super::recorded::Page;
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, Run, send, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program_of_tests, shipped};

const BIAS: &str = "bias measured.position_m 0.001";

/// Branch as a page receives it.
struct Branch {
    /// Description when it was held.
    about: Value,
    folder: PathBuf,
}

impl Branch {
    /// Starts a branch and waits until it is held.
    fn held(page: &mut Page, step: u64) -> Self {
        let about = asked(page, step);
        assert_eq!(about["state"], "held", "{about}");
        let folder = about["folder"].as_str().expect("a folder").into();
        Self { about, folder }
    }

    /// Runs a command in the session of the branch.
    fn command(&self, rig: &Rig, line: &str) {
        let session = self.about["session"].as_str().expect("a session");
        let words = line.split(' ').chain(["--session", session]);
        rig.beside(&words.collect::<Vec<_>>()).expect(0);
    }

    /// Resumes the branch, waits for its end and returns its summary.
    fn finish(&self, rig: &Rig, page: &mut Page) -> Value {
        self.command(rig, "resume");
        assert_eq!(state(page, &["ended"])["text"], "ended");
        summary(&self.folder)
    }
}

/// Requests a branch and returns its description when it is held or refused.
fn asked(page: &mut Page, step: u64) -> Value {
    page.say(&json!({ "ask": "branch", "step": step }));
    let about = state(page, &["held", "refused"]);
    assert_eq!(about["step"], step);
    about
}

/// Reads until the newest branch has one of these states.
fn state(page: &mut Page, states: &[&str]) -> Value {
    loop {
        let all = page.hear("branches");
        let newest = all["branches"].as_array().expect("a list").last().cloned();
        let newest = newest.expect("a branch");
        if states.contains(&newest["state"].as_str().expect("a state")) {
            return newest;
        }
    }
}

fn summary(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("summary.json")).expect("a summary");
    serde_json::from_str(&text).expect("JSON")
}

/// Runs the shipped scenario with a fault from a time on, without any branch.
fn with_bias(rig: &Rig, at_s: f64) -> Run {
    let fault = format!(
        "\n[[faults]]\nkind = \"bias\"\nat_s = {at_s}\n[[faults.effects]]\ntarget = \"measured.position_m\"\nbias = 0.001\n"
    );
    let scenario = rig.write("with-bias.toml", &format!("{}{fault}", shipped(SCENARIO)));
    // The fault breaks a requirement.
    rig.run(scenario.to_str().expect("text")).expect(1)
}

/// Compares every sample of two runs that the digest covers.
fn assert_same_samples(run: &Path, other: &Path) {
    let [run, other] = [run, other].map(|folder| Recording::open(&folder.join("run.mcap")));
    assert_eq!(run.columns, other.columns);
    for name in run.columns.iter().filter(|name| {
        ["truth.", "measured.", "reference.", "command.", "internal."]
            .iter()
            .any(|group| name.starts_with(group))
    }) {
        let bits = |recording: &Recording| -> Vec<u64> {
            let column = recording.column(name).into_iter();
            column.map(f64::to_bits).collect()
        };
        assert_eq!(bits(&run), bits(&other), "{name}");
    }
}

#[test]
fn a_branch_of_a_recorded_run_has_its_bits_and_ends_with_its_digest() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} --checkpoint-at 1.2 --checkpoint-at 3"));
    let run = run.expect(0);
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let mut page = Page::open(&panel.url);
    for (step, text) in [
        (1500, "repeated from the checkpoint before step 1200"),
        (1200, "repeated from the checkpoint before step 1200"),
        (700, "repeated from the beginning"),
    ] {
        let branch = Branch::held(&mut page, step);
        assert_eq!(branch.about["text"], text);
        let url = branch.about["panel"].as_str().expect("an address");
        let mut own = Page::open(url);
        let mut state = own.hear("state");
        while state["state"] != "paused" {
            state = own.hear("state");
        }
        assert_eq!(state["step"], step);
        drop(own);
        let summary = branch.finish(&rig, &mut page);
        assert_eq!(summary["digest"], run.digest(), "{text}");
        assert_same_samples(&branch.folder, &run.folder);
        let is_resumed = step >= 1200;
        assert_eq!(
            summary["resumed"]["step"],
            if is_resumed { json!(1200) } else { Value::Null }
        );
        let marks = summary["marks"].as_array().expect("marks");
        let name = run
            .folder
            .file_name()
            .expect("a name")
            .to_str()
            .expect("text");
        assert_eq!(marks[0]["step"], step);
        let origin = marks[0]["text"].as_str().expect("text");
        assert!(
            origin.contains(name) && origin.ends_with(&format!("at step {step}")),
            "{origin}"
        );
    }
    assert_eq!(panel.interrupt(), Some(0));
    rig.assert_nothing_left();
}

#[test]
fn a_branch_with_a_fault_equals_a_fresh_run_with_that_fault_in_every_sample() {
    let rig = Rig::new();
    let run = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1.2"))
        .expect(0);
    let fresh = with_bias(&rig, 1.5);
    assert_ne!(fresh.digest(), run.digest());
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let mut page = Page::open(&panel.url);
    let branch = Branch::held(&mut page, 1500);
    branch.command(&rig, &format!("inject {BIAS}"));
    let summary = branch.finish(&rig, &mut page);
    assert_eq!(summary["digest"], fresh.digest());
    assert_eq!(summary["faults"][0]["effective_step"], 1500);
    assert_same_samples(&branch.folder, &fresh.folder);
    assert_eq!(panel.interrupt(), Some(0));
}

#[test]
fn a_held_run_goes_back_behind_a_live_fault_and_repeats_one_before_the_step() {
    let rig = Rig::new();
    let straight = rig.run(SCENARIO).expect(0);
    let biased = with_bias(&rig, 1.5);
    let run = rig.start(&format!("{SCENARIO} --pause-at 1.5"));
    rig.until_held_at(1500);
    rig.in_session(&format!("inject {BIAS}")).expect(0);
    rig.in_session("step 500").expect(0);
    let panel = Panel::start(&rig, &[]);
    let mut page = Page::open(&panel.url);
    // Before the fault there was none.
    let branch = Branch::held(&mut page, 1500);
    assert_eq!(branch.finish(&rig, &mut page)["digest"], straight.digest());
    // Of both runs at the held step, the same future.
    let branch = Branch::held(&mut page, 2000);
    let faulty = branch.finish(&rig, &mut page);
    assert_eq!(faulty["digest"], biased.digest());
    assert_eq!(
        asked(&mut page, 2001)["state"],
        "refused",
        "it has not been there"
    );
    drop(page);
    assert_eq!(panel.interrupt(), Some(130));
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(1);
    assert_eq!(faulty["digest"], run.digest());
    assert_same_samples(&branch.folder, &run.folder);
}

#[test]
fn a_branch_that_is_not_possible_is_refused_with_its_reason() {
    let rig = Rig::new();
    let refused = |run: &Path, step: u64, reason: &str| {
        let panel = Panel::recorded(&rig, run, &[]);
        let about = asked(&mut Page::open(&panel.url), step);
        let text = about["text"].as_str().expect("text");
        assert_eq!(about["state"], "refused", "{about}");
        assert!(text.contains(reason), "{text}");
        assert_eq!(panel.interrupt(), Some(0));
        rig.assert_nothing_left();
    };
    let run = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1.2"))
        .expect(0);
    refused(
        &run.folder,
        5000,
        "is not before the end of the run at step 5000",
    );
    refused(&run.folder, 9000, "step 9000 is not before the end");
    // Another program than that which saved the state.
    let file = run.folder.join("checkpoint-1200/checkpoint.json");
    let mut checkpoint: Value =
        serde_json::from_str(&std::fs::read_to_string(&file).expect("a checkpoint")).expect("JSON");
    checkpoint["plant"]["binary_blake3"] = "0".repeat(64).into();
    std::fs::write(&file, checkpoint.to_string()).expect("written");
    refused(&run.folder, 1500, "is not the binary that saved the state");
    let late = rig.run(&format!(
        "{SCENARIO} --clock realtime --set run.overrun=skip --set requirements=[]"
    ));
    refused(&late.folder, 100, "the run was in real time");
    let part = rig.run(&format!("{SCENARIO} --record-every 10"));
    refused(&part.expect(0).folder, 100, "record");
    // A law that reads the clock.
    let law = program_of_tests("clock-reading-controller");
    let scenario = rig.write(
        "clock.toml",
        "schema = 1\nname = \"clock\"\n[run]\nduration_s = 1.0\nrate_hz = 1000\nseed = 7\n[plant]\nmodel = \"spring-mass\"\n[[stimuli]]\ntarget = \"position_m\"\nkind = \"sine\"\namplitude = 0.01\nfrequency_hz = 2\n[controller]\nlaw = \"reads-clock\"\n",
    );
    let clock = rig.run(&format!(
        "{} --controller-bin {}",
        scenario.display(),
        law.display()
    ));
    refused(
        &clock.expect(0).folder,
        500,
        "not repeatable: the new run has other bits before step 500",
    );
}

#[test]
fn a_branch_ends_with_the_panel_that_started_it() {
    let rig = Rig::new();
    let run = rig
        .run(&format!("{SCENARIO} --checkpoint-at 1.2"))
        .expect(0);
    for signal in [Signal::INT, Signal::TERM, Signal::KILL] {
        let mut panel = Panel::recorded(&rig, &run.folder, &[]);
        let mut page = Page::open(&panel.url);
        let branch = Branch::held(&mut page, 1500);
        let second = asked(&mut page, 1300);
        assert_eq!(
            second["text"],
            "another branch of this panel is alive; end it first"
        );
        send(panel.process.id(), signal);
        panel.wait();
        until("the branch has ended", || {
            branch.folder.join("summary.json").exists()
        });
        until("no process is left", || rig.processes().is_empty());
        assert_eq!(summary(&branch.folder)["verdict"], "aborted");
        let session = branch.about["session"].as_str().expect("a session");
        until("its session is gone", || {
            !rig.sessions().join(session).exists()
        });
        rig.assert_nothing_left();
    }
}

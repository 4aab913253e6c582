//! `hil monitor`: a monitored run equals an unmonitored one, and the terminal is restored.

use std::fs::File;
use std::io::Read;
use std::process::Command;

use hil_views::monitor::terminal::Screen;
use rustix::process::Signal;
use serde_json::Value;

use crate::pseudo_terminal::open_terminal;
use crate::support::harness::{Rig, ended, send, until};
use crate::support::programs::{program, shipped, workspace};
use crate::support::terminal::Terminal;

const SCENARIO: &str = "scenarios/spring-mass.toml";
const USUAL: (u16, u16) = (80, 24);

/// Starts a monitor of this test's session in a terminal, and waits until it is attached.
fn monitor(rig: &Rig, arguments: &[&str]) -> Terminal {
    let mut hil = rig.command(program("hil"));
    hil.current_dir(workspace());
    hil.args(["monitor", "--session", rig.session()])
        .args(arguments);
    let terminal = Terminal::start(hil, USUAL);
    until("the view is there", || {
        terminal.is_taken() && terminal.text().contains("q quit")
    });
    terminal
}

fn json(rig: &Rig) -> Value {
    rig.in_session("monitor --json").expect(0).json()
}

#[test]
fn running_stopped_and_killed_monitors_do_not_change_the_digest() {
    let rig = Rig::new();
    let alone = rig.run(SCENARIO).expect(0).digest();

    let run = rig.start(&format!("{SCENARIO} --pause-at 0.001 --wait-limit 60"));
    until("the run is held", || json_state(&rig) == "paused");
    let mut live = monitor(&rig, &["--signal", "*_m"]);
    let mut stopped = monitor(&rig, &[]);
    let killed = monitor(&rig, &[]);
    send(stopped.pid(), Signal::STOP);
    rig.in_session("step 1000").expect(0);
    send(killed.pid(), Signal::KILL);
    rig.in_session("resume").expect(0);
    let watched = run.finish().expect(0);
    assert_eq!(watched.digest(), alone);
    assert_eq!(watched.summary()["recording"]["lost"], 0);

    send(stopped.pid(), Signal::CONT);
    for (name, terminal) in [("live", &mut live), ("stopped", &mut stopped)] {
        terminal.until_it_shows("spring-mass ended: pass");
        terminal.press(" ");
        assert_eq!(terminal.wait().code(), Some(0), "{name}");
        terminal.assert_restored(name);
        let text = terminal.text();
        assert!(
            text.contains("spring-mass ended: pass, 5000 steps"),
            "{text}"
        );
    }
    rig.assert_nothing_left();
}

/// Returns the state reported by a monitor; empty as long as there is none.
pub(crate) fn json_state(rig: &Rig) -> String {
    let text = rig.in_session("monitor --json").stdout;
    let text: Value = serde_json::from_str(&text).unwrap_or_default();
    text["state"].as_str().unwrap_or_default().to_owned()
}

#[test]
fn the_terminal_is_restored_however_the_view_ends() {
    let rig = Rig::new();
    let run = rig.held();
    for (key, code) in [("q", 0), ("\u{3}", 130)] {
        let mut terminal = monitor(&rig, &[]);
        terminal.press(key);
        assert_eq!(terminal.wait().code(), Some(code), "{key:?}");
        terminal.assert_restored(key);
        assert!(!terminal.text().contains("ended"), "the run goes on");
    }
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let mut terminal = monitor(&rig, &[]);
        send(terminal.pid(), signal);
        assert_eq!(terminal.wait().code(), Some(130), "{signal:?}");
        terminal.assert_restored(&format!("{signal:?}"));
    }
    let mut terminal = monitor(&rig, &[]);
    terminal.until_it_shows("PAUSED");
    terminal.press("r");
    terminal.until_it_shows("spring-mass ended: pass");
    assert!(terminal.is_taken(), "it stays until a key is pressed");
    terminal.press("x");
    assert_eq!(terminal.wait().code(), Some(0));
    terminal.assert_restored("the session's end");
    run.finish().expect(0);
}

#[test]
fn a_vacuous_requirement_is_no_pass_in_the_view_and_at_the_end() {
    let rig = Rig::new();
    let far = "[[requirements]]\nname = \"far\"\nformula = \"always(truth.position_m > 5 implies truth.position_m < 1)\"\n";
    let scenario = rig.write("far.toml", &(shipped(SCENARIO) + far));
    let run = rig.start(&format!("{} --pause-at 4.9", scenario.display()));
    until("the run is held", || json_state(&rig) == "paused");
    let mut terminal = monitor(&rig, &[]);
    rig.in_session("resume").expect(0);
    terminal.until_it_shows("spring-mass ended: pass, 1 vacuous");
    terminal.until_it_shows("vacuous  far");
    terminal.press("q");
    assert_eq!(terminal.wait().code(), Some(0));
    run.finish().expect(0);
}

#[test]
fn a_view_ends_when_its_terminal_is_closed() {
    let rig = Rig::new();
    let run = rig.held();
    // Repeated, because it may be doing anything when its window is closed.
    for _ in 0..10 {
        assert_eq!(exit_of_a_view_without_its_window(&rig), Some(130));
    }
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

fn exit_of_a_view_without_its_window(rig: &Rig) -> Option<i32> {
    let (master, line) = open_terminal(USUAL.0, USUAL.1);
    let end = || line.try_clone().expect("another handle");
    let mut hil = rig.command(program("hil"));
    hil.args(["monitor", "--session", rig.session()])
        .current_dir(workspace());
    hil.env("TERM", "xterm-256color")
        .stdin(end())
        .stdout(end())
        .stderr(end());
    let mut view = hil.spawn().expect("starts");
    drop((hil, line));
    // The window, which is closed when the view is open.
    std::thread::spawn(move || {
        let (mut window, mut seen, mut bytes) = (File::from(master), Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = window.read(&mut bytes) {
            seen.extend_from_slice(&bytes[..count]);
            if seen.windows(4).any(|part| part == b"quit") {
                return;
            }
        }
    });
    ended(&mut view).code()
}

#[test]
fn a_stopped_or_killed_hil_is_reported() {
    let rig = Rig::new();
    let run = rig.held();
    let mut terminal = monitor(&rig, &[]);
    terminal.until_it_shows("PAUSED");
    run.signal(Signal::STOP);
    terminal.until_it_shows("hil is stopped");
    run.kill();
    terminal.until_it_shows("hil is gone without a summary");
    terminal.until_it_shows("hil recover");
    terminal.press("q");
    assert_eq!(terminal.wait().code(), Some(0));
    rig.hil(&["sessions", "--clean"]).expect(0);
}

#[test]
fn a_panic_restores_the_terminal_before_it_prints() {
    let mut own = Command::new(std::env::current_exe().expect("this program"));
    own.args([
        "--ignored",
        "--exact",
        "--nocapture",
        "monitor::a_view_that_panics",
    ]);
    let mut terminal = Terminal::start(own, USUAL);
    assert!(!terminal.wait().success());
    terminal.assert_restored("a panic");
    terminal.until_it_shows("the view went wrong");
}

#[test]
#[ignore = "the other half of a test: it panics"]
fn a_view_that_panics() {
    let _screen = Screen::take().expect("a terminal");
    panic!("the view went wrong");
}

#[test]
fn at_most_three_monitors_may_attach_and_a_killed_one_frees_its_slot() {
    let rig = Rig::new();
    let run = rig.held();
    let mut monitors: Vec<Terminal> = (0..3).map(|_| monitor(&rig, &[])).collect();
    rig.in_session("monitor --json")
        .expect(2)
        .says(&["already has 3 observers"]);
    for watching in &mut monitors {
        send(watching.pid(), Signal::KILL);
        watching.wait();
        *watching = monitor(&rig, &[]);
    }
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn keys_step_the_run_and_inject_and_clear_faults() {
    let rig = Rig::new();
    let run = rig.held();
    let fault = "bias measured.position_m 0.001";
    let mut terminal = monitor(&rig, &["--inject", fault]);
    terminal.until_it_shows("step 2500 of 5000");
    terminal.press("S");
    terminal.until_it_shows("paused before step 2600");
    terminal.press("s");
    terminal.until_it_shows("step 2601 of 5000");
    terminal.press("1");
    terminal.until_it_shows("inject bias measured.position_m 0.001? y");
    terminal.press("n");
    terminal.until_it_shows("cancelled");
    terminal.press("1y");
    terminal.until_it_shows("fault 1 bias takes effect at step 2601");
    terminal.press("S");
    terminal.until_it_shows("1 active");
    terminal.press("cy");
    terminal.until_it_shows("fault 1 ends");
    terminal.press("?");
    terminal.until_it_shows(&format!("1     inject {fault}"));
    terminal.press("?r");
    terminal.until_it_shows("spring-mass ended:");
    terminal.press("q");
    assert_eq!(terminal.wait().code(), Some(0));
    let run = run.finish();
    let summary = run.summary();
    assert_eq!(summary["faults"][0]["effective_step"], 2601, "{summary}");
    assert_eq!(summary["faults"][0]["effects"][0]["ended_step"], 2701);
}

#[test]
fn the_view_follows_the_size_of_the_terminal() {
    let rig = Rig::new();
    let run = rig.held();
    let mut terminal = monitor(&rig, &[]);
    for (columns, rows) in [(120, 40), (40, 12), (80, 24)] {
        terminal.resize(columns, rows);
        until("the keys are in the last line", || {
            let text = terminal.text();
            let lines: Vec<&str> = text.lines().collect();
            lines.len() == usize::from(rows) && lines[lines.len() - 1].starts_with("q quit")
        });
        terminal.until_it_shows("PAUSED");
    }
    terminal.press("q");
    terminal.wait();
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn without_a_terminal_one_line_reports_the_state_of_the_run() {
    let rig = Rig::new();
    let run = rig.held();
    let text = rig.in_session("monitor").expect(0).stdout;
    assert!(
        text.starts_with("spring-mass: paused, step 2500, 2.5 of 5 s"),
        "{text}"
    );
    let status = json(&rig);
    assert_eq!(
        (&status["step"], &status["steps"]),
        (&2500.into(), &5000.into())
    );
    // Judged from step 0 on, although it joined late.
    let settles = &status["requirements"][0];
    assert_eq!(
        (&settles["name"], &settles["verdict"], &settles["at_most"]),
        (&"settles".into(), &"undecided".into(), &Value::Null)
    );
    let at_most = status["requirements"][1]["at_most"].as_f64();
    rig.in_session("step 2000").expect(0);
    until("a margin of what has begun", || {
        json(&rig)["requirements"][0]["at_most"].is_f64()
    });
    let later = json(&rig)["requirements"][0]["at_most"].as_f64();
    rig.in_session("resume").expect(0);
    let summary = run.finish().expect(0).summary();
    let final_margin = |number: usize| summary["requirements"][number]["robustness"].as_f64();
    assert!(final_margin(0) <= later, "{later:?} {summary}");
    assert!(final_margin(1) <= at_most, "{at_most:?} {summary}");
}

#[test]
fn unwatchable_sessions_are_refused_with_the_reason() {
    let rig = Rig::new();
    rig.hil(&["monitor", "--session", "nobody"])
        .expect(2)
        .says(&["no session `nobody` is running"]);
    rig.hil(&["monitor", "--window", "0s"])
        .expect(2)
        .says(&["is not a valid time-axis width"]);
    let run = rig.held();
    for (arguments, says) in [
        (&["--signal", "truth.positon_m"][..], "`truth.position_m`"),
        (&["--inject", "leek x 1"], "no fault `leek`"),
        (&["--inject", "bias measured.position_m"], "bias"),
        (&["--inject", "bias 'x"], "quote"),
    ] {
        let all = [&["monitor", "--session", rig.session()], arguments].concat();
        rig.beside(&all).expect(2).says(&[says]);
    }
    rig.in_session("resume").expect(0);
    run.finish().expect(0);

    let run = rig.start(&format!("{SCENARIO} --link in-process --pause-at 1"));
    until("the session says what it is", || {
        rig.session_folder().join("run.json").exists()
    });
    rig.in_session("monitor")
        .expect(2)
        .says(&["in one process"]);
    // If it were resumed before it is paused, it would never pause; and its end, some milliseconds later, may
    // precede the answer, which would then never come, however often it is requested.
    rig.until_held_at(1000);
    rig.in_session("resume");
    run.finish().expect(0);
}

#[test]
fn a_monitor_waits_for_a_session_and_reports_its_death() {
    let rig = Rig::new();
    let mut hil = rig.command(program("hil"));
    hil.current_dir(workspace());
    hil.args(["monitor", "--wait", "100s", "--session", rig.session()]);
    let mut terminal = Terminal::start(hil, USUAL);
    terminal.until_it_shows("waiting up to 100 s");
    let run = rig.held();
    terminal.until_it_shows("PAUSED");
    run.kill();
    // The last message of the plant, if there was one, or nothing.
    terminal.until_it_shows("spring-mass ended:");
    terminal.press("q");
    assert_eq!(terminal.wait().code(), Some(0));
    terminal.assert_restored("the death of hil");
    rig.hil(&["sessions"]).expect(0);
    rig.assert_nothing_left();
}

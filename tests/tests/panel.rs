//! `hil panel`: the content and the controls in a browser, no access for anybody else, and an unaffected run.
//!
//! The browser is a headless Chromium, driven by `tests/hosts/panel_page.py`; without one, or without playwright,
//! its tests say so and pass, unless `HIL_TEST_CHROMIUM=1` demands it. All other clients use a bare socket.

mod accessible;
mod arranged;
pub(crate) mod bands;
mod branches;
pub(crate) mod browser;
mod closer;
mod cursors;
mod intruders;
mod log;
mod page;
mod recorded;
mod searches;
mod stream;

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};

use rustix::process::Signal;
use serde_json::Value;

use crate::panel_socket::parts;
use crate::support::company::Companion;
use crate::support::harness::{Rig, Run, ended, send, until};
use crate::support::programs::{path_from, program, workspace};

const SCENARIO: &str = "scenarios/spring-mass.toml";

/// Runs the scenario with half as much mass again, which no requirement expects.
pub(crate) fn heavy(rig: &Rig) -> Run {
    let run = rig.run(&format!(
        "{SCENARIO} --set plant.parameters.mass_kg=1.5 --set requirements=[]"
    ));
    run.expect(0)
}

/// Panel of a test's session.
struct Panel {
    process: Companion,
    stdout: BufReader<ChildStdout>,
    url: String,
}

impl Panel {
    fn start(rig: &Rig, arguments: &[&str]) -> Self {
        let mut hil = rig.command(program("hil"));
        hil.arg("panel")
            .args(["--session", rig.session(), "--json", "--no-open"]);
        hil.args(arguments);
        Self::of(hil)
    }

    /// Starts the panel of a recorded run.
    fn recorded(rig: &Rig, run: &Path, arguments: &[&str]) -> Self {
        let mut hil = rig.command(program("hil"));
        hil.arg("panel").arg(run).args(["--json", "--no-open"]);
        hil.args(arguments);
        Self::of(hil)
    }

    /// Starts a panel that prints its address as JSON.
    fn of(mut hil: Command) -> Self {
        hil.current_dir(workspace()).stdin(Stdio::null());
        let mut process = Companion::start(hil.stdout(Stdio::piped()));
        let mut stdout = BufReader::new(process.stdout.take().expect("piped"));
        let mut text = String::new();
        stdout.read_line(&mut text).expect("it tells where");
        let text: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
        let url = text["url"].as_str().expect("an address").to_owned();
        Self {
            process,
            stdout,
            url,
        }
    }

    fn address(&self) -> &str {
        let (address, _) = parts(&self.url);
        address
    }

    fn secret(&self) -> &str {
        let (_, secret) = parts(&self.url);
        secret
    }

    /// Interrupts it like a terminal; returns its exit code.
    fn interrupt(mut self) -> Option<i32> {
        send(self.process.id(), Signal::INT);
        self.wait()
    }

    fn wait(&mut self) -> Option<i32> {
        ended(&mut self.process).code()
    }
}

#[test]
fn a_panel_beside_a_run_ends_with_it_and_not_before() {
    let rig = Rig::new();
    let (mut run, mut stderr) = with_panel(&rig, &["--pause-at", "0.5"]);
    let url = told_url(&mut stderr);
    let mut client = stream::Client::greeted(&url);
    client.until(|message| message["state"] == "paused");
    rig.in_session("resume").expect(0);
    let message = client.until(|message| message["ending"]["verdict"] == "pass");
    assert!(
        message["told"]
            .as_str()
            .expect("text")
            .contains("5000 steps"),
        "{message}"
    );
    client.until(|message| message["tell"] == "over");
    assert_eq!(ended(&mut run).code(), Some(0));
    rig.assert_nothing_left();
}

#[test]
fn a_panel_of_a_run_that_is_interrupted_before_it_begins_ends_with_it() {
    let rig = Rig::new();
    let (mut run, mut stderr) = with_panel(&rig, &["--controller", "external"]);
    let url = told_url(&mut stderr);
    let mut client = stream::Client::greeted(&url);
    interrupt(&run);
    // A panel that `hil` had to kill does not print this.
    client.until(|message| message["tell"] == "over");
    assert_eq!(ended(&mut run).code(), Some(130));
    rig.assert_nothing_left();
}

#[test]
fn a_run_with_a_panel_that_is_interrupted_leaves_nothing() {
    let rig = Rig::new();
    let (mut run, mut stderr) = with_panel(&rig, &["--pause-at", "0.5"]);
    let url = told_url(&mut stderr);
    let mut client = stream::Client::greeted(&url);
    client.until(|message| message["state"] == "paused");
    interrupt(&run);
    client.until(|message| message["state"] == "ended");
    assert_eq!(ended(&mut run).code(), Some(130));
    let address = parts(&url).0.to_owned();
    until("nobody listens any more", || {
        std::net::TcpStream::connect(&address).is_err()
    });
    rig.assert_nothing_left();
}

/// Interrupts a run and its panel, which is in the run's group, like a terminal.
fn interrupt(run: &Child) {
    let group = rustix::process::Pid::from_raw(run.id() as i32).expect("a process");
    rustix::process::kill_process_group(group, Signal::INT).expect("it is there");
}

/// Starts a run with its panel, in a process group of its own.
fn with_panel(rig: &Rig, arguments: &[&str]) -> (Child, BufReader<ChildStderr>) {
    use std::os::unix::process::CommandExt;
    let mut hil = rig.command(program("hil"));
    hil.args([
        "run",
        SCENARIO,
        "--panel",
        "--no-open",
        "--wait-limit",
        "60",
    ]);
    hil.args(["--session", rig.session(), "--out"])
        .arg(rig.path("run"));
    hil.args(arguments)
        .current_dir(workspace())
        .process_group(0);
    hil.stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut run = hil.spawn().expect("hil");
    let stderr = BufReader::new(run.stderr.take().expect("piped"));
    (run, stderr)
}

/// Returns the address printed by a run; the rest is read too, so that the writer never blocks.
fn told_url(stderr: &mut BufReader<ChildStderr>) -> String {
    let mut line = String::new();
    loop {
        line.clear();
        let count = stderr.read_line(&mut line).expect("text");
        assert!(count > 0, "the run ended without an address");
        if let Some(url) = line.trim_end().strip_prefix("panel: ") {
            return url.to_owned();
        }
    }
}

#[test]
fn the_opener_receives_a_private_file_and_no_argument_contains_the_secret() {
    let rig = Rig::new();
    let run = rig.held();
    let output = rig.path("told");
    let opener = format!(
        "#!/bin/sh\n{{ stat -c %a \"$1\"; echo \"$#\"; cat \"$1\"; }} > {0}.part; mv {0}.part {0}\n",
        output.display()
    );
    rig.script("xdg-open", &opener);
    let mut hil = rig.command(program("hil"));
    hil.args(["panel", "--session", rig.session(), "--json"]);
    hil.env("PATH", path_from(&rig.path("")));
    hil.env("DISPLAY", ":0");
    let panel = Panel::of(hil);
    until("the opener was called", || output.exists());
    let output = std::fs::read_to_string(&output).expect("text");
    assert!(output.starts_with("600\n1\n"), "{output}");
    assert!(output.contains(&format!("url={}", panel.url)), "{output}");
    assert_eq!(panel.secret().len(), 32);
    for process in std::fs::read_dir("/proc").expect("/proc").flatten() {
        let line = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line);
        assert!(!line.contains(panel.secret()), "{line}");
    }
    assert_eq!(panel.interrupt(), Some(130));
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    let log = std::fs::read_dir(&run.folder)
        .expect("the run's folder")
        .flatten();
    let is_text = |name: &OsStr| name != "run.mcap";
    for file in log.filter(|file| is_text(&file.file_name())) {
        let text = std::fs::read_to_string(file.path()).unwrap_or_default();
        assert!(!text.contains("/#"), "{}", file.path().display());
    }
}

#[test]
fn sessions_that_cannot_be_shown_are_refused_before_anything_starts() {
    let rig = Rig::new();
    rig.hil(&["panel", "--session", rig.session()])
        .expect(2)
        .says(&["no session `", "is running"]);
    for (more, expected) in [
        (&["--link", "in-process"][..], "--panel needs two processes"),
        (&["--repeat", "2"], "--panel shows a single run"),
        (&[SCENARIO], "--panel shows a single run"),
    ] {
        rig.hil(&[&["run", SCENARIO, "--panel"], more].concat())
            .expect(2)
            .says(&[expected]);
    }
    rig.hil(&["run", "missing.toml", "--panel", "--no-open"])
        .expect(2)
        .says(&["missing.toml", "No such file"]);
    let run = rig.held();
    rig.in_session("panel --no-open --signal truth.nothing")
        .expect(2)
        .says(&["the session has no signal"]);
    rig.in_session("panel --no-open --inject leek")
        .expect(2)
        .says(&["prepared fault 'leek'"]);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn a_panel_announces_the_end_and_waits_for_a_late_page() {
    let rig = Rig::new();
    let run = rig.held();
    let mut panel = Panel::start(&rig, &[]);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
    // Connected only now, it receives the whole log.
    let mut client = stream::Client::greeted(&panel.url);
    let output = client.until(|output| output["ending"]["verdict"] == "pass");
    assert_eq!(output["state"], "ended");
    client.look(1, 5.0);
    let points = client.until_points(|points| points.view == 1);
    assert_eq!(points.newest, 5000);
    drop(client);
    assert_eq!(panel.wait(), Some(0), "some seconds after the last page");
    let mut rest = String::new();
    panel.stdout.read_to_string(&mut rest).expect("text");
    assert_eq!(rest, "", "as JSON it is told in the messages alone");
}

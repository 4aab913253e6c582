//! Sides started by hand: the same digest as with launched ones, even if stopped by a signal or a debugger; no
//! other process takes their place; no end leaves anything behind.

mod admission;
mod ends;

use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use hil_session::live;
use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::json;
use shared_types::live::{Request, Response};

use crate::support::company::Companion;
use crate::support::harness::{Rig, Running, ended, send, text, until};
use crate::support::programs::{example, of_pendulum, program, shipped, skip};

const SCENARIO: &str = "scenarios/spring-mass.toml";
/// Wait limit that a loaded machine meets, and a time beyond it.
const LIMIT: &str = "--wait-limit 2";
const BEYOND: Duration = Duration::from_millis(3000);

/// Side started by this test; killed when dropped.
struct Hand(Companion);

impl Hand {
    /// Starts a program as an awaited side, optionally with a command prefix.
    fn start(rig: &Rig, side: &str, program: &Path, before: &[&str]) -> Self {
        awaited(&rig.session_folder(), side);
        let folder = rig.session_folder();
        let own = [text(program), "--session", text(&folder), "--by-hand"];
        let words = [before, &own].concat();
        let mut command = rig.command(words[0]);
        command
            .args(&words[1..])
            // Its connection is not its terminal.
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0);
        Self(Companion::start(&mut command))
    }

    fn pid(&self) -> u32 {
        self.0.id()
    }

    fn stop(&self) {
        send(self.pid(), Signal::STOP);
        let process = ProcessId::of(self.pid()).expect("it is there");
        until("it is stopped", || process.is_stopped());
    }

    fn go_on(&self) {
        send(self.pid(), Signal::CONT);
    }

    /// Waits for its end; returns its exit code and output.
    fn end(mut self) -> (Option<i32>, String) {
        let status = ended(&mut self.0);
        let mut text = String::new();
        for mut pipe in [
            Box::new(self.0.stderr.take().expect("piped")) as Box<dyn Read>,
            Box::new(self.0.stdout.take().expect("piped")),
        ] {
            pipe.read_to_string(&mut text).expect("text");
        }
        (status.code(), text)
    }
}

/// Waits until a side can be admitted.
fn awaited(folder: &Path, side: &str) {
    let token = folder.join(format!("{side}.token"));
    until("the side is awaited", || token.exists());
}

/// Returns the command that `hil` must print, for a shell.
fn command(rig: &Rig, program: &Path) -> String {
    let (mut program, folder) = (text(program).to_owned(), rig.session_folder());
    if program.contains(' ') {
        program = format!("'{program}'");
    }
    format!("{program} --session {} --by-hand", folder.display())
}

fn controller(rig: &Rig) -> Hand {
    Hand::start(rig, "controller", &program("controller-process"), &[])
}

fn plant(rig: &Rig) -> Hand {
    Hand::start(rig, "plant", &program("plant-process"), &[])
}

/// Starts a run that waits for its controller and is paused at 2.5 s.
fn held<'r>(rig: &'r Rig, arguments: &str) -> (Running<'r>, Hand) {
    let running = rig.start(&format!(
        "{SCENARIO} --controller external --pause-at 2.5 {arguments}"
    ));
    let hand = controller(rig);
    rig.until_held_at(2500);
    (running, hand)
}

fn launched() -> String {
    let rig = Rig::new();
    rig.run(SCENARIO).expect(0).digest()
}

#[test]
fn each_side_and_both_run_like_launched_ones() {
    let digest = launched();
    for (flags, sides) in [
        ("--controller external", &["controller"][..]),
        ("--plant external", &["plant"]),
        (
            "--plant external --controller external",
            &["plant", "controller"],
        ),
        (
            "--controller external --clock paced --pace 5",
            &["controller"],
        ),
    ] {
        let rig = Rig::new();
        let running = rig.start(&format!("{SCENARIO} {flags}"));
        // In the reverse of the printed order.
        let hands: Vec<(Hand, &str)> = (sides.iter().rev())
            .map(|side| match *side {
                "plant" => (plant(&rig), "plant-process"),
                _ => (controller(&rig), "controller-process"),
            })
            .collect();
        let run = running.finish().expect(0);
        assert_eq!(run.digest(), digest, "{flags}");
        let summary = run.summary();
        assert_eq!(summary["started_by_hand"], json!(sides), "{flags}");
        assert_eq!(summary["evidence"], "sil");
        let expected = format!("{} started by hand (sil)", sides.join(" and "));
        assert!(run.stdout.contains(&expected), "{}", run.stdout);
        for (hand, name) in hands {
            let printed = format!("\n  {}\n", command(&rig, &program(name)));
            assert!(run.stderr.contains(&printed), "{}", run.stderr);
            let (code, output) = hand.end();
            assert_eq!(code, Some(0), "{output}");
            assert!(output.contains("admitted as the "), "{output}");
        }
        for side in ["plant", "controller"] {
            let is_there = run.folder.join(format!("{side}.log")).exists();
            assert_eq!(is_there, !sides.contains(&side), "{flags}: {side}.log");
        }
    }
}

#[test]
fn a_side_started_by_hand_answers_in_real_time() {
    let rig = Rig::new();
    // The law has no feedback: with feedback, late commands on a loaded machine make the plant diverge.
    let running = rig.start(&format!(
        "{SCENARIO} --controller external --clock realtime --wait-limit 60 --set run.overrun=catch-up \
         --set controller.law=hold"
    ));
    let hand = controller(&rig);
    let run = running.finish();
    let summary = run.summary();
    assert_eq!(summary["steps"], 5000, "{}", run.stderr);
    assert_eq!(summary["clock"], "realtime");
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn a_controller_stopped_and_continued_gives_the_same_digest() {
    let digest = launched();
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit inf");
    hand.stop();
    rig.in_session("resume").expect(0);
    // The plant has sent its sample and gets no answer.
    let session = SessionInfo::read(&rig.session_folder()).expect("it runs");
    let status = || match live::ask(&session, &Request::Status, BEYOND) {
        Ok(Response::Status(status)) => (status.step, status.paused),
        other => panic!("{other:?}"),
    };
    until("the run goes on", || !status().1);
    let before = status();
    std::thread::sleep(BEYOND);
    assert_eq!(status(), before, "it waits");
    hand.go_on();
    let run = running.finish().expect(0);
    assert_eq!(run.digest(), digest);
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn before_hello_a_side_has_no_time_limit() {
    let digest = launched();
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{SCENARIO} --plant external --controller external {LIMIT}"
    ));
    let first = controller(&rig);
    let folder = rig.session_folder();
    until("the controller is admitted", || {
        SessionInfo::read(&folder).is_ok_and(|info| info.controller.is_some())
    });
    // It waits for the plant for longer than the limit; then the plant waits for its hello.
    std::thread::sleep(BEYOND);
    first.stop();
    let second = plant(&rig);
    until("the plant is there", || folder.join("control").exists());
    std::thread::sleep(BEYOND);
    first.go_on();
    let run = running.finish().expect(0);
    assert_eq!(run.digest(), digest);
    assert_eq!((first.end().0, second.end().0), (Some(0), Some(0)));
}

#[test]
fn after_hello_the_wait_limit_applies() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, LIMIT);
    hand.stop();
    rig.in_session("resume").expect(0);
    let run = running.finish().expect(3);
    let reason = run.summary()["reason"].to_string();
    assert!(
        reason.contains("controller did not answer step 2500"),
        "{reason}"
    );
    assert_eq!(hand.end().0, None, "it was stopped and had to be killed");
}

#[test]
fn gdb_can_stop_a_side_before_and_after_hello() {
    let tried = Command::new("gdb")
        .args(["-nx", "-batch", "-ex", "run", "--args", "true"])
        .output();
    let works = tried
        .is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains("exited normally"));
    if !works {
        return skip("gdb is not here, or may not trace", "HIL_TEST_GDB");
    }
    // Built like a program to be debugged: with line information for breakpoints.
    let scenario = of_pendulum("examples/own-plant/pendulum.toml");
    let digest = Rig::new().run(&scenario).expect(0).digest();
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{scenario} --controller external --wait-limit inf"
    ));
    // Admitted without hello; then in the loop.
    let attach = line_of(
        "shared-types/session/src/program.rs",
        "match IceoryxLink::open(session, epoch)",
    );
    let answer = line_of(
        "controller-process/src/runner/answering.rs",
        "self.previous.copy_from_slice(&self.answer[..commands])",
    );
    let orders = [
        "set debuginfod enabled off",
        &format!("tbreak {attach}"),
        "run",
        "shell sleep 1",
        &format!("break {answer}"),
        "ignore 2 1000",
        "continue",
        "shell sleep 1",
        "info breakpoints",
        "delete",
        "continue",
    ];
    let orders = orders.iter().flat_map(|order| ["-ex", order]);
    let gdb: Vec<&str> = (["gdb", "-nx", "-batch"].into_iter())
        .chain(orders)
        .chain(["--args"])
        .collect();
    let hand = Hand::start(&rig, "controller", &example("own-controller"), &gdb);
    // The debugger ends after its program, and `hil` before it.
    let run = running.finish_beside_another().expect(0);
    let (_, output) = hand.end();
    rig.assert_nothing_left();
    assert_eq!(run.digest(), digest, "{output}");
    for part in [
        "Temporary breakpoint 1, ",
        "Breakpoint 2, ",
        "already hit 1001 times",
        "exited normally",
    ] {
        assert!(output.contains(part), "no `{part}` in {output}");
    }
}

/// Returns a source line as a breakpoint location.
fn line_of(file: &str, text: &str) -> String {
    let source = shipped(file);
    let line = source.lines().position(|line| line.contains(text));
    format!("{file}:{}", line.expect("it is there") + 1)
}

#[test]
fn a_swap_replaces_it_by_a_controller_that_hil_starts() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit 60");
    rig.in_session("controller swap --set controller.law=hold --json")
        .expect(0);
    rig.in_session("resume").expect(0);
    let run = running.finish();
    let controllers = run.summary()["controllers"].clone();
    assert_eq!(
        controllers.as_array().map(Vec::len),
        Some(2),
        "{controllers}"
    );
    assert_eq!(controllers[1]["from_step"], 2500);
    hand.end();
}

#[test]
fn a_recorded_run_is_repeated_by_hand() {
    let rig = Rig::new();
    let first = rig.run(SCENARIO).expect(0);
    let recorded = first.folder.to_str().expect("text");
    let arguments = [
        "rerun",
        recorded,
        "--controller",
        "external",
        "--session",
        rig.session(),
        "--no-record",
    ];
    let out = rig.path("again");
    let arguments = [&arguments[..], &["--out", out.to_str().expect("text")]].concat();
    let running = rig.start_hil(&arguments);
    let hand = controller(&rig);
    running.finish().expect(0).prints(&["same digest as"]);
    assert_eq!(hand.end().0, Some(0));
}

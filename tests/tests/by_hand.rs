//! Sides that somebody starts by hand: the same digest as launched ones, held by a signal or a debugger or not;
//! nobody else gets their place; whatever ends leaves nothing.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use shared_types::live::{self, Request, Response};
use shared_types::process::ProcessId;
use shared_types::session::SessionInfo;

use crate::support::harness::{Rig, Running, send, until};
use crate::support::programs::{misbehaving_controller, program, skip, workspace};

const SCENARIO: &str = "scenarios/spring-mass.toml";
/// The user that is nobody.
const NOBODY: u32 = 65534;
/// A wait limit that a loaded machine keeps, and a time beyond it.
const LIMIT: &str = "--wait-limit 2";
const BEYOND: Duration = Duration::from_millis(3000);

/// A side that this test started; it does not outlive the test.
struct Hand(Child);

impl Drop for Hand {
    fn drop(&mut self) {
        let _ = self.0.kill(); // it may have ended
        let _ = self.0.wait();
    }
}

impl Hand {
    /// Starts a program as a side that is awaited, with words in front of its command if there are any.
    fn start(rig: &Rig, side: &str, program: &Path, before: &[&str]) -> Self {
        awaited(&rig.session_folder(), side);
        let command = command(rig, program);
        let words: Vec<&str> = (before.iter().copied()).chain(command.split(' ')).collect();
        let child = Command::new(words[0])
            .args(&words[1..])
            // Its leash is not its terminal.
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn();
        Self(child.expect("it can be run"))
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

    /// Waits for its end: its exit code and what it said.
    fn end(mut self) -> (Option<i32>, String) {
        let mut status = None;
        until("the side ends", || {
            status = self.0.try_wait().expect("it is our child");
            status.is_some()
        });
        let mut said = String::new();
        for mut pipe in [
            Box::new(self.0.stderr.take().expect("piped")) as Box<dyn Read>,
            Box::new(self.0.stdout.take().expect("piped")),
        ] {
            pipe.read_to_string(&mut said).expect("text");
        }
        (status.and_then(|status| status.code()), said)
    }
}

/// Waits until a side can come in.
fn awaited(folder: &Path, side: &str) {
    let token = folder.join(format!("{side}.token"));
    until("the side is awaited", || token.exists());
}

/// The command that `hil` has to print.
fn command(rig: &Rig, program: &Path) -> String {
    let (program, folder) = (program.display(), rig.session_folder());
    format!("{program} --session {} --by-hand", folder.display())
}

fn controller(rig: &Rig) -> Hand {
    Hand::start(rig, "controller", &program("controller-process"), &[])
}

fn plant(rig: &Rig) -> Hand {
    Hand::start(rig, "plant", &program("plant-process"), &[])
}

fn is_held(rig: &Rig) {
    until("the run is held", || {
        let told = rig.beside(&["inject", "--active", "--json", "--session", rig.session()]);
        let status: Value = serde_json::from_str(&told.stdout).unwrap_or_default();
        status["status"]["paused"] == true
    });
}

fn resume(rig: &Rig) {
    rig.beside(&["resume", "--session", rig.session()])
        .expect(0);
}

/// A run that waits for its controller until it is held at 2.5 s.
fn held<'r>(rig: &'r Rig, arguments: &str) -> (Running<'r>, Hand) {
    let running = rig.start(&format!(
        "{SCENARIO} --controller external --pause-at 2.5 {arguments}"
    ));
    let hand = controller(rig);
    is_held(rig);
    (running, hand)
}

fn launched() -> String {
    let rig = Rig::new();
    rig.run(SCENARIO).expect(0).digest()
}

#[test]
fn each_side_and_both_run_as_launched_ones_do() {
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
        // In the other order than they are printed.
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
        let told = format!("{} started by hand (sil)", sides.join(" and "));
        assert!(run.stdout.contains(&told), "{}", run.stdout);
        for (hand, name) in hands {
            let printed = format!("\n  {}\n", command(&rig, &program(name)));
            assert!(run.stderr.contains(&printed), "{}", run.stderr);
            let (code, said) = hand.end();
            assert_eq!(code, Some(0), "{said}");
            assert!(said.contains("admitted as the "), "{said}");
        }
        for side in ["plant", "controller"] {
            let is_there = run.folder.join(format!("{side}.log")).exists();
            assert_eq!(is_there, !sides.contains(&side), "{flags}: {side}.log");
        }
    }
}

#[test]
fn against_the_clock_it_answers_as_well() {
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{SCENARIO} --controller external --clock realtime --wait-limit 60 --set run.overrun=catch-up"
    ));
    let hand = controller(&rig);
    let run = running.finish();
    let summary = run.summary();
    assert_eq!(summary["steps"], 5000, "{}", run.stderr);
    assert_eq!(summary["clock"], "realtime");
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn a_stopped_controller_that_goes_on_has_the_same_digest() {
    let digest = launched();
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit inf");
    hand.stop();
    resume(&rig);
    // The plant has sent its sample, and nobody answers.
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
fn before_hello_nothing_limits_a_side() {
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
    // It looks for the plant, for longer than the limit; then the plant waits for its hello.
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
fn after_hello_the_limit_counts() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, LIMIT);
    hand.stop();
    resume(&rig);
    let run = running.finish().expect(3);
    let reason = run.summary()["reason"].to_string();
    assert!(
        reason.contains("controller did not answer step 2500"),
        "{reason}"
    );
    assert_eq!(hand.end().0, None, "it was stopped and had to be killed");
}

#[test]
fn under_gdb_it_is_held_before_and_after_hello() {
    const TEST: &str = "under_gdb_it_is_held_before_and_after_hello";
    let tried = Command::new("gdb")
        .args(["-nx", "-batch", "-ex", "run", "--args", "true"])
        .output();
    let works = tried
        .is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains("exited normally"));
    if !works {
        return skip(TEST, "gdb is not here, or may not trace", "HIL_TEST_GDB");
    }
    if cfg!(not(debug_assertions)) {
        return skip(
            TEST,
            "programs of this profile have no lines to break at",
            "HIL_TEST_GDB",
        );
    }
    let digest = launched();
    let rig = Rig::new();
    let running = rig.start(&format!(
        "{SCENARIO} --controller external --wait-limit inf"
    ));
    // Admitted, and has not said hello; then in the loop.
    let attach = line_of(
        "shared-types/src/program.rs",
        "match IceoryxLink::open(session, epoch)",
    );
    let answer = line_of(
        "controller-process/src/runner.rs",
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
    let hand = Hand::start(&rig, "controller", &program("controller-process"), &gdb);
    // The debugger ends after its program, and `hil` before it.
    let run = running.finish_beside_another().expect(0);
    let (_, said) = hand.end();
    rig.assert_nothing_left();
    assert_eq!(run.digest(), digest, "{said}");
    for part in [
        "Temporary breakpoint 1, ",
        "Breakpoint 2, ",
        "already hit 1001 times",
        "exited normally",
    ] {
        assert!(said.contains(part), "no `{part}` in {said}");
    }
}

/// The place of a line of source, as a debugger takes it.
fn line_of(file: &str, text: &str) -> String {
    let source = std::fs::read_to_string(workspace().join(file)).expect("source");
    let line = source.lines().position(|line| line.contains(text));
    format!("{file}:{}", line.expect("it is there") + 1)
}

/// Shows something at the door of the controller, and gives the answer to it.
fn asked(folder: &Path, line: &str) -> String {
    let mut stream = UnixStream::connect(folder.join("controller.door")).expect("a door");
    writeln!(stream, "{line}").expect("written");
    let mut said = String::new();
    BufReader::new(stream)
        .read_line(&mut said)
        .expect("an answer");
    said
}

/// An entry as a program shows it.
fn entry(token: &Value, process: ProcessId) -> String {
    json!({"token": token, "process": process}).to_string()
}

#[test]
fn nobody_else_gets_in() {
    let digest = launched();
    let rig = Rig::new();
    let running = rig.start(&format!("{SCENARIO} --controller external"));
    let folder = rig.session_folder();
    let door = folder.join("controller.door");
    awaited(&folder, "controller");
    let file = folder.join("controller.token");
    let mode = |path: &Path| {
        std::fs::metadata(path)
            .expect("it is there")
            .permissions()
            .mode()
    };
    assert_eq!((mode(&file) & 0o777, mode(&folder) & 0o777), (0o600, 0o700));
    let token: Value =
        serde_json::from_str(&std::fs::read_to_string(&file).expect("text")).expect("JSON");
    let own = ProcessId::own();
    let mut wrong = token.clone();
    wrong["token"] = json!("0".repeat(64));
    let second = second_session(&rig);
    for (attempt, line, expected) in [
        ("nonsense", "hello".to_owned(), "not a request"),
        (
            "no token",
            json!({"process": own}).to_string(),
            "missing field `token`",
        ),
        (
            "a wrong token",
            entry(&wrong, own),
            "the token is not that of the controller of this session",
        ),
        (
            "the token of another session",
            entry(&second, own),
            "the token is not that of the controller of this session",
        ),
        (
            "the name of another process",
            entry(&token, ProcessId::of(1).expect("the first")),
            "it says that it is process 1, and process",
        ),
        (
            "a process of before",
            entry(
                &token,
                ProcessId {
                    start_ticks: own.start_ticks + 1,
                    ..own
                },
            ),
            "it says that it is process",
        ),
        (
            "another program with the right token",
            entry(&token, own),
            "was checked: start that, or name yours by --controller-bin",
        ),
    ] {
        let said = asked(&folder, &line);
        assert!(
            said.contains("refused") && said.contains(expected),
            "{attempt}: {said}"
        );
    }
    // A program that speaks all of it, from another file.
    let (code, said) = Hand::start(&rig, "controller", &misbehaving_controller(), &[]).end();
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("misbehaving-controller with hash"), "{said}");
    if rustix::process::geteuid().is_root() {
        let mut cat = Command::new("cat");
        let output = cat
            .arg(&file)
            .uid(NOBODY)
            .gid(NOBODY)
            .output()
            .expect("cat");
        assert!(!output.status.success() && output.stdout.is_empty());
        let mut shell = Command::new(program("controller-process"));
        let output = shell.arg("--session").arg(&folder).arg("--by-hand");
        let output = output.uid(NOBODY).gid(NOBODY).output();
        // It may not even be allowed to run the program.
        assert!(!output.is_ok_and(|output| output.status.success()));
    } else {
        eprintln!("not root: attempts of another user were left out");
    }
    let hand = controller(&rig);
    until("it is admitted", || {
        SessionInfo::read(&folder).is_ok_and(|info| info.controller.is_some())
    });
    let pid = hand.pid();
    let line = entry(&token, own);
    if let Ok(mut stream) = UnixStream::connect(&door) {
        // The run may be over by now.
        let _ = writeln!(stream, "{line}");
        let mut said = String::new();
        let _ = BufReader::new(stream).read_line(&mut said);
        let expected = format!("process {pid} is the controller of this run");
        assert!(said.is_empty() || said.contains(&expected), "{said}");
    }
    let run = running.finish().expect(0);
    assert_eq!(run.digest(), digest);
    assert_eq!(hand.end().0, Some(0));
    let secret = token["token"].as_str().expect("text");
    let mut kept = vec![run.stderr.clone(), run.stdout.clone()];
    for file in std::fs::read_dir(&run.folder).expect("a folder").flatten() {
        let bytes = std::fs::read(file.path()).expect("a file");
        kept.push(String::from_utf8_lossy(&bytes).into_owned());
    }
    assert!(kept.iter().all(|text| !text.contains(secret)));
}

/// The token of another session of this user.
fn second_session(rig: &Rig) -> Value {
    let name = format!("{}-2", rig.session());
    let folder = rig.session_folder().with_file_name(&name);
    let out = rig.path("second");
    let out = out.to_str().expect("text");
    let arguments = [
        "run",
        SCENARIO,
        "--controller",
        "external",
        "--session",
        &name,
        "--out",
        out,
    ];
    let running = rig.start_hil(&arguments);
    let file = folder.join("controller.token");
    awaited(&folder, "controller");
    let token = std::fs::read_to_string(file).expect("text");
    running.signal(Signal::INT);
    assert_eq!(running.finish_beside_another().code, Some(130));
    assert!(!Path::new(out).exists());
    serde_json::from_str(&token).expect("JSON")
}

#[test]
fn a_second_process_with_the_right_token_is_refused() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit 60");
    let (code, said) = controller(&rig).end();
    assert_eq!(code, Some(2), "{said}");
    let expected = format!("process {} is the controller of this run", hand.pid());
    assert!(said.contains(&expected), "{said}");
    resume(&rig);
    running.finish().expect(0);
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn an_interrupted_wait_leaves_nothing() {
    for flags in [
        "--controller external",
        "--plant external --controller external",
    ] {
        let rig = Rig::new();
        let running = rig.start(&format!("{SCENARIO} {flags}"));
        let folder = running.folder().to_owned();
        awaited(&rig.session_folder(), "controller");
        // One of two is there, and goes too.
        let hand = flags.contains("plant").then(|| plant(&rig));
        if hand.is_some() {
            until("the plant is admitted", || {
                SessionInfo::read(&rig.session_folder()).is_ok_and(|info| info.children.len() == 1)
            });
        }
        running.signal(Signal::INT);
        let run = running.finish().expect(130);
        assert!(!folder.exists(), "{}", run.stderr);
        if let Some(hand) = hand {
            assert_ne!(hand.end().0, Some(0));
        }
    }
}

#[test]
fn an_interrupted_run_ends_a_side_that_is_held() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit inf");
    hand.stop();
    resume(&rig);
    running.signal(Signal::INT);
    let run = running.finish().expect(130);
    assert_eq!(run.summary()["verdict"], "aborted");
    assert_eq!(hand.end().0, None);
}

#[test]
fn whatever_ends_it_its_end_is_named() {
    let program = misbehaving_controller();
    let path = program.display();
    let silent = "controller, started by hand, is gone without a word";
    for (law, expected) in [("panics", "controller panicked"), ("leaves", silent)] {
        let rig = Rig::new();
        let scenario = format!(
            "{SCENARIO} --controller-bin {path} --set controller.law={law} --controller external"
        );
        let scenario = scenario_without_gains(&rig, &scenario);
        let running = rig.start(&scenario);
        let hand = Hand::start(&rig, "controller", &program, &[]);
        let run = running.finish().expect(3);
        let reason = run.summary()["reason"].to_string();
        assert!(reason.contains(expected), "{law}: {reason}");
        hand.end();
    }
    for side in ["plant", "controller"] {
        let rig = Rig::new();
        let running = rig.start(&format!(
            "{SCENARIO} --{side} external --pause-at 2.5 --wait-limit inf"
        ));
        let hand = match side {
            "plant" => plant(&rig),
            _ => controller(&rig),
        };
        is_held(&rig);
        send(hand.pid(), Signal::KILL);
        let run = running.finish().expect(3);
        let reason = run.summary()["reason"].to_string();
        let expected = format!("{side}, started by hand, is gone without a word");
        assert!(reason.contains(&expected), "{reason}");
    }
}

/// The teaching scenario without what only the law `pid` has.
fn scenario_without_gains(rig: &Rig, arguments: &str) -> String {
    let text = std::fs::read_to_string(workspace().join(SCENARIO));
    let text = text.expect("text");
    let (before, after) = text.split_once("[controller.pid]").expect("gains");
    let after = after.split_once("[[stimuli]]").expect("stimuli").1;
    let path = rig.write("plain.toml", &format!("{before}[[stimuli]]{after}"));
    arguments.replace(SCENARIO, path.to_str().expect("text"))
}

#[test]
fn it_ends_with_a_killed_hil_also_if_it_is_stopped() {
    let rig = Rig::alone();
    for is_stopped in [false, true] {
        let (running, hand) = held(&rig, "--wait-limit inf");
        if is_stopped {
            hand.stop();
        }
        running.kill();
        if is_stopped {
            // The next command, whichever it is, ends what a dead one left.
            rig.hil(&["config", "schema"]).expect(0);
            assert_eq!(hand.end().0, None);
        } else {
            let (code, said) = hand.end();
            assert_eq!(code, Some(3), "{said}");
            // Its own leash or the plant's word comes first.
            let told = [
                "stopped at step 2500",
                "gave up at step 2500: it was asked to stop",
            ];
            assert!(told.iter().any(|told| said.contains(told)), "{said}");
            rig.hil(&["config", "schema"]).expect(0);
        }
        rig.assert_nothing_left();
    }
}

#[test]
fn a_swap_brings_a_controller_that_hil_starts() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit 60");
    let swap = [
        "controller",
        "swap",
        "--set",
        "controller.law=hold",
        "--json",
        "--session",
        rig.session(),
    ];
    rig.beside(&swap).expect(0);
    resume(&rig);
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
    let run = running.finish().expect(0);
    assert!(run.stdout.contains("same digest as"), "{}", run.stdout);
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    let rig = Rig::new();
    let script = rig.script(
        "controller",
        &format!(
            "#!/bin/sh\nexec {} \"$@\"\n",
            program("controller-process").display()
        ),
    );
    let script = format!(
        "{SCENARIO} --controller external --controller-bin {}",
        script.display()
    );
    let other = "scenarios/severe-leakage.toml";
    for (arguments, expected) in [
        (
            format!("{SCENARIO} --controller external --link in-process"),
            "--controller external needs a process to start",
        ),
        (
            format!("{SCENARIO} --plant external --target me@board"),
            "--plant external is for a side on this machine",
        ),
        (
            format!("{SCENARIO} {other} --controller external"),
            "--controller external is for a single run; several run by themselves",
        ),
        (
            format!("{SCENARIO} --controller external --repeat 2"),
            "--controller external is for a single run; several run by themselves",
        ),
        (
            format!("{SCENARIO} --controller external --jobs 1"),
            "--controller external is for a single run; leave out --jobs",
        ),
        (
            format!("{SCENARIO} --controller external --audit"),
            "--audit starts both sides again and again",
        ),
        (
            script,
            "is a script, and which one an interpreter runs cannot be seen",
        ),
    ] {
        rig.run(&arguments).expect(2).says(&[expected]);
    }
    // Where nobody waits for one.
    let running = rig.held();
    let mut hand = Command::new(program("controller-process"));
    hand.arg("--session")
        .arg(rig.session_folder())
        .arg("--by-hand");
    let told = rig.program(hand);
    told.expect(2).says(&[
        "waits for no controller that is started by hand",
        "hil run --controller external",
    ]);
    resume(&rig);
    running.finish().expect(0);
}

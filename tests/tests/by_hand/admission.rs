//! Admission of a side, and refusals before any side is awaited.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::{Value, json};

use super::{Hand, SCENARIO, awaited, controller, held, launched};
use crate::support::harness::{Rig, until};
use crate::support::programs::{misbehaving_controller, program};

/// User ID of `nobody`.
const NOBODY: u32 = 65534;

/// Sends a message to the controller's socket, and returns the answer.
fn asked(folder: &Path, line: &str) -> String {
    let mut stream = UnixStream::connect(folder.join("controller.door")).expect("a door");
    writeln!(stream, "{line}").expect("written");
    let mut text = String::new();
    BufReader::new(stream)
        .read_line(&mut text)
        .expect("an answer");
    text
}

/// Returns the entry that a program sends.
fn entry(token: &Value, process: ProcessId) -> String {
    json!({"token": token, "process": process}).to_string()
}

#[test]
fn no_other_process_is_admitted() {
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
    #[rustfmt::skip] // a table
    let cases = [
        ("nonsense", "hello".to_owned(), "not a request"),
        ("no token", json!({"process": own}).to_string(), "missing field `token`"),
        ("a wrong token", entry(&wrong, own), "the token does not belong to the controller of this session"),
        ("the token of another session", entry(&second, own), "the token does not belong to the controller of this session"),
        ("the name of another process", entry(&token, ProcessId::of(1).expect("the first")), "it claims to be process 1, but process"),
        ("a process of before", entry(&token, ProcessId { start_ticks: own.start_ticks + 1,..own }), "it claims to be process"),
        ("another program with the right token", entry(&token, own), ": start that program, or name yours with --controller-bin"),
    ];
    for (attempt, line, expected) in cases {
        let answer = asked(&folder, &line);
        assert!(
            answer.contains("refused") && answer.contains(expected),
            "{attempt}: {answer}"
        );
    }
    // A program with a complete implementation, from another file.
    let (code, answer) = Hand::start(&rig, "controller", &misbehaving_controller(), &[]).end();
    assert_eq!(code, Some(2), "{answer}");
    assert!(
        answer.contains("misbehaving-controller with hash"),
        "{answer}"
    );
    if rustix::process::geteuid().is_root() {
        let mut cat = Command::new("cat");
        let output = cat
            .arg(&file)
            .uid(NOBODY)
            .gid(NOBODY)
            .output()
            .expect("cat");
        assert!(!output.status.success() && output.stdout.is_empty());
        let mut shell = rig.command(program("controller-process"));
        let output = shell.arg("--session").arg(&folder).arg("--by-hand");
        let output = output.uid(NOBODY).gid(NOBODY).output();
        // The user may not even be allowed to run the program.
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
        let mut answer = String::new();
        let _ = BufReader::new(stream).read_line(&mut answer);
        let expected = format!("process {pid} is already the controller of this run");
        assert!(answer.is_empty() || answer.contains(&expected), "{answer}");
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

/// Starts another session of this user; returns its token.
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
    let (code, output) = controller(&rig).end();
    assert_eq!(code, Some(2), "{output}");
    let expected = format!(
        "process {} is already the controller of this run",
        hand.pid()
    );
    assert!(output.contains(&expected), "{output}");
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
    assert_eq!(hand.end().0, Some(0));
}

#[test]
fn contradictory_options_are_refused_by_name() {
    let rig = Rig::new();
    let script = rig.script(
        "controller",
        &format!(
            "#!/bin/sh\nexec '{}' \"$@\"\n",
            program("controller-process").display()
        ),
    );
    let script = format!(
        "{SCENARIO} --controller external --controller-bin {}",
        script.display()
    );
    let other = "scenarios/severe-leakage.toml";
    #[rustfmt::skip] // a table
    let cases = [
        (format!("{SCENARIO} --controller external --link in-process"), "--controller external needs a process to start"),
        (format!("{SCENARIO} --plant external --target me@board"), "--plant external works only for a side on this machine"),
        (format!("{SCENARIO} {other} --controller external"), "--controller external requires a single run"),
        (format!("{SCENARIO} --controller external --repeat 2"), "--controller external requires a single run"),
        (format!("{SCENARIO} --controller external --jobs 1"), "--controller external requires a single run; omit --jobs"),
        (format!("{SCENARIO} --controller external --audit"), "--audit starts both sides repeatedly"),
        (script, "is a script, whose process is its interpreter and so cannot be identified"),
    ];
    for (arguments, expected) in cases {
        rig.run(&arguments).expect(2).says(&[expected]);
    }
    // A session that awaits no side.
    let running = rig.held();
    let mut hand = rig.command(program("controller-process"));
    hand.arg("--session")
        .arg(rig.session_folder())
        .arg("--by-hand");
    let output = rig.program(hand);
    output.expect(2).says(&[
        "expects no manually started controller",
        "hil run --controller external",
    ]);
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}

//! Listening agent instead of `ssh`.

use std::io::Write;
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::mpsc::Receiver;

use tempfile::TempDir;

use super::{SHORT, text};
use crate::support::company::Companion;
use crate::support::harness::{Rig, Run, WATCHDOG};
use crate::support::hosts::lines;
use crate::support::programs::program;

/// Listening agent; stopped when dropped.
struct Listening {
    _serving: Companion,
    address: String,
    key: PathBuf,
    log: Receiver<String>,
    /// Not the test's session: the agent outlives a run.
    _folder: TempDir,
}

impl Listening {
    fn start(rig: &Rig) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let key = folder.path().join("board.key");
        rig.hil(&["target", "key", text(&key)]).expect(0);
        let mut serve = rig.command(program("hil"));
        serve.args(["target", "serve", "--listen", "127.0.0.1:0", "--key-file"]);
        serve
            .arg(&key)
            .arg("--allow")
            .arg(program("controller-process"));
        let mut serving = Companion::start(serve.stderr(Stdio::piped()));
        let log = lines(serving.stderr.take().expect("piped"));
        let first = log.recv_timeout(WATCHDOG);
        let first = first.expect("watchdog: it says where it listens");
        let address = first.strip_prefix("listening on ").expect("an address");
        Self {
            _serving: serving,
            address: address.to_owned(),
            key,
            log,
            _folder: folder,
        }
    }

    fn target(&self) -> String {
        format!(
            "--target serve://{} --key-file {}",
            self.address,
            text(&self.key)
        )
    }

    fn check(&self, rig: &Rig) -> Run {
        let target = format!("serve://{}", self.address);
        rig.beside(&["target", "check", &target, "--key-file", text(&self.key)])
    }

    fn contact(&self) -> TcpStream {
        TcpStream::connect(&self.address).expect("it listens")
    }

    /// Reads the log up to the line that contains this text.
    fn log_until(&self, last: &str) -> Vec<String> {
        let mut lines = Vec::new();
        while !lines
            .last()
            .is_some_and(|line: &String| line.contains(last))
        {
            lines.push(self.log.recv_timeout(WATCHDOG).expect("watchdog: it logs"));
        }
        lines
    }
}

#[test]
fn silent_contacts_of_the_same_host_do_not_keep_the_honest_one_out() {
    let rig = Rig::new();
    let listening = Listening::start(&rig);
    let silent: Vec<TcpStream> = (0..50).map(|_| listening.contact()).collect();
    listening.check(&rig).expect(0);
    // Contacts with invalid messages hold no slot either.
    for mut contact in &silent {
        let _ = contact.write_all(b"\x20\0GET / HTTP/1.1"); // it may be closed by now
    }
    listening.check(&rig).expect(0);
}

#[test]
fn failed_contacts_are_counted_and_not_logged_individually() {
    let rig = Rig::new();
    let listening = Listening::start(&rig);
    for _ in 0..2000 {
        drop(listening.contact());
    }
    listening.check(&rig).expect(0);
    let lines = listening.log_until("the session has ended");
    // One at once, and one a minute.
    let refused = lines.iter().filter(|line| line.contains("refused"));
    let count = refused.count();
    assert!((1..=3).contains(&count), "{lines:?}");
}

#[test]
fn a_contact_during_a_session_is_told_who_owns_it() {
    let rig = Rig::new();
    let listening = Listening::start(&rig);
    let target = listening.target();
    let running = rig.start(&format!(
        "scenarios/spring-mass.toml --pause-at 0.1 {target}"
    ));
    rig.until_held_at(100);
    let silent: Vec<TcpStream> = (0..50).map(|_| listening.contact()).collect();
    let refused = listening.check(&rig).expect(3);
    refused.says(&["it is serving another session, from 127.0.0.1:"]);
    drop(silent);
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
    listening.check(&rig).expect(0);
}

#[test]
fn a_listening_agent_serves_holders_of_the_key_and_runs_listed_programs_only() {
    let rig = Rig::new();
    let listening = Listening::start(&rig);
    let key = text(&listening.key);
    assert_eq!(
        std::fs::metadata(key).expect("there").permissions().mode() & 0o777,
        0o600
    );
    rig.hil(&["target", "key", key])
        .expect(2)
        .says(&["already exists"]);
    let (address, target) = (&listening.address, listening.target());

    let here = rig.run(SHORT).expect(0).summary();
    let there = rig.run(&format!("{SHORT} {target}")).expect(0).summary();
    assert_eq!(there["digest"], here["digest"]);
    let again = rig.run(&format!("{SHORT} {target}")).expect(0).summary();
    assert_eq!(again["digest"], here["digest"]);

    let unlisted = rig.path("unlisted");
    std::fs::copy(program("plant-process"), &unlisted).expect("copied");
    rig.run(&format!(
        "{SHORT} {target} --controller-bin {}",
        text(&unlisted)
    ))
    .expect(2)
    .says(&["runs only the programs that were listed"]);
    let stranger = rig.path("stranger.key");
    rig.hil(&["target", "key", text(&stranger)]).expect(0);
    rig.hil(&[
        "target",
        "check",
        &format!("serve://{address}"),
        "--key-file",
        text(&stranger),
    ])
    .expect(3)
    .says(&["no handshake", "another key"]);
    // It continues to serve.
    rig.hil(&[
        "target",
        "check",
        &format!("serve://{address}"),
        "--key-file",
        key,
    ])
    .expect(0);
}

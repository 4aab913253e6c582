//! An agent that listens, in place of `ssh`.

use std::os::unix::fs::PermissionsExt;
use std::process::Stdio;

use super::{SHORT, text};
use crate::support::company::Companion;
use crate::support::harness::{Rig, WATCHDOG};
use crate::support::hosts::lines;
use crate::support::programs::program;

#[test]
fn an_agent_that_listens_serves_who_has_the_key_and_runs_what_is_listed() {
    let rig = Rig::new();
    // Not in the test's folder: one who serves goes on after a run.
    let folder = tempfile::tempdir().expect("a folder");
    let key = folder.path().join("board.key");
    let key = text(&key);
    rig.hil(&["target", "key", key]).expect(0);
    assert_eq!(
        std::fs::metadata(key).expect("there").permissions().mode() & 0o777,
        0o600
    );
    rig.hil(&["target", "key", key])
        .expect(2)
        .says(&["is there already"]);
    let listed = program("controller-process");
    let mut serve = rig.command(program("hil"));
    serve.args([
        "target",
        "serve",
        "--listen",
        "127.0.0.1:0",
        "--key-file",
        key,
        "--allow",
    ]);
    let mut serving = Companion::start(serve.arg(&listed).stderr(Stdio::piped()));
    let said = lines(serving.stderr.take().expect("piped"));
    let first = said.recv_timeout(WATCHDOG);
    let first = first.expect("watchdog: it says where it listens");
    let address = first.strip_prefix("listening on ").expect("an address");
    let target = format!("--target serve://{address} --key-file {key}");

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
    // It serves on.
    rig.hil(&[
        "target",
        "check",
        &format!("serve://{address}"),
        "--key-file",
        key,
    ])
    .expect(0);
}

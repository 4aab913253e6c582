//! Controller on another machine: the same digest, whatever happens on the wire, and nothing left behind on either
//! side.

mod listening;
mod long;
mod processor;
mod stopped;
mod unusable;
mod wire;

use std::os::unix::fs::PermissionsExt;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::support::board::Board;
use crate::support::harness::{Rig, Run, send, text, until};
use crate::support::programs::{program, workspace};

/// Less than a second of the teaching run, without metrics and requirements.
const SHORT: &str =
    "scenarios/spring-mass.toml --set run.duration_s=0.8 --set metrics=[] --set requirements=[]";
const ON_BOARD: &str = "--target me@board";

fn run(rig: &Rig, board: &Board, arguments: &str) -> Run {
    rig.start_with(board.hil(), arguments).finish()
}

fn hil(rig: &Rig, board: &Board, arguments: &[&str]) -> Run {
    let mut hil = board.hil();
    hil.args(arguments);
    rig.program(hil)
}

fn log(run: &Run) -> String {
    std::fs::read_to_string(run.folder.join("controller.log")).unwrap_or_default()
}

/// Waits for the process on the board with this first argument.
fn there(board: &Board, argument: &str) -> u32 {
    let mut result = None;
    until("it runs there", || {
        result = board.processes(argument).first().copied();
        result.is_some()
    });
    result.expect("it runs there")
}

/// Waits until steps are being exchanged.
fn under_way(rig: &Rig) {
    until("steps are exchanged", || rig.status().step > 10);
}

/// Lists sessions of this test without a given name, as created by agents.
fn sessions(rig: &Rig) -> Vec<String> {
    let entries = std::fs::read_dir(rig.sessions());
    let names = (entries.into_iter().flatten().flatten()).map(|entry| entry.file_name());
    names
        .map(|name| name.to_string_lossy().into_owned())
        .filter(|name| name.starts_with('s'))
        .collect()
}

fn no_process_there(board: &Board) {
    until("nothing runs there any more", || {
        board.processes("agent").is_empty() && board.processes("--session").is_empty()
    });
}

#[test]
fn a_run_on_a_target_has_the_digest_of_the_desk_and_records_the_target() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let here = rig.run(SHORT).expect(0).summary();
    let run = run(&rig, &board, &format!("{SHORT} {ON_BOARD}"))
        .expect(0)
        .prints(&["controller on target me@board"]);
    let there = run.summary();
    assert_eq!(there["digest"], here["digest"]);
    assert_eq!(here["target"], Value::Null);
    let target = &there["target"];
    assert_eq!(target["name"], "me@board");
    let kernel = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").expect("it is there");
    assert_eq!(target["boot_id"], kernel.trim());
    // Two ends on one machine prove nothing about another.
    assert_eq!(there["evidence"], "sil");
    // The same file runs on both sides.
    assert_eq!(there["controller"]["blake3"], here["controller"]["blake3"]);

    // Each program states its source; the lock file is that of this workspace.
    let lock = std::fs::read(workspace().join("Cargo.lock")).expect("read");
    let git = |arguments: &[&str]| {
        let mut git = std::process::Command::new("git");
        let output = git.args(arguments).current_dir(workspace()).output();
        output.is_ok_and(|output| output.status.success())
    };
    let is_clone = git(&["rev-parse", "HEAD"]);
    for (side, package) in [
        ("plant", "plant-process/src"),
        ("controller", "controller-process/src"),
    ] {
        let build = &there[side]["build"];
        assert_eq!(build["lock_blake3"], *blake3::hash(&lock).to_hex());
        let commit = build["commit"].as_str();
        // A copy of a clone has programs that were built in the clone.
        assert!(commit.is_some() || !is_clone, "{build}");
        // The commit contains the sources, unless they are marked as modified.
        let shared = ["shared-types/src", "shared-types/session/src"];
        let same = |commit| {
            let diff = ["diff", "--quiet", commit, "--", package];
            git(&[&diff[..], &shared].concat())
        };
        let is_modified = build["modified"].as_bool().expect("true or false");
        assert!(
            is_modified || !is_clone || commit.is_none_or(same),
            "{build}"
        );
    }

    // Agent and program are cached under their hashes, for this user alone; and can be removed.
    let kept = |board: &Board| -> Vec<(String, u32)> {
        let files = std::fs::read_dir(board.cache()).expect("the cache");
        let files = files.flatten().map(|file| {
            let mode = file.metadata().expect("there").permissions().mode();
            (
                file.file_name().to_string_lossy().into_owned(),
                mode & 0o777,
            )
        });
        files.collect()
    };
    let files = kept(&board);
    assert!(
        files
            .iter()
            .any(|(name, _)| *name == here["controller"]["blake3"])
    );
    assert!(
        files.len() == 2
            && files
                .iter()
                .all(|(name, mode)| name.len() == 64 && *mode == 0o500),
        "{files:?}"
    );
    // The agent that ran there is the other file.
    let agent = files
        .iter()
        .find(|(name, _)| *name != here["controller"]["blake3"]);
    let agent = board.cache().join(&agent.expect("two files").0);
    let agent = blake3::hash(&std::fs::read(agent).expect("read"));
    assert_eq!(target["agent_blake3"], *agent.to_hex());
    assert!(target["free_bytes"].as_u64() > Some(0), "{target}");
    let mode = std::fs::metadata(board.cache())
        .expect("there")
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o700);
    hil(&rig, &board, &["target", "clean", "me@board"]).expect(0);
    assert_eq!(kept(&board), []);
}

#[test]
fn recordings_of_desk_and_target_can_be_replayed_and_repeated_on_the_other() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let here = rig.run(SHORT).expect(0);
    let there = run(&rig, &board, &format!("{SHORT} {ON_BOARD}")).expect(0);
    let folders = [text(&here.folder), text(&there.folder)];
    let replayed = hil(
        &rig,
        &board,
        &["replay", folders[0], "--target", "me@board", "--json"],
    )
    .expect(0)
    .json();
    assert_eq!(replayed["verdict"], "same", "{replayed}");
    rig.hil(&["replay", folders[1]]).expect(0);
    rig.hil(&["compare", folders[0], folders[1]]).expect(0);
    let again = rig.path("again");
    hil(
        &rig,
        &board,
        &[
            "rerun",
            folders[0],
            "--target",
            "me@board",
            "--out",
            text(&again),
        ],
    )
    .expect(0);
}

#[test]
fn a_real_time_run_on_a_target_repeats_at_the_desk_with_the_same_digest() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let overrun = "--clock realtime";
    let there = run(&rig, &board, &format!("{SHORT} {ON_BOARD} {overrun}")).expect(0);
    rig.rerun(&there.folder, &[]).expect(0);
}

#[test]
fn frames_use_the_connection_if_no_datagrams_get_through() {
    let rig = Rig::new();
    // Not an address of this machine: the agent has no socket there.
    let board = Board::reached_by(&rig, "export SSH_CONNECTION='203.0.113.1 1 203.0.113.2 2'");
    let here = rig.run(SHORT).expect(0).summary();
    let there = run(&rig, &board, &format!("{SHORT} {ON_BOARD}")).expect(0);
    assert_eq!(there.summary()["digest"], here["digest"]);
    assert!(
        log(&there).contains("no datagrams get through"),
        "{}",
        log(&there)
    );
}

#[test]
fn a_noisy_shell_profile_is_harmless_and_an_endless_one_is_named() {
    let rig = Rig::new();
    let local = "export SSH_CONNECTION='127.0.0.1 1 127.0.0.1 2'";
    let board = Board::reached_by(&rig, &format!("{local}\necho Welcome; printf 'to the '"));
    hil(&rig, &board, &["target", "check", "me@board"]).expect(0);
    let board = Board::reached_by(&rig, &format!("{local}\nyes"));
    let refused = hil(&rig, &board, &["target", "check", "me@board"]).expect(2);
    refused.says(&["its shell profile prints without end"]);
}

#[test]
fn a_check_describes_the_target() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let checked = hil(&rig, &board, &["target", "check", "me@board", "--json"])
        .expect(0)
        .json();
    let machine = rustix::system::uname();
    assert_eq!(checked["machine"], *machine.machine().to_string_lossy());
    assert_eq!(checked["host"], *machine.nodename().to_string_lossy());
    let trip = &checked["round_trip_ns"];
    assert!(
        trip["p50"].as_u64() > Some(0) && trip["p99"].as_u64() >= trip["p50"].as_u64(),
        "{checked}"
    );
    assert!(checked["fit_for_hz"].as_f64() > Some(0.0), "{checked}");
    assert!(checked["cache_free_bytes"].as_u64() > Some(0), "{checked}");
    assert_eq!(checked["hindrance"], Value::Null);
}

#[test]
fn an_audit_compares_the_target_with_this_machine() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let audit = run(&rig, &board, &format!("{SHORT} {ON_BOARD} --audit")).expect(0);
    let line = audit
        .stdout
        .lines()
        .find(|line| line.contains("on this machine in place of me@board"));
    assert!(
        line.is_some_and(|line| line.contains("same")),
        "{}",
        audit.stdout
    );
}

#[test]
fn live_faults_and_swaps_work_on_a_target() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let held = format!("{SHORT} --pause-at 0.5 --wait-limit 60 {ON_BOARD}");
    let running = rig.start_with(board.hil(), &held);
    let session = ["--session", rig.session()];
    let beside = |arguments: &[&str]| {
        let mut hil = board.hil();
        hil.args(arguments).args(session);
        rig.program(hil)
    };
    rig.until_held_at(500);
    let first = there(&board, "--session");
    beside(&["inject", "bias", "measured.position_m", "0.001"]).expect(0);
    // The run is paused until the other one has taken over: it cannot end before.
    beside(&["controller", "swap", "--set", "controller.law=hold"]).expect(0);
    until("the other one alone is there", || {
        let there = board.processes("--session");
        there.len() == 1 && there[0] != first
    });
    beside(&["resume"]).expect(0);
    let run = running.finish().expect(0);
    let summary = run.summary();
    assert_eq!(
        summary["controllers"].as_array().map(Vec::len),
        Some(2),
        "{summary}"
    );
    assert_eq!(summary["faults"][0]["source"], "cli");
    no_process_there(&board);
}

#[test]
fn the_death_of_a_controller_on_a_target_is_named_and_the_policy_applies() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let long = "scenarios/spring-mass.toml --pace 1 --set requirements=[]";
    let running = rig.start_with(board.hil(), &format!("{long} {ON_BOARD}"));
    under_way(&rig);
    send(there(&board, "--session"), Signal::KILL);
    let run = running.finish().expect(3);
    let expected = [&run.stderr, &*log(&run)].concat();
    assert!(
        expected.contains("target me@board: the controller was killed by signal 9"),
        "{expected}"
    );
    no_process_there(&board);

    let restart = "--set run.on_controller_loss=wait-for-restart --set metrics=[]";
    let running = rig.start_with(board.hil(), &format!("{long} {restart} {ON_BOARD}"));
    under_way(&rig);
    send(there(&board, "--session"), Signal::KILL);
    let summary = running.finish().expect(0).summary();
    assert_eq!(
        summary["controllers"].as_array().map(Vec::len),
        Some(2),
        "{summary}"
    );
    no_process_there(&board);
}

#[test]
fn a_killed_agent_ends_the_run_and_the_next_contact_cleans_up() {
    let rig = Rig::new();
    let before = sessions(&rig);
    let board = Board::new(&rig);
    let running = rig.start_with(
        board.hil(),
        &format!("scenarios/spring-mass.toml --pace 1 {ON_BOARD}"),
    );
    running.children_at_once();
    there(&board, "--session");
    send(there(&board, "agent"), Signal::KILL);
    let run = running.finish_beside_another().expect(3);
    let expected = [&run.stderr, &*log(&run)].concat();
    assert!(
        expected.contains("target me@board: connection lost"),
        "{expected}"
    );
    assert_ne!(sessions(&rig), before, "the agent was killed");
    hil(&rig, &board, &["target", "check", "me@board"]).expect(0);
    no_process_there(&board);
    assert_eq!(sessions(&rig), before);
}

#[test]
fn nothing_continues_on_the_target_however_the_desk_ends() {
    let rig = Rig::new();
    let before = sessions(&rig);
    let board = Board::new(&rig);
    let paced = format!("scenarios/spring-mass.toml --pace 1 {ON_BOARD}");
    let running = rig.start_with(board.hil(), &paced);
    running.children_at_once();
    there(&board, "--session");
    running.signal(Signal::INT);
    running.finish().expect(130);
    no_process_there(&board);

    let running = rig.start_with(board.hil(), &paced);
    running.children_at_once();
    there(&board, "--session");
    running.kill();
    no_process_there(&board);
    // The desk's session is left for the next `hil`; the board's agent removed its own.
    assert_eq!(sessions(&rig), before);
    rig.hil(&["sessions", "--clean"]).expect(0);
    rig.assert_nothing_left();
}

#[test]
fn a_silent_target_is_abandoned_by_name() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    // A paused run awaits no answer: only the bridge can miss the target.
    let held = format!("scenarios/spring-mass.toml --pause-at 0.5 {ON_BOARD}");
    let running = rig.start_with(board.hil(), &held);
    rig.until_held_at(500);
    let agent = there(&board, "agent");
    send(agent, Signal::STOP);
    let run = running.finish_beside_another().expect(3);
    // A pause is not a sample: the last one was that of the previous step.
    assert!(
        log(&run).contains("target me@board: nothing received since step 499 for 4.5 s"),
        "{}",
        log(&run)
    );
    // When it continues, the silent agent notices the closed connection.
    let _ = kill_process(Pid::from_raw(agent as i32).expect("a number"), Signal::CONT); // `ssh` may have ended it
    no_process_there(&board);
    // Then its session is still there, for the next contact to remove.
    hil(&rig, &board, &["target", "check", "me@board"]).expect(0);
    rig.assert_nothing_left();
}

#[test]
fn contradictory_options_are_refused_and_nothing_is_started() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    let foreign = rig.path("foreign");
    let mut content = std::fs::read(program("controller-process")).expect("read");
    (content[18], content[19]) = (183, 0); // an aarch64 ELF file
    std::fs::write(&foreign, content).expect("written");
    std::fs::set_permissions(&foreign, std::fs::Permissions::from_mode(0o755)).expect("executable");
    let open = rig.path("open.key");
    rig.hil(&["target", "key", text(&open)]).expect(0);
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o644)).expect("opened");
    let nothing = rig.write("no.key", "nothing");
    std::fs::set_permissions(&nothing, std::fs::Permissions::from_mode(0o600)).expect("closed");
    let (foreign, open, nothing) = (text(&foreign), text(&open), text(&nothing));
    #[rustfmt::skip] // a table
    let cases = [
        ("--target -oProxyCommand=x", "unexpected argument"),
        ("--target=-oProxyCommand=x", "is not a target"),
        ("--target a;b", "is not a target"),
        ("--target serve://board", "is not a target"),
        ("--key-file board.key", "--target <TARGET>"),
        (&format!("{ON_BOARD} --key-file {open}"), "ssh uses its own keys"),
        ("--target serve://127.0.0.1:1", "needs its key"),
        (&format!("--target serve://127.0.0.1:1 --key-file {open}"), "can be read by others"),
        (&format!("--target serve://127.0.0.1:1 --key-file {nothing}"), "holds no key"),
        (&format!("{ON_BOARD} --controller-bin {foreign}"), "is built for aarch64, but the target is"),
        (&format!("{ON_BOARD} --target-agent {foreign}"), "is built for aarch64, but the target is"),
        (&format!("{ON_BOARD} --link in-process"), "needs a process on the target"),
        (&format!("{ON_BOARD} --checkpoint-at 0.1"), "--checkpoint-at cannot be used with --target"),
    ];
    for (arguments, expected) in cases {
        let run = run(&rig, &board, &format!("{SHORT} {arguments}")).expect(2);
        assert!(!run.folder.exists(), "{arguments}");
        run.says(&[expected]);
    }
    let key = rig.path("own.key");
    rig.hil(&["target", "key", text(&key)]).expect(0);
    let nobody = format!(
        "{SHORT} --target serve://127.0.0.1:1 --key-file {}",
        text(&key)
    );
    rig.run(&nobody).expect(3).says(&["Connection refused"]);
}

#[test]
fn messages_of_ssh_are_passed_on_with_the_right_exit_code() {
    let rig = Rig::new();
    for (expected, code) in [
        (
            "ssh: Could not resolve hostname board: Name or service not known",
            2,
        ),
        ("Host key verification failed.", 2),
        ("me@board: Permission denied (publickey).", 2),
        (
            "ssh: connect to host board port 22: Connection timed out",
            3,
        ),
        ("ssh: connect to host board port 22: No route to host", 3),
    ] {
        let board = Board::reached_by(&rig, &format!("echo '{expected}' >&2; exit 255"));
        let run = run(&rig, &board, &format!("{SHORT} {ON_BOARD}")).expect(code);
        assert!(!run.folder.exists(), "{expected}");
        run.says(&["target me@board", expected]);
    }
}

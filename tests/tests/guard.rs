//! Deaths of `hil` itself: the guard ends both sides, leaves a summary, and nothing else; to terminals, shells and
//! scripts, guard and run are one process.

use std::fs;
use std::io::{Read, Write, pipe};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use hil_session::process::ProcessId;
use hil_session::session::SessionInfo;
use rustix::fs::{OFlags, XattrFlags, fcntl_setfl, setxattr};
use rustix::process::{Pid, Signal, geteuid, kill_process};
use serde_json::Value;

use crate::support::harness::{Rig, Run, Running, send, text, until, until_gone};
use crate::support::programs::{
    misbehaving_controller, misbehaving_plant, program, shipped, skip, workspace,
};

/// ID of an unprivileged user.
const NOBODY: u32 = 65534;
/// Run that ends only when it is ended.
const ENDLESS: &str = "scenarios/severe-leakage.toml --set run.duration_s=1000 --wait-limit 60";

/// Returns the process that runs this test's session.
fn owner(rig: &Rig) -> ProcessId {
    let session = SessionInfo::read(&rig.session_folder());
    session.expect("the session is there").owner
}

fn summary_in(folder: &Path) -> Value {
    let text = fs::read_to_string(folder.join("summary.json"));
    serde_json::from_str(&text.expect("a summary")).expect("JSON")
}

/// Fails unless a run has the summary of a guard, and the commands that read summaries accept it.
#[track_caller]
fn assert_lost(rig: &Rig, run: &Run, cause: &str) {
    let summary = run.summary();
    assert_eq!(summary["verdict"], "aborted");
    assert_eq!(summary["digest"], Value::Null);
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(
        reason.contains(cause) && reason.contains("hil recover"),
        "{reason}"
    );
    let folder = text(&run.folder);
    let listed = rig.beside(&["runs", folder, "--json"]).expect(0).json();
    assert_eq!(listed["runs"][0]["verdict"], "aborted");
}

#[test]
fn a_plant_that_corrupts_its_shared_memory_ends_the_run_with_a_summary() {
    for deed in ["smears", "wipes"] {
        let rig = Rig::new();
        let scenario = rig.scenario(1000.0, deed, "hold");
        let plant = misbehaving_plant();
        let line = format!("{} --plant-bin {}", scenario.display(), plant.display());
        // It dies by a signal, or its recorder panics.
        let run = rig.run(&line).expect(3).says(&["hil recover"]);
        assert_lost(&rig, &run, "hil ");
    }
}

#[test]
fn a_run_killed_by_a_signal_has_a_summary_that_names_the_signal() {
    for (signal, name) in [
        (Signal::KILL, "SIGKILL (9)"),
        (Signal::SEGV, "SIGSEGV (11)"),
        (Signal::ABORT, "SIGABRT (6)"),
    ] {
        let rig = Rig::new();
        let running = rig.start(&format!("{ENDLESS} --json"));
        let children = running.children();
        let owner = owner(&rig);
        let pid = Pid::from_raw(owner.pid as i32).expect("a number");
        // Repeated: the standard library's handler ignores a SIGSEGV that was not caused by an access.
        until("it dies", || {
            let _ = kill_process(pid, signal); // it may have ended
            !owner.is_alive()
        });
        let run = running.finish().expect(3).says(&[name, "hil recover"]);
        assert!(children.iter().all(|child| !child.is_alive()));
        assert_eq!(run.json(), run.summary(), "{name}");
        assert_lost(&rig, &run, &format!("hil was killed by {name}"));
    }
}

#[test]
fn a_recovered_run_has_a_summary_of_its_recording_with_the_cause() {
    let rig = Rig::new();
    let running = rig.start(ENDLESS);
    running.children();
    send(owner(&rig).pid, Signal::KILL);
    let run = running.finish().expect(3);
    rig.hil(&["recover", text(&run.folder)]).expect(0);
    let summary = run.summary();
    assert!(summary["steps"].as_u64() > Some(0) && summary["digest"].is_string());
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(
        reason.contains("broke off") && reason.contains("SIGKILL"),
        "{reason}"
    );
}

#[test]
fn killing_the_guard_ends_its_run_and_the_next_hil_cleans_up() {
    let rig = Rig::new();
    let running = rig.start(ENDLESS);
    let children = running.children();
    let owner = owner(&rig);
    running.kill();
    // At once: the run may still be dying.
    rig.hil(&["sessions", "--clean"]).expect(0);
    until_gone(&children);
    until_gone(&[owner]);
}

#[test]
fn each_run_of_a_killed_suite_is_reported_as_it_ended() {
    let rig = Rig::new();
    let (junit, markdown) = (rig.path("all.xml"), rig.path("all.md"));
    let short = rig.write(
        "short.toml",
        &shipped("scenarios/spring-mass.toml")
            .replace("name = \"spring-mass\"", "name = \"short\""),
    );
    let running = rig.start(&format!(
        "{} scenarios/spring-mass.toml --repeat 2 --jobs 1 --junit {} --markdown {} --pace 5",
        short.display(),
        junit.display(),
        markdown.display()
    ));
    let second = running.folder().join("spring-mass-1");
    until("the second of four goes on", || {
        fs::metadata(second.join("run.mcap")).is_ok_and(|file| file.len() > 0)
    });
    let sessions = rig.session_folder();
    let session = format!("{}-2", rig.session());
    let info = SessionInfo::read(&sessions.with_file_name(session)).expect("it goes on");
    send(info.owner.pid, Signal::KILL);
    let suite = running.finish().expect(3);
    let suite = suite.says(&["SIGKILL"]).prints(&[
        "short-1",
        "pass",
        "spring-mass-1",
        "4 runs: 1 pass, 1 aborted, 2 not run",
    ]);
    assert_eq!(summary_in(&second)["verdict"], "aborted");
    let first = second.with_file_name("short-1");
    let summary = summary_in(&first);
    assert_eq!(summary["verdict"], "pass");
    let digest = summary["digest"].as_str().expect("a digest");
    let mut lines = suite.stdout.lines();
    let line = lines.find(|line| line.contains("short-1")).expect("a row");
    for cell in ["2 of 2", &digest[..8], &first.display().to_string()] {
        assert!(line.contains(cell), "{cell} is not in {line}");
    }
    let (junit, markdown) = (fs::read_to_string(junit), fs::read_to_string(markdown));
    let junit = junit.expect("written");
    assert!(
        junit.contains("errors=\"3\"") && junit.contains("SIGKILL"),
        "{junit}"
    );
    let markdown = markdown.expect("written");
    assert!(markdown.contains("1 of 4 runs pass"), "{markdown}");
}

#[test]
fn signals_to_the_started_process_end_the_run_in_order() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let rig = Rig::new();
        let running = rig.start(ENDLESS);
        running.children();
        send(running.pid(), signal);
        let summary = running.finish().expect(130).summary();
        let reason = summary["reason"].as_str().expect("a reason");
        assert!(reason.starts_with("interrupted"), "{signal:?}: {reason}");
    }
}

#[test]
fn a_run_stops_and_continues_under_job_control() {
    let rig = Rig::new();
    let running = rig.held();
    let run = owner(&rig);
    let guard = ProcessId::of(running.pid()).expect("it runs");
    for _ in 0..3 {
        send(guard.pid, Signal::TSTP);
        until("both are stopped", || {
            run.is_stopped() && guard.is_stopped()
        });
        send(guard.pid, Signal::CONT);
        until("both go on", || !run.is_stopped() && !guard.is_stopped());
    }
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}

#[test]
fn a_continuation_while_a_guard_stops_is_not_lost() {
    let rig = Rig::new();
    let running = rig.held();
    let run = owner(&rig);
    for _ in 0..10 {
        send(running.pid(), Signal::TSTP);
        // The guard is about to stop, and may not have done so yet.
        until("the run is stopped", || run.is_stopped());
        send(running.pid(), Signal::CONT);
        until("the run goes on", || !run.is_stopped());
    }
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}

/// Starts a run that ignores signals until a handler is registered, and pauses it.
fn held_ignoring<'r>(rig: &'r Rig, signals: &str) -> Running<'r> {
    let mut shell = rig.command("sh");
    let script = format!("trap '' {signals}; exec \"$0\" \"$@\"");
    shell.args(["-c", &script]).arg(program("hil"));
    let running = rig.start_with(
        shell,
        "scenarios/spring-mass.toml --pause-at 2.5 --wait-limit 60",
    );
    rig.until_held_at(2500);
    running
}

#[test]
fn a_run_under_nohup_ignores_the_end_of_its_terminal() {
    let rig = Rig::new();
    let running = held_ignoring(&rig, "HUP");
    for process in [running.pid(), running.worker()] {
        send(process, Signal::HUP);
    }
    rig.in_session("resume").expect(0);
    running.finish().expect(0);
}

#[test]
fn a_script_interrupts_its_background_job() {
    let rig = Rig::new();
    // A shell without job control starts background jobs like this.
    let running = held_ignoring(&rig, "INT QUIT");
    send(running.pid(), Signal::INT);
    running.finish().expect(130);
}

#[test]
fn a_run_ends_under_any_inherited_disposition_of_sigchld() {
    let rig = Rig::new();
    for option in ["--block-signal=CHLD", "--ignore-signal=CHLD"] {
        let env = |arguments: &[&str]| {
            let mut env = rig.command("env");
            env.arg(option).args(arguments);
            env
        };
        if rig.program(env(&["true"])).code != Some(0) {
            return skip("this `env` sets no signals", "HIL_TEST_ENV_SIGNALS");
        }
        let hil = program("hil");
        let start = |arguments: &str| rig.start_with(env(&[text(&hil)]), arguments);
        // The child may have ended before it is looked at.
        start("none.toml").finish().expect(2);
        start("scenarios/spring-mass.toml").finish().expect(0);
    }
}

#[test]
fn any_signal_that_kills_the_started_process_leaves_a_summary() {
    for (signal, name) in [
        (Signal::USR1, "SIGUSR1 (10)"),
        (Signal::ALARM, "SIGALRM (14)"),
    ] {
        let rig = Rig::new();
        let running = rig.start(ENDLESS);
        running.children();
        send(running.pid(), signal);
        let run = running.finish().expect(3).says(&[name]);
        assert_lost(&rig, &run, &format!("hil was killed by {name}"));
    }
}

/// Copies `hil` with its sides and gives it a privilege: its processes are then closed to others of the same user.
fn privileged(rig: &Rig) -> PathBuf {
    let folder = rig.path("programs");
    fs::create_dir(&folder).expect("a folder");
    for name in ["hil", "plant-process", "controller-process"] {
        fs::copy(program(name), folder.join(name)).expect("copied");
    }
    // Independent of the umask.
    for path in ["", "hil", "plant-process", "controller-process"] {
        let mode = fs::Permissions::from_mode(0o755);
        fs::set_permissions(folder.join(path), mode).expect("set");
    }
    let hil = folder.join("hil");
    // Second form of the attribute, effective at once: CAP_SYS_NICE, number 23.
    let words = [0x0200_0001_u32, 1 << 23, 0, 0, 0];
    let capability: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    setxattr(
        &hil,
        "security.capability",
        &capability,
        XattrFlags::empty(),
    )
    .expect("as root");
    hil
}

#[test]
fn a_killed_run_of_a_privileged_program_has_a_summary() {
    if !geteuid().is_root() {
        return skip("only root gives privileges", "HIL_TEST_ROOT");
    }
    let may_enter = |folder: &Path| fs::metadata(folder).is_ok_and(|it| it.mode() & 1 != 0);
    if !workspace().ancestors().all(may_enter) {
        return skip("the sources are closed to other users", "HIL_TEST_ROOT");
    }
    let rig = Rig::new();
    let folder = rig.path("");
    chown(&folder, Some(NOBODY), Some(NOBODY)).expect("as root");
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).expect("set");
    let mut hil = rig.command(privileged(&rig));
    hil.uid(NOBODY).gid(NOBODY);
    let running = rig.start_with(hil, ENDLESS);
    running.wait_for_records();
    send(running.worker(), Signal::KILL);
    let run = running.finish().expect(3).says(&["SIGKILL"]);
    let reason = run.summary()["reason"].to_string();
    assert!(reason.contains("hil was killed by SIGKILL"), "{reason}");
    let sessions = format!("/dev/shm/hil-{NOBODY}-{}", rig.session());
    assert!(!Path::new(&sessions).exists(), "{sessions} is left");
}

#[test]
fn a_stuck_side_does_not_outlive_a_killed_hil() {
    let rig = Rig::new();
    let scenario = rig.scenario(1000.0, "spring-mass", "sleeps");
    let controller = misbehaving_controller();
    let running = rig.start(&format!(
        "{} --controller-bin {} --wait-limit 600",
        scenario.display(),
        controller.display()
    ));
    let children = running.children_at_once();
    until("the law sleeps", || rig.status().step == 100);
    running.kill();
    until_gone(&children);
    rig.hil(&["sessions", "--clean"]).expect(0);
}

/// Starts a run with a stack limit of 64 KiB.
fn start_with_small_stack<'a>(rig: &'a Rig, arguments: &str) -> Running<'a> {
    let mut shell = rig.command("sh");
    shell.args(["-c", "ulimit -Ss 64; exec \"$0\" \"$@\""]);
    shell.arg(program("hil"));
    rig.start_with(shell, arguments)
}

#[test]
fn every_program_runs_with_a_stack_of_64_kib() {
    let rig = Rig::new();
    for link in ["iceoryx2", "in-process"] {
        let line = format!("scenarios/spring-mass.toml --link {link}");
        start_with_small_stack(&rig, &line).finish().expect(0);
    }
}

#[test]
fn a_guard_with_a_stack_of_64_kib_reads_every_signal() {
    for signal in [Signal::TERM, Signal::INT] {
        let rig = Rig::new();
        let running = start_with_small_stack(&rig, ENDLESS);
        running.children();
        send(running.pid(), signal);
        let summary = running.finish().expect(130).summary();
        let reason = summary["reason"].as_str().expect("a reason");
        assert!(reason.starts_with("interrupted"), "{signal:?}: {reason}");
    }
    // The end of the child, which refuses a missing file at once, is a signal to the guard too.
    for _ in 0..5 {
        let rig = Rig::new();
        start_with_small_stack(&rig, "none.toml").finish().expect(2);
    }
}

#[test]
fn a_paused_run_is_reported_on_its_own_terminal() {
    for link in ["iceoryx2", "in-process"] {
        let rig = Rig::new();
        let output = rig.path("said");
        let mut shell = rig.command("sh");
        let line = format!("exec \"$0\" \"$@\" 2>{}", output.display());
        shell.args(["-c", &line]).arg(program("hil"));
        let line = "scenarios/spring-mass.toml --pace 0.1 --wait-limit 60";
        let running = rig.start_with(shell, &format!("{line} --link {link}"));
        rig.status();
        rig.in_session("pause").expect(0);
        let step = rig.status().step;
        let notice = format!("paused at step {step} ");
        let output = || fs::read_to_string(&output).expect("written to");
        until("the run says that it is paused", || {
            output().contains(&notice)
        });
        assert!(output().contains(&format!("hil resume --session {}", rig.session())));
        assert_eq!(output().matches("paused at").count(), 1, "{}", output());
        rig.in_session("resume").expect(0);
        running.signal(Signal::INT);
        running.finish().expect(130);
    }
}

#[test]
fn a_signal_at_the_very_end_does_not_change_the_exit_code_beside_a_summary() {
    let rig = Rig::new();
    let (mut reader, mut writer) = pipe().expect("a pipe");
    // Nobody reads, so the process ends only after the signal.
    fcntl_setfl(&writer, OFlags::NONBLOCK).expect("a flag of the pipe");
    while writer.write(b"\n").is_ok() {}
    fcntl_setfl(&writer, OFlags::empty()).expect("a flag of the pipe");
    let out = rig.path("out");
    let mut hil = rig.command(program("hil"));
    hil.args([
        "run",
        "scenarios/spring-mass.toml",
        "--session",
        rig.session(),
    ]);
    hil.arg("--out")
        .arg(&out)
        .stdin(Stdio::null())
        .stdout(writer);
    let mut guard = hil.spawn().expect("it starts");
    // It holds the other end of the pipe.
    drop(hil);
    until("the summary is there", || out.join("summary.json").exists());
    send(guard.id(), Signal::ALARM);
    let status = format!("/proc/{}/status", guard.id());
    until("the guard has the signal", || {
        let status = fs::read_to_string(&status).expect("it lives");
        let pending = status.lines().find_map(|line| line.strip_prefix("ShdPnd:"));
        let pending = pending.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
        pending.expect("a mask") & 1 << (Signal::ALARM.as_raw() - 1) == 0
    });
    let mut output = String::new();
    reader.read_to_string(&mut output).expect("text");
    let code = guard.wait().expect("it ends").code();
    let summary = summary_in(&out);
    assert_eq!((code, &summary["verdict"]), (Some(0), &Value::from("pass")));
    assert!(output.contains("spring-mass: "), "{output}");
}

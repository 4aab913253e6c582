//! Loss and takeover of controllers: the continuation of the run, and which process may act as the controller.

use std::path::{Path, PathBuf};

use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::Value;
use shared_types::hello::{Control, Hello};
use shared_types::link::{Link, LinkError};

use crate::support::harness::{EXPIRES_S, Rig, Run, Running, send, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{misbehaving_controller, program, program_of_tests};

/// Step at which the laws of the misbehaving controller misbehave, counted from their first.
const WHEN: u64 = 100;
/// Force that these laws command before that step.
const BEFORE_N: f64 = 0.5;
pub(crate) const SAFE_N: f64 = -0.25;
pub(crate) const STEPS: u64 = 1000;

/// The teaching plant for a second under a law that may be lost.
pub(crate) fn losing(rig: &Rig, law: &str, policy: &str) -> PathBuf {
    let text = format!(
        "schema = 1\nname = \"loss\"\n\
         [run]\nduration_s = 1.0\nrate_hz = {STEPS}\non_controller_loss = \"{policy}\"\n\
         [plant]\nmodel = \"spring-mass\"\n[plant.safe_command]\nforce_n = {SAFE_N}\n\
         [controller]\nlaw = \"{law}\"\n"
    );
    rig.write("scenario.toml", &text)
}

/// Returns the arguments that run it under a misbehaving law.
fn scenario(rig: &Rig, law: &str, policy: &str) -> String {
    let (path, controller) = (losing(rig, law, policy), misbehaving_controller());
    // The limit expires for a sleeping law; everything else is noticed at once, even on a slow machine.
    let limit_s = if law == "sleeps" { EXPIRES_S } else { 1000.0 };
    format!(
        "{} --controller-bin {} --wait-limit {limit_s}",
        path.display(),
        controller.display()
    )
}

/// Returns the forces received by the plant, whose steps all have a command.
pub(crate) fn applied_n(run: &Run) -> Vec<f64> {
    let mut applied = Recording::open(&run.recording()).column("applied.force_n");
    applied.retain(|force_n| !force_n.is_nan());
    applied
}

fn lost_at(summary: &Value, controller: usize) -> u64 {
    let controller = &summary["controllers"][controller];
    assert_eq!(controller["end"], "lost", "{summary:#}");
    controller["until_step"].as_u64().expect("a step")
}

#[test]
fn without_its_controller_the_plant_follows_the_policy() {
    let (leaves, panics) = ("controller is gone at step 100", "gone at step 100");
    for (law, policy, then_n, reason) in [
        ("leaves", "hold", BEFORE_N, leaves),
        ("panics", "safe-command", SAFE_N, panics),
        ("sleeps", "safe-command", SAFE_N, "did not answer step 100"),
    ] {
        let rig = Rig::new();
        let arguments = scenario(&rig, law, policy);
        let run = rig.run(&arguments).expect(0);
        let summary = run.summary();
        assert_eq!(summary["verdict"], "pass");
        assert_eq!(summary["steps"], STEPS);
        assert_eq!(lost_at(&summary, 0), WHEN);
        let output = summary["controllers"][0]["reason"].as_str();
        assert!(output.expect("why").contains(reason), "{output:?}");
        let applied = applied_n(&run);
        assert_eq!(applied.len() as u64, STEPS);
        let (before, after) = applied.split_at(WHEN as usize);
        assert!(before.iter().all(|force_n| *force_n == BEFORE_N), "{law}");
        assert!(after.iter().all(|force_n| *force_n == then_n), "{law}");

        let again = rig.run(&arguments).expect(0);
        assert_eq!(again.digest(), run.digest(), "{law} under {policy}");
        let rerun = rig.hil(&["rerun", run.folder.to_str().expect("plain text")]);
        rerun.expect(2).says(&["lost controller 1 at step 100"]);
    }
}

#[test]
fn a_lost_controller_is_restarted_a_limited_number_of_times() {
    let rig = Rig::new();
    let run = rig.run(&scenario(&rig, "leaves", "wait-for-restart"));
    let run = run.expect(3);
    let summary = run.summary();
    // It leaves at each of its hundredth samples: once at first, and after three restarts.
    let lost: Vec<u64> = (0..4)
        .map(|controller| lost_at(&summary, controller))
        .collect();
    assert_eq!(lost, [100, 200, 300, 400]);
    let reason = summary["reason"].as_str().expect("a reason");
    assert!(
        reason.contains("the new controller is gone at step 400"),
        "{reason}"
    );
    assert_eq!(applied_n(&run), [BEFORE_N; 400]);
}

#[test]
fn a_killed_controller_is_restarted_and_the_run_completes() {
    let rig = Rig::new();
    let running = rig.start(
        "scenarios/spring-mass.toml --set run.rate_hz=10000 --set run.duration_s=30 \
         --set run.on_controller_loss=wait-for-restart",
    );
    let [_, controller] = running.children();
    send(controller.pid, Signal::KILL);
    let run = running.finish();
    let summary = run.summary();
    assert_eq!(summary["steps"], 300_000, "{summary:#}");
    let (lost, joined) = (lost_at(&summary, 0), &summary["controllers"][1]);
    assert_eq!(joined["from_step"], lost);
    assert_eq!(joined["end"], Value::Null);
    // Every step has an answer of its own, from the active controller.
    let recording = Recording::open(&run.recording());
    let [held, epoch] = ["held_steps", "epoch"].map(|name| recording.place(name));
    for record in recording.records().take(300_000) {
        assert_eq!(record.words[held], 0, "step {}", record.step());
        let in_office = if record.step() < lost { 1 } else { 2 };
        assert_eq!(record.words[epoch], in_office, "step {}", record.step());
    }
}

#[test]
fn in_real_time_the_run_continues_until_another_controller_is_ready() {
    let rig = Rig::new();
    let arguments = scenario(&rig, "leaves", "wait-for-restart");
    // The run ends at once with the last restarted controller, however long each start takes: the limit is beyond
    // every watchdog.
    let run = rig.run(&format!(
        "{arguments} --clock realtime --set run.rate_hz=500 --set run.duration_s=1e5"
    ));
    let run = run.expect(3);
    let summary = run.summary();
    // The step of a loss depends on the machine; the command is held until the next controller is active.
    for next in 1..4 {
        let (lost, joined) = (lost_at(&summary, next - 1), &summary["controllers"][next]);
        let from = joined["from_step"].as_u64().expect("it took over");
        assert!(from >= lost, "{summary:#}");
    }
    let applied_n = applied_n(&run);
    // Before the first command nothing is applied.
    let first = applied_n.iter().position(|force_n| *force_n != 0.0);
    let commanded = &applied_n[first.expect("a command")..];
    assert!(commanded.iter().all(|force_n| *force_n == BEFORE_N));
}

fn swap(rig: &Rig, arguments: &[&str]) -> Run {
    let session = ["--session", rig.session()];
    rig.beside(&[&["controller", "swap"], arguments, &session].concat())
}

fn resume(rig: &Rig, running: Running<'_>) -> Run {
    rig.in_session("resume").expect(0);
    running.finish()
}

#[test]
fn another_controller_takes_over_at_the_answered_step() {
    let rig = Rig::new();
    let plain = rig.run("scenarios/spring-mass.toml").expect(0);
    let running = rig.held();
    let report = swap(&rig, &["--set", "controller.law=hold", "--json"])
        .expect(0)
        .json();
    assert_eq!(
        (&report["epoch"], &report["step"]),
        (&2.into(), &2500.into())
    );
    assert_eq!(report["law"], "hold");
    let run = resume(&rig, running);
    let summary = run.summary();
    assert_eq!(summary["controllers"][0]["end"], "replaced");
    assert_eq!(summary["controllers"][1]["from_step"], 2500);
    let facts = &Recording::open(&run.recording()).metadata()["hil.run"];
    assert_eq!(facts["controller_2_law"], "hold");
    assert_eq!(
        facts["controller_2_blake3"],
        summary["controller"]["blake3"].as_str().expect("a hash")
    );
    // The law `hold` commands nothing; until then the runs are equal.
    let (before, after) = (applied_n(&plain), applied_n(&run));
    assert_eq!(before[..2500], after[..2500]);
    assert!(after[2500..].iter().all(|force_n| *force_n == 0.0));
}

#[test]
fn a_law_of_another_program_takes_over_without_its_unknown_keys() {
    let rig = Rig::new();
    let running = rig.held();
    let other = program_of_tests("clock-reading-controller");
    let other = other.to_str().expect("plain text");
    let arguments = ["--bin", other, "--set", "controller.law=honest"];
    // The requested law must be known now.
    let wrong = [
        &arguments[..],
        &["--set", "controller.pid.proportional_n_per_m=3"],
    ]
    .concat();
    swap(&rig, &wrong).expect(2).says(&["unknown key `pid`"]);
    let swapped = swap(&rig, &arguments).expect(0).stdout;
    let took = format!("controller 2 (honest, {other}) took over at step 2500\n");
    let left_out = "  left out, because none of its laws has them: controller.pid\n";
    assert_eq!(swapped, took + left_out);
    // Back again: nothing of the scenario is left out.
    let report = swap(&rig, &["--set", "controller.law=pid", "--json"])
        .expect(0)
        .json();
    assert_eq!(report["left_out"], serde_json::json!([]));
    let run = resume(&rig, running);
    let summary = run.summary();
    let laws: Vec<&Value> = (0..2)
        .map(|one| &summary["controllers"][one]["law"])
        .collect();
    assert_eq!(laws, ["pid", "honest"]);
}

#[test]
fn a_controller_that_cannot_take_over_changes_nothing() {
    let rig = Rig::new();
    let plain = rig.run("scenarios/spring-mass.toml").expect(0).digest();
    let running = rig.held();
    let other = misbehaving_controller();
    let other = other.to_str().expect("plain text");
    let dying = rig.script(
        "dies",
        &format!(
            "#!/bin/sh\ncase $1 in --session) echo I am not well; exit 7;; esac\nexec '{}' \"$@\"\n",
            program("controller-process").display()
        ),
    );
    let dying = dying.to_str().expect("plain text");
    for (arguments, expected) in [
        (&["--bin", other][..], "unknown law `pid`"),
        (&["--bin", "/bin/true"], "does not speak the protocol"),
        (&["--bin", "/nowhere/at-all"], "cannot run /nowhere/at-all"),
        (
            &["--set", "controller.pid.proportionl_n_per_m=3"],
            "proportional_n_per_m",
        ),
        (
            &["--set", "run.rate_hz=500"],
            "keys that begin with `controller.`",
        ),
        (&["--bin", dying], "I am not well"),
    ] {
        swap(&rig, arguments).expect(2).says(&[expected]);
    }
    let run = resume(&rig, running).expect(0);
    assert_eq!(run.digest(), plain);
}

#[test]
fn a_process_that_was_not_launched_is_rejected_and_the_run_is_unaffected() {
    let rig = Rig::new();
    let plain = rig.run("scenarios/spring-mass.toml").expect(0).digest();
    // The controller is late: this test connects first.
    let (binary, gate) = (program("controller-process"), rig.path("gate"));
    let late = rig.script(
        "late",
        &format!(
            "#!/bin/sh\ncase $1 in --session) while [ ! -e {} ]; do sleep 0.01; done;; esac\nexec '{}' \"$@\"\n",
            gate.display(),
            binary.display()
        ),
    );
    let running = rig.start(&format!(
        "scenarios/spring-mass.toml --controller-bin {} --wait-limit 60",
        late.display()
    ));
    let mut link = stranger(&rig.session_folder());
    let session = SessionInfo::read(&rig.session_folder()).expect("it runs");
    let hello = Hello::new(session.id, "mine");
    (link.send_control(&Control::Hello(hello).to_bytes())).expect("sends");
    let mut answer = None;
    until("an answer comes", || {
        answer = link.receive_control().expect("polls");
        answer.is_some()
    });
    match Control::from_bytes(&answer.expect("it came")) {
        Ok(Control::Refusal { reason }) => {
            let own = format!("process {}", std::process::id());
            assert!(reason.contains(&own), "{reason}");
        }
        other => panic!("{other:?}"),
    }
    drop(link);
    std::fs::write(gate, "").expect("writes");
    let run = running.finish().expect(0);
    assert_eq!(run.digest(), plain);
    let log = std::fs::read_to_string(run.folder.join("plant.log")).expect("a log");
    assert!(log.contains("refused: process"), "{log}");
}

/// Opens the link like the controller, from this process.
fn stranger(folder: &Path) -> IceoryxLink {
    let mut link = None;
    until("the plant makes its link", || {
        let Ok(session) = SessionInfo::read(folder) else {
            return false;
        };
        match IceoryxLink::open(&session, 1) {
            Ok(opened) => link = Some(opened),
            Err(LinkError::Absent { .. }) => {}
            Err(error) => panic!("{error}"),
        }
        link.is_some()
    });
    link.expect("it is there")
}

#[test]
fn repeated_swaps_never_end_the_run() {
    let rig = Rig::new();
    let running = rig.start("scenarios/spring-mass.toml --pace 1 --set run.duration_s=600");
    running.children_at_once();
    for epoch in 2..10 {
        let report = swap(&rig, &["--set", "controller.law=pid", "--json"])
            .expect(0)
            .json();
        assert_eq!(report["epoch"], epoch);
    }
    running.signal(Signal::INT);
    let run = running.finish().expect(130);
    let summary = run.summary();
    assert_eq!(
        summary["reason"]
            .as_str()
            .map(|report| report.split(';').next()),
        Some(Some("interrupted"))
    );
    let controllers = summary["controllers"].as_array().expect("a list");
    assert_eq!(controllers.len(), 9);
    assert!(controllers[..8].iter().all(|one| one["end"] == "replaced"));
}

#[test]
fn a_loss_is_noticed_at_once_after_a_failed_swap() {
    for (policy, code) in [("hold", 130), ("wait-for-restart", 130), ("abort", 3)] {
        let rig = Rig::new();
        let controller = program("controller-process");
        let leaves = format!(
            "#!/bin/sh\ncase $1 in --session) exit 7;; esac\nexec '{}' \"$@\"\n",
            controller.display()
        );
        let leaves = rig.script("leaves", &leaves);
        // A limit beyond every watchdog: everything noticed is noticed at once.
        let running = rig.start(&format!(
            "scenarios/spring-mass.toml --pace 1 --set run.duration_s=600 --wait-limit 1000 \
             --set run.on_controller_loss={policy}"
        ));
        let [_, controller] = running.children_at_once();
        swap(&rig, &["--bin", leaves.to_str().expect("plain text")]).expect(2);
        send(controller.pid, Signal::KILL);
        if code == 130 {
            until("the plant tells of the loss", || {
                let log = std::fs::read_to_string(rig.path("run0/plant.log"));
                log.is_ok_and(|log| log.contains("controller is gone at step"))
            });
            if policy == "wait-for-restart" {
                until("another one is there", || {
                    let info = SessionInfo::read(&rig.session_folder());
                    info.is_ok_and(|info| info.controller.is_some_and(|one| one.epoch == 3))
                });
                // It takes over between two steps.
                rig.in_session("inject --active").expect(0);
            }
            running.signal(Signal::INT);
        }
        let run = running.finish().expect(code);
        let report = run.summary()["controllers"].to_string();
        let reason = run.summary()["reason"].to_string();
        assert!(
            (report + &reason).contains("killed by SIGKILL"),
            "{policy}: {reason}"
        );
    }
}

#[test]
fn a_stopped_plant_is_noticed_under_every_policy() {
    for policy in ["hold", "wait-for-restart", "safe-command"] {
        let rig = Rig::new();
        let running = rig.start(&format!(
            "scenarios/spring-mass.toml --pace 1 --set run.duration_s=600 --wait-limit {EXPIRES_S} \
             --set run.on_controller_loss={policy}"
        ));
        let [plant, _] = running.children_at_once();
        send(plant.pid, Signal::STOP);
        let run = running.finish().expect(3);
        let reason = run.summary()["reason"].to_string();
        assert!(reason.contains("plant was stopped"), "{policy}: {reason}");
    }
}

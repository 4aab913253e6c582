//! Controllers that never stop sending: repeated messages delay no run, with any policy and any clock, and a
//! second, different answer is named.

use serde_json::Value;

use crate::succession::{SAFE_N, STEPS, applied_n, losing};
use crate::support::harness::{EXPIRES_S, Rig, Run};
use crate::support::programs::program_of_tests;

/// Number of samples that the chatting controller answers.
const ANSWERED: u64 = 100;
/// Duration of a run in real time.
const LONG_S: u64 = 15;
/// Force commanded by the chatting controller.
const FORCE_N: f64 = 0.5;

/// Runs the teaching plant for a second, or longer in real time, under a chatting law.
fn chats(rig: &Rig, law: &str, policy: &str, clock: &str) -> Run {
    let path = losing(rig, law, policy);
    let (path, controller) = (path.display(), program_of_tests("chatting-controller"));
    let controller = controller.display();
    // In real time the run must last longer than the limit.
    let duration_s = if clock == "realtime" { LONG_S } else { 1 };
    rig.run(&format!(
        "{path} --controller-bin {controller} --clock {clock} --wait-limit {EXPIRES_S} \
         --set run.duration_s={duration_s}"
    ))
}

#[track_caller]
fn assert_told(output: &Value, fragment: &str) {
    let output = output.as_str().expect("a reason");
    assert!(
        output.contains(fragment),
        "`{fragment}` is not in `{output}`"
    );
}

#[test]
fn an_endlessly_repeated_answer_ends_at_the_wait_limit_under_any_policy() {
    let late = &format!("controller did not answer step 100 within {EXPIRES_S} s");
    let rig = Rig::new();
    let run = chats(&rig, "repeats", "abort", "lockstep").expect(3);
    let summary = run.summary();
    assert_told(&summary["reason"], late);
    assert_eq!(applied_n(&run), [FORCE_N; ANSWERED as usize]);
    // As often as the plant polled; nothing else was sent in vain.
    let ignored = summary["ignored"].as_object().expect("reasons");
    assert_eq!(ignored.keys().collect::<Vec<_>>(), ["repeated"]);
    assert!(ignored["repeated"].as_u64() > Some(1), "{ignored:?}");
    for (policy, then_n) in [("hold", FORCE_N), ("safe-command", SAFE_N)] {
        let run = chats(&rig, "repeats", policy, "lockstep").expect(0);
        let summary = run.summary();
        assert_eq!(
            (&summary["verdict"], &summary["steps"]),
            (&"pass".into(), &STEPS.into())
        );
        assert_told(&summary["controllers"][0]["reason"], late);
        let applied_n = applied_n(&run);
        let (before, after) = applied_n.split_at(ANSWERED as usize);
        assert!(before.iter().all(|force_n| *force_n == FORCE_N));
        assert!(after.iter().all(|force_n| *force_n == then_n), "{policy}");
    }
    // Each successor does the same: it answers the sample that it begins with.
    let run = chats(&rig, "repeats", "wait-for-restart", "lockstep").expect(3);
    let controllers = &run.summary()["controllers"];
    assert_told(&controllers[0]["reason"], late);
    assert_told(
        &controllers[1]["reason"],
        &format!("controller did not answer step 101 within {EXPIRES_S} s"),
    );
}

#[test]
fn with_a_clock_chatter_delays_no_run() {
    let rig = Rig::new();
    let run = chats(&rig, "repeats", "abort", "paced").expect(3);
    let late = &format!("controller did not answer step 100 within {EXPIRES_S} s");
    assert_told(&run.summary()["reason"], late);
    // In real time the run continues until the limit; the step at that time depends on the machine.
    let run = chats(&rig, "repeats", "abort", "realtime").expect(3);
    assert_told(&run.summary()["reason"], "controller did not answer step ");
    let run = chats(&rig, "repeats", "safe-command", "realtime");
    let summary = run.summary();
    assert_eq!(summary["steps"], LONG_S * STEPS);
    assert_told(
        &summary["controllers"][0]["reason"],
        "controller did not answer step ",
    );
}

#[test]
fn an_endlessly_repeated_hello_ends_at_the_wait_limit() {
    let rig = Rig::new();
    let run = chats(&rig, "greets", "hold", "lockstep").expect(3);
    let late = &format!("controller did not open its frames within {EXPIRES_S} s");
    let summary = run.summary();
    assert_told(&summary["reason"], late);
    assert!(
        summary["ignored"]["out_of_turn"].as_u64() > Some(1),
        "{}",
        summary["ignored"]
    );
}

#[test]
fn a_second_different_answer_is_named() {
    let rig = Rig::new();
    let twice = "controller broke the protocol at step 100: it answered step 99 twice, with different commands";
    let run = chats(&rig, "contradicts", "abort", "lockstep").expect(3);
    assert_told(&run.summary()["reason"], twice);
    let run = chats(&rig, "contradicts", "safe-command", "lockstep").expect(0);
    assert_told(&run.summary()["controllers"][0]["reason"], twice);
}

#[test]
fn chatter_delays_no_replay() {
    let rig = Rig::new();
    let run = rig.run(
        "scenarios/spring-mass.toml --set run.duration_s=0.8 --set controller.law=hold \
         --set metrics=[] --set requirements=[]",
    );
    let run = run.expect(0);
    let (folder, controller) = (run.folder, program_of_tests("chatting-controller"));
    let replay = rig.hil(&[
        "replay",
        folder.to_str().expect("plain text"),
        "--controller-bin",
        controller.to_str().expect("plain text"),
        "--wait-limit",
        &EXPIRES_S.to_string(),
    ]);
    let late = &format!("controller did not answer step 100 within {EXPIRES_S} s");
    replay.expect(3).says(&[late]);
}

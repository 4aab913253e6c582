//! Ends of sides started by hand: each is named, and leaves nothing behind.

use hil_session::session::SessionInfo;
use rustix::process::Signal;

use super::{Hand, SCENARIO, awaited, controller, held, plant};
use crate::support::harness::{Rig, send, until};
use crate::support::programs::{misbehaving_controller, shipped};

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
        // One of two sides is admitted, and ends too.
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
fn an_interrupted_run_ends_a_stopped_side() {
    let rig = Rig::new();
    let (running, hand) = held(&rig, "--wait-limit inf");
    hand.stop();
    rig.in_session("resume").expect(0);
    running.signal(Signal::INT);
    let run = running.finish().expect(130);
    assert_eq!(run.summary()["verdict"], "aborted");
    assert_eq!(hand.end().0, None);
}

#[test]
fn each_end_of_a_side_started_by_hand_is_named() {
    let program = misbehaving_controller();
    let path = program.display();
    let silent = "controller, which was started by hand, ended without reporting why";
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
        rig.until_held_at(2500);
        send(hand.pid(), Signal::KILL);
        let run = running.finish().expect(3);
        let reason = run.summary()["reason"].to_string();
        let expected = format!("{side}, which was started by hand, ended without reporting why");
        assert!(reason.contains(&expected), "{reason}");
    }
}

/// Returns the teaching scenario without the keys specific to the law `pid`.
fn scenario_without_gains(rig: &Rig, arguments: &str) -> String {
    let text = shipped(SCENARIO);
    let (before, after) = text.split_once("[controller.pid]").expect("gains");
    let after = after.split_once("[[stimuli]]").expect("stimuli").1;
    let path = rig.write("plain.toml", &format!("{before}[[stimuli]]{after}"));
    arguments.replace(SCENARIO, path.to_str().expect("text"))
}

#[test]
fn a_side_ends_with_a_killed_hil_even_if_it_is_stopped() {
    let rig = Rig::new();
    for is_stopped in [false, true] {
        let (running, hand) = held(&rig, "--wait-limit inf");
        if is_stopped {
            hand.stop();
        }
        running.kill();
        if is_stopped {
            // Any later command removes the remains of a dead one.
            rig.hil(&["config", "schema"]).expect(0);
            assert_eq!(hand.end().0, None);
        } else {
            let (code, output) = hand.end();
            assert_eq!(code, Some(3), "{output}");
            // Its own connection or the plant's message arrives first.
            let expected = [
                "stopped at step 2500",
                "gave up at step 2500: it was asked to stop",
            ];
            assert!(
                expected.iter().any(|expected| output.contains(expected)),
                "{output}"
            );
            rig.hil(&["config", "schema"]).expect(0);
        }
        rig.assert_nothing_left();
    }
}

//! Recorded samples against a controller: an identical one answers the same, a different one is detected, with step
//! and signal.

mod copy;

use std::path::{Path, PathBuf};

use hil_session::session::SessionInfo;
use rustix::process::Signal;
use serde_json::Value;
use shared_types::random::RandomStream;

use copy::Copy;

use crate::clocks;
use crate::support::harness::{Rig, Run, text, until};
use crate::support::programs::{
    example, misbehaving_controller, of_pendulum, program, program_of_tests, shipped,
};
use crate::tried_faults;

/// Two seconds of the hydraulic system; the runs here are shorter.
const LEAKAGE: &str = "tests/scenarios/leakage.toml";
const SPRING_MASS: &str =
    "scenarios/spring-mass.toml --set run.duration_s=0.8 --set metrics=[] --set requirements=[]";

fn rebuilt() -> PathBuf {
    program_of_tests("rebuilt-controller")
}

/// Runs `hil replay --json` on a recording, and returns its output.
#[track_caller]
fn replayed(rig: &Rig, run: &Path, arguments: &[&str], code: i32) -> Value {
    let output = rig.hil(&[&["replay", text(run), "--json"], arguments].concat());
    output.expect(code).json()
}

fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value}"))
}

/// Writes a scenario with faults of signals, links and timing at once, in the first tenths of a second.
fn with_all_faults(rig: &Rig) -> PathBuf {
    let mut scenario = shipped(LEAKAGE);
    let kinds = [
        "noise",
        "dropout",
        "stuck-at",
        "message-loss",
        "message-delay",
        "message-jitter",
        "message-corruption",
        "late",
        "skip",
    ];
    let faults = tried_faults::faults();
    let chosen = faults.iter().filter(|fault| kinds.contains(&&*fault.kind));
    let mut count = 0;
    for fault in chosen {
        scenario = tried_faults::with_fault(&scenario, fault, 0.02 + 0.01 * f64::from(count));
        count += 1;
    }
    assert_eq!(count as usize, kinds.len());
    rig.write("all-faults.toml", &scenario)
}

#[test]
fn an_unchanged_controller_reproduces_every_answer_bit_by_bit() {
    let rig = Rig::new();
    let faults = with_all_faults(&rig);
    let faults = text(&faults);
    let short = "--set run.duration_s=0.3 --set faults[0].at_s=0.1 --set controller.law";
    for (scenario, steps) in [
        (format!("{faults} {short}=ftsc"), 3000),
        (format!("{faults} {short}=nrsc"), 3000),
        (
            format!("{faults} {short}=pid --set controller.command_delay_steps=1"),
            3000,
        ),
        (format!("{SPRING_MASS} --set controller.rate_hz=250"), 800),
        (format!("{SPRING_MASS} --set controller.law=hold"), 800),
    ] {
        let run = rig.run(&scenario).expect(0);
        for link in ["iceoryx2", "in-process"] {
            let report = replayed(&rig, &run.folder, &["--link", link], 0);
            let same = (
                &report["verdict"],
                number(&report["steps"]),
                &report["first_difference"],
            );
            assert_eq!(
                same,
                (&"same".into(), steps, &Value::Null),
                "{scenario} {link}"
            );
            assert_eq!(report["controller"]["of_the_run"], true);
            assert_eq!(
                (&report["whole"], number(&report["unanswered_steps"])),
                (&true.into(), 0)
            );
            assert!(!report["compared"].as_array().expect("a list").is_empty());
        }
    }
}

#[test]
fn a_late_controller_is_replayed_with_the_samples_that_it_saw() {
    let rig = Rig::new();
    let late = clocks::SCENARIO.to_owned() + &clocks::busy_for(12, "controller", 0.2);
    let scenario = rig.write("clocks.toml", &late);
    let run = rig.run(&format!("{} --clock realtime", scenario.display()));
    let run = run.expect(0);
    let missed = number(&run.summary()["missed_commands"]["count"]);
    assert!(missed >= 10, "{missed}");
    let report = replayed(&rig, &run.folder, &[], 0);
    assert_eq!(report["verdict"], "same");
    let (answered, unanswered) = (
        number(&report["steps"]),
        number(&report["unanswered_steps"]),
    );
    assert_eq!(answered + unanswered, 200);
    assert!(unanswered >= 5, "{unanswered}");
    // A rerun waits for its controller, and so does the replay of a rerun.
    let again = rig.rerun(&run.folder, &[]).expect(0).folder;
    let report = replayed(&rig, &again, &[], 0);
    assert_eq!(
        (
            number(&report["steps"]),
            number(&report["unanswered_steps"])
        ),
        (answered, unanswered)
    );
}

#[test]
fn a_change_of_one_line_is_found_with_step_signal_and_both_values() {
    let rig = Rig::new();
    let run = rig.run(SPRING_MASS).expect(0);
    let rebuilt = rebuilt();
    let other = ["--controller-bin", text(&rebuilt)];
    let report = replayed(&rig, &run.folder, &other, 1);
    let first = &report["first_difference"];
    assert_eq!(
        (&report["verdict"], &first["signal"]),
        (&"different".into(), &"command.force_n".into())
    );
    assert_eq!(
        (number(&first["step"]), first["time_s"].as_f64()),
        (137, Some(0.137))
    );
    let value = |name: &str| first[name].as_f64().expect("a number");
    assert_eq!(value("recorded").next_up(), value("replayed"));
    let around = first["samples_around"].as_array().expect("a list");
    let steps: Vec<u64> = around
        .iter()
        .map(|sample| number(&sample["step"]))
        .collect();
    assert_eq!(steps, [132, 133, 134, 135, 136, 137, 138, 139]);
    for sample in around {
        let is_first = sample["step"] == 137;
        assert_eq!(
            sample["recorded"] != sample["replayed"],
            is_first,
            "{sample}"
        );
        assert!(sample["sample"]["measured.position_m"].is_f64(), "{sample}");
    }
    let signals = report["signals"].as_array().expect("a list");
    assert_eq!(
        (signals.len(), number(&signals[0]["differing_steps"])),
        (1, 1)
    );
    assert_eq!(number(&signals[0]["at_step"]), 137);
    assert_eq!(report["controller"]["of_the_run"], false);

    let output = rig
        .hil(&["replay", text(&run.folder), other[0], other[1]])
        .expect(1)
        .stdout;
    for part in [
        "first difference at step 137 (0.137 s): command.force_n",
        ">137",
        "measured.position_m",
    ] {
        assert!(output.contains(part), "`{part}` is not in:\n{output}");
    }
    let allowed = [other[0], other[1], "--tolerance", "command.force_n=1e-9"];
    let report = replayed(&rig, &run.folder, &allowed, 0);
    assert_eq!(
        (&report["verdict"], &report["first_difference"]),
        (&"within-tolerance".into(), &Value::Null)
    );
}

#[test]
fn each_signal_has_its_given_tolerance() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{LEAKAGE} --set run.duration_s=0.1 --set faults[0].at_s=0.05"
        ))
        .expect(0);
    let rebuilt = rebuilt();
    for (tolerance, code) in [
        ("internal.fault_detected=2e-9", 0),
        ("internal.fault_detected=5e-10", 1),
        ("internal.lyapunov_v3=1", 1),
        ("1e-8", 0),
    ] {
        let arguments = ["--controller-bin", text(&rebuilt), "--tolerance", tolerance];
        let report = replayed(&rig, &run.folder, &arguments, code);
        let signal = &report["signals"][0];
        assert_eq!(signal["name"], "internal.fault_detected", "{tolerance}");
        assert_eq!(number(&signal["differing_steps"]), 1000, "{tolerance}");
    }
    rig.hil(&[
        "replay",
        text(&run.folder),
        "--tolerance",
        "internal.fault_detekted=1",
    ])
    .expect(2)
    .says(&[
        "internal.fault_detekted",
        "nearest: `internal.fault_detected`",
    ]);
}

#[test]
fn signals_present_on_one_side_only_are_named() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{LEAKAGE} --set run.duration_s=0.02 --set faults[0].at_s=0.01"
        ))
        .expect(0);
    // As if a newer controller had made the recording.
    let newer = rewritten(&rig, &run, "newer", |_, _| ());
    let report = replayed(&rig, &newer, &[], 0);
    assert_eq!(
        report["only_in_recording"].as_array().map(Vec::len),
        Some(0)
    );
    let renamed = rig.path("renamed.mcap");
    let mut copy = Copy::of(&run.recording());
    copy.layout.internal[0].name = "of_old".into();
    copy.describe("lyapunov_v3", "of_old");
    copy.write(&renamed, |_, _| ());
    let report = replayed(&rig, &renamed, &[], 0);
    assert_eq!(report["only_in_recording"][0], "internal.of_old");
    assert_eq!(report["only_in_controller"][0], "internal.lyapunov_v3");
}

fn rewritten(
    rig: &Rig,
    run: &Run,
    name: &str,
    change: impl Fn(&mut Vec<u64>, &[String]),
) -> PathBuf {
    let path = rig.path(&format!("{name}.mcap"));
    Copy::of(&run.recording()).write(&path, change);
    path
}

#[test]
fn a_flipped_bit_in_any_recorded_answer_is_detected_and_named() {
    let rig = Rig::new();
    let run = rig
        .run(&format!(
            "{LEAKAGE} --set run.duration_s=0.05 --set faults[0].at_s=0.02"
        ))
        .expect(0);
    let copy = Copy::of(&run.recording());
    let is_answer = |name: &&String| name.starts_with("command.") || name.starts_with("internal.");
    let answers: Vec<&String> = copy.columns.iter().filter(is_answer).collect();
    let mut random = RandomStream::new(1, "flipped bits");
    let mut below = |limit: usize| (random.uniform() * limit as f64) as usize;
    let path = rig.path("flipped.mcap");
    for _ in 0..24 {
        let (step, signal, bit) = (below(500) as u64, answers[below(answers.len())], below(64));
        copy.write(&path, |words, columns| {
            let place = columns
                .iter()
                .position(|name| name == signal)
                .expect("there");
            if words[0] == step {
                words[place] ^= 1 << bit;
            }
        });
        let report = replayed(&rig, &path, &["--link", "in-process"], 1);
        let first = &report["first_difference"];
        let result = (
            number(&first["step"]),
            first["signal"].as_str().expect("a name"),
        );
        assert_eq!(result, (step, signal.as_str()), "bit {bit}");
        let signals = report["signals"].as_array().expect("a list");
        assert_eq!(
            (signals.len(), number(&signals[0]["differing_steps"])),
            (1, 1)
        );
        std::fs::remove_file(&path).expect("removed");
    }
    // A validity bit: that of the last internal signal is the last of the answer.
    let last = answers.len() - 1;
    let path = rewritten(&rig, &run, "invalid", |words, columns| {
        let place = columns
            .iter()
            .position(|name| name == "command_invalid[0]")
            .expect("there");
        if words[0] == 77 {
            words[place + last / 64] ^= 1 << (last % 64);
        }
    });
    let report = replayed(&rig, &path, &[], 1);
    let first = &report["first_difference"];
    assert_eq!(
        (number(&first["step"]), &first["signal"]),
        (77, &answers[last].as_str().into())
    );
    assert_eq!(first["validity"], serde_json::json!([false, true]));
}

#[test]
fn unreplayable_recordings_are_refused_before_anything_starts() {
    let rig = Rig::new();
    let hydraulic = format!(
        "{LEAKAGE} --set run.duration_s=0.02 --set faults[0].at_s=0.01 --set controller.law=pid"
    );
    let run = rig.run(&hydraulic).expect(0);
    let (misbehaving, rebuilt) = (misbehaving_controller(), rebuilt());
    let words = rig.write("words.mcap", "not a recording");
    let folder = text(&run.folder);
    #[rustfmt::skip] // a table
    let cases = [
        (vec![text(&words)], "is not a recording of a run"),
        (vec!["nowhere/run"], "cannot read"),
        (vec![folder, "--controller-bin", "nowhere/controller"], "cannot run"),
        // A controller for another plant.
        (vec![folder, "--controller-bin", text(&misbehaving)], "unknown law `pid`"),
        // One that no longer has a command of this one.
        (vec![folder, "--controller-bin", text(&rebuilt)], "needs the command `actuator2_valve_current_a`"),
        (vec![folder, "--controller-bin", text(&rebuilt), "--link", "in-process"], "needs a process"),
        (vec![folder, "--tolerance", "-1"], "at least 0"),
        (vec![folder, "--wait-limit", "0"], "above 0"),
        (vec![folder, "--session", "NO"], "is not a session name"),
    ];
    for (arguments, expected) in cases {
        rig.hil(&[&["replay"], &arguments[..]].concat())
            .expect(2)
            .says(&[expected]);
    }
}

#[test]
fn a_controller_that_dies_or_falls_silent_is_named_with_its_step() {
    let rig = Rig::new();
    let rebuilt = rebuilt();
    let held = rig
        .run(&format!("{SPRING_MASS} --set controller.law=hold"))
        .expect(0);
    let other = ["--controller-bin", text(&rebuilt)];
    let arguments = ["replay", text(&held.folder), other[0], other[1]];
    rig.hil(&arguments)
        .expect(3)
        .says(&["controller panicked", "the law fell over", "step 137"]);
    let silent = rig
        .run(&format!("{LEAKAGE} --set run.duration_s=0.05 --set faults[0].at_s=0.02 --set controller.law=nrsc"))
        .expect(0);
    let arguments = [
        "replay",
        text(&silent.folder),
        other[0],
        other[1],
        "--wait-limit",
        "0.3",
    ];
    rig.hil(&arguments).expect(3).says(&[
        "controller did not answer step 137 within 0.3 s",
        "controller was stuck",
    ]);
}

#[test]
fn an_interrupted_replay_ends_in_order_also_with_a_silent_controller() {
    let rig = Rig::new();
    let rebuilt = rebuilt();
    let run = rig
        .run(&format!("{LEAKAGE} --set run.duration_s=0.05 --set faults[0].at_s=0.02 --set controller.law=nrsc"))
        .expect(0);
    let session = rig.session().to_owned();
    let replay = rig.start_hil(&[
        "replay",
        text(&run.folder),
        "--controller-bin",
        text(&rebuilt),
        "--wait-limit",
        "inf",
        "--session",
        &session,
    ]);
    until("the controller is started", || {
        SessionInfo::read(&rig.session_folder()).is_ok_and(|info| !info.children.is_empty())
    });
    replay.signal(Signal::INT);
    replay.finish().expect(130).says(&["interrupted"]);
}

#[test]
fn a_truncated_recording_is_replayed_up_to_its_last_record() {
    let rig = Rig::new();
    let run = rig
        .run(&format!("{LEAKAGE} --set run.duration_s=1.5"))
        .expect(0);
    let bytes = std::fs::read(run.recording()).expect("read");
    let cut = rig.path("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).expect("written");
    let report = replayed(&rig, &cut, &[], 0);
    assert_eq!(
        (&report["verdict"], &report["whole"]),
        (&"same".into(), &false.into())
    );
    let steps = number(&report["steps"]);
    assert!((1000..15_000).contains(&steps), "{steps}");
    let output = rig.hil(&["replay", text(&cut)]).expect(0).stdout;
    assert!(
        output.contains("cut off and is replayed as far as possible"),
        "{output}"
    );
}

#[test]
fn a_run_that_diverged_is_replayed_to_its_last_record() {
    let rig = Rig::new();
    // Positive feedback: the mass leaves its range.
    let run = rig.run(&format!("{SPRING_MASS} --set controller.pid.proportional_n_per_m=1e7 --set controller.pid.derivative_n_s_per_m=0"));
    assert_eq!(run.summary()["verdict"], "aborted", "{}", run.stderr);
    let report = replayed(&rig, &run.folder, &[], 0);
    let records = number(&run.summary()["recording"]["records"]);
    assert_eq!(number(&report["steps"]), records);
    assert!(records < number(&report["planned_steps"]));
}

#[test]
fn replaying_a_run_of_a_missing_plant_needs_only_its_recording() {
    let rig = Rig::new();
    let run = rig.run(&of_pendulum("examples/own-plant/pendulum.toml"));
    let run = run.expect(0);
    let moved = rig.path("moved.mcap");
    std::fs::rename(run.recording(), &moved).expect("moved");
    let own = example("own-controller");
    let report = replayed(&rig, &moved, &["--controller-bin", text(&own)], 0);
    assert_eq!(
        (&report["verdict"], &report["law"]),
        (&"same".into(), &"state-feedback".into())
    );
    // Without a flag it is the program of the run, which the recording names.
    let report = replayed(&rig, &moved, &[], 0);
    assert_eq!(report["verdict"], "same");
    let shipped = program("controller-process");
    rig.hil(&["replay", text(&moved), "--controller-bin", text(&shipped)])
        .expect(2)
        .says(&["unknown law `state-feedback`", "(--controller-bin)"]);
}

//! Signals of a running session as printed by `hil get` and `hil watch`, compared with its recording.

use serde_json::Value;

use crate::support::harness::Rig;
use crate::support::mcap_reader::{Record, Recording};

const SHORT: &str = "tests/scenarios/leakage.toml";
const SIGNALS: [&str; 3] = [
    "tracking_error_rad",
    "reference.surface_angle_rad",
    "measured.surface_angle_rad",
];

/// Checks that the printed values of the signals equal the recorded ones at their step.
fn is_recorded(printed: &Value, recording: &Recording, records: &[Record]) {
    let step = printed["step"].as_u64().expect("a step");
    let record = &records[step as usize];
    assert_eq!(record.step(), step);
    assert_eq!(printed["time_s"].as_f64(), Some(step as f64 / 10_000.0));
    let recorded = |name| recording.value(record, name);
    let reference = recorded("reference.surface_angle_rad");
    let truth = recorded("truth.surface_angle_rad");
    let expected = [
        truth - reference,
        reference,
        recorded("measured.surface_angle_rad"),
    ];
    for ((signal, name), expected) in (printed["signals"].as_array().expect("signals").iter())
        .zip(SIGNALS)
        .zip(expected)
    {
        assert_eq!(signal["name"], name);
        assert_eq!(signal["unit"], "rad");
        assert_eq!(
            signal["value"].as_f64(),
            Some(expected),
            "{name} at step {step}"
        );
        // At 2 s the paper's command passes zero.
        assert!(step == 20_000 || expected != 0.0, "{name} moves");
    }
}

#[test]
fn printed_values_equal_the_recorded_ones_and_change_no_digest() {
    let rig = Rig::new();
    let expected = rig.run(SHORT).expect(0).digest();
    let run = rig.start(&format!("{SHORT} --pause-at 0.5"));
    rig.until_held_at(5000);
    let session = ["--session", rig.session()];
    let beside = |arguments: &[&str]| rig.beside(&[arguments, &session].concat());
    let get = [&["get", "--json"][..], &SIGNALS].concat();
    let mut text = vec![beside(&get).expect(0).stdout];
    assert_eq!(text[0].matches("\"step\":4999").count(), 1, "{}", text[0]);

    let all = beside(&["get"]).expect(0).stdout;
    assert!(all.starts_with("step 4999 (0.4999 s)\n"), "{all}");
    for name in SIGNALS {
        assert!(
            all.lines().any(|line| line.starts_with(name)),
            "{name}: {all}"
        );
    }
    let some = beside(&["get", "measured.*angle*"]).expect(0).stdout;
    assert!(!some.contains("reference."), "{some}");

    beside(&["get", "truth.surface_angel_rad"])
        .expect(2)
        .says(&["surface_angel_rad", "surface_angle_rad"]);
    beside(&["get", "["]).expect(2).says(&["signal `[`"]);
    beside(&["watch"]).expect(2).says(&["<SIGNAL>"]);

    // One line is printed for the paused step, others as the run continues.
    let once = beside(&[&["watch", "--count", "1"][..], &SIGNALS].concat());
    let once = once.expect(0).stdout;
    assert!(once.starts_with("0.4999 s  tracking_error_rad "), "{once}");
    let watch = [
        &["watch", "--json", "--every", "1ms"][..],
        &SIGNALS,
        &session,
    ]
    .concat();
    std::thread::scope(|scope| {
        let watching = scope.spawn(|| rig.beside(&watch));
        for _ in 0..20 {
            beside(&["step", "100"]).expect(0);
        }
        beside(&["resume"]).expect(0);
        text.extend(
            watching
                .join()
                .expect("watched")
                .expect(0)
                .stdout
                .lines()
                .map(Into::into),
        );
    });
    let run = run.finish().expect(0);
    assert_eq!(run.digest(), expected);

    let recording = Recording::open(&run.recording());
    let records: Vec<Record> = recording.records().collect();
    let text: Vec<Value> = (text.iter())
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert!(text.len() >= 3, "{text:?}");
    text.iter()
        .for_each(|one| is_recorded(one, &recording, &records));
    let steps: Vec<u64> = text
        .iter()
        .skip(1)
        .filter_map(|one| one["step"].as_u64())
        .collect();
    assert!(steps.is_sorted_by(|one, next| one < next), "{steps:?}");
    assert_eq!(steps.last(), Some(&20_000), "the last values are told");
}

#[test]
fn before_the_first_step_there_are_no_values() {
    let rig = Rig::new();
    let run = rig.start(&format!("{SHORT} --pause-at 0"));
    rig.until_held_at(0);
    rig.in_session("get")
        .expect(2)
        .says(&["no step was executed", "hil step"]);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

//! Partial recordings: their content is unchanged, and commands that need the whole run say so.

use std::collections::BTreeMap;

use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;

/// Half a second of the teaching plant at 1 kHz, with a faulty sensor from 0.2 s to 0.3 s.
const SCENARIO: &str = r#"
schema = 1
name = "excerpt"
[run]
duration_s = 0.5
rate_hz = 1000
[plant]
model = "spring-mass"
[controller]
law = "pid"
[[stimuli]]
target = "position_m"
kind = "step"
after = 0.01
[[faults]]
kind = "bias"
at_s = 0.2
duration_s = 0.1
effects = [{ target = "measured.position_m", bias = 1e-3 }]
"#;

#[test]
fn an_excerpt_is_part_of_the_full_recording_with_the_same_verdict() {
    let rig = Rig::new();
    let scenario = rig.write("excerpt.toml", SCENARIO);
    let scenario = scenario.display();
    let whole = rig.run(&format!("{scenario}")).expect(0);
    let part = rig.run(&format!(
        "{scenario} --record measured.* --record applied.force_n --record-every 100 --record-around-faults 0.003 0.002"
    ));
    let part = part.expect(0);
    let (all, some) = (whole.summary(), part.summary());
    assert_eq!(all["digest"], some["digest"]);
    assert_eq!(all["metrics"], some["metrics"]);
    assert_eq!(some["recording"]["records"], 501);

    let open = |run: &std::path::Path| Recording::open(&run.join("run.mcap"));
    let (all, some) = (open(&whole.folder), open(&part.folder));
    let signals: Vec<&String> = some
        .columns
        .iter()
        .filter(|name| name.contains('.'))
        .collect();
    assert!(
        signals
            .iter()
            .all(|name| name.starts_with("measured.") || *name == "applied.force_n")
    );
    assert!(signals.len() > 1, "{signals:?}");
    // Every 100th, the last, and around 0.2 s and 0.3 s from 3 steps before to 2 after.
    let expected = [
        0, 100, 197, 198, 199, 200, 201, 202, 297, 298, 299, 300, 301, 302, 400, 500,
    ];
    let steps: Vec<u64> = some.records().map(|record| record.step()).collect();
    assert_eq!(steps, expected);
    let by_step: BTreeMap<u64, _> = all.records().map(|one| (one.step(), one)).collect();
    for record in some.records() {
        let original = &by_step[&record.step()];
        assert_eq!(record.log_time_ns, original.log_time_ns);
        for name in &signals {
            let (actual, expected) = (some.value(&record, name), all.value(original, name));
            assert_eq!(actual.to_bits(), expected.to_bits(), "{name}");
        }
    }

    let path = |run: &std::path::Path| run.display().to_string();
    let (whole, part) = (path(&whole.folder), path(&part.folder));
    rig.hil(&["compare", &whole, &part]).expect(0);
    rig.hil(&["compare", &part, &whole]).expect(0);
    for arguments in [["judge", &part], ["replay", &part], ["latency", &part]] {
        rig.hil(&arguments)
            .expect(2)
            .says(&["is an excerpt (signals measured.*"]);
    }
    rig.rerun(part.as_ref(), &[]).expect(0);
}

#[test]
fn a_contradictory_selection_is_refused_before_the_run() {
    let rig = Rig::new();
    let scenario = rig.write("excerpt.toml", SCENARIO);
    for (arguments, message) in [
        ("--record truth.positon_m", "nearest: `truth.position_m`"),
        ("--record [", "is not a valid pattern"),
        ("--record-every 0", "a whole number from 1"),
        ("--record-around-faults 100 1", "at most 60 s"),
        ("--record-every 2 --no-record", "records nothing"),
        (
            "--record-every 2 --checkpoint-at 0.1",
            "needs a complete recording",
        ),
    ] {
        let run = rig
            .run(&format!("{} {arguments}", scenario.display()))
            .expect(2)
            .says(&[message]);
        assert!(!run.folder.exists(), "{arguments}");
    }
}

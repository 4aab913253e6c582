//! Runs with instruments that are cut short, varied, taken over or disturbed keep their bits.

use super::{INSTRUMENTS, run, scenario};
use crate::support::harness::{Rig, text};
use crate::support::mcap_reader::Recording;

/// Varies keys of instruments over the scenario of the test.
const STUDY: &str = r#"
schema = 1
scenario = "instruments.toml"
cases = 12
seed = 3

[[vary]]
key = "sensors[0].noise_sigma"
kind = "uniform"
min = 0
max = 1e-4

[[vary]]
key = "sensors[0].bias_tau_s"
kind = "uniform"
min = 0.01
max = 10

[[vary]]
key = "actuators[0].lag_hz"
kind = "uniform"
min = 50
max = 200

[[variants]]
name = "early"

[[variants]]
name = "late"
set = ["actuators[0].dead_time_s=0.004", "sensors[0].bits=10"]
"#;

#[test]
fn a_campaign_that_varies_instruments_has_the_bits_of_separate_runs() {
    let rig = Rig::new();
    scenario(&rig, INSTRUMENTS);
    let study = rig.write("study.toml", STUDY);
    let mut digests = Vec::new();
    for jobs in ["1", "2"] {
        let folder = rig.path(jobs);
        let plan = ["campaign", "plan", text(&study), "-o", text(&folder)];
        rig.hil(&plan).expect(0);
        rig.hil(&["campaign", "run", text(&folder), "--jobs", jobs])
            .expect(0);
        let collect = ["campaign", "collect", text(&folder), "--json"];
        digests.push(rig.hil(&collect).expect(0).json()["digest"].clone());
    }
    assert_eq!(digests[0], digests[1], "one worker and two");
    let folder = rig.path("2");
    for case in ["0", "17"] {
        let show = ["campaign", "case", text(&folder), case, "--show"];
        let shown = rig.hil(&show).expect(0);
        let alone = rig.write(&format!("case{case}.toml"), &shown.stdout);
        let alone = rig
            .run(&format!("{} --no-record", alone.display()))
            .expect(0);
        for flags in [&[][..], &["--in-process"]] {
            let out = rig.path(&format!("case{case}-{}", flags.len()));
            let again = [
                "campaign",
                "case",
                text(&folder),
                case,
                "--json",
                "--out",
                text(&out),
            ];
            let again = rig.hil(&[&again[..], flags].concat()).expect(0);
            let again = again.says(&["reproduced the campaign's digest"]);
            assert_eq!(
                again.json()["digest"],
                alone.digest(),
                "case {case} {flags:?}"
            );
        }
    }
}

#[test]
fn a_controller_that_takes_over_gets_the_same_numbers() {
    let rig = Rig::new();
    let path = scenario(&rig, INSTRUMENTS);
    // The law `hold` has no state: another process of it changes no bit, unless an instrument noticed.
    let line = format!("{} --set controller.law=hold", path.display());
    let straight = rig.run(&format!("{line} --no-record")).expect(0);
    let running = rig.start(&format!("{line} --pause-at 0.503 --wait-limit 60"));
    rig.until_held_at(503);
    rig.in_session("controller swap --set controller.law=hold")
        .expect(0);
    rig.in_session("resume").expect(0);
    let swapped = running.finish().expect(0);
    assert_eq!(swapped.summary()["controllers"][1]["from_step"], 503);
    assert_eq!(swapped.digest(), straight.digest());
}

/// Messages that are lost, late, doubled and out of order.
const DISTURBED: &str = r#"
[[faults]]
kind = "message-loss"
at_s = 0.1
[[faults.effects]]
target = "link.sample"
probability = 0.2

[[faults]]
kind = "message-delay"
at_s = 0.2
end_s = 0.6
[[faults.effects]]
target = "link.command"
steps = 3

[[faults]]
kind = "noise"
at_s = 0.3
[[faults.effects]]
target = "measured.position_m"
standard_deviation = 1e-4
"#;

#[test]
fn message_faults_act_behind_the_sensor_and_before_the_actuator() {
    let rig = Rig::new();
    scenario(&rig, &format!("{INSTRUMENTS}{DISTURBED}"));
    let first = run(&rig, &["--record *"]);
    let digest = first.digest();
    assert_eq!(
        run(&rig, &["--link in-process --no-record"]).digest(),
        digest
    );
    let without = scenario(&rig, INSTRUMENTS);
    let without = rig.run(text(&without)).expect(0);
    let [faulty, healthy] = [&first, &without].map(|run| Recording::open(&run.recording()));
    let sensed = faulty.column("sensed.velocity_mps");
    let measured = faulty.column("measured.velocity_mps");
    // Counts are words, which the reader takes for the bits of a number.
    let ages = faulty.column("sample_age_steps");
    let ages: Vec<usize> = ages.iter().map(|age| age.to_bits() as usize).collect();
    assert!(ages.iter().any(|age| *age > 0), "messages are lost");
    for step in 0..sensed.len() - 1 {
        let then = step - ages[step];
        assert_eq!(
            measured[step].to_bits(),
            sensed[then].to_bits(),
            "step {step}"
        );
    }
    // The noise of a sensor is the same in any run of a seed: no fault draws from its stream.
    let noise = |recording: &Recording| {
        let [before, after] = [
            "sensor.noise_density_position_m",
            "sensor.lag_hz_position_m",
        ]
        .map(|name| recording.column(name));
        before
            .iter()
            .zip(after)
            .map(|(before, after)| after - before)
            .collect::<Vec<_>>()
    };
    assert_eq!(
        healthy.column("sensed.position_m")[..100],
        faulty.column("sensed.position_m")[..100]
    );
    scenario(&rig, INSTRUMENTS);
    let healthy = Recording::open(&run(&rig, &["--record *"]).recording());
    for (step, (ours, theirs)) in noise(&faulty).iter().zip(noise(&healthy)).enumerate() {
        assert!(
            (ours - theirs).abs() < 1e-15,
            "step {step}: {ours} {theirs}"
        );
    }
}

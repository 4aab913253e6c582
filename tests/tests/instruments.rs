//! Sensors and actuators from a scenario to its recording: what they do, and that a run with them repeats to
//! the bit wherever it runs.

mod inputs;
mod judges;
mod survival;

use std::path::PathBuf;

use crate::support::board::Board;
use crate::support::harness::{Rig, Run, text};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

/// Every key, on the teaching plant at 1000 steps a second.
const INSTRUMENTS: &str = r#"
[[sensors]]
signal = "position_m"
scale = 1.001
cross = { velocity_mps = 1e-4 }
bias = "0.01 mm"
bias_sigma = "0.02 mm"
bias_tau_s = 0.3
bias_walk = 1e-5
noise_density = "1 um/sqrt(Hz)"
lag_hz = 200
noise_sigma = "1 LSB"
rate_hz = 500
phase_steps = 1
delay_s = "2 ms"
bits = 12
range = ["-5 cm", "5 cm"]

[[sensors]]
signal = "velocity_mps"
bias_sigma = 1e-3
lag_hz = 150
lag_damping = 0.7
resolution = 1e-5

[[actuators]]
signal = "force_n"
dead_time_s = "3 ms"
rate_limit_per_s = 50
lag_hz = 100
dead_band = 1e-3
backlash = 1e-3
range = [-20, 20]
bits = 14
rate_hz = 500
"#;

/// Writes the teaching scenario of one second with instruments, without its verdict.
fn scenario(rig: &Rig, instruments: &str) -> PathBuf {
    let whole = shipped("scenarios/spring-mass.toml");
    let end = whole
        .find("\n[[derived]]")
        .expect("a part behind the stimuli");
    let short = whole[..end].replace("duration_s = 5.0", "duration_s = 1.0");
    rig.write("instruments.toml", &format!("{short}\n{instruments}"))
}

fn run(rig: &Rig, arguments: &[&str]) -> Run {
    let path = rig.path("instruments.toml");
    let line = [&[text(&path)], arguments].concat();
    rig.run(&line.join(" ")).expect(0)
}

#[test]
fn a_run_with_instruments_has_one_digest_over_every_link_clock_and_thread() {
    let rig = Rig::new();
    scenario(&rig, INSTRUMENTS);
    let digest = run(&rig, &["--link in-process --no-record"]).digest();
    for arguments in ["--link iceoryx2", "--pace 5", "--pace 5 --link in-process"] {
        assert_eq!(run(&rig, &[arguments]).digest(), digest, "{arguments}");
    }
    let suite = run(&rig, &["--link in-process --no-record --repeat 3 --json"]).json();
    for run in suite["runs"].as_array().expect("a list of runs") {
        assert_eq!(run["digest"], digest, "{run}");
    }
    let other = run(&rig, &["--link in-process --no-record --set run.seed=2"]).digest();
    assert_ne!(other, digest, "noise follows the seed");
}

#[test]
fn a_run_with_instruments_is_resumed_repeated_and_replayed_to_the_bit() {
    let rig = Rig::new();
    scenario(&rig, INSTRUMENTS);
    let straight = run(&rig, &["--checkpoint-at 0.501"]);
    let digest = straight.digest();
    let check = &straight.summary()["checkpoints"][0]["check"]["text"];
    assert_eq!(check, "exact for 100 steps");
    for link in ["iceoryx2", "in-process"] {
        let from = straight.folder.join("checkpoint-501");
        let resumed = rig.run(&format!("--from {} --link {link}", from.display()));
        assert_eq!(
            resumed.expect(0).digest(),
            digest,
            "from a checkpoint over {link}"
        );
    }
    let again = rig.rerun(&straight.folder, &[]).expect(0);
    assert_eq!(again.digest(), digest, "rerun");
    let recording = straight.recording();
    rig.hil(&["replay", text(&recording)]).expect(0);
    let shown = rig.hil(&["config", "show", text(&rig.path("instruments.toml"))]);
    let path = rig.write("shown.toml", &shown.expect(0).stdout);
    let shown = rig
        .run(&format!("{} --no-record", path.display()))
        .expect(0);
    assert_eq!(shown.digest(), digest, "as shown");
}

#[test]
fn a_target_gives_the_bits_of_this_machine() {
    let rig = Rig::new();
    let board = Board::new(&rig);
    scenario(&rig, INSTRUMENTS);
    let here = run(&rig, &["--no-record"]).digest();
    let line = format!(
        "{} --no-record --target me@board",
        rig.path("instruments.toml").display()
    );
    let there = rig.start_with(board.hil(), &line).finish().expect(0);
    assert_eq!(there.digest(), here);
}

#[test]
fn a_continuation_keeps_its_instruments() {
    let rig = Rig::new();
    scenario(&rig, INSTRUMENTS);
    let straight = run(&rig, &["--checkpoint-at 0.5 --link in-process"]);
    let from = straight.folder.join("checkpoint-500");
    let other = format!("--from {} --set sensors[0].bits=10", from.display());
    let refused = rig.run(&other).expect(2);
    refused.says(&["sensors must stay the same"]);
}

#[test]
fn a_recording_shows_the_converter_the_dead_time_and_the_rate() {
    let rig = Rig::new();
    let keys = "[[sensors]]\nsignal = \"position_m\"\nbits = 12\nrange = [-0.05, 0.05]\nrate_hz = 500\n\
        [[actuators]]\nsignal = \"force_n\"\ndead_time_s = 0.003\nrate_limit_per_s = 50\n";
    scenario(&rig, keys);
    let recording = Recording::open(&run(&rig, &[]).recording());
    let column = |name: &str| recording.column(name);
    let (truth, sensed) = (column("truth.position_m"), column("sensed.position_m"));
    let measured = column("measured.position_m");
    let q = 0.1 / 4096.0;
    assert!(truth.iter().any(|x| *x > 0.005), "the mass moves");
    for step in 0..truth.len() {
        let sample = truth[step - step % 2];
        assert!((sensed[step] - sample).abs() <= 0.5001 * q, "step {step}");
        let codes = sensed[step] / q;
        assert!((codes - codes.round()).abs() < 1e-9, "step {step}");
        assert_eq!(sensed[step].to_bits(), measured[step].to_bits());
    }
    let (command, applied) = (column("command.force_n"), column("applied.force_n"));
    let mut expected = command[0];
    for step in 0..truth.len() - 1 {
        let wanted = command[step.saturating_sub(3)];
        // 50 N/s are 0.05 N in a step.
        expected += (wanted - expected).clamp(-0.05, 0.05);
        assert!((applied[step] - expected).abs() < 1e-9, "step {step}");
    }
    let steepest = command.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    assert!(steepest.take(998).any(|step| step > 0.05), "the limit acts");
}

#[test]
fn the_figures_of_instruments_are_shown() {
    let rig = Rig::new();
    let path = scenario(&rig, INSTRUMENTS);
    let show = ["config", "show", text(&path), "--instruments"];
    let shown = rig.hil(&show).expect(0);
    shown.prints(&[
        "measured.position_m",
        "500 a second",
        "stages        scale, cross, bias, bias_sigma,",
        "correlation time 0.3 s",
        "after 1 s",
        "command.force_n",
        "deg at 10 Hz",
        // The loop of the teaching plant measures the position alone.
        "unused        law `pid` does not use this signal",
    ]);
    let figures = rig
        .hil(&[&show[..], &["--json", "--at-hz", "10"]].concat())
        .expect(0)
        .json();
    let is_used = |place: usize| figures["instruments"][place]["is_used"].as_bool();
    assert_eq!(
        [0, 1, 2].map(is_used),
        [Some(true), Some(false), Some(true)]
    );
    let drive = &figures["instruments"][2];
    assert_eq!(drive["signal"], "command.force_n");
    let near = |key: &str, expected: f64| {
        let value = drive[key].as_f64().unwrap_or(f64::NAN);
        assert!((value / expected - 1.0).abs() < 1e-6, "{key}: {value}");
    };
    near("dead_time_s", 0.003);
    near("hold_s", 0.000_5);
    near("lag_s", 1.0 / (std::f64::consts::TAU * 100.0));
    near("quantisation_sigma", 40.0 / 16_384.0 / 12.0_f64.sqrt());
    let refused = rig.hil(&[&show[..], &["--at-hz", "501"]].concat());
    refused.expect(2).says(&["half of run.rate_hz, 500 Hz"]);
}

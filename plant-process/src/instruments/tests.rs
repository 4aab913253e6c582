//! Chains of instruments against closed forms, and the defects that other simulators shipped.

use hil_config::plan::{Clock, PlantPlan, Run};
use shared_types::describe::Settings;
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;

use super::*;
use crate::models::drhas::Drhas;
use crate::plant::PlantKind;

const RATE_HZ: f64 = 1000.0;

fn plant() -> PlantDescription {
    PlantKind::of::<Drhas>().description
}

fn instrument(signal: &str, values: &[(&str, f64)]) -> Instrument {
    let mut settings = Settings::default();
    for (key, value) in values {
        settings.set(key, *value);
    }
    Instrument {
        signal: signal.into(),
        values: settings,
        ..Instrument::default()
    }
}

fn job(seed: u64, sensors: Vec<Instrument>, actuators: Vec<Instrument>) -> Job {
    let run = Run {
        rate: Rate::new(RATE_HZ).expect("legal"),
        steps: 1000,
        seed,
        clock: Clock::Lockstep,
        overrun: OverrunPolicy::CatchUp,
        deadline: 0.8,
        on_controller_loss: OnLoss::Abort,
    };
    let plan = PlantPlan {
        model: "drhas".into(),
        substeps: 1,
        parameters: Settings::default(),
        limits: vec![],
        safe_command: Settings::default(),
        inputs: Settings::default(),
    };
    Job {
        sensors,
        actuators,
        ..Job::new(5, run, plan, 1.0)
    }
}

fn started(seed: u64, sensors: Vec<Instrument>) -> Instruments {
    let instruments = Instruments::new(&plant(), &job(seed, sensors, Vec::new()));
    instruments.expect("right instruments")
}

/// Names of the first measured signals and of the first command.
fn names() -> (Vec<String>, String) {
    let plant = plant();
    let measured = plant.measured.iter().map(|field| field.name.clone());
    (measured.collect(), plant.commands[0].name.clone())
}

/// Applies the sensor of the first measured signal to a series of readings.
fn sensed(seed: u64, values: &[(&str, f64)], course: impl Fn(u64) -> f64, steps: u64) -> Vec<f64> {
    let (measured, _) = names();
    let mut instruments = started(seed, vec![instrument(&measured[0], values)]);
    let mut row = vec![0.0; measured.len()];
    let one = |step| {
        row.fill(0.0);
        row[0] = course(step);
        instruments
            .sense(Step(step), &mut row, &mut [], &mut SignalSet::default())
            .expect("finite");
        row[0]
    };
    (0..steps).map(one).collect()
}

fn deviation(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares = values.iter().map(|value| (value - mean) * (value - mean));
    (squares.sum::<f64>() / n).sqrt()
}

/// A course that a converter does not repeat: steps of the golden ratio.
fn irrational(step: u64) -> f64 {
    let turns = step as f64 * 0.618_033_988_749_894_9;
    1.8 * (turns.fract() - 0.5)
}

#[test]
fn a_converter_of_b_bits_has_the_error_of_its_step_over_the_root_of_12() {
    let range = [("range_min", -1.0), ("range_max", 1.0)];
    for bits in [4.0, 8.0, 12.0] {
        let values = [&range[..], &[("bits", bits)]].concat();
        let errors: Vec<f64> = (0..50_000)
            .zip(sensed(1, &values, irrational, 50_000))
            .map(|(step, value)| value - irrational(step))
            .collect();
        let q = 2.0 / libm::pow(2.0, bits);
        let ratio = deviation(&errors) / (q / 12.0_f64.sqrt());
        assert!((ratio - 1.0).abs() < 0.02, "{bits} bits: {ratio}");
    }
}

#[test]
fn a_converter_has_as_many_codes_as_its_bits_say_from_the_lower_end_on() {
    // 0.5 is no multiple of the step 0.75.
    let values = [("range_min", 0.5), ("range_max", 3.5), ("bits", 2.0)];
    let course = |step: u64| step as f64 / 100.0 - 1.0;
    let mut codes = sensed(1, &values, course, 700);
    codes.dedup();
    assert_eq!(codes, [0.5, 1.25, 2.0, 2.75]);
}

#[test]
fn a_delay_and_a_dead_time_are_exact() {
    let course = |step: u64| libm::sin(step as f64);
    let delayed = sensed(1, &[("delay_s", 0.03)], course, 200);
    let expected = |step: u64| course(step.saturating_sub(30));
    assert_eq!(delayed, (0..200).map(expected).collect::<Vec<_>>());

    let (_, command) = names();
    let actuators = vec![instrument(&command, &[("dead_time_s", 0.003)])];
    let mut instruments =
        Instruments::new(&plant(), &job(1, Vec::new(), actuators)).expect("right");
    let mut row = vec![0.0; plant().commands.len()];
    for step in 0..50 {
        row[0] = course(step);
        instruments
            .actuate(Step(step), &mut row, &mut [])
            .expect("finite");
        assert_eq!(row[0], course(step.saturating_sub(3)));
    }
}

#[test]
fn samples_are_taken_at_their_phase_and_held() {
    let values = [("rate_hz", 250.0), ("phase_steps", 3.0)];
    let held = sensed(1, &values, |step| step as f64, 12);
    assert_eq!(held, [0., 0., 0., 3., 3., 3., 3., 7., 7., 7., 7., 11.]);
}

#[test]
fn noise_by_density_has_the_deviation_of_its_band() {
    // 0.02 per root of Hz over 500 Hz, and over 50 Hz where the sensor takes 100 samples a second.
    for (rate_hz, band_hz) in [(RATE_HZ, 500.0_f64), (100.0, 50.0)] {
        let values = [("noise_density", 0.02), ("rate_hz", rate_hz)];
        let every = (RATE_HZ / rate_hz) as usize;
        let steps = 100_000 * every as u64;
        let samples: Vec<f64> = sensed(1, &values, |_| 0.0, steps)
            .into_iter()
            .step_by(every)
            .collect();
        let ratio = deviation(&samples) / (0.02 * band_hz.sqrt());
        assert!((ratio - 1.0).abs() < 0.01, "{rate_hz} Hz: {ratio}");
    }
}

#[test]
fn a_bias_is_drawn_once_a_run_and_added() {
    // A public simulator drew it and never added it.
    let biases: Vec<f64> = (0..1000)
        .map(|seed| {
            let values = sensed(seed, &[("bias_sigma", 0.5)], |step| step as f64, 5);
            let bias = values[0];
            for (step, value) in (0..).zip(&values) {
                assert_eq!(*value, f64::from(step) + bias);
            }
            bias
        })
        .collect();
    // Five standard deviations of the estimate, s / sqrt(2 n).
    let ratio = deviation(&biases) / 0.5;
    assert!((ratio - 1.0).abs() < 5.0 / 2000.0_f64.sqrt(), "{ratio}");
    let mean = biases.iter().sum::<f64>() / 1000.0;
    assert!(mean.abs() < 5.0 * 0.5 / 1000.0_f64.sqrt(), "{mean}");
}

#[test]
fn each_sensor_has_its_own_correlation_time_and_its_own_numbers() {
    // A public simulator gave its gyro the correlation time of its accelerometer.
    let (measured, _) = names();
    let (slow_s, fast_s) = (0.5, 0.02);
    let sensor =
        |name: &str, tau_s| instrument(name, &[("bias_sigma", 1.0), ("bias_tau_s", tau_s)]);
    let sensors = vec![sensor(&measured[0], slow_s), sensor(&measured[1], fast_s)];
    let mut instruments = started(1, sensors);
    let mut courses = [Vec::new(), Vec::new()];
    for step in 0..400_000 {
        let mut row = vec![0.0; measured.len()];
        instruments
            .sense(Step(step), &mut row, &mut [], &mut SignalSet::default())
            .expect("finite");
        courses[0].push(row[0]);
        courses[1].push(row[1]);
    }
    let covariance = |a: &[f64], b: &[f64]| {
        a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len().min(b.len()) as f64
    };
    for (course, tau_s) in courses.iter().zip([slow_s, fast_s]) {
        let lag = 10;
        let correlation = covariance(course, &course[lag..]) / covariance(course, course);
        let expected = libm::exp(-(lag as f64) / RATE_HZ / tau_s);
        assert!(
            (correlation - expected).abs() < 0.02,
            "{correlation} {expected}"
        );
    }
    let shared = covariance(&courses[0], &courses[1]);
    assert!(shared.abs() < 0.1, "{shared}");
}

#[test]
fn another_sensor_changes_no_number_of_the_first() {
    let (measured, _) = names();
    let noisy = |name: &str| instrument(name, &[("noise_sigma", 1.0)]);
    let first = |sensors| {
        let mut instruments = started(9, sensors);
        let one = |step| {
            let mut row = vec![0.0; measured.len()];
            instruments
                .sense(Step(step), &mut row, &mut [], &mut SignalSet::default())
                .expect("finite");
            row[0].to_bits()
        };
        (0..20).map(one).collect::<Vec<_>>()
    };
    let alone = first(vec![noisy(&measured[0])]);
    let beside = first(vec![noisy(&measured[1]), noisy(&measured[0])]);
    assert_eq!(alone, beside);
}

#[test]
fn coupled_sensors_see_each_others_readings_of_the_model() {
    let (measured, _) = names();
    let sensor = |own: usize, other: usize| {
        let mut sensor = instrument(&measured[own], &[("scale", 2.0)]);
        sensor.cross.insert(measured[other].clone(), 0.5);
        sensor
    };
    let mut instruments = started(1, vec![sensor(0, 1), sensor(1, 0)]);
    let mut row = vec![0.0; measured.len()];
    (row[0], row[1]) = (1.0, 4.0);
    instruments
        .sense(Step(0), &mut row, &mut [], &mut SignalSet::default())
        .expect("finite");
    assert_eq!(row[..2], [2.0 + 2.0, 8.0 + 0.5]);
}

#[test]
fn recorded_inputs_are_those_of_the_named_stages() {
    let (measured, _) = names();
    let mut sensor = instrument(
        &measured[0],
        &[("scale", 2.0), ("bias", 1.0), ("resolution", 0.5)],
    );
    sensor.taps = vec![format!("resolution.{}", measured[0]), measured[0].clone()];
    let mut other = instrument(&measured[1], &[("scale", 3.0)]);
    other.taps = vec![measured[1].clone()];
    let mut instruments = started(1, vec![sensor, other]);
    let mut row = vec![0.0; measured.len()];
    (row[0], row[1]) = (0.7, 5.0);
    let mut taps = [0.0; 3];
    instruments
        .sense(Step(0), &mut row, &mut taps, &mut SignalSet::default())
        .expect("finite");
    assert_eq!(taps, [0.7, 2.0 * 0.7 + 1.0, 5.0]);
    assert_eq!(row[..2], [2.5, 15.0]);
}

#[test]
fn a_restored_chain_continues_bit_for_bit() {
    let (measured, command) = names();
    let all = [
        ("scale", 1.1),
        ("bias", 0.1),
        ("bias_sigma", 0.2),
        ("bias_tau_s", 0.3),
        ("bias_walk", 0.1),
        ("noise_density", 0.01),
        ("lag_hz", 80.0),
        ("lag_damping", 0.7),
        ("noise_sigma", 0.01),
        ("rate_hz", 250.0),
        ("phase_steps", 1.0),
        ("delay_s", 0.005),
        ("bits", 12.0),
        ("range_min", -8.0),
        ("range_max", 8.0),
    ];
    let drive = [
        ("dead_time_s", 0.004),
        ("rate_limit_per_s", 20.0),
        ("lag_hz", 50.0),
        ("dead_band", 0.01),
        ("backlash", 0.02),
        ("resolution", 0.001),
        ("rate_hz", 500.0),
    ];
    let job = job(
        3,
        vec![instrument(&measured[0], &all)],
        vec![instrument(&command, &drive)],
    );
    let new = || Instruments::new(&plant(), &job).expect("right");
    let (mut straight, mut resumed) = (new(), new());
    let step_of = |instruments: &mut Instruments, step: u64| {
        let (mut row, mut applied) = (vec![0.0; measured.len()], vec![0.0; plant().commands.len()]);
        (row[0], applied[0]) = (libm::sin(step as f64 * 0.1), libm::cos(step as f64 * 0.03));
        instruments
            .sense(Step(step), &mut row, &mut [], &mut SignalSet::default())
            .expect("finite");
        instruments
            .actuate(Step(step), &mut applied, &mut [])
            .expect("finite");
        (row[0].to_bits(), applied[0].to_bits())
    };
    for step in 0..57 {
        step_of(&mut straight, step);
    }
    resumed
        .restore(&straight.save().expect("saves"))
        .expect("restores");
    for step in 57..200 {
        assert_eq!(
            step_of(&mut straight, step),
            step_of(&mut resumed, step),
            "{step}"
        );
    }
    let other = started(3, vec![instrument(&measured[0], &[("scale", 2.0)])]);
    assert!(resumed.restore(&other.save().expect("saves")).is_err());
}

#[test]
fn a_value_that_overflows_is_named() {
    let (measured, _) = names();
    let mut instruments = started(1, vec![instrument(&measured[0], &[("scale", 1e30)])]);
    let mut row = vec![1e300; measured.len()];
    let failure = instruments
        .sense(Step(0), &mut row, &mut [], &mut SignalSet::default())
        .expect_err("infinite");
    assert!(failure.contains(&measured[0]), "{failure}");
}

/// Passes the course k + 1 through a sensor, with a gap at some steps; returns values and marks.
fn with_gap(values: &[(&str, f64)], gap: std::ops::Range<u64>) -> Vec<(f64, bool)> {
    let (measured, _) = names();
    let mut instruments = started(1, vec![instrument(&measured[0], values)]);
    let mut row = vec![0.0; measured.len()];
    let one = |step| {
        let mut invalid = SignalSet::default();
        // A value that must not be used.
        row[0] = (step + 1) as f64;
        if gap.contains(&step) {
            row[0] = 1e9;
            invalid.insert(0);
        }
        let result = instruments.sense(Step(step), &mut row, &mut [], &mut invalid);
        result.expect("finite");
        (row[0], invalid.contains(0))
    };
    (0..9).map(one).collect()
}

#[test]
fn a_sensor_hands_a_mark_on_with_its_value() {
    // Two steps later, with the reading before the gap.
    let delayed = with_gap(&[("delay_s", 0.002)], 3..5);
    let marks: Vec<bool> = delayed.iter().map(|(_, is_marked)| *is_marked).collect();
    assert_eq!(
        marks,
        [false, false, false, false, false, true, true, false, false]
    );
    assert_eq!(delayed[5..8], [(3.0, true), (3.0, true), (6.0, false)]);
    // Sampled at the steps 0, 4 and 8: only a gap there is seen, and until the next sample.
    let sampled = |gap| with_gap(&[("rate_hz", 250.0)], gap);
    assert_eq!(sampled(1..4), with_gap(&[("rate_hz", 250.0)], 9..9));
    let marks: Vec<bool> = sampled(4..5)
        .iter()
        .map(|(_, is_marked)| *is_marked)
        .collect();
    assert_eq!(
        marks,
        [false, false, false, false, true, true, true, true, false]
    );
}

#[test]
fn a_gap_shifts_no_random_number() {
    let noise = [("noise_sigma", 0.1)];
    let (whole, broken) = (with_gap(&noise, 9..9), with_gap(&noise, 3..5));
    assert_eq!(whole[..3], broken[..3]);
    assert_eq!(whole[5..], broken[5..]);
}

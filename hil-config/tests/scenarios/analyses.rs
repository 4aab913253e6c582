//! Predefined analyses: valid uses, and their evaluation.

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::AnalysisKind;
use shared_types::time::Step;

use crate::{check, descriptions, plan};

const TEXT: &str = r#"
schema = 1
run = {duration_s = 4.0, rate_hz = 100}
plant.model = "spring-mass"
controller.law = "hold"

[[stimuli]]
target = "position_m"
kind = "step"
at_s = 1.0
before = 0.5
after = -0.5

[[stimuli]]
target = "force_n"
kind = "chirp"
amplitude = 3.0
start_hz = 1.0
end_hz = 5.0
duration_s = 4.0

[[faults]]
name = "stuck"
kind = "bias"
at_s = 2.0
[[faults.effects]]
target = "measured.position_m"
bias = 1.0

[[metrics]]
name = "move"
kind = "step-response"
signal = "truth.position_m"

[[metrics]]
name = "follow"
kind = "frequency-response"
output = "-0.5 * reference.force_n"

[[metrics]]
name = "found"
kind = "detection"
alarm = "abs(measured.position_m - truth.position_m) > 0.5"
held_s = 0.1
fault = "stuck"
recovered = "abs(truth.velocity_mps) < 1"
effect = "truth.velocity_mps"
"#;

#[test]
fn each_analysis_receives_its_signals_and_its_fault() {
    let plan = plan(TEXT);
    let laws = descriptions::laws();
    let hold = laws.iter().find(|law| law.name == "hold").expect("hold");
    let columns = Columns::of(&descriptions::plants()[1], &plan.stimuli, &hold.internals);
    let column = |name: &str| columns.index_of(name).expect("a column");
    let mut evaluation = Evaluation::new(&plan, &columns).expect("known names");
    for k in 0..=400_u64 {
        let t = k as f64 / 100.0;
        let mut row = vec![0.0; columns.len()];
        // A straight line from 0.5 at 1 s to -0.5 at 2 s: from 10 to 90 % in 0.8 s.
        let truth = 0.5 - (t - 1.0).clamp(0.0, 1.0);
        row[column("truth.position_m")] = truth;
        row[column("measured.position_m")] = if k < 200 { truth } else { truth + 1.0 };
        row[column("truth.velocity_mps")] = if (200..=250).contains(&k) { 2.0 } else { 0.0 };
        let turned = t + 0.5 * t * t;
        row[column("reference.force_n")] = 3.0 * libm::sin(std::f64::consts::TAU * turned);
        if k == 200 {
            evaluation.fault(1, Step(200));
        }
        evaluation.observe(Step(k), &row, []);
    }
    let results = evaluation.results();
    let figures = results
        .iter()
        .map(|metric| (metric.name.as_str(), metric.unit.as_str(), metric.value));
    let expected = [
        ("move.rise_time_s", "s", 0.8),
        ("move.overshoot", "1", 0.0),
        ("move.peak_time_s", "s", f64::NAN),
        ("move.settling_time_s", "s", 0.98),
        ("move.steady_state_error", "m", 0.0),
        ("follow.low_frequency_gain", "1", 0.5),
        ("follow.bandwidth_hz", "Hz", f64::NAN),
        ("follow.peak_gain", "1", 1.0),
        // Shifted by 180 degrees at every frequency, forward or back.
        ("follow.peak_frequency_hz", "Hz", f64::INFINITY),
        ("follow.phase_lag_90_frequency_hz", "Hz", f64::INFINITY),
        ("found.time_to_detect_s", "s", 0.1),
        ("found.missed", "1", 0.0),
        ("found.false_alarms", "1", 0.0),
        ("found.time_to_recover_s", "s", 0.51),
        ("found.peak_effect", "m/s", 2.0),
        ("found.rms_effect", "m/s", (4.0_f64 * 51.0 / 201.0).sqrt()),
    ];
    assert_eq!(results.len(), expected.len());
    for ((name, unit, value), metric) in expected.iter().zip(figures) {
        assert_eq!((*name, *unit), (metric.0, metric.1));
        let is_close = (metric.2 - value).abs() < 1e-9 || (metric.2.is_nan() && value.is_nan());
        assert!(is_close || value.is_infinite(), "{metric:?}");
    }
}

#[test]
fn a_shown_plan_checks_to_the_same_plan() {
    let first = plan(&TEXT.replace("end_hz = 5.0", "end_hz = 5.0\nsweep = \"logarithmic\""));
    let text = descriptions::shown(&first);
    let again = plan(&text);
    assert_eq!(again.analyses, first.analyses);
    assert_eq!(again.stimuli, first.stimuli);
    assert!(text.contains("sweep = \"logarithmic\""), "{text}");
    let linear = descriptions::shown(&plan(TEXT));
    assert!(!linear.contains("sweep"), "{linear}");
    let AnalysisKind::Detection(detection) = &first.analyses[2].kind else {
        panic!("{:?}", first.analyses[2]);
    };
    assert_eq!((detection.records, detection.fault), (11, Some(1)));
}

#[test]
fn an_impossible_analysis_is_refused_with_its_place() {
    #[rustfmt::skip] // a table
    let cases = [
        ("kind = \"detection\"", "kind = \"detecton\"", "metrics[2].kind", "unknown kind of metric"),
        ("signal = \"truth.position_m\"", "signal = \"truth.positon_m\"", "metrics[0].signal", "unknown signal"),
        ("signal = \"truth.position_m\"", "signal = \"max(truth.position_m)\"", "metrics[0].signal", "a reduction needs a window"),
        (
            "signal = \"truth.position_m\"",
            "signal = \"truth.position_m\"\nstimulus = \"force_n\"",
            "metrics[0].stimulus",
            "no stimulus `force_n` of kind step",
        ),
        ("signal = \"truth.position_m\"", "signal = \"truth.position_m\"\nwanted = 0.5", "metrics[0]", "no height"),
        ("signal = \"truth.position_m\"", "signal = \"truth.position_m\"\nuntil_s = 1.0", "metrics[0].until_s", "is 1"),
        ("signal = \"truth.position_m\"", "", "metrics[0].signal", "is missing"),
        ("end_hz = 5.0", "end_hz = 13.0", "metrics[1].stimulus", "at most 12.5 Hz"),
        ("end_hz = 5.0", "end_hz = 0.5", "metrics[1].stimulus", "is not above `start_hz`"),
        ("start_hz = 1.0", "start_hz = 0\nsweep = \"logarithmic\"", "stimuli[1].sweep", "a logarithmic sweep from 0 to 5 Hz"),
        ("end_hz = 5.0", "end_hz = 1.0\nsweep = \"logarithmic\"", "stimuli[1].sweep", "above 0 that differ"),
        ("end_hz = 5.0", "end_hz = 5.0\nsweep = \"log\"", "stimuli[1].sweep", "`logarithmic`"),
        (
            "start_hz = 1.0\nend_hz = 5.0",
            "start_hz = 0.001\nend_hz = 1.6\nsweep = \"logarithmic\"",
            "metrics[1].stimulus",
            "fewer than two periods",
        ),
        ("duration_s = 4.0\n\n[[faults]]", "duration_s = 4.5\n\n[[faults]]", "metrics[1].stimulus", "beyond the end of the run"),
        ("kind = \"chirp\"", "kind = \"sine\"", "stimuli[1].start_hz", "unknown key"),
        ("fault = \"stuck\"", "fault = \"stuk\"", "metrics[2].fault", "no fault event `stuk`"),
        ("fault = \"stuck\"", "fault = 2", "metrics[2].fault", "no fault event 2"),
        ("fault = \"stuck\"", "fault = 1.5", "metrics[2].fault", "name or number"),
        ("effect = \"truth.velocity_mps\"", "effects = \"truth.velocity_mps\"", "metrics[2].effects", "unknown key"),
        ("name = \"found\"", "name = \"move\"", "metrics[2].name", "already named"),
    ];
    for (right, wrong, key, message) in cases {
        assert!(TEXT.contains(right), "{right}");
        let problems = check(&TEXT.replacen(right, wrong, 1)).expect_err(wrong);
        let is_reported = problems.0.iter().any(|problem| {
            problem.key == key && problem.to_string().contains(message) && problem.excerpt.is_some()
        });
        assert!(is_reported, "{wrong}: {problems}");
    }
}

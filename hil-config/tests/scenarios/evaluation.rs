//! Derived signals and metrics over rows.

use hil_config::evaluation::{Evaluation, MetricValue};
use hil_config::expression::{Columns, Group};
use proptest::prelude::*;
use shared_types::time::Step;

use crate::{descriptions, plan};

const TEXT: &str = r#"
schema = 1
run = {duration_s = 1.0, rate_hz = 10}
plant.model = "spring-mass"
controller.law = "hold"

[[derived]]
name = "twice_m"
expression = "2 * truth.position_m"

[[derived]]
name = "thrice_m"
expression = "twice_m + truth.position_m"

[[metrics]]
name = "span_m"
expression = "max(thrice_m) - min(thrice_m)"
windows_s = [[0, 0.2], [0.15, 0.5], [1, 1]]

[[metrics]]
name = "mean_force_n"
expression = "mean(command.force_n)"

[[metrics]]
name = "impulse"
unit = "N s"
expression = "integral(command.force_n)"

[[metrics]]
name = "share_pushed"
expression = "mean(command.force_n > 0)"
windows_s = [[0.8, 1.0]]
"#;

/// Column order: truth, measured, command, applied.
fn columns() -> Columns {
    let plants = descriptions::plants();
    let laws = descriptions::laws();
    let hold = laws.iter().find(|law| law.name == "hold").expect("hold");
    Columns::of(&plants[1], &[], &hold.internals)
}

/// Rows 0 to 10; the last one has no command.
fn run(position_m: impl Fn(u64) -> f64, force_n: impl Fn(u64) -> f64) -> Vec<MetricValue> {
    let columns = columns();
    let mut evaluation = Evaluation::new(&plan(TEXT), &columns).expect("known names");
    for k in 0..=10 {
        let mut row = vec![0.0; columns.len()];
        row[columns.index_of("truth.position_m").expect("a column")] = position_m(k);
        let force_n = if k == 10 { f64::NAN } else { force_n(k) };
        row[columns.index_of("command.force_n").expect("a column")] = force_n;
        evaluation.observe(Step(k), &row, []);
        assert_eq!(
            evaluation.derived(),
            [2.0 * position_m(k), 3.0 * position_m(k)]
        );
    }
    evaluation.results()
}

#[test]
fn metrics_reduce_exactly_the_rows_of_their_windows() {
    let results = run(|k| (k * k) as f64, |k| k as f64);
    let expected = [
        ("span_m", [0.0, 0.2], 12.0, 0),  // 3 (4 - 0)
        ("span_m", [0.15, 0.5], 63.0, 0), // 3 (25 - 4)
        ("span_m", [1.0, 1.0], 0.0, 0),   // one row
        ("mean_force_n", [0.0, 1.0], 4.5, 1),
        ("impulse", [0.0, 1.0], 4.05, 1), // 0.1 (9^2 / 2)
        ("share_pushed", [0.8, 1.0], 1.0, 1),
    ];
    assert_eq!(results.len(), expected.len());
    for (metric, (name, window_s, value, skipped)) in results.iter().zip(expected) {
        assert_eq!((metric.name.as_str(), metric.window_s), (name, window_s));
        assert!((metric.value - value).abs() < 1e-14, "{metric:?}");
        assert_eq!(metric.skipped, skipped, "{metric:?}");
    }
    let units: Vec<&str> = results.iter().map(|m| m.unit.as_str()).collect();
    assert_eq!(units, ["m", "m", "m", "N", "N s", "1"]);
}

#[test]
fn a_metric_over_rows_without_a_value_is_missing() {
    let results = run(|_| 0.0, |_| f64::NAN);
    assert!(results[3].value.is_nan());
    assert_eq!(results[3].skipped, 11);
}

#[test]
fn rows_without_a_needed_column_are_refused() {
    let mut columns = Columns::default();
    columns.push(Group::Truth, "velocity_mps");
    let error = Evaluation::new(&plan(TEXT), &columns).expect_err("no position");
    assert!(error.message.contains("truth.position_m"), "{error}");
}

proptest! {
    #[test]
    fn the_span_is_that_of_a_sorted_copy(positions in prop::array::uniform11(-1e6..1e6_f64)) {
        let results = run(|k| positions[k as usize], |_| 0.0);
        let mut window = positions[2..=5].iter().map(|x| 2.0 * x + x).collect::<Vec<f64>>();
        window.sort_by(f64::total_cmp);
        prop_assert_eq!(results[1].value, window[3] - window[0]);
    }
}

#[test]
fn a_signal_marked_as_invalid_is_missing() {
    let text = format!(
        "{TEXT}
[[metrics]]
name = \"mean_m\"
expression = \"mean(measured.position_m)\"
[[derived]]
name = \"seen_m\"
expression = \"abs(measured.position_m)\"
[[requirements]]
name = \"small\"
formula = \"always(seen_m < 100)\"
[[requirements]]
name = \"seen\"
formula = \"always(truth.position_m < 100 or measured.position_m < 100)\"
"
    );
    let columns = columns();
    let measured = columns.index_of("measured.position_m").expect("a column");
    let values = |invalid: &[u64]| {
        let mut evaluation = Evaluation::new(&plan(&text), &columns).expect("known names");
        for k in 0..=10 {
            let mut row = vec![0.0; columns.len()];
            // An invalid signal may have any value.
            row[measured] = if invalid.contains(&k) { 50.0 } else { k as f64 };
            let missing = invalid.contains(&k).then_some(measured);
            evaluation.observe(Step(k), &row, missing);
            assert_eq!(evaluation.derived()[2].is_nan(), missing.is_some());
        }
        let results = evaluation.results();
        let mean = results
            .iter()
            .find(|one| one.name == "mean_m")
            .expect("asked for");
        let requirements = evaluation.requirements();
        let robustness = requirements
            .iter()
            .map(|one| one.robustness.expect("known"));
        (mean.value, mean.skipped, robustness.collect::<Vec<f64>>())
    };
    assert_eq!(values(&[]), (5.0, 0, vec![90.0, 100.0]));
    // 0 + 1 + .. + 10 without 3 and 4, over nine rows.
    let lost = vec![f64::NEG_INFINITY, 100.0];
    assert_eq!(values(&[3, 4]), (48.0 / 9.0, 2, lost));
}

//! Conditions of faults over records.

use hil_config::condition::Watch;
use hil_config::expression::{Columns, Group};
use hil_config::plan::{Condition, Definition};
use proptest::prelude::*;
use shared_types::time::{Rate, Step};

fn rate() -> Rate {
    Rate::new(1000.0).expect("a rate")
}

fn columns() -> Columns {
    let mut columns = Columns::default();
    columns.push(Group::Truth, "a");
    columns.push(Group::Parameter, "actuator1.bulk_modulus_pa");
    columns
}

fn watch(expression: &str, records: u64, derived: &[(&str, &str)]) -> Watch {
    let condition = Condition {
        expression: expression.into(),
        records,
    };
    let derived: Vec<(String, Definition)> = (derived.iter())
        .map(|(name, text)| ((*name).into(), Definition::Expression((*text).into())))
        .collect();
    Watch::new(&condition, &derived, &columns(), rate()).expect("known names")
}

#[test]
fn a_condition_is_met_once_it_has_held_long_enough() {
    let mut watch = watch("truth.a > 0", 3, &[]);
    let results: Vec<bool> = [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0]
        .map(|a| watch.observe(Step(0), &[a, 0.0]))
        .into();
    assert_eq!(
        results,
        [false, false, false, false, false, true, true, false, false]
    );
}

#[test]
fn a_missing_value_does_not_hold() {
    let mut watch = watch("truth.a > 0", 2, &[]);
    assert!(!watch.observe(Step(0), &[1.0, 0.0]));
    assert!(!watch.observe(Step(0), &[f64::NAN, 0.0]));
    assert!(!watch.observe(Step(0), &[1.0, 0.0]));
    assert!(watch.observe(Step(0), &[1.0, 0.0]));
}

#[test]
fn a_reset_condition_must_hold_anew() {
    let mut watch = watch("truth.a", 2, &[]);
    assert!(!watch.observe(Step(0), &[1.0, 0.0]));
    watch.reset();
    assert!(!watch.observe(Step(0), &[1.0, 0.0]));
    assert!(watch.observe(Step(0), &[1.0, 0.0]));
}

#[test]
fn a_condition_uses_derived_signals_directly_and_transitively() {
    let derived = [
        ("twice", "2 * truth.a"),
        ("unused", "1 / truth.gone"), // of another record: never looked at
        ("sum", "twice + parameter.actuator1.bulk_modulus_pa"),
        ("later", "sum + unused"),
    ];
    let mut watch = watch("sum == 7", 1, &derived);
    assert!(watch.observe(Step(0), &[2.0, 3.0]));
    assert!(!watch.observe(Step(0), &[2.0, 4.0]));
    assert!(watch.observe(Step(0), &[0.0, 7.0]));
}

#[test]
fn an_unknown_name_is_refused() {
    let condition = |expression: &str| Condition {
        expression: expression.into(),
        records: 1,
    };
    let derived = [("d".to_owned(), Definition::from("truth.gone".to_owned()))];
    for (expression, name) in [("truth.b > 0", "truth.b"), ("d > 0", "truth.gone")] {
        let error =
            Watch::new(&condition(expression), &derived, &columns(), rate()).expect_err(name);
        assert!(error.message.contains(name), "{error}");
    }
    let error = Watch::new(&condition("max_abs(truth.a)"), &[], &columns(), rate());
    assert!(error.is_err(), "a reduction has no value at a record");
}

#[test]
fn a_watch_can_be_sent_to_the_loops_thread() {
    fn is_send<T: Send>(_: &T) {}
    is_send(&watch("1", 1, &[]));
}

proptest! {
    #[test]
    fn a_condition_is_met_where_the_last_records_all_hold(
        values in prop::collection::vec(prop::sample::select(vec![0.0, 1.0, f64::NAN]), 0..60),
        records in 1..6_usize,
    ) {
        let mut watch = watch("truth.a", records as u64, &[]);
        for last in 0..values.len() {
            let expected = last + 1 >= records
                && values[last + 1 - records..=last].iter().all(|value| *value == 1.0);
            prop_assert_eq!(watch.observe(Step(0), &[values[last], 0.0]), expected);
        }
    }
}

use shared_types::layout::SignalKind;
use shared_types::table::Field;

use super::*;
use crate::replay::tape::Head;

const VALID: [u64; VALIDITY_WORDS] = [0; VALIDITY_WORDS];

/// Recorded answers: command.u_n, internal.a_m and internal.b_m, the latter two with the validity bits 0 and 2.
fn places() -> Vec<AnswerPlace> {
    let names = [
        ("command.u_n", "N", None),
        ("internal.a_m", "m", Some(0)),
        ("internal.b_m", "m", Some(2)),
    ];
    (0..)
        .zip(names)
        .map(|(word, (name, unit, bit))| AnswerPlace {
            name: name.into(),
            unit: unit.into(),
            word,
            bit,
        })
        .collect()
}

/// Replayed frame: command.spare_n, command.u_n, internal.b_m in mm, internal.a_m.
fn table() -> SignalTable {
    let field = |name: &str, unit: &str| Field::signal(name, unit, "x");
    SignalTable::of(
        SignalKind::Command,
        &[field("spare_n", "N"), field("u_n", "N")],
    )
    .and(
        SignalKind::Internal,
        &[field("b_m", "mm"), field("a_m", "m")],
    )
}

fn comparison(tolerances: &[&str]) -> Comparison {
    let typed: Vec<_> = tolerances
        .iter()
        .map(|t| t.parse().expect("a tolerance"))
        .collect();
    let rate = Rate::new(1000.0).expect("legal");
    let tolerances = Tolerances::typed(&typed);
    Comparison::new(&places(), &table(), &tolerances, 1, rate).expect("tolerances fit")
}

/// Adds a step with recorded and replayed values of u and a.
fn take(comparison: &mut Comparison, step: u64, recorded: [f64; 2], replayed: [f64; 2]) {
    let head = Head {
        step,
        is_answered: true,
        ..Head::default()
    };
    let ([u, a], [u_now, a_now]) = (recorded, replayed);
    let row = Row {
        head: &head,
        sample: &[step as f64],
        answer: &[u, a, 9.0],
    };
    comparison.take(&row, &[5.0, u_now, 6.0, a_now], &VALID);
}

#[test]
fn signals_are_matched_by_name_and_unit_and_the_others_are_named() {
    let comparison = comparison(&[]);
    assert!(comparison.names().eq(["command.u_n", "internal.a_m"]));
    assert_eq!(comparison.only_recorded, ["internal.b_m"]);
    assert_eq!(
        comparison.only_replayed,
        ["command.spare_n", "internal.b_m"]
    );
    let typed = Tolerances::typed(&["internal.b_m=1".parse().expect("a tolerance")]);
    let rate = Rate::new(1000.0).expect("legal");
    let refused = Comparison::new(&places(), &table(), &typed, 1, rate).expect_err("not compared");
    assert!(refused.contains("`internal.b_m`"), "{refused}");
}

#[test]
fn the_first_difference_is_shown_with_its_neighbouring_samples() {
    let mut comparison = comparison(&[]);
    for step in 0..20 {
        let off = if step >= 11 { 0.5 } else { 0.0 };
        let last_bit = if step == 11 { f64::EPSILON } else { 0.0 };
        take(
            &mut comparison,
            step,
            [1.0, 2.0],
            [1.0 + last_bit, 2.0 + off],
        );
    }
    let first = comparison.first().expect("a difference");
    assert_eq!(
        (first.step, first.time_s, &*first.signal),
        (11, 0.011, "command.u_n")
    );
    assert_eq!((first.recorded, first.replayed), (1.0, 1.0 + f64::EPSILON));
    assert_eq!(first.also, ["internal.a_m"]);
    assert_eq!(
        first.to_string(),
        "first difference at step 11 (0.011 s): command.u_n was 1 N and is 1.0000000000000002 N, a difference of 2.220446049250313e-16 N"
    );
    let around = comparison.around();
    let steps: Vec<u64> = around.iter().map(|near| near.step).collect();
    assert_eq!(steps, [6, 7, 8, 9, 10, 11, 12, 13]);
    assert_eq!(around[5].replayed, 1.0 + f64::EPSILON);
    assert!(around.iter().all(|near| near.sample == [near.step as f64]));
    let differences = comparison.differences();
    assert_eq!(differences[1].0.differing_steps, 9);
    assert_eq!(comparison.answers, 20);
}

#[test]
fn fewer_samples_surround_a_difference_near_the_start_or_end() {
    let mut comparison = comparison(&[]);
    take(&mut comparison, 0, [1.0, 2.0], [1.0, 2.0]);
    take(&mut comparison, 1, [1.0, 2.0], [1.0, 3.0]);
    take(&mut comparison, 2, [1.0, 2.0], [1.0, 3.0]);
    let steps: Vec<u64> = comparison.around().iter().map(|near| near.step).collect();
    assert_eq!(steps, [0, 1, 2]);
}

#[test]
fn differences_within_the_tolerance_are_listed_but_never_the_first() {
    let mut comparison = comparison(&["internal.a_m=0.5"]);
    take(&mut comparison, 0, [1.0, 2.0], [1.0, 2.5]);
    assert!(comparison.first().is_none() && !comparison.is_same());
    take(&mut comparison, 1, [1.0, 2.0], [1.0, 2.6]);
    take(&mut comparison, 2, [1.0, 2.0], [1.1, 2.0]);
    let first = comparison.first().expect("beyond its tolerance");
    assert_eq!((first.step, &*first.signal), (1, "internal.a_m"));
    let of_a = &comparison.differences()[1].0;
    assert_eq!((of_a.first_step, of_a.tolerance), (Some(0), 0.5));
}

#[test]
fn nan_equals_only_itself() {
    let mut comparison = comparison(&["1e300"]);
    let nan = f64::NAN;
    take(&mut comparison, 0, [nan, nan], [nan, nan]);
    assert!(comparison.is_same());
    take(&mut comparison, 1, [1.0, nan], [1.0, 0.0]);
    assert_eq!(
        comparison.first().expect("a difference").signal,
        "internal.a_m"
    );
    assert_eq!(comparison.differences()[0].0.incomparable_steps, 1);
}

#[test]
fn validity_is_compared_by_signal_and_not_by_bit_number() {
    let head = Head {
        is_answered: true,
        answer_invalid: [0b010, 0, 0, 0, 0, 0, 0, 0], // u_n: what a fault did on its way
        ..Head::default()
    };
    let row = Row {
        head: &head,
        sample: &[0.0],
        answer: &[1.0, 2.0, 9.0],
    };
    let frame = [5.0, 1.0, 6.0, 2.0];
    let bits = |bits| [bits, 0, 0, 0, 0, 0, 0, 0];
    let mut same = comparison(&[]);
    same.take(&row, &frame, &bits(0b0000));
    assert!(same.is_same());
    let mut other = comparison(&[]);
    other.take(&row, &frame, &bits(0b1000)); // a_m stands at 3
    assert!(!other.is_same());
    assert_eq!(
        other.first().expect("a difference").to_string(),
        "first difference at step 0 (0 s): internal.a_m was valid and is invalid"
    );
    assert_eq!(other.differences()[0].1, 1);
}

#[test]
fn a_sample_without_a_recorded_answer_is_not_compared() {
    let mut comparison = comparison(&[]);
    let head = Head::default();
    let row = Row {
        head: &head,
        sample: &[0.0],
        answer: &[f64::NAN; 3],
    };
    comparison.take(&row, &[1.0; 4], &VALID);
    assert!(comparison.is_same());
    assert_eq!((comparison.answers, comparison.unanswered), (0, 1));
}

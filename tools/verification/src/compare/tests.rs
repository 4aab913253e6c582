use shared_types::table::Field;

use super::*;
use crate::fixture::{Content, Folder, layout, record, recorded, taken};

/// Creates a run of four records, which `change` may modify.
fn run(change: impl Fn(u64, &mut Vec<u64>)) -> Folder {
    let contents: Vec<Content> = (0..4)
        .map(|step| {
            let mut words = record(step, step as f64, -1.0);
            change(step, &mut words);
            Content::Record(words)
        })
        .collect();
    recorded(&layout(), &contents, vec![])
}

/// Returns the same tolerance for all signals.
fn all(tolerance: f64) -> Tolerances {
    Tolerances::typed(&[tolerance.to_string().parse().expect("a tolerance")])
}

fn first(comparison: &Comparison) -> String {
    comparison
        .first_difference
        .as_ref()
        .map_or_else(String::new, ToString::to_string)
}

#[test]
fn two_empty_runs_are_not_the_same() {
    let nothing = || recorded(&layout(), &[], vec![]);
    let (a, b) = (nothing(), nothing());
    let some = run(|_, _| ());
    let with = |b: &Path| compare(&a, b, &[], &all(0.0)).expect("comparable");
    let refused = with(&b).refuse_nothing().expect_err("nothing").to_string();
    assert!(
        refused.ends_with(", so there is nothing to compare"),
        "{refused}"
    );
    assert!(with(&some).refuse_nothing().is_ok());
}

#[test]
fn the_first_difference_and_the_size_of_each_are_determined() {
    let a = run(|_, _| ());
    let same = run(|step, words| words[13] = step); // a clock
    // truth.x_m is word 3: off by 3 at step 1 and by 4 at step 2.
    let b = run(|step, words| match step {
        1 => words[3] = 4.0_f64.to_bits(),
        2 => words[3] = (-2.0_f64).to_bits(),
        _ => {}
    });
    let nan = run(|step, words| {
        if step == 3 {
            words[5] = f64::NAN.to_bits(); // command.u_n
        }
    });
    let bits = run(|step, words| words[1] = u64::from(step == 2));
    let with = |b: &Path, tolerance| compare(&a, b, &[], &all(tolerance)).expect("comparable");

    let comparison = with(&same, 0.0);
    assert_eq!(
        (comparison.verdict, comparison.first_difference),
        (Verdict::Same, None)
    );
    assert_eq!(comparison.a.digest, comparison.b.digest);

    let comparison = with(&b, 0.0);
    assert_eq!(comparison.verdict, Verdict::Different);
    assert_eq!(
        first(&comparison),
        "first difference at step 1 (0.001 s): truth.x_m is 1 and 4"
    );
    let expected = SignalDifference {
        name: "truth.x_m".into(),
        unit: "m".into(),
        max_abs_difference: 4.0,
        at_step: Some(2),
        rms_difference: 2.5, // sqrt((9 + 16) / 4)
        first_step: Some(1),
        first_beyond_step: Some(1),
        differing_steps: 2,
        incomparable_steps: 0,
        tolerance: 0.0,
    };
    assert_eq!(comparison.signals, [expected]);
    assert_eq!(with(&b, 4.0).verdict, Verdict::WithinTolerance);
    assert_eq!(with(&b, 3.9).verdict, Verdict::Different);
    let others = compare(&a, &b, &["command.u_n".into()], &all(0.0)).expect("comparable");
    assert_eq!((others.verdict, others.signals.len()), (Verdict::Same, 0));

    let comparison = with(&nan, 10.0);
    assert_eq!(comparison.verdict, Verdict::Different);
    assert_eq!(
        first(&comparison),
        "first difference at step 3 (0.003 s): command.u_n is -1 and NaN"
    );
    assert_eq!(comparison.signals[0].incomparable_steps, 1);

    let comparison = with(&bits, 10.0);
    assert_eq!(comparison.verdict, Verdict::Different);
    assert_eq!(
        first(&comparison),
        "first difference at step 2 (0.002 s): validity of measured.x_m is valid and invalid"
    );
}

#[test]
fn the_missing_last_command_of_a_shorter_run_is_not_a_difference() {
    // The last record of a run has no command: NaN, and marked as not valid.
    let of = |steps: u64| {
        let record = |step| {
            let mut words = record(
                step,
                step as f64,
                if step == steps { f64::NAN } else { -1.0 },
            );
            words[2] = u64::from(step == steps);
            if step == steps {
                words[3] = 0.5_f64.to_bits(); // a truth with the command in it
            }
            Content::Record(words)
        };
        let contents: Vec<Content> = (0..=steps).map(record).collect();
        recorded(&layout(), &contents, vec![])
    };
    let (short, long) = (of(3), of(5));
    for (a, b, which, lengths) in [
        (&short, &long, "first", "4 records and 6"),
        (&long, &short, "second", "6 records and 4"),
    ] {
        let comparison = compare(a, b, &[], &all(0.0)).expect("comparable");
        assert_eq!(comparison.verdict, Verdict::Different);
        let expected =
            format!("first difference at step 4 (0.004 s): only the {which} run has ended");
        assert_eq!(first(&comparison), expected);
        assert_eq!(comparison.signals, []);
        let message = comparison.describe();
        assert!(
            message.contains(&format!("lengths differ: {lengths}")),
            "{message}"
        );
    }
}

#[test]
fn each_signal_may_have_its_own_tolerance() {
    let a = run(|_, _| ());
    // truth.x_m by 3 and command.u_n by 0.5, both at step 1
    let b = run(|step, words| {
        if step == 1 {
            (words[3], words[5]) = (4.0_f64.to_bits(), (-0.5_f64).to_bits());
        }
    });
    let with = |typed: &[&str]| {
        let typed: Vec<_> = typed
            .iter()
            .map(|t| t.parse().expect("a tolerance"))
            .collect();
        compare(&a, &b, &[], &Tolerances::typed(&typed))
    };
    for (typed, verdict) in [
        (
            &["truth.x_m=3", "command.u_n=0.5"][..],
            Verdict::WithinTolerance,
        ),
        (&["truth.x_m=3"], Verdict::Different),
        (&["3", "command.u_n=0.25"], Verdict::Different),
        (&["3"], Verdict::WithinTolerance),
    ] {
        assert_eq!(
            with(typed).expect("comparable").verdict,
            verdict,
            "{typed:?}"
        );
    }
    let message = with(&["truth.y_m=1"])
        .expect_err("no such signal")
        .to_string();
    assert!(message.contains("nearest: `truth.x_m`"), "{message}");
}

#[test]
fn differing_faults_and_ends_are_reported() {
    let records = |count| (0..count).map(|step| Content::Record(record(step, 0.0, 0.0)));
    let plain = recorded(&layout(), &records(3).collect::<Vec<_>>(), vec![]);
    let longer = recorded(&layout(), &records(4).collect::<Vec<_>>(), vec![]);
    let mut contents: Vec<Content> = records(3).collect();
    contents.insert(2, Content::Event(taken(2)));
    let faulty = recorded(&layout(), &contents, vec![]);
    let comparison = compare(&plain, &faulty, &[], &all(1.0)).expect("comparable");
    assert_eq!(comparison.verdict, Verdict::Different);
    assert_eq!(
        first(&comparison),
        "first difference at step 2 (0.002 s): faults is none and bias measured.x_m x_m bias=0 step"
    );
    let comparison = compare(&plain, &longer, &[], &all(1.0)).expect("comparable");
    assert_eq!(comparison.verdict, Verdict::Different);
    assert_eq!(
        first(&comparison),
        "first difference at step 3 (0.003 s): only the first run has ended"
    );
    assert_eq!((comparison.a.records, comparison.b.records), (3, 4));
}

#[test]
fn signals_of_one_run_only_are_named() {
    let mut other = layout();
    other.internal = vec![Field::signal("gain_1", "1", "Gain.")];
    other.command_signals = 2;
    let words: Vec<u64> = [&record(0, 0.0, 0.0)[..7], &[0], &record(0, 0.0, 0.0)[7..]].concat();
    let a = recorded(&layout(), &[Content::Record(record(0, 0.0, 0.0))], vec![]);
    let b = recorded(&other, &[Content::Record(words)], vec![]);
    let comparison = compare(&a, &b, &[], &all(0.0)).expect("comparable");
    assert_eq!(
        (comparison.verdict, comparison.first_difference),
        (Verdict::Different, None)
    );
    assert_eq!(
        (comparison.only_in_a.len(), comparison.only_in_b),
        (0, vec!["internal.gain_1".to_owned()])
    );
    let selected = compare(&a, &b, &["truth.x_m".into()], &all(0.0)).expect("comparable");
    assert_eq!(selected.verdict, Verdict::Same);
    let error = compare(&a, &b, &["truth.x".into()], &all(0.0))
        .expect_err("no such signal")
        .to_string();
    assert!(
        error.contains("has no signal `truth.x`; nearest: `truth.x_m`"),
        "{error}"
    );
}

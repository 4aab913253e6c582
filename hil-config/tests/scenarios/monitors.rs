//! Monitors against the definitions: every formula evaluated by recursion over its windows.
//!
//! The reference below has no delays, sliding windows or shared parts. It evaluates a formula as defined by the tables
//! of `docs/requirements.md`, at any step, with access to whole traces.

mod definitions;
mod vacuous;

use hil_config::expression::{Columns, Group};
use hil_config::formula::Formula;
use hil_config::monitor::{EveryStep, FormulaContext, Monitors, Verdict};
use shared_types::time::{Rate, Step};

use definitions::{Draws, Tree, random_trace};

fn columns() -> Columns {
    let mut columns = Columns::default();
    columns.push(Group::Truth, "a");
    columns.push(Group::Truth, "b");
    columns.push(Group::Command, "c");
    columns
}

fn monitor(text: &str, end: u64) -> Result<Monitors, String> {
    let formula = Formula::parse(text).map_err(|error| error.to_string())?;
    let (columns, rate) = (columns(), Rate::new(10.0).expect("a rate"));
    let context = FormulaContext::new(&columns, &[], rate, end);
    Monitors::new([&formula], &context).map_err(|error| error.to_string())
}

#[test]
fn ten_thousand_random_formulas_are_evaluated_as_defined() {
    let mut draws = Draws(2010);
    let mut judged = 0;
    let (mut passed, mut early, mut without_value, mut too_long) = (0, 0, 0, 0);
    let mut narrowed = 0;
    while judged < 10_000 {
        let depth = 1 + draws.below(4);
        let tree = Tree::random(&mut draws, depth, true);
        let trace = random_trace(&mut draws);
        let (text, end) = (tree.text(), trace.end());
        let monitor = monitor(&text, end);
        if tree.is_too_long(end as i64) {
            let error = monitor.expect_err(&text);
            assert!(error.contains("reaches too far"), "{text}: {error}");
            too_long += 1;
            continue;
        }
        let mut monitor = monitor.unwrap_or_else(|error| panic!("{text}: {error}"));
        let (size, step) = tree.judge(0, true, &trace);
        let is_true = tree.is_true(0, true, &trace);
        let verdict = if is_true {
            Verdict::Pass
        } else {
            Verdict::Fail
        };
        let mut bounds = [f64::NEG_INFINITY, f64::INFINITY];
        for (k, row) in (0..).zip(&trace.rows) {
            monitor.observe(Step(k), row);
            // Bounds on the robustness hold, and each row can only narrow them.
            let [low, high] = monitor.bounds()[0];
            let is_kept = bounds[0] <= low && low <= size && size <= high && high <= bounds[1];
            assert!(is_kept, "{text} at {k}: {low} to {high} for {size}");
            bounds = [low, high];
            narrowed += u32::from(
                monitor.judgements()[0].robustness().is_none() && low > f64::NEG_INFINITY,
            );
            narrowed +=
                u32::from(monitor.judgements()[0].robustness().is_none() && high < f64::INFINITY);
            // Once certain, the verdict is that of the whole run.
            if monitor.judgements()[0].verdict() != Verdict::Undecided {
                assert_eq!(
                    monitor.judgements()[0].verdict(),
                    verdict,
                    "{text} at {k}: {:?}",
                    trace.rows
                );
                early += u32::from(monitor.judgements()[0].robustness().is_none());
            }
        }
        let actual = monitor.judgements()[0]
            .robustness()
            .expect("the run is over");
        assert_eq!(bounds, [actual; 2], "{text}");
        let context_text = || format!("{text}: {actual} not {size}, {:?}", trace.rows);
        assert_eq!(
            monitor.judgements()[0].verdict(),
            verdict,
            "{}",
            context_text()
        );
        assert_eq!(actual.to_bits(), size.to_bits(), "{}", context_text());
        let expected = (step != u64::MAX).then_some(Step(step));
        assert_eq!(
            monitor.judgements()[0].judged_by(),
            expected,
            "{}",
            context_text()
        );
        assert_eq!(actual.is_sign_positive(), is_true, "{}", context_text());
        judged += 1;
        passed += u32::from(is_true);
        without_value += u32::from(size == f64::NEG_INFINITY);
    }
    // The cases are diverse.
    assert!((2_000..8_000).contains(&passed), "{passed} pass");
    assert!(early > 5_000, "{early} rows between certainty and the end");
    assert!(narrowed > 5_000, "{narrowed} bounds before the end");
    assert!(without_value > 200, "{without_value} hang on NaN");
    assert!(too_long > 100, "{too_long} do not fit their run");
}

#[test]
fn a_formula_is_evaluated_at_every_step_as_defined() {
    let mut draws = Draws(2029);
    let (columns, rate) = (columns(), Rate::new(10.0).expect("a rate"));
    let (mut judged, mut held, mut delayed) = (0, 0, 0);
    while judged < 5_000 {
        let depth = 1 + draws.below(4);
        let tree = Tree::random(&mut draws, depth, false);
        let trace = random_trace(&mut draws);
        let (text, end) = (tree.text(), trace.end());
        if tree.is_too_long(end as i64) {
            continue;
        }
        let formula = Formula::parse(&text).expect(&text);
        let context = FormulaContext::new(&columns, &[], rate, end);
        let mut every_step = EveryStep::new(&formula, &context).expect(&text);
        let rows = (0..).zip(&trace.rows);
        let decided: Vec<(Step, bool)> = rows
            .filter_map(|(step, row)| every_step.observe(Step(step), row))
            .collect();
        let until = tree.until(end as i64) as u64;
        let expected = (0..=until).map(|step| (Step(step), tree.is_true(step, true, &trace)));
        let expected: Vec<(Step, bool)> = expected.collect();
        assert_eq!(decided, expected, "{text}: {:?}", trace.rows);
        judged += expected.len();
        held += expected.iter().filter(|(_, holds)| *holds).count();
        delayed += usize::from(until < end);
    }
    assert!((1_000..4_000).contains(&held), "{held} of {judged} hold");
    assert!(delayed > 20, "{delayed} formulas look ahead");

    // What extends to the end of the run has no value at each step of it.
    let formula = Formula::parse("always(truth.a < 1)").expect("a formula");
    let context = FormulaContext::new(&columns, &[], rate, 100);
    let error = EveryStep::new(&formula, &context).expect_err("no bounds");
    assert!(error.to_string().contains("give it bounds"), "{error}");
}

#[test]
fn rows_from_a_step_on_decide_a_formula_that_looks_back_no_further() {
    let mut draws = Draws(2031);
    let (columns, rate) = (columns(), Rate::new(10.0).expect("a rate"));
    let (mut judged, mut back, mut unbounded) = (0, 0, 0);
    while judged < 5_000 {
        let depth = 1 + draws.below(4);
        let tree = Tree::random(&mut draws, depth, false);
        let trace = random_trace(&mut draws);
        let (text, end) = (tree.text(), trace.end());
        if end == 0 {
            continue;
        }
        let first = 1 + draws.below(end);
        let formula = Formula::parse(&text).expect(&text);
        let context = FormulaContext::new(&columns, &[], rate, end - first);
        // Too long for what is left of the run.
        let Ok(mut every_step) = EveryStep::new(&formula, &context) else {
            continue;
        };
        let Some(past) = every_step.past() else {
            unbounded += 1;
            continue;
        };
        let rows = (0..).zip(&trace.rows[first as usize..]);
        for (row, values) in rows {
            let Some((Step(step), holds)) = every_step.observe(Step(row), values) else {
                continue;
            };
            if step >= past {
                let step = first + step;
                let expected = tree.is_true(step, true, &trace);
                assert_eq!(holds, expected, "{text} at {step}: {:?}", trace.rows);
                judged += 1;
                back += u32::from(past > 0);
            }
        }
    }
    assert!(back > 500, "{back} of {judged} look back");
    assert!(unbounded > 50, "{unbounded} look back at all rows");
}

#[test]
fn formulas_that_share_comparisons_are_evaluated_as_defined() {
    let mut draws = Draws(2015);
    let (columns, rate) = (columns(), Rate::new(10.0).expect("a rate"));
    let mut judged = 0;
    while judged < 5_000 {
        let trace = random_trace(&mut draws);
        let end = trace.end();
        // Few signals, relations and numbers: most comparisons stand in several formulas, in other windows.
        let trees = (0..12).map(|_| {
            let depth = 1 + draws.below(3);
            Tree::random(&mut draws, depth, true)
        });
        let trees: Vec<Tree> = trees.filter(|one| !one.is_too_long(end as i64)).collect();
        let formulas = trees.iter().map(|tree| Formula::parse(&tree.text()));
        let formulas: Vec<Formula> = formulas.collect::<Result<_, _>>().expect("reads");
        let context = FormulaContext::new(&columns, &[], rate, end);
        let of = |formulas| Monitors::new(formulas, &context).expect("fits the run");
        let mut monitors = of(&formulas[..]);
        let mut alone: Vec<Monitors> = formulas.chunks(1).map(of).collect();
        for (k, row) in (0..).zip(&trace.rows) {
            monitors.observe(Step(k), row);
            let bounds = monitors.bounds();
            for (at, one) in alone.iter_mut().enumerate() {
                one.observe(Step(k), row);
                let (together, alone) = (&monitors.judgements()[at], &one.judgements()[0]);
                assert_eq!(
                    together.decided_at(),
                    alone.decided_at(),
                    "{}",
                    formulas[at]
                );
                assert_eq!(bounds[at], one.bounds()[0], "{}", formulas[at]);
            }
        }
        for (tree, judgement) in trees.iter().zip(monitors.judgements()) {
            let (size, step) = tree.judge(0, true, &trace);
            let actual = judgement.robustness().expect("the run is over");
            let context_text = || format!("{}: {actual} not {size}, {:?}", tree.text(), trace.rows);
            assert_eq!(actual.to_bits(), size.to_bits(), "{}", context_text());
            let expected = (step != u64::MAX).then_some(Step(step));
            assert_eq!(judgement.judged_by(), expected, "{}", context_text());
            judged += 1;
        }
    }
}

/// Feeds one signal and returns the monitor at the end.
fn watched(text: &str, values: &[f64]) -> Monitors {
    let end = values.len() as u64 - 1;
    let mut monitor = monitor(text, end).unwrap_or_else(|error| panic!("{text}: {error}"));
    for (k, a) in (0..).zip(values) {
        monitor.observe(Step(k), &[*a, 0.0, f64::NAN]);
    }
    monitor
}

#[test]
fn a_formula_has_the_robustness_of_a_calculation_by_hand() {
    // a = 0, 1, 3, 2, 5, 4 at 10 Hz.
    let a = [0.0, 1.0, 3.0, 2.0, 5.0, 4.0];
    #[rustfmt::skip] // a table
    let cases: [(&str, f64, u64); 14] = [
        ("truth.a < 2", 2.0, 0),
        ("always[0s,0.3s](truth.a < 4)", 1.0, 2),
        ("always(truth.a < 4)", -1.0, 4),
        ("always[0.05s,0.29s] truth.a >= 1", 0.0, 1), // steps 1 and 2
        ("always[100ms,200ms] truth.a > 1", -0.0, 1),
        ("eventually[0,0.2](truth.a >= 4)", -1.0, 2),
        ("eventually[100ms,300ms] always[0ms,200ms](truth.a > 1.5)", 0.5, 3),
        ("not eventually (truth.a == 2)", -0.0, 3),
        ("truth.a < 4 until[0s,0.4s] truth.a > 2.5", 1.0, 2),
        ("truth.a < 2 until[0s,0.4s] truth.a > 4.5", -1.0, 2),
        ("always(rise(truth.a > 2.5) implies eventually[0s,100ms](truth.a < 2.5))", -0.5, 3),
        ("eventually[0.5s,0.5s] once[0.2s,0.3s] truth.a > 2", 1.0, 2),
        ("eventually[0.5s,0.5s] (truth.a > 1 since[0s,0.5s] truth.a >= 3)", 2.0, 4),
        ("eventually[0.5s,0.5s] historically truth.a < 7", 2.0, 4),
    ];
    for (text, robustness, step) in cases {
        let monitor = watched(text, &a);
        let actual = monitor.judgements()[0].robustness().expect(text);
        assert_eq!(
            actual.to_bits(),
            f64::to_bits(robustness),
            "{text}: {actual}"
        );
        assert_eq!(
            monitor.judgements()[0].judged_by(),
            Some(Step(step)),
            "{text}"
        );
    }
}

#[test]
fn operators_bind_according_to_the_grammar() {
    let [a, b, c] = ["truth.a < 1", "truth.b < 1", "command.c < 1"];
    let mut draws = Draws(7);
    #[rustfmt::skip] // a table
    let cases = [
        (format!("{a} and {b} or {c}"), format!("(({a}) and ({b})) or ({c})")),
        (format!("{a} or {b} and {c}"), format!("({a}) or (({b}) and ({c}))")),
        (format!("{a} or {b} implies {c}"), format!("(({a}) or ({b})) implies ({c})")),
        (format!("{a} implies {b} implies {c}"), format!("({a}) implies (({b}) implies ({c}))")),
        (format!("not {a} and {b}"), format!("(not ({a})) and ({b})")),
        (format!("not {a} until[0,0.3] {b} and {c}"), format!("((not ({a})) until[0,0.3] ({b})) and ({c})")),
        (format!("eventually[0,0.3] {a} and {b}"), format!("(eventually[0,0.3] ({a})) and ({b})")),
        (format!("always[0,0.2] once[0,0.1] {a}"), format!("always[0,0.2] (once[0,0.1] ({a}))")),
        ("(truth.a + 1) * 2 < (truth.b)".into(), "((truth.a + 1) * 2) < truth.b".into()),
        ("always(truth.a) < 1".into(), "always((truth.a) < 1)".into()),
    ];
    for (bare, grouped) in cases {
        for _ in 0..200 {
            let trace = random_trace(&mut draws);
            let judged = [&bare, &grouped].map(|text| {
                let mut monitor = monitor(text, trace.end()).expect(text);
                for (k, row) in (0..).zip(&trace.rows) {
                    monitor.observe(Step(k), row);
                }
                let size = monitor.judgements()[0]
                    .robustness()
                    .expect("the run is over");
                (size.to_bits(), monitor.judgements()[0].judged_by())
            });
            assert_eq!(judged[0], judged[1], "{bare}: {:?}", trace.rows);
        }
    }
}

#[test]
fn a_verdict_is_given_once_certain_and_the_robustness_at_the_last_step() {
    let a = [0.0, 1.0, 3.0, 2.0, 5.0, 4.0];
    let (pass, fail) = (Verdict::Pass, Verdict::Fail);
    for (text, verdict, decided_at) in [
        ("always(truth.a < 3)", fail, 2),
        ("always(truth.a < 6)", pass, 5),
        ("eventually[0s,0.4s](truth.a > 2)", pass, 2),
        ("eventually[0s,0.4s](truth.a > 7)", fail, 4),
        ("always(truth.a < 6) or truth.a < 1", pass, 0),
        ("always(truth.a < 6) and truth.a > 0", fail, 0),
        ("truth.a < 1 until[0s,0.4s] truth.a > 4", fail, 1),
        ("not (truth.a < 1 until[0s,0.4s] truth.a > 4)", pass, 1),
        ("truth.a < 4 until[0s,0.4s] truth.a > 2", pass, 2),
    ] {
        let monitor = watched(text, &a);
        assert_eq!(monitor.judgements()[0].verdict(), verdict, "{text}");
        assert_eq!(
            monitor.judgements()[0].decided_at(),
            Some(Step(decided_at)),
            "{text}"
        );
    }
}

#[test]
fn bounds_of_a_robustness_close_as_rows_come() {
    const NO: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
    let up = f64::INFINITY;
    let a = [0.0, 1.0, 3.0, 2.0, 5.0, 4.0];
    #[rustfmt::skip] // a table
    let cases = [
        ("always[0.1s,0.4s](truth.a < 6)", [NO, [-up, 5.0], [-up, 3.0], [-up, 3.0], [1.0; 2], [1.0; 2]]),
        ("eventually[0s,0.4s](truth.a > 2)", [[-2.0, up], [-1.0, up], [1.0, up], [1.0, up], [3.0; 2], [3.0; 2]]),
        ("truth.a < 4 until[0s,0.4s] truth.a > 2", [[-2.0, 4.0], [-1.0, 3.0], [1.0; 2], [1.0; 2], [1.0; 2], [1.0; 2]]),
        ("always(truth.a < 6) or truth.a > 7", [[-7.0, 6.0], [-7.0, 5.0], [-7.0, 3.0], [-7.0, 3.0], [-7.0, 1.0], [1.0; 2]]),
    ];
    for (text, expected) in cases {
        let mut monitor = monitor(text, 5).expect("right");
        assert_eq!(monitor.bounds()[0], NO, "{text}");
        for (k, expected) in (0..).zip(expected) {
            monitor.observe(Step(k), &[a[k as usize], 0.0, 0.0]);
            assert_eq!(monitor.bounds()[0], expected, "{text} at {k}");
        }
    }
}

#[test]
fn a_run_that_ends_early_leaves_uncertain_verdicts_undecided() {
    let mut passing = monitor("always[0s,1s](truth.a < 3)", 20).expect("right");
    let mut failing = monitor("always[0s,1s](truth.a < 0)", 20).expect("right");
    for k in 0..5 {
        passing.observe(Step(k), &[1.0, 0.0, 0.0]);
        failing.observe(Step(k), &[1.0, 0.0, 0.0]);
    }
    assert_eq!(passing.judgements()[0].verdict(), Verdict::Undecided);
    assert_eq!(failing.judgements()[0].verdict(), Verdict::Fail);
    assert_eq!(
        (
            passing.judgements()[0].robustness(),
            failing.judgements()[0].robustness()
        ),
        (None, None)
    );
}

#[test]
fn no_formula_passes_on_a_missing_value() {
    let a = [1.0, f64::NAN, 1.0, 1.0];
    for text in [
        "always(truth.a > 0)",
        "always(not truth.a < 0)",
        "not eventually(truth.a < 0)",
        "eventually[100ms,100ms](truth.a > 0 or truth.a <= 0)",
        "eventually[100ms,100ms](truth.a > 9 implies truth.a > 9)",
        "always(truth.a < 0 implies truth.a > 9)",
        "always(truth.a == 1)",
        "always(truth.a != 7)",
    ] {
        let monitor = watched(text, &a);
        assert_eq!(monitor.judgements()[0].verdict(), Verdict::Fail, "{text}");
        assert_eq!(
            monitor.judgements()[0].robustness(),
            Some(f64::NEG_INFINITY),
            "{text}"
        );
        assert_eq!(monitor.judgements()[0].judged_by(), Some(Step(1)), "{text}");
    }
    // An existing value may still satisfy an alternative.
    assert_eq!(
        watched("always(truth.a > 0 or truth.b < 1)", &a).judgements()[0].verdict(),
        Verdict::Pass
    );
}

#[test]
fn memory_does_not_grow_with_the_run() {
    let rows = 1_000_000;
    let text = "always((truth.a > 0 until[0.5s,30s] truth.b < 1) or once[1s,90s](truth.a < truth.b) \
         or eventually[3s,100s] truth.a < 2 and (truth.b > 0 since[1s,20s] truth.a > 1))";
    let mut monitor = monitor(text, rows).expect("right");
    let before = monitor.kept_bytes();
    for k in 0..=rows {
        let a = (k % 977) as f64;
        monitor.observe(Step(k), &[a, 500.0 - a, 0.0]);
    }
    assert!(monitor.judgements()[0].robustness().is_some());
    assert_eq!(monitor.kept_bytes(), before);
    // Windows of up to 1000 steps, not of a million.
    assert!((1_000 * 16..300_000).contains(&before), "{before} bytes");
}

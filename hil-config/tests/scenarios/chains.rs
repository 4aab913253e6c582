//! Formulas of maximum length and depth, on a stack far smaller than any thread's.

use std::thread;

use hil_config::expression::{Columns, Expression, Group};
use hil_config::formula::Formula;
use hil_config::monitor::{FormulaContext, Monitors, Verdict};
use shared_types::time::{Rate, Step};

/// A quarter of a thread's stack; the rest belongs to the caller. The deepest formula takes about half of it. The size
/// of a level differs between builds, because it depends on how much the compiler inlines into one function.
const STACK_BYTES: usize = 512 << 10;
/// Operands of a chain.
const MANY: usize = 100_000;
/// Last step of the run.
const STEPS: u64 = 3;

/// Runs a function on a small stack, whose overflow would abort the whole test.
fn on_a_small_stack(run: impl FnOnce() + Send + 'static) {
    let thread = thread::Builder::new().stack_size(STACK_BYTES);
    let run = thread.spawn(run).expect("a thread");
    run.join().expect("see above");
}

fn columns() -> Columns {
    let mut columns = Columns::default();
    columns.push(Group::Truth, "x");
    columns
}

/// Evaluates a formula on rows in which the signal is the step number.
fn judged(text: &str) -> Monitors {
    let formula = Formula::parse(text).expect("reads");
    assert_eq!(formula.to_string(), text);
    assert_eq!(formula.unknown_names(&columns()), []);
    let (columns, rate) = (columns(), Rate::new(10.0).expect("a rate"));
    let context = FormulaContext::new(&columns, &[], rate, STEPS);
    let mut monitor = Monitors::new([&formula.clone()], &context).expect("fits the run");
    for step in 0..=STEPS {
        monitor.observe(Step(step), &[step as f64]);
        let [low, high] = monitor.bounds()[0];
        assert!(low <= high);
    }
    monitor
}

#[test]
fn chains_of_any_length_are_evaluated() {
    on_a_small_stack(|| {
        // `x < k` has the margin k at step 0: the minimum is 1 and the maximum that of the last.
        let terms = |joint: &str| {
            let terms: Vec<String> = (1..=MANY).map(|k| format!("truth.x < {k}")).collect();
            terms.join(joint)
        };
        let all = judged(&terms(" and "));
        assert_eq!(all.judgements()[0].verdict(), Verdict::Pass);
        assert_eq!(all.judgements()[0].robustness(), Some(1.0));
        let any = judged(&terms(" or "));
        assert_eq!(any.judgements()[0].robustness(), Some(MANY as f64));
        let none = judged(&format!("not ({})", terms(" or ")));
        assert_eq!(none.judgements()[0].robustness(), Some(-(MANY as f64)));
        // At step 3 the first comparison fails by 2; the chain is then not evaluated at step 0 only.
        let always = judged(&format!("always ({})", terms(" and ")));
        assert_eq!(always.judgements()[0].robustness(), Some(-2.0));
        assert_eq!(always.judgements()[0].judged_by(), Some(Step(3)));
        assert_eq!(always.judgements()[0].decided_at(), Some(Step(1)));
    });
}

#[test]
fn the_earliest_of_equal_margins_in_a_chain_is_named() {
    on_a_small_stack(|| {
        let some = |window: &str| format!("eventually{window} truth.x >= 0 ");
        // Each operand reaches its maximum margin, 2, at its last step except the one at 0.1 s.
        let chain = format!(
            "{}and {}",
            some("[0.2s,0.2s]"),
            vec![some("[0s,0.2s]"); MANY / 100].join("and ")
        );
        let monitor = judged(chain.trim_end());
        assert_eq!(monitor.judgements()[0].robustness(), Some(2.0));
        assert_eq!(monitor.judgements()[0].judged_by(), Some(Step(2)));
        let mixed = format!(
            "truth.x < 2 {} and always[0.1s,0.1s] truth.x < 3",
            "and eventually[0.1s,0.2s] abs(truth.x - 1) <= 2 ".repeat(MANY / 100)
        );
        let monitor = judged(&mixed);
        assert_eq!(monitor.judgements()[0].robustness(), Some(2.0));
        assert_eq!(monitor.judgements()[0].judged_by(), Some(Step(0)));
    });
}

#[test]
fn the_deepest_formulas_are_evaluated_and_deeper_ones_refused_at_their_place() {
    on_a_small_stack(|| {
        let deep = |open: &str, inner: &str, close: &str, levels: usize| {
            format!("{}{inner}{}", open.repeat(levels), close.repeat(levels))
        };
        let sum = deep("(", "truth.x", ")", 64);
        for (open, close) in [
            ("(", ")"),
            ("not ", ""),
            ("always[0s,0s] ", ""),
            ("(truth.x < 1 and ", ")"),
            ("(truth.x < 1 implies ", ")"),
            ("rise ", ""),
            ("(truth.x < 1 until[0s,0s] ", ")"),
        ] {
            // In parentheses `implies` is two levels.
            let levels = if open.contains("implies") { 32 } else { 64 };
            judged(&deep(open, &format!("{sum} < 1"), close, levels));
            for more in [levels + 1, MANY] {
                let text = deep(open, "truth.x < 1", close, more);
                let error = Formula::parse(&text).expect_err("too deep").to_string();
                assert!(error.contains("nesting deeper than 64 levels"), "{error}");
                let begin = open.len() * levels + 1;
                let place = begin..=begin + open.len();
                let column = Formula::parse(&text).expect_err("too deep").column;
                assert!(place.contains(&column), "{open}: column {column}");
            }
        }
        let implied = |more: usize| format!("truth.x < 1{}", " implies truth.x < 1".repeat(more));
        judged(&implied(64));
        let error = Formula::parse(&implied(MANY)).expect_err("too deep");
        assert!(error.message.contains("deeper than 64 levels"), "{error}");
    });
}

#[test]
fn sums_of_any_length_are_computed_from_left_to_right() {
    on_a_small_stack(|| {
        // Each addition of 1 to 2^53 is lost, and none before.
        let ones = vec!["1"; MANY].join(" + ");
        let sum = Expression::parse(&format!("{ones} + 9007199254740992{}", " + 1".repeat(MANY)));
        let sum = sum.expect("reads");
        assert_eq!(sum.constant(), Some(9_007_199_254_740_992.0 + MANY as f64));
    });
}

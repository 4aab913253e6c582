//! Vacuous passes against the definition: a formula that holds also where the conclusion of an `implies` is false.

use hil_config::monitor::Verdict;
use shared_types::time::Step;

use super::definitions::{Draws, Tree, random_trace};
use super::{monitor, watched};

/// Comparison that no trace fulfils.
const NEVER: Tree = Tree::Compare(0, "<", -1e6);

#[test]
fn a_pass_is_vacuous_if_its_conclusion_was_never_called_for() {
    let a = [0.0, 1.0, 3.0, 2.0, 5.0, 4.0];
    for (text, vacuous) in [
        // The premise never holds.
        (
            "always(truth.a > 9 implies truth.a < 1)",
            Some("truth.a > 9"),
        ),
        (
            "always((truth.a > 9) implies truth.a < 1)",
            Some("(truth.a > 9)"),
        ),
        (
            "always(rise(truth.a > 9) implies eventually[0s,0.2s](truth.a > 3))",
            Some("rise(truth.a > 9)"),
        ),
        (
            "truth.a > 9 implies always(truth.a > 99)",
            Some("truth.a > 9"),
        ),
        // The premise holds once, and then the conclusion.
        ("always(truth.a > 4 implies truth.a < 6)", None),
        ("truth.a < 1 implies always(truth.a < 6)", None),
        // The premise holds only at steps from which the formula does not look ahead.
        (
            "always(truth.a > 4 implies eventually[0s,0.2s](truth.a > 3))",
            Some("truth.a > 4"),
        ),
        (
            "always(truth.a > 4 implies eventually[0s,0.1s](truth.a > 3))",
            None,
        ),
        // Every implication must be called for.
        (
            "always(truth.a > 4 implies truth.a < 6) and always(truth.a > 9 implies truth.a < 6)",
            Some("truth.a > 9"),
        ),
        (
            "always(truth.a > 4 implies (truth.a > 9 implies truth.a < 6))",
            Some("truth.a > 9"),
        ),
        (
            "always(truth.a > 4 implies truth.a > 3 implies truth.a < 6)",
            None,
        ),
        // An outer premise that never held leaves the inner one unused, whether or not that one held.
        (
            "always(truth.a > 9 implies (truth.a > 4 implies truth.a < 6))",
            Some("truth.a > 9"),
        ),
        (
            "always(truth.a > 9 implies eventually[0s,0.1s](truth.a > 4 implies truth.a < 6))",
            Some("truth.a > 9"),
        ),
        // A premise that did not hold at one step is enough for `eventually`.
        (
            "eventually[0s,0.5s](truth.a > 2 implies truth.a < 6)",
            Some("truth.a > 2"),
        ),
        // Formulas without an implication that is asked for.
        ("always(not (truth.a > 9) or truth.a < 1)", None),
        ("not (truth.a > -1 implies truth.a > 9)", None),
        (
            "always((truth.a > 9 implies truth.a > 9) implies truth.a < 6)",
            None,
        ),
        (
            "not not (truth.a > 9 implies truth.a < 1)",
            Some("truth.a > 9"),
        ),
        // A failed formula is not vacuous.
        ("always(truth.a > 4 implies truth.a < 5)", None),
        (
            "always(truth.a < 1) and always(truth.a > 9 implies truth.a < 1)",
            None,
        ),
    ] {
        assert_eq!(watched(text, &a).vacuous(0), vacuous, "{text}");
    }
}

#[test]
fn a_premise_without_a_value_calls_for_its_conclusion() {
    let a = [0.0, f64::NAN, 0.0];
    let text = "always(truth.a > 9 implies truth.b < 1)";
    let monitor = watched(text, &a);
    let result = (monitor.judgements()[0].verdict(), monitor.vacuous(0));
    assert_eq!(result, (Verdict::Pass, None));
}

#[test]
fn a_pass_is_not_vacuous_before_that_is_certain() {
    let mut monitor = monitor("always(truth.a > 9 implies truth.a < 99)", 5).expect("fits");
    for step in 0..5 {
        monitor.observe(Step(step), &[0.0; 3]);
        assert_eq!(monitor.vacuous(0), None, "step {step}");
    }
    monitor.observe(Step(5), &[0.0; 3]);
    assert_eq!(monitor.vacuous(0), Some("truth.a > 9"));
}

#[test]
fn random_formulas_are_vacuous_as_defined() {
    let mut draws = Draws(1997);
    let [mut vacuous, mut called_for, mut judged] = [0; 3];
    while judged < 3_000 {
        let tree = Tree::random(&mut draws, 4, true);
        let trace = random_trace(&mut draws);
        if tree.is_too_long(trace.end() as i64) {
            continue;
        }
        let without = without_conclusion(&tree, true);
        if without.is_empty() {
            continue;
        }
        let text = tree.text();
        let mut monitor = monitor(&text, trace.end()).unwrap_or_else(|error| panic!("{error}"));
        for (k, row) in (0..).zip(&trace.rows) {
            monitor.observe(Step(k), row);
        }
        let is_true = |tree: &Tree| tree.is_true(0, true, &trace);
        let expected = is_true(&tree) && without.iter().any(is_true);
        let actual = monitor.vacuous(0);
        assert_eq!(actual.is_some(), expected, "{text}: {:?}", trace.rows);
        judged += 1;
        vacuous += u32::from(expected);
        called_for += u32::from(is_true(&tree) && !expected);
    }
    // The cases are diverse.
    assert!(vacuous > 500, "{vacuous} are vacuous");
    assert!(
        called_for > 200,
        "{called_for} called for their conclusions"
    );
}

/// Returns the tree once for each `implies` that it asks for, with the conclusion of that one false.
fn without_conclusion(tree: &Tree, holds: bool) -> Vec<Tree> {
    let over = |f: &Tree, with: &dyn Fn(Box<Tree>) -> Tree, holds: bool| {
        let all = without_conclusion(f, holds).into_iter();
        all.map(|f| with(Box::new(f))).collect::<Vec<_>>()
    };
    let of = |tree: &Tree| Box::new(tree.clone());
    match tree {
        Tree::Compare(..) | Tree::Edge(..) => Vec::new(),
        Tree::Not(f) => over(f, &Tree::Not, !holds),
        Tree::Over(word, bounds, f) => over(f, &|f| Tree::Over(word, *bounds, f), holds),
        Tree::Chain(word, bounds, f, g) => {
            let mut all = over(f, &|f| Tree::Chain(word, *bounds, f, of(g)), holds);
            all.extend(over(g, &|g| Tree::Chain(word, *bounds, of(f), g), holds));
            all
        }
        Tree::Two(word, f, g) => {
            let of_premise = if *word == "implies" { !holds } else { holds };
            let mut all = over(f, &|f| Tree::Two(word, f, of(g)), of_premise);
            all.extend(over(g, &|g| Tree::Two(word, of(f), g), holds));
            if *word == "implies" && holds {
                // The steps at which the conclusion can be judged stay the same.
                let never = Tree::Two("and", of(g), Box::new(NEVER));
                all.push(Tree::Two("implies", of(f), Box::new(never)));
            }
            all
        }
    }
}

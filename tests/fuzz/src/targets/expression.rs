//! Expressions of signals and metrics, and formulas of requirements.
//!
//! An expression that is read prints to a text that reads back the same, can be computed over any rows, and means
//! the same in parentheses. A formula and its opposite never both hold.

use hil_config::expression::{Accumulator, Columns, Expression, ExpressionError, Group};
use hil_config::formula::Formula;
use hil_config::monitor::{FormulaContext, Monitors, Verdict};
use shared_types::time::{Rate, Step};

use super::numbers::OddNumbers;

/// Number of steps over which formulas are judged.
const STEPS: u64 = 24;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let rate = Rate::new(1000.0).expect("a legal rate");
    match Expression::parse(text) {
        Ok(expression) => expressed(&expression, rate, OddNumbers::of(bytes)),
        Err(error) => refused(text, &error),
    }
    match Formula::parse(text) {
        Ok(formula) => stated(&formula, rate, OddNumbers::of(bytes)),
        Err(error) => refused(text, &error),
    }
}

/// Checks that the place of an error lies inside the text.
fn refused(text: &str, error: &ExpressionError) {
    assert!(!error.message.is_empty());
    assert!(text.get(error.span.clone()).is_some(), "{error:?}");
    let before = text[..error.span.start].chars().count();
    assert_eq!(error.column, before + 1, "{error:?}");
}

/// Returns columns with these names.
fn columns<'a>(names: impl Iterator<Item = &'a str>) -> Columns {
    let mut columns = Columns::default();
    for name in names {
        if columns.index_of(name).is_none() {
            columns.push(Group::Derived, name); // the name is whole already
        }
    }
    columns
}

fn expressed(expression: &Expression, rate: Rate, mut numbers: OddNumbers) {
    let text = expression.to_string();
    assert_eq!(Expression::parse(&text).as_ref(), Ok(expression));
    let columns = columns(expression.signals());
    assert_eq!(expression.unknown_names(&columns), []);
    // One level deeper may be one too many.
    let wrapped = Expression::parse(&format!("({text})")).ok();
    if expression.refuse_reduction().is_ok() {
        let compile = |e: &Expression| e.compile_signal(&columns).expect("every name is known");
        let program = compile(expression);
        let wrapped = wrapped.as_ref().map(compile);
        for _ in 0..4 {
            let row = numbers.row(columns.len());
            let value = program.evaluate(&row);
            if let Some(wrapped) = &wrapped {
                assert_eq!(value.to_bits(), wrapped.evaluate(&row).to_bits(), "{text}");
            }
        }
        return;
    }
    let (reductions, result) = (expression.compile_metric(&columns)).expect("every name is known");
    let accumulators = reductions.iter().map(|one| Accumulator::new(one.kind));
    let mut accumulators: Vec<Accumulator> = accumulators.collect();
    for step in 0..4 {
        let row = numbers.row(columns.len());
        for (accumulator, reduction) in accumulators.iter_mut().zip(&reductions) {
            accumulator.take(Step(step), rate, reduction.program.evaluate(&row));
        }
    }
    let reduced: Vec<f64> = accumulators.iter().map(Accumulator::result).collect();
    let _ = result.evaluate(&reduced); // no end but its own
}

fn stated(formula: &Formula, rate: Rate, mut numbers: OddNumbers) {
    let text = formula.to_string();
    assert_eq!(Formula::parse(&text).as_ref(), Ok(formula));
    let unknown = formula.unknown_names(&Columns::default());
    let names = unknown.iter().map(|error| &text[error.span.clone()]);
    let columns = columns(names);
    let context = FormulaContext::new(&columns, &[], rate, STEPS);
    let mut monitor = match Monitors::new([formula], &context) {
        Ok(monitor) => monitor,
        Err(error) => return refused(&text, &error),
    };
    let opposite = Formula::parse(&format!("not ({text})")).ok();
    let mut opposite = opposite.and_then(|opposite| Monitors::new([&opposite], &context).ok());
    for step in 0..=STEPS {
        let row = numbers.row(columns.len());
        monitor.observe(Step(step), &row);
        if let Some(opposite) = &mut opposite {
            opposite.observe(Step(step), &row);
        }
    }
    assert_ne!(
        monitor.judgements()[0].verdict(),
        Verdict::Undecided,
        "{text}"
    );
    let robustness = monitor.judgements()[0]
        .robustness()
        .expect("the run is over");
    let holds = monitor.judgements()[0].verdict() == Verdict::Pass;
    assert!(!robustness.is_nan(), "{text}");
    assert_eq!(robustness.is_sign_positive(), holds, "{text}: {robustness}");
    if let Some(opposite) = &opposite {
        let both = holds && opposite.judgements()[0].verdict() == Verdict::Pass;
        assert!(!both, "{text} and its opposite both hold");
    }
}

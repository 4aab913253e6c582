//! Expressions against an independent evaluator: a recursive tree walk.

use hil_config::expression::{Columns, Expression, Group};
use proptest::prelude::*;

const SIGNALS: [&str; 3] = ["truth.a", "command.b", "c"];

fn columns() -> Columns {
    let mut columns = Columns::default();
    columns.push(Group::Truth, "a");
    columns.push(Group::Command, "b");
    columns.push(Group::Derived, "c");
    columns
}

#[derive(Clone, Debug)]
enum Tree {
    Number(f64),
    Signal(usize),
    One(&'static str, Box<Tree>),
    Two(&'static str, Box<Tree>, Box<Tree>),
}

impl Tree {
    /// Returns the binding strength of the outermost operator, by the grammar.
    fn strength(&self) -> u32 {
        match self {
            Self::Two("or", ..) => 1,
            Self::Two("and", ..) => 2,
            Self::One("not", _) => 3,
            Self::Two("<" | "<=" | ">" | ">=" | "==" | "!=", ..) => 4,
            Self::Two("+" | "-", ..) => 5,
            Self::Two("*" | "/", ..) => 6,
            Self::One("-", _) => 7,
            _ => 8,
        }
    }

    /// Writes the expression as text, with parentheses only where the grammar needs them.
    fn text(&self) -> String {
        let at_least = |tree: &Self, strength| {
            if tree.strength() < strength {
                format!("({})", tree.text())
            } else {
                tree.text()
            }
        };
        match self {
            Self::Number(value) => format!("{value:?}"),
            Self::Signal(index) => SIGNALS[*index].into(),
            Self::One("-", a) => format!("-{}", at_least(a, 7)),
            Self::One("not", a) => format!("not {}", at_least(a, 3)),
            Self::One(name, a) => format!("{name}({})", a.text()),
            Self::Two(name @ ("min" | "max"), a, b) => format!("{name}({},{})", a.text(), b.text()),
            Self::Two(name, a, b) => {
                let own = self.strength();
                // Operators of one strength group to the left; comparisons do not group.
                let left = if own == 4 { 5 } else { own };
                format!("{} {name} {}", at_least(a, left), at_least(b, own + 1))
            }
        }
    }

    /// Computes the value; `None` for a missing value.
    fn value(&self, row: &[f64]) -> Option<f64> {
        let truth = |holds| if holds { 1.0 } else { 0.0 };
        let value = match self {
            Self::Number(value) => *value,
            Self::Signal(index) => row[*index],
            Self::One(name, a) => {
                let a = a.value(row);
                if *name == "valid" {
                    return Some(truth(a.is_some()));
                }
                let a = a?;
                match *name {
                    "-" => -a,
                    "not" => truth(a == 0.0),
                    "abs" => a.abs(),
                    "sqrt" if a < 0.0 => return None,
                    "sqrt" => a.sqrt(),
                    other => panic!("{other}"),
                }
            }
            Self::Two(name, a, b) => {
                let (a, b) = (a.value(row)?, b.value(row)?);
                match *name {
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" => a / b,
                    "<" => truth(a < b),
                    "<=" => truth(a <= b),
                    ">" => truth(a > b),
                    ">=" => truth(a >= b),
                    "==" => truth(a == b),
                    "!=" => truth(a != b),
                    "and" => truth(a != 0.0 && b != 0.0),
                    "or" => truth(a != 0.0 || b != 0.0),
                    "min" if b < a => b,
                    "max" if b > a => b,
                    "min" | "max" => a,
                    other => panic!("{other}"),
                }
            }
        };
        (!value.is_nan()).then_some(value)
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        prop_oneof![Just(0.0), Just(1.0), 0.0..1e3_f64].prop_map(Tree::Number),
        (0..SIGNALS.len()).prop_map(Tree::Signal),
    ];
    leaf.prop_recursive(6, 40, 2, |inner| {
        let one = prop::sample::select(vec!["-", "not", "abs", "sqrt", "valid"]);
        let two = prop::sample::select(vec![
            "+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "and", "or", "min", "max",
        ]);
        prop_oneof![
            (one, inner.clone()).prop_map(|(name, a)| Tree::One(name, Box::new(a))),
            (two, inner.clone(), inner).prop_map(|(name, a, b)| Tree::Two(
                name,
                Box::new(a),
                Box::new(b)
            )),
        ]
    })
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(1.0),
        Just(f64::NAN),
        -1e3..1e3_f64,
        any::<f64>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_compiled_expression_has_the_value_of_its_tree(
        tree in tree(), row in prop::array::uniform3(number()),
    ) {
        let text = tree.text();
        let expression = Expression::parse(&text).expect("the grammar has it");
        let program = expression.compile_signal(&columns()).expect("known names");
        let actual = program.evaluate(&row);
        match tree.value(&row) {
            // -0.0 and 0.0 are equal here.
            Some(expected) => prop_assert_eq!(actual, expected, "{}", text),
            None => prop_assert!(actual.is_nan(), "{} is {}", text, actual),
        }
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in "([a-z.0-9_()+*/<>=!, -]|and|or|not|max|truth.a|\\PC){0,60}") {
        if let Err(error) = Expression::parse(&text) {
            prop_assert!(text.get(error.span.clone()).is_some(), "{error:?}");
        }
    }
}

#[test]
fn the_grammar_binds_as_documented() {
    let value = |text: &str| {
        let program = Expression::parse(text)
            .and_then(|expression| expression.compile_signal(&columns()))
            .unwrap_or_else(|error| panic!("{text}: {error}"));
        program.evaluate(&[2.0, -3.0, 0.5])
    };
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("7 - 2 - 1", 4.0),
        ("8 / 2 / 2", 2.0),
        ("-truth.a * 3", -6.0),
        ("2 - -3", 5.0),
        ("not 0 and 0", 0.0),
        ("not (0 and 0)", 1.0),
        ("1 or 0 and 0", 1.0),
        ("not 1 < 0", 1.0),
        ("1 + 1 == 2 and 2 >= 2", 1.0),
        ("max(truth.a, command.b) + min(1, c)", 2.5),
        ("sqrt(abs(command.b + 1) * 2)", 2.0),
        ("1e-1 * 10", 1.0),
        (".5 + c", 1.0),
    ] {
        assert_eq!(value(text), expected, "{text}");
    }
}

#[test]
fn a_missing_value_stays_missing() {
    for text in [
        "command.b",
        "command.b > 0",
        "not command.b",
        "command.b or 1",
        "0 and command.b",
        "min(1, command.b)",
        "max(command.b, 1)",
        "command.b != command.b",
        "abs(command.b)",
        "sqrt(-1)",
    ] {
        let program = Expression::parse(text)
            .and_then(|expression| expression.compile_signal(&columns()))
            .expect(text);
        assert!(program.evaluate(&[1.0, f64::NAN, 1.0]).is_nan(), "{text}");
    }
}

#[test]
fn too_deep_and_too_wide_expressions_are_refused() {
    let deep =
        |open: &str, close: &str, n: usize| format!("{}1{}", open.repeat(n), close.repeat(n));
    assert!(Expression::parse(&deep("(", ")", 60)).is_ok());
    for text in [
        deep("(", ")", 100_000),
        deep("-", "", 100_000),
        deep("not ", "", 100_000),
        deep("abs(", ")", 100_000),
        deep("(1 + ", ")", 60),
    ] {
        let error = Expression::parse(&text).expect_err("too deep").to_string();
        assert!(
            error.contains("nesting deeper") || error.contains("intermediate values"),
            "{error}"
        );
    }
    // Long is not deep.
    let long = vec!["1"; 100_000].join(" + ");
    let program = Expression::parse(&long).and_then(|e| e.compile_signal(&columns()));
    assert_eq!(program.expect("a sum").evaluate(&[0.0; 3]), 100_000.0);
}

#[test]
fn a_bare_signal_name_is_refused_with_its_full_name() {
    let expression = Expression::parse("1 + a").expect("reads");
    let errors = expression.unknown_names(&columns());
    assert_eq!(errors.len(), 1);
    assert_eq!(
        (errors[0].column, errors[0].nearest.as_slice()),
        (5, &["truth.a".to_owned()][..])
    );
}

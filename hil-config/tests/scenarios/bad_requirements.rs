//! Faulty requirements, each refused with the problem, its place and the expected text.

use hil_config::formula::Formula;
use hil_config::problem::ProblemKind;

use crate::bad::assert_one_problem;
use crate::base_with;

const FORMULA: &str = "always(abs(truth.surface_angle_rad) < 0.2)";

/// Formula with `^` before its first faulty byte, and pieces of the message.
type Case = (&'static str, &'static [&'static str]);

/// The base runs for 2 s at 1 kHz.
#[rustfmt::skip] // a table reads best with a case on a line
const CASES: &[Case] = &[
    // Words
    ("always(abs(^truth.surface_angel_rad) < 0.2)", &["column 12 of the expression: unknown signal `truth.surface_angel_rad`", "nearest: `truth.surface_angle_rad`"]),
    ("error_rad < 2 and 3 < ^eror_rad", &["unknown derived signal `eror_rad`", "nearest: `error_rad`"]),
    ("^alway[0s,1s](error_rad < 1)", &["unknown operator `alway`", "nearest: `always`"]),
    ("error_rad < 2 or ^eventualy(error_rad < 1)", &["unknown operator `eventualy`", "nearest: `eventually`"]),
    ("^sign(error_rad) < 1", &["unknown function `sign`"]),
    ("always(error_rad ^$ 1)", &["unexpected '$'"]),
    ("always[0s,^1hx](error_rad < 1)", &["`1hx` is not a number: `hx` is not a known unit"]),
    ("always[0s,^5 m](error_rad < 1)", &["expected a time of at least 0", "minutes are `min`", "found `5 m`"]),
    ("error_rad < 5 ^metres", &["found `metres`", "`metres` is not a known unit"]),
    ("error_rad < 5 ^c m", &["found `c`; the unit `cm` is written without a space"]),
    ("error_rad < 5 ^k rad / s", &["found `k`; the unit `krad` is written without a space"]),
    ("error_rad < 1 ^kn", &["`kn` is not a known unit; nearest: `kN`"]),
    ("error_rad < ^1kn", &["`kn` is not a known unit; nearest: `kN`"]),
    ("error_rad < 1 ^mpa", &["nearest: `MPa`, `mPa`"]),
    ("error_rad < 1 ^Seconds", &["nearest: `s`"]),
    ("always[0 ^sec,1s](error_rad < 1)", &["found `sec`", "nearest: `s`"]),
    ("always[0s,^5 m s](error_rad < 1)", &["found `5 m s`", "`ms` without a space"]),
    ("error_rad < 5 deg/^sec", &["unknown derived signal `sec`; the unit is `s`"]),
    // Other languages
    ("error_rad < 1 ^&& error_rad > 0", &["unknown operator `&&`; write `and`"]),
    ("error_rad < 1 ^|| error_rad > 2", &["unknown operator `||`; write `or`"]),
    ("always(^|error_rad| < 1)", &["write `abs(error_rad)`"]),
    ("^|error_rad - |large|| < 1", &["write `abs(error_rad - abs(large))` for a magnitude"]),
    ("always ^|| error_rad | - 2| < 1", &["write `abs(abs(error_rad) - 2)` for a magnitude"]),
    ("^|2 * (|error_rad| + 1)| < 1", &["write `abs(2 * (abs(error_rad) + 1))` for a magnitude"]),
    ("0 < ^|error_rad or |large||", &["write `abs(error_rad or abs(large))` for a magnitude"]),
    ("error_rad < large ^|| large < 1 || error_rad > 2", &["unknown operator `||`; write `or`"]),
    ("error_rad < 1 ^| error_rad > 2 | large < 1", &["unknown operator `|`; write `or`"]),
    ("^|error_rad < 1", &["unknown operator `|`"]),
    ("error_rad ^=< 1", &["unknown operator `=<`; write `<=`"]),
    ("error_rad ^=> 1", &["write `>=` for at least, or `implies`"]),
    ("error_rad ^= 1", &["unknown operator `=`; write `==`"]),
    ("^!(error_rad < 1)", &["unknown operator `!`; write `not`"]),
    ("error_rad < 1 ^-> error_rad > 0", &["unknown operator `->`; write `implies`"]),
    ("error_rad ^** 2 < 1", &["there is no operator `**`; multiply, as in `x * x`"]),
    ("^G[0s,1s](error_rad < 1)", &["unknown operator `G`; write `always`"]),
    ("^F[0s,1s](error_rad < 1)", &["unknown operator `F`; write `eventually`"]),
    ("^globally(error_rad < 1)", &["unknown operator `globally`; write `always`"]),
    ("^globally error_rad < 1", &["unknown operator `globally`; write `always`"]),
    ("error_rad < 1 ^U error_rad > 0", &["found `U`; write `until`"]),
    ("error_rad < 1 ^AND error_rad > 0", &["found `AND`; write `and`"]),
    ("^if error_rad < 1 then error_rad > 0", &["unknown operator `if`; write `a implies b` for `if a then b`"]),
    ("^settling_time(error_rad) < 1", &["a figure of a metric; add a [[metrics]] with kind = \"step-response\""]),
    ("^average(error_rad) < 1", &["unknown function `average`; write `mean(..)`"]),
    ("^max_abs(error_rad) < 1", &["can be used only in [[metrics]]"]),
    // Grammar
    (" ^", &["expected a comparison, found the end"]),
    ("always ^", &["expected a comparison, found the end"]),
    ("always(error_rad < 1^", &["expected an operator or `)`, found the end"]),
    ("error_rad < 1^)", &["expected an operator or the end, found `)`"]),
    ("error_rad < 1 and ^", &["expected a comparison, found the end"]),
    ("error_rad <^", &["expected a number, a signal or `(`, found the end"]),
    ("^error_rad", &["consists of comparisons"]),
    ("always(^abs(error_rad))", &["consists of comparisons"]),
    ("1 < 2 ^< 3", &["two comparisons in a row; join them by `and`"]),
    ("error_rad < 1 until[0,1] error_rad < 2 ^until[0,1] error_rad < 3", &["group them by parentheses"]),
    ("always[0s,1s](^1 < 2)", &["has only numbers and no signal"]),
    ("^(error_rad < 1) < 2", &["a truth value cannot be compared", "`and`"]),
    ("0 < ^(not error_rad < 1)", &["a truth value cannot be compared"]),
    ("not ^and 1 < 2", &["expected a comparison, found `and`"]),
    ("^error_rad < 2s", &["`error_rad` is in rad and `2s` in s, which cannot be compared", "a plain number fits every unit"]),
    // Bounds
    ("always[^-1s,1s](error_rad < 1)", &["expected a time of at least 0", "found `-`"]),
    ("always[0s^](error_rad < 1)", &["expected `,` and the end of the window, found `]`"]),
    ("always[0s,1s^(error_rad < 1)", &["expected `]`, found `(`"]),
    ("always^[1s,500ms](error_rad < 1)", &["the window ends before it begins"]),
    ("^always[100us,900us](error_rad < 1)", &["no step lies in this window", "0.001 s apart"]),
    ("^always[0s,2.001s](error_rad < 1)", &["reaches too far", "the run ends at 2 s", "omit the bounds"]),
    ("^always[0s,2s](abs(command.actuator1_valve_current_a) < 1)", &["the last command is at 1.999 s"]),
    ("^eventually[0s,2s](large > 0)", &["the last command is at 1.999 s"]),
    ("^always[0s,1.5s] eventually[0s,1s](error_rad < 1)", &["the operand itself looks ahead and can be evaluated only until 1 s"]),
    ("error_rad < 1 ^until[1s,3s] error_rad > 0", &["the run ends at 2 s"]),
    ("always[0s,1s] ^eventually(error_rad < 1)", &["only an outermost operator can", "[0s,1s]"]),
    ("once(^always(error_rad < 1))", &["only an outermost operator can"]),
];

#[test]
fn each_faulty_formula_is_refused_with_its_place_and_the_expected_text() {
    for (formula, pieces) in CASES {
        let text = base_with(FORMULA, formula);
        assert_one_problem(&text, ProblemKind::Expression, pieces);
    }
}

#[test]
fn names_are_unique_and_valid_as_file_names() {
    for (from, to, kind, pieces) in [
        (
            "\"stays-small\"",
            "^\"stays small\"",
            ProblemKind::OutOfRange,
            "`requirements[0].name` is `stays small`",
        ),
        (
            "\"stays-small\"",
            "\"a\"\nformula = \"error_rad < 2\"\n[[requirements]]\nname = ^\"a\"",
            ProblemKind::Duplicate,
            "already named `a`",
        ),
        (
            "\"T-12.3\"",
            "^\"T 12\"",
            ProblemKind::OutOfRange,
            "`requirements[0].id` is `T 12`",
        ),
        (
            "\"T-12.3\"",
            "\"T-1\"\n[[requirements]]\nname = \"b\"\nformula = \"error_rad < 2\"\nid = ^\"T-1\"",
            ProblemKind::Duplicate,
            "another requirement already has the id `T-1`",
        ),
        (
            "[\"SYS_7\", \"SYS-8.1\"]",
            "[\"SYS_7\", ^\"SYS 8\"]",
            ProblemKind::OutOfRange,
            "`requirements[0].verifies[1]` is `SYS 8`",
        ),
        (
            "[\"SYS_7\", \"SYS-8.1\"]",
            "[\"SYS_7\", ^\"SYS_7\"]",
            ProblemKind::Duplicate,
            "`SYS_7` is listed twice",
        ),
        (
            "unit = \"rad\"",
            "unit = ^\"\\u001b[31mrad\"",
            ProblemKind::OutOfRange,
            "`requirements[0].unit` has the control character '\\u{1b}'",
        ),
        (
            "unit = \"rad\"",
            "unit = \"rad\"\n^\"\\u0007bell\" = 1",
            ProblemKind::UnknownKey,
            "unknown key `\u{fffd}bell`",
        ),
        (
            "name = \"stays-small\"\n",
            "name = \"b\"\n^laws = [\"pid\"]\n",
            ProblemKind::UnknownKey,
            "unknown key `laws` in `requirements[0]`",
        ),
        (
            "name = \"error_rad\"",
            "name = \"error_rad\"\nexpression = \"1\"\n[[derived]]\nname = ^\"until\"",
            ProblemKind::OutOfRange,
            "`derived[1].name` is `until`",
        ),
    ] {
        assert_one_problem(&base_with(from, to), kind, &[pieces]);
    }
}

#[test]
fn a_formula_that_would_keep_millions_of_numbers_is_refused() {
    // 100,000 s at 1 kHz.
    let text = base_with("duration_s = 2.0", "duration_s = 100000.0");
    let formula = "^always[0s,10000s] eventually[0s,10000s](error_rad < 1)";
    let text = text.replace(FORMULA, formula);
    let pieces = ["would keep 20000002 numbers at a time"];
    assert_one_problem(&text, ProblemKind::Expression, &pieces);
}

#[test]
fn each_comparison_is_listed_with_the_time_at_which_it_may_count() {
    // In a run of 20 s.
    #[rustfmt::skip] // a table
    let cases = [
        ("a < 1", vec![("a", "<", Some(1.0), [0.0, 0.0])]),
        ("always(abs(a) <= 2 * 3)", vec![("a", "<=", Some(6.0), [0.0, 20.0])]),
        (
            "always[7s,8s](abs(a) < 1) and not always[15s,20s](b > -1)",
            vec![
                ("a", "<", Some(1.0), [7.0, 8.0]),
                ("b", ">", Some(-1.0), [15.0, 20.0]),
            ],
        ),
        ("eventually[7s,15s] always[0s,5s](a < 150)", vec![("a", "<", Some(150.0), [7.0, 20.0])]),
        (
            "always[1s,2s](rise(a > 0) implies eventually[0s,500ms](b > c))",
            vec![
                ("a", ">", Some(0.0), [1.0, 2.0]),
                ("b", ">", None, [1.0, 2.5]),
            ],
        ),
        ("always[4s,5s](once[1s,2s](a > 0))", vec![("a", ">", Some(0.0), [2.0, 4.0])]),
        ("a < 1 until[1s,3s] b > 2", vec![("a", "<", Some(1.0), [0.0, 3.0]), ("b", ">", Some(2.0), [1.0, 3.0])]),
    ];
    for (formula, expected) in cases {
        let read = Formula::parse(formula).expect(formula);
        let actual: Vec<_> = (read.comparisons(20.0).into_iter())
            .map(|one| {
                let signal = one.left.plain_signal().expect("a signal").0;
                (signal, one.relation, one.right.constant(), one.window_s)
            })
            .collect();
        assert_eq!(actual, expected, "{formula}");
    }
}

#[test]
fn a_negation_reverses_the_margin_of_a_comparison() {
    for (formula, expected) in [
        (
            "always(a < 1) and eventually(b > 2)",
            vec![Some(false), Some(false)],
        ),
        ("not a < 1 or b > 2", vec![Some(true), Some(false)]),
        ("not not a < 1", vec![Some(false)]),
        ("always(a < 1 implies b > 2)", vec![Some(true), Some(false)]),
        ("eventually(rise(a > 1))", vec![None]),
        ("not rise(a > 1)", vec![None]),
    ] {
        let read = Formula::parse(formula).expect(formula);
        let actual: Vec<Option<bool>> = (read.comparisons(20.0).iter())
            .map(|one| one.is_turned)
            .collect();
        assert_eq!(actual, expected, "{formula}");
    }
}

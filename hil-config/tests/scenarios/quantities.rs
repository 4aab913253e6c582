//! Numbers with units in expressions and formulas.

use hil_config::expression::{Columns, Expression, Group};
use hil_config::formula::Formula;
use shared_types::units::Unit;

use crate::units::text;
use crate::{check, plan};

/// Derived signals named like units.
fn columns() -> Columns {
    let mut columns = Columns::default();
    for name in ["s", "m", "x"] {
        columns.push(Group::Derived, name);
    }
    columns
}

/// Evaluates an expression with `s` = 2, `m` = 3 and `x` = 5.
fn value(text: &str) -> f64 {
    let program = Expression::parse(text)
        .and_then(|expression| expression.compile_signal(&columns()))
        .unwrap_or_else(|error| panic!("{text}: {error}"));
    program.evaluate(&[2.0, 3.0, 5.0])
}

#[test]
fn a_number_with_a_unit_counts_in_si_units() {
    for (text, expected) in [
        ("0.01 m", 0.01),
        ("5 cm", 0.05),
        ("5cm", 0.05),
        ("2%", 0.02),
        ("2 %", 0.02),
        ("500 ms", 0.5),
        ("200ms", 0.2),
        ("1.5e-3 s", 1.5e-3),
        ("3 min", 180.0),
        ("1.5 kN", 1500.0),
        ("3 N m", 3.0),
        ("3 N.m", 3.0),
        ("3 mN m", 0.003),
        ("36 km/h", 10.0),
        ("9.81 m/s2", 9.81),
        ("9.81 m/s^2", 9.81),
        ("9.81 m s^-2", 9.81),
        ("5e-7 m3/s/sqrt(Pa)", 5e-7),
        ("2 J/(kg K)", 2.0),
        ("180 deg", std::f64::consts::PI),
        ("180 °", std::f64::consts::PI),
        ("30 rpm", std::f64::consts::PI),
        ("4 bar", 4e5),
        ("7 µm", 7e-6),
        ("-5 cm * 2", -0.1),
        ("abs(-5 cm) + 1 m", 1.05),
    ] {
        let actual = value(text);
        let error = (actual - expected).abs();
        assert!(error <= f64::EPSILON * expected.abs(), "{text}: {actual}");
    }
}

#[test]
fn signals_with_the_names_of_units_stay_signals() {
    for (text, expected) in [
        ("2 * s", 4.0),
        ("2 / s", 1.0),
        ("s + m", 5.0),
        ("2 - m", -1.0),
        ("max(2, m)", 3.0),
        ("2 or m", 1.0),
        ("6 m / s", 3.0),
        ("6 m /s", 3.0),
        ("6 m*s", 12.0),
        ("6 m-2", 4.0),
        ("6 m/x", 1.2),
        ("6 m/2", 3.0),
        ("6 m/s", 6.0),
    ] {
        assert_eq!(value(text), expected, "{text}");
    }
}

#[test]
fn every_known_unit_can_follow_a_number() {
    let symbols = Unit::symbols();
    assert!(symbols.len() > 700, "{}", symbols.len());
    for symbol in symbols {
        let unit = Unit::parse(&symbol).expect(&symbol);
        let base = Unit::parse(&unit.base()).expect(&symbol);
        let conversion = unit.conversion_to(&base).expect(&symbol);
        for text in [
            format!("2.5 {symbol}"),
            format!("2.5{symbol}"),
            format!("2.5 {symbol} or x"),
            format!("2.5 {symbol}/x"),
        ] {
            let read = Expression::parse(&text);
            if conversion.offset != 0.0 {
                let error = read.expect_err(&text).to_string();
                assert!(
                    error.contains("offset from absolute zero"),
                    "{text}: {error}"
                );
                continue;
            }
            let expected = match text.as_str() {
                text if text.ends_with("or x") => 1.0,
                text if text.ends_with("/x") => conversion.apply(2.5) / 5.0,
                _ => conversion.apply(2.5),
            };
            let actual = value(&text);
            let error = (actual / expected - 1.0).abs();
            assert!(error < 1e-15, "{text}: {actual}, not {expected}");
            assert_eq!(read.expect(&text).to_string(), text);
        }
    }
}

#[test]
fn a_window_means_the_same_with_every_spelling_of_its_times() {
    let windows = |text: &str| {
        let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let comparisons = formula.comparisons(9e9);
        comparisons
            .iter()
            .map(|one| one.window_s)
            .collect::<Vec<_>>()
    };
    for window in [
        "0s,500ms",
        "0 s, 500 ms",
        "0, 0.5",
        "0 min, 0.5 s",
        "0ns,5e5us",
    ] {
        let text = format!("always[{window}](x < 1)");
        assert_eq!(windows(&text), [[0.0, 0.5]], "{text}");
    }
}

#[test]
fn a_number_with_a_unit_is_compatible_with_signals_of_its_dimension() {
    for (place, expression) in [
        ("DERIVED", "truth.position_m - 5 cm"),
        ("DERIVED", "max(truth.position_m, 5 cm) + 1"),
        ("METRIC", "max(truth.position_m) - 2 mm"),
        ("METRIC", "integral(truth.velocity_mps) + 2 cm"),
        ("ALARM", "truth.velocity_mps > 3.6 km/h"),
        (
            "FORMULA",
            "always[0 s, 500 ms](abs(truth.position_m) < 5 cm)",
        ),
        ("FORMULA", "always(share < 2%)"),
        ("FORMULA", "always(truth.position_m / 10 cm < 50%)"),
        ("WHEN", "applied.force_n > 1.5 kN"),
    ] {
        plan(&text(place, expression));
    }
    let plan = plan(&text("FORMULA", "always(abs(truth.position_m) < 5 cm)"));
    assert_eq!(plan.requirements[0].unit, "m");
}

#[test]
fn an_incompatible_unit_is_refused_with_a_suggestion() {
    #[rustfmt::skip] // a table
    let cases = [
        ("DERIVED", "truth.position_m - 5 ms", ["`5 ms` in ms, which cannot be subtracted", "plain number"]),
        ("METRIC", "max(truth.position_m) - 2%", ["`2%` in %, which cannot be subtracted", "plain number"]),
        ("METRIC", "integral(truth.position_m) + 2 cm", ["`integral(..)` is in m s and `2 cm` in cm", "plain number"]),
        ("FORMULA", "always(5 cm < truth.velocity_mps)", ["`5 cm` is in cm and `truth.velocity_mps` in m/s", "plain"]),
        ("FORMULA", "always(truth.position_m + 1 < 5 cm + 1 s)", ["`5 cm` is in cm and `1 s` in s", "one dimension"]),
        ("WHEN", "command.force_n > 20 kPa", ["`command.force_n` is in N and `20 kPa` in kPa", "compared"]),
    ];
    for (place, expression, pieces) in cases {
        let problems = check(&text(place, expression)).expect_err(expression);
        let message = problems.to_string();
        assert_eq!(problems.0.len(), 1, "{message}");
        assert!(problems.0[0].excerpt.is_some());
        for piece in pieces {
            assert!(message.contains(piece), "{expression}: {message}");
        }
    }
}

#[test]
fn a_quantity_beside_a_signal_in_a_scaled_unit_is_answered_with_a_plain_number() {
    let text = text("FORMULA", "always(way_m < 5 cm)")
        .replace("name = \"way_m\"", "name = \"way_m\"\nunit = \"mm\"");
    let message = check(&text).expect_err("mm").to_string();
    let advice = "a number with a unit is converted to m, so write a plain number in mm: `50.0`";
    assert!(message.contains(advice), "{message}");
}

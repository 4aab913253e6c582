//! Sums and comparisons of signals of different units.

use crate::{check, plan};

const TEXT: &str = r#"
schema = 1
run = {duration_s = 1.0, rate_hz = 10}
plant.model = "spring-mass"
controller.law = "hold"

[[derived]]
name = "way_m"
expression = "DERIVED"

[[derived]]
name = "share"
expression = "way_m / 2"

[[metrics]]
name = "largest"
expression = "METRIC"

[[metrics]]
name = "found"
kind = "detection"
alarm = "ALARM"

[[requirements]]
name = "stays"
formula = "FORMULA"

[[faults]]
kind = "bias"
when = "WHEN"
[[faults.effects]]
target = "measured.position_m"
bias = 1.0
"#;

pub(crate) fn text(place: &str, expression: &str) -> String {
    let fitting = [
        ("DERIVED", "truth.position_m - 1"),
        ("METRIC", "max(truth.position_m) - min(way_m)"),
        ("ALARM", "truth.velocity_mps > 1"),
        ("FORMULA", "always(abs(truth.velocity_mps) < 3)"),
        ("WHEN", "command.force_n > applied.force_n"),
    ];
    fitting.iter().fold(TEXT.to_owned(), |text, (name, fits)| {
        text.replace(name, if *name == place { expression } else { fits })
    })
}

#[test]
fn two_known_units_are_neither_added_nor_compared() {
    #[rustfmt::skip] // a table
    let cases = [
        ("DERIVED", "truth.position_m + truth.velocity_mps", "derived[0].expression", "m", "m/s", "added"),
        ("DERIVED", "2 + truth.position_m - -truth.velocity_mps", "derived[0].expression", "m", "m/s", "subtracted"),
        ("DERIVED", "max(truth.position_m, truth.velocity_mps)", "derived[0].expression", "m", "m/s", "compared"),
        ("METRIC", "max(truth.position_m - truth.velocity_mps)", "metrics[0].expression", "m", "m/s", "subtracted"),
        ("METRIC", "max(truth.position_m) + rms(way_m + 1) - mean(command.force_n)", "metrics[0].expression", "m", "N", "subtracted"),
        ("METRIC", "mean(truth.position_m < truth.velocity_mps)", "metrics[0].expression", "m", "m/s", "compared"),
        ("ALARM", "abs(measured.velocity_mps) >= way_m", "metrics[1].alarm", "m/s", "m", "compared"),
        ("FORMULA", "always(truth.position_m < truth.velocity_mps)", "requirements[0].formula", "m", "m/s", "compared"),
        ("FORMULA", "not eventually[0s,0.5s](truth.position_m + 1 == applied.force_n)", "requirements[0].formula", "m", "N", "compared"),
        ("FORMULA", "always(truth.position_m + truth.velocity_mps > 0)", "requirements[0].formula", "m", "m/s", "added"),
        ("WHEN", "command.force_n > truth.position_m", "faults[0].when", "N", "m", "compared"),
    ];
    for (place, expression, key, unit, other, joined) in cases {
        let problems = check(&text(place, expression)).expect_err(expression);
        let texts: Vec<String> = problems.0.iter().map(ToString::to_string).collect();
        let [problem] = &problems.0[..] else {
            panic!("{expression}: {texts:?}");
        };
        assert_eq!(problem.key, key, "{expression}");
        assert!(problem.excerpt.is_some());
        let parts = [
            format!("is in {unit} and `"),
            format!(
                "` in {other}, which cannot be {joined}; if this is intended, write a factor, as in `1 * "
            ),
        ];
        assert!(
            parts.iter().all(|part| texts[0].contains(part)),
            "{}",
            texts[0]
        );
    }
}

#[test]
fn plain_numbers_products_and_factors_are_compatible_with_everything() {
    #[rustfmt::skip] // a table
    let cases = [
        ("DERIVED", "truth.position_m * truth.position_m - truth.velocity_mps"),
        ("DERIVED", "truth.position_m + 1 * truth.velocity_mps"),
        ("DERIVED", "truth.position_m / truth.velocity_mps + truth.velocity_mps"),
        ("DERIVED", "sqrt(truth.velocity_mps) + truth.position_m + 1"),
        ("METRIC", "integral(truth.position_m) - max(truth.velocity_mps)"),
        ("METRIC", "mean(truth.position_m > 0) + max(truth.velocity_mps)"),
        ("ALARM", "share > truth.velocity_mps and way_m < 1"),
        ("FORMULA", "always(share < truth.velocity_mps and 0 < way_m + 1)"),
        ("FORMULA", "always(truth.position_m < 1 * truth.velocity_mps)"),
        ("FORMULA", "always(1 * truth.position_m * 3.6 < truth.velocity_mps)"),
        ("FORMULA", "always(2 / truth.position_m < 5 N)"),
    ];
    for (place, expression) in cases {
        plan(&text(place, expression));
    }
}

#[test]
fn a_plain_factor_keeps_the_dimension_of_a_quantity() {
    #[rustfmt::skip] // a table
    let cases = [
        ("FORMULA", "always truth.position_m * 2 < 5 N", "`5 N` in N"),
        ("FORMULA", "always truth.position_m / 2 < 5 N", "`5 N` in N"),
        ("FORMULA", "always -1 * truth.position_m < 5 N", "`5 N` in N"),
        ("FORMULA", "always abs(2 * (truth.position_m + way_m)) < 5 N", "`5 N` in N"),
        ("FORMULA", "always applied.force_n < 2 * 3 * 5 cm", "`5 cm` in cm"),
        ("FORMULA", "always truth.position_m * 2% < 5 N", "`5 N` in N"),
        ("FORMULA", "always truth.velocity_mps < 1 cm * 2%", "`1 cm` in cm"),
        ("FORMULA", "always truth.velocity_mps < 2% * (1 cm / 3)", "`1 cm` in cm"),
        ("FORMULA", "always min(2 * truth.position_m, way_m) < truth.velocity_mps", "`truth.velocity_mps` in m/s"),
        ("DERIVED", "100 * truth.position_m - truth.velocity_mps", "`truth.velocity_mps` in m/s"),
        ("METRIC", "2 * max(truth.position_m) - mean(command.force_n / 3)", "`command.force_n` in N"),
        ("WHEN", "command.force_n * 2 > truth.position_m * 2", "`truth.position_m` in m"),
    ];
    for (place, expression, second) in cases {
        let problems = check(&text(place, expression)).expect_err(expression);
        let message = problems.to_string();
        assert_eq!(problems.0.len(), 1, "{message}");
        assert!(message.contains(second), "{expression}: {message}");
        assert!(message.contains("which cannot be"), "{message}");
    }
    for expression in [
        "always abs(truth.position_m) < 1 cm * 2%",
        "always abs(truth.position_m) < 2% * (1 cm + 3 mm) / 2",
        "always truth.position_m * 2 < way_m",
        "always truth.position_m * 2 < 5",
    ] {
        plan(&text("FORMULA", expression));
    }
}

/// A factor may convert between two units of one dimension, so such units are not refused.
#[test]
fn a_factor_may_convert_between_units_of_one_dimension() {
    for expression in [
        "always truth.position_m * 1000 < way_m",
        "always truth.position_m < way_m / 1000",
        "always 1 + 1000 * truth.position_m < way_m + 1",
    ] {
        let text = text("FORMULA", expression)
            .replace("name = \"way_m\"", "name = \"way_m\"\nunit = \"mm\"")
            .replace("min(way_m)", "1000 * min(way_m)");
        // The value is in no known unit.
        assert_eq!(plan(&text).requirements[0].unit, "", "{expression}");
    }
}

/// After a factor that may be a conversion, a number with a unit, which counts in SI units, would be wrong by that
/// factor.
#[test]
fn a_number_with_a_unit_is_refused_beside_a_value_that_a_factor_may_have_converted() {
    let derived = |name: &str, unit: &str, expression: &str| {
        format!("[[derived]]\nname = \"{name}\"\n{unit}expression = \"{expression}\"\n\n")
    };
    let scenario = |signals: &str, formula: &str| {
        let formula = text("FORMULA", formula);
        formula.replacen("[[metrics]]", &format!("{signals}[[metrics]]"), 1)
    };
    let pos = derived("pos", "", "truth.position_m * 1000");
    let pos_mm = derived("pos_mm", "", "truth.position_m * 1000");
    let declared = derived("pos", "unit = \"mm\"\n", "truth.position_m * 1000");
    let p_bar = derived("p_bar", "", "truth.position_m * 1e-5");
    let chain = format!("{pos}{}", derived("other", "", "abs(pos) + 1"));
    #[rustfmt::skip] // a table
    let cases = [
        (&pos_mm, "always(pos_mm < 15 mm)", "plain number in mm: `15.0`"),
        (&pos_mm, "always(pos_mm / 1 cm < 2)", "plain number in mm: `10.0`"),
        (&pos_mm, "always(pos_mm < truth.position_m)", "in mm and `truth.position_m` in m"),
        (&pos_mm, "always(pos_mm / 2 s < 5 cm/s)", "is taken in m/s, but the derived signal `pos_mm` has no `unit`"),
        (&pos_mm, "always(pos_mm * truth.position_m < 5 cm)", "give the signal a `unit`"),
        (&p_bar, "always(p_bar < 1 Pa)", "plain number in bar: `1e-5`"),
        (&pos, "always(pos < 15 mm)", "`15 mm` is taken in m, but the derived signal `pos` has no `unit`"),
        (&pos, "always(5 cm > pos * 2)", "give the signal a `unit`"),
        (&pos, "always(pos / 1 cm < 2)", "give the signal a `unit`"),
        (&pos, "always(abs(pos + 1) < 5 cm)", "give the signal a `unit`"),
        (&chain, "always(other < 5 cm)", "the derived signal `other` has no `unit`"),
        (&chain, "always(other + truth.position_m < 5 cm)", "the derived signal `other` has no `unit`"),
        (&declared, "always(pos < 5 cm)", "plain number in mm: `50.0`"),
        (&declared, "always(pos / 1 cm < 2)", "plain number in mm: `10.0`"),
        (&pos, "always(truth.position_m * 1000 < 5 cm)", "scale `5 cm` instead"),
        (&pos, "always(way_m + 1000 * truth.position_m < 5 cm)", "scales `truth.position_m`"),
        (&pos, "always(1000 * truth.position_m / 1 cm < 5)", "scale `1 cm` instead"),
    ];
    for (signals, formula, advice) in cases {
        let problems = check(&scenario(signals, formula)).expect_err(formula);
        let message = problems.to_string();
        assert_eq!(problems.0.len(), 1, "{message}");
        assert_eq!(problems.0[0].key, "requirements[0].formula");
        assert!(message.contains(advice), "{formula}: {message}");
    }
    for (signals, formula) in [
        (&pos_mm, "always(pos_mm < 15)"),
        (&pos_mm, "always(1000 * truth.position_m < pos_mm)"),
        (&pos_mm, "always(1 * pos_mm < 15 mm)"),
        (&pos, "always(pos < 15 and pos > truth.velocity_mps)"),
        (&pos, "always(pos < 15%)"),
        (&declared, "always(1000 * truth.position_m < pos)"),
        (&pos, "always(truth.position_m < 2 * 5 cm)"),
        (&pos, "always(truth.position_m / 1 cm < 2)"),
        (
            &pos,
            "always(0.5 * truth.velocity_mps * truth.velocity_mps < 5 J/kg)",
        ),
    ] {
        plan(&scenario(signals, formula));
    }
}

#[test]
fn a_requirement_has_the_common_unit_of_its_comparisons_or_none() {
    for (formula, unit) in [
        ("abs(truth.position_m) < 5", "m"),
        (
            "always(truth.position_m - way_m < 1 and max(way_m, 2) > 0)",
            "m",
        ),
        // As described, whatever its suffix.
        ("parameter.stiffness_n_per_m > 1", "N/m"),
        ("always(sideways_s < 1)", "m"),
        ("truth.position_m < 1 or applied.force_n < 1", ""),
        ("truth.position_m * 2 < 1", ""),
        ("truth.position_m / way_m < 1", ""),
        ("sqrt(truth.position_m) < 1", ""),
        ("share > 0", ""),
        ("truth.position_m < 1 and share > 0", ""),
    ] {
        let text = text("FORMULA", formula).replace(
            "[[metrics]]\nname = \"largest\"",
            &format!("{SIDEWAYS}[[metrics]]\nname = \"largest\""),
        );
        assert_eq!(plan(&text).requirements[0].unit, unit, "{formula}");
        let with_unit = text.replace("formula =", "unit = \"turns\"\nformula =");
        assert_eq!(plan(&with_unit).requirements[0].unit, "turns");
    }
}

const SIDEWAYS: &str = "[[derived]]\nname = \"sideways_s\"\nexpression = \"-truth.position_m\"\n\n";

use proptest::prelude::*;

use super::*;
use crate::layout::check_fields;
use crate::table::Field;

#[test]
fn common_names_get_readable_spellings() {
    for (foreign, name) in [
        ("surface_angle_rad", "surface_angle_rad"),
        ("actuator1.piston_mass_kg", "actuator1.piston_mass_kg"),
        ("_x", "_x"),
        ("der(x)", "der__x"),
        ("der(der(x))", "der__der__x"),
        ("der(pipe[3,4].T[14])", "der__pipe__3_4.T__14"),
        ("der(x,2)", "der__x__u2c_2"),
        ("a.b[1]", "a.b__1"),
        ("a[0]", "a__0"),
        ("a name", "a__name"),
        ("'quoted name'", "q__quoted__name"),
        ("wheel.'front left'.speed", "wheel.q__front__left.speed"),
        ("φ", "__u3c6_"),
        ("temperature_°C", "temperature___ub0_C"),
        ("a-b", "a__u2d_b"),
        ("2nd", "__u32_nd"),
        ("", "__u_"),
    ] {
        assert_eq!(spelled(foreign).as_deref(), Ok(name), "{foreign}");
        assert_eq!(super::foreign(name).as_deref(), Some(foreign), "{name}");
    }
}

#[test]
fn names_that_look_spelled_are_not_confused_with_spellings() {
    for one in [
        "der__x",
        "der x",
        "der (x)",
        "der()",
        "der(u28_)",
        "a__1",
        "a[01]",
        "a[1]2",
        "a[1]_2",
        "a[1,]",
        "a[]",
        "a 1",
        "q__a",
        "q a",
        "'a'",
        "'a' b",
        "''",
        "'a.b'",
        "__u_",
        "__u41_",
        "_u41_",
        "a__u41_b",
        "a_",
        "a__",
        "a._b",
        "a..b",
        ".",
        "a.",
        ".a",
        "a.2",
        " ",
        "  a",
        "a\u{0}",
        "a\n",
        "der(_)",
        "der(u)",
        "q__u28_",
        "\u{10ffff}",
    ] {
        let name = spelled(one).expect("it is short");
        assert_eq!(foreign(&name).as_deref(), Some(one), "{name}");
        let field = Field::signal(&name, "1", "It.");
        assert_eq!(check_fields(&[field], 1), Ok(()), "{one:?}");
    }
    for name in [
        "a__u41_",
        "a__u0041_",
        "a__uFC_",
        "__",
        "der__",
        "a__01",
        "q__a__u2e_b",
        "a.__u_",
    ] {
        if let Some(text) = foreign(name) {
            assert_eq!(spelled(&text).as_deref(), Ok(name));
        }
    }
    // A plain letter is never written by its number.
    assert_eq!(foreign("a__u41_"), None);
}

#[test]
fn a_name_may_just_fit_but_not_be_longer() {
    assert_eq!(spelled(&"a".repeat(256)).map(|name| name.len()), Ok(256));
    let error = spelled(&"ä".repeat(50)).expect_err("300 bytes");
    assert_eq!(
        error.to_string(),
        format!(
            "the name \"{}\".. has 300 bytes when spelled with letters, digits and _; at most 256 are allowed",
            "ä".repeat(40)
        )
    );
}

#[test]
fn deeply_nested_derivatives_are_refused_as_too_long() {
    let order = 100_000;
    let endless = format!("{}x{}", "der(".repeat(order), ")".repeat(order));
    let error = spelled(&endless).expect_err("500,001 bytes");
    assert!(matches!(error, Unspellable::Long { bytes: 500_001, .. }));
    assert_eq!(foreign(&format!("{}x", "der__".repeat(order))), None);
}

#[test]
fn names_that_coincide_in_a_recording_are_refused_together() {
    let names = ["a[1]", "der(a)", "b"];
    let spelled = spelled_all(&names).expect("they differ");
    assert_eq!(spelled, ["a__1", "der__a", "b"]);
    for [one, other] in [["a.b", "a_b"], ["a", "a"]] {
        let result = spelled_all(&[one, "c", other]);
        let (one, other) = (one.into(), other.into());
        assert_eq!(result, Err(Unspellable::Alike { one, other }));
    }
}

/// Generates texts from pieces that the spelling treats specially and that chance would rarely combine.
fn text() -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        Just("_"),
        Just("__"),
        Just("."),
        Just(" "),
        Just("'"),
        Just("der("),
        Just("der"),
        Just("q"),
        Just("u"),
        Just("u28_"),
        Just("("),
        Just(")"),
        Just("["),
        Just("]"),
        Just("[1]"),
        Just("[1,2]"),
        Just("0"),
        Just("12"),
        Just(","),
        Just("a"),
        Just("ü"),
        Just("𝜑"),
    ];
    prop_oneof![
        proptest::collection::vec(piece, 0..12).prop_map(|pieces| pieces.concat()),
        any::<String>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_text_has_one_legal_name_and_every_such_name_one_text(text in text()) {
        if let Ok(name) = spelled(&text) {
            prop_assert_eq!(foreign(&name), Some(text));
            let field = Field::signal(&name, "1", "It.");
            prop_assert_eq!(check_fields(&[field], 1), Ok(()));
        }
    }

    #[test]
    fn a_name_that_reads_as_a_text_is_the_spelling_of_that_text(name in "[a-z_]{0,3}(der__|q__|__|__u[0-9a-f]{0,3}_|_|\\.|[a-z0-9]){0,8}") {
        if let Some(text) = foreign(&name) {
            prop_assert_eq!(spelled(&text), Ok(name));
        }
    }

    #[test]
    fn a_valid_name_without_double_underscores_is_unchanged(name in "[a-z][a-z0-9]{0,3}(_[a-z0-9]{1,4}){0,4}(\\.[a-z][a-z0-9]{0,3}){0,2}") {
        prop_assert_eq!(spelled(&name), Ok(name));
    }
}

use super::*;

fn unit(text: &str) -> Unit {
    Unit::parse(text).unwrap_or_else(|e| panic!("{text}: {e}"))
}

fn conversion(from: &str, to: &str) -> Conversion {
    let actual = unit(from).conversion_to(&unit(to));
    actual.unwrap_or_else(|| panic!("{from} to {to}"))
}

#[test]
fn texts_of_one_unit_convert_without_changing_a_bit() {
    for (one, other) in [
        ("N.m", "N m"),
        ("N m", "N*m"),
        ("N·m", "J"),
        ("Nm", "W s"),
        ("kg.m/s2", "N"),
        ("kg m s-2", "N"),
        ("m/s^2", "m/s2"),
        ("m.s^-2", "m/s²"),
        ("m s⁻²", "m/s/s"),
        ("1/s", "Hz"),
        ("s-1", "Hz"),
        ("m3/s/sqrt(Pa)", "m3/(s sqrt(Pa))"),
        ("J/(kg.K)", "J/kg/K"),
        ("", "1"),
        ("degC", "°C"),
        ("W", "V A"),
        ("Ohm", "V/A"),
        ("T", "Wb/m2"),
        ("Ω", "ohm"),
        ("µm", "um"),
        ("m2/m", "m"),
        ("m0", "1"),
    ] {
        let conversion = conversion(one, other);
        assert!(conversion.is_identity(), "{one} to {other}: {conversion:?}");
    }
}

/// Factors from pint 0.25.3, an independent program; both round, each in its own order.
#[test]
fn factors_are_those_of_an_independent_program() {
    for (from, to, factor) in [
        ("mm", "m", 0.001),
        ("km/h", "m/s", 0.277_777_777_777_777_8),
        ("rpm", "rad/s", 0.104_719_755_119_659_77),
        ("bar", "Pa", 100_000.0),
        ("psi", "Pa", 6_894.757_293_168_363_5),
        ("lbf.ft", "N.m", 1.355_817_948_331_400_6),
        ("deg/s", "rad/s", 0.017_453_292_519_943_295),
        ("%", "1", 0.01),
        ("L/min", "m3/s", 1.666_666_666_666_667e-5),
        ("kWh", "J", 3_600_000.0),
        ("in", "mm", 25.4),
        ("g/cm3", "kg/m3", 1000.0),
        ("mN/um", "N/m", 1000.0),
        ("atm", "kPa", 101.325),
        ("arcmin", "rad", 0.000_290_888_208_665_721_63),
        ("t", "kg", 1000.0),
        ("rev/min", "deg/s", 6.0),
        ("lb", "kg", 0.453_592_37),
        ("mOhm", "V/A", 0.001),
        ("uF", "s/Ohm", 1e-6),
        ("mmol/L", "mol/m3", 1.0),
        ("d", "s", 86_400.0),
        ("degC/s", "K/s", 1.0),
        ("degF/h", "K/h", 5.0 / 9.0),
    ] {
        let actual = conversion(from, to);
        assert!(
            (actual.factor / factor - 1.0).abs() < 4e-16,
            "{from} to {to}: {actual:?} {factor}"
        );
        assert_eq!(actual.offset, 0.0, "{from} to {to}");
    }
}

#[test]
fn temperatures_have_an_offset() {
    for (from, to, value, expected) in [
        ("degC", "K", 25.0, 298.15),
        ("K", "degC", 0.0, -273.15),
        ("degF", "degC", 212.0, 100.0),
        ("degC", "degF", -40.0, -40.0),
        ("degF", "K", -40.0, 233.15),
        ("mK", "degC", 273_150.0, 0.0),
    ] {
        let actual = conversion(from, to).apply(value);
        assert!(
            (actual - expected).abs() < 1e-12 * 300.0,
            "{value} {from} is {actual} {to}"
        );
    }
    assert_eq!(conversion("degC", "K").offset, 273.15);
    assert_eq!(conversion("K", "degC").factor, 1.0);
}

#[test]
fn a_unit_in_millimetres_is_a_thousandth_rounded_once() {
    assert_eq!(conversion("mm", "m").factor, 1e-3);
    assert_eq!(conversion("m", "mm").factor, 1e3);
    assert_eq!(conversion("mm2", "m2").factor, 1e-6);
    assert_eq!(conversion("kN", "N").factor, 1e3);
}

#[test]
fn units_of_two_dimensions_have_no_conversion() {
    for (one, other) in [
        ("m", "s"),
        ("rad", "1"),
        ("rad/s", "Hz"),
        ("N m", "N m/rad"),
        ("%", "m"),
        ("m", "m2"),
    ] {
        assert_eq!(
            unit(one).conversion_to(&unit(other)),
            None,
            "{one} to {other}"
        );
    }
}

#[test]
fn printed_base_units_can_be_parsed() {
    for (text, base) in [
        ("N.m", "kg m2/s2"),
        ("Hz", "1/s"),
        ("rpm", "rad/s"),
        ("%", "1"),
        ("Pa", "kg/(m s2)"),
        ("m/sqrt(s)", "m/sqrt(s)"),
        ("m3/s/sqrt(Pa)", "sqrt(m7)/sqrt(kg)"),
        ("degC", "K"),
    ] {
        assert_eq!(unit(text).base(), base);
    }
    for text in ["W/(m2.K)", "uV/sqrt(Hz)", "mol/L", "m8 s2/N3", "lm/W"] {
        let base = unit(&unit(text).base());
        assert_eq!(base.halves, unit(text).halves, "{text}");
    }
}

#[test]
fn invalid_units_are_refused_with_the_reason() {
    for (text, reason) in [
        ("steps", "`steps` is not a known unit"),
        ("metre", "`metre` is not a known unit; nearest: `m`"),
        (
            "J/kg K",
            "`J/kg K` is ambiguous; write a denominator of two units in parentheses, as in J/(kg K)",
        ),
        ("kmin", "`kmin` is not a known unit"),
    ] {
        let error = Unit::parse(text).expect_err(text).to_string();
        assert!(error.starts_with(reason), "{text}: {error}");
    }
    for text in [
        "m/",
        "(m",
        "m)",
        "m^",
        "m^99",
        "sqrt(sqrt(m))",
        "2 m",
        "m..s",
    ] {
        let error = Unit::parse(text).expect_err(text).to_string();
        let reason =
            format!("`{text}` is not a product of units with exponents, such as kg m2/s2 or N.m");
        assert!(error.starts_with(&reason), "{text}: {error}");
    }
    assert!(Unit::parse(&"(".repeat(60)).is_err());
    assert!(Unit::parse(&"m ".repeat(60)).is_err());
}

#[test]
fn a_conversion_is_a_factor_and_an_offset_of_the_receiver() {
    let conversion = Conversion {
        factor: -2.0,
        offset: 0.5,
    };
    assert_eq!(conversion.apply(3.0), -5.5);
    let nan = f64::from_bits(0x7ff8_0000_0000_0123);
    assert_eq!(Conversion::IDENTITY.apply(nan).to_bits(), nan.to_bits());
    assert_eq!(
        Conversion::IDENTITY.apply(-0.0).to_bits(),
        (-0.0f64).to_bits()
    );
}

proptest::proptest! {
    #[test]
    fn any_text_is_refused_or_a_unit_that_converts_to_itself(text in "[a-zA-Z0-9 .*/^()µ°%-]{0,20}") {
        if let Ok(unit) = Unit::parse(&text) {
            proptest::prop_assert_eq!(unit.conversion_to(&unit), Some(Conversion::IDENTITY));
        }
    }
}

use super::*;

crate::table! {
    /// Signals.
    struct Measured {
        /// Angle.
        angle_rad: "rad" in (-1.0)..=1.0,
        /// Rate.
        rate_radps: "rad/s",
    }
}

#[test]
fn a_row_and_its_struct_are_the_same_numbers() {
    let measured = Measured {
        angle_rad: 0.5,
        rate_radps: -2.0,
    };
    assert_eq!(measured.row(), [0.5, -2.0]);
    assert_eq!(Measured::from_row(&[0.5, -2.0]), measured);
    assert_eq!(Measured::LEN, 2);
    assert_eq!(Empty::LEN, 0);
    assert!(Empty {}.row().is_empty());
}

#[test]
fn fields_carry_name_unit_text_and_range() {
    let fields = Measured::fields();
    assert_eq!(fields[0].name, "angle_rad");
    assert_eq!(fields[0].description, "Angle.");
    assert_eq!((fields[0].min, fields[0].max), (-1.0, 1.0));
    assert!(!fields[0].admits(f64::NAN) && !fields[0].admits(1.5) && fields[0].admits(1.0));
}

#[test]
fn infinity_survives_json() {
    let field = Field::signal("a_m", "m", "x");
    let text = serde_json::to_string(&field).expect("serialises");
    assert_eq!(serde_json::from_str::<Field>(&text).expect("parses"), field);
}

#[test]
fn canonical_numbers_have_one_zero_and_one_nan() {
    assert_eq!(canonical(-0.0).to_bits(), 0);
    assert_eq!(canonical(-f64::NAN).to_bits(), f64::NAN.to_bits());
    assert_eq!(canonical(-1.5), -1.5);
}

#[test]
fn derivatives_are_named_by_order_and_unit() {
    let named = |order| derivative_of("surface_angle_rad", "rad", order);
    assert_eq!(named(1), ("surface_angle_d1_radps".into(), "rad/s".into()));
    assert_eq!(
        named(5),
        ("surface_angle_d5_radps5".into(), "rad/s5".into())
    );
}

#[test]
fn the_nearest_names_come_first() {
    let names = [
        "actuator1_pressure1_pa",
        "surface_angle_rad",
        "surface_rate_radps",
    ];
    assert_eq!(nearest("surface_angel_rad", names)[0], "surface_angle_rad");
    assert!(nearest("zzz", names).is_empty());
    assert!(nearest(&names[1].repeat(100), names).is_empty());
}

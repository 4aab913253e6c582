//! Numbers at their limits and beyond, and back again.

use proptest::prelude::*;

use super::*;

fn scaled(factor: f64, offset: f64, range: Option<(f64, f64)>) -> Scale {
    Scale {
        wire: Conversion { factor, offset },
        range,
        ..Scale::default()
    }
}

#[test]
fn a_value_beyond_the_range_is_packed_as_the_limit() {
    let number = Number::new(Encoding::Signed, 16, scaled(0.01, 0.0, None)).expect("fits");
    for (value, raw, is_beyond) in [
        (1.0, 100, false),
        (-1.0, 0xFF9C, false),
        (327.67, 0x7FFF, false),
        (327.68, 0x7FFF, true),
        (-327.68, 0x8000, false),
        (-1e9, 0x8000, true),
        (f64::INFINITY, 0x7FFF, true),
        (f64::NEG_INFINITY, 0x8000, true),
    ] {
        assert_eq!(number.encode(value), (raw, is_beyond), "{value}");
    }
    assert_eq!(number.decode(0xFF9C), Decoded::Value(-1.0));
    assert_eq!(number.resolution(), Some(0.01));
}

#[test]
fn the_widest_numbers_saturate_without_wrapping() {
    let unsigned = Number::new(Encoding::Unsigned, 64, Scale::default()).expect("fits");
    assert_eq!(unsigned.encode(TWO_64), (u64::MAX, true));
    assert_eq!(unsigned.encode(-1.0), (0, true));
    assert_eq!(unsigned.encode(-0.2), (0, false));
    let signed = Number::new(Encoding::Signed, 64, Scale::default()).expect("fits");
    assert_eq!(signed.encode(TWO_63), (i64::MAX as u64, true));
    assert_eq!(signed.encode(-TWO_63), (i64::MIN as u64, false));
    let float = Number::new(Encoding::Float, 32, Scale::default()).expect("fits");
    assert_eq!(float.encode(1e300), (u64::from(f32::MAX.to_bits()), true));
}

#[test]
fn numbers_on_the_wire_that_are_no_value_are_refused() {
    let range = Some((0.0, 90.0));
    let number = Number::new(Encoding::Unsigned, 8, scaled(1.0, 0.0, range)).expect("fits");
    assert_eq!(number.decode(90), Decoded::Value(90.0));
    assert_eq!(number.decode(91), Decoded::OutOfRange(91.0));
    let float = Number::new(Encoding::Float, 64, Scale::default()).expect("fits");
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(float.decode(value.to_bits()), Decoded::NotFinite);
    }
    // A product beyond every number is no value either.
    let large = Number::new(Encoding::Float, 64, scaled(10.0, 0.0, None)).expect("fits");
    assert_eq!(large.decode(f64::MAX.to_bits()), Decoded::NotFinite);
    let scale = Scale {
        invalid: Some(0xFF),
        ..Scale::default()
    };
    let number = Number::new(Encoding::Unsigned, 8, scale).expect("fits");
    assert_eq!(number.decode(0xFF), Decoded::Invalid);
    assert_eq!(number.encode(255.0), (254, true));
}

#[test]
fn scales_that_do_not_fit_are_refused() {
    let new = |encoding, width, scale| Number::new(encoding, width, scale).err();
    let possible = (-1.28, 1.27);
    for (encoding, width, scale, expected) in [
        (Encoding::Signed, 8, scaled(0.0, 0.0, None), Unfit::Factor),
        (Encoding::Float, 16, Scale::default(), Unfit::FloatWidth(16)),
        (
            Encoding::Signed,
            8,
            scaled(0.01, 0.0, Some((-1.28, 1.28))),
            Unfit::Range { possible },
        ),
        (
            Encoding::Unsigned,
            8,
            Scale {
                invalid: Some(0),
                range: Some((0.0, 4.0)),
                ..Scale::default()
            },
            Unfit::Range {
                possible: (1.0, 255.0),
            },
        ),
        (
            Encoding::Unsigned,
            8,
            Scale {
                invalid: Some(7),
                ..Scale::default()
            },
            Unfit::InvalidInside,
        ),
        (
            Encoding::Unsigned,
            8,
            Scale {
                invalid: Some(256),
                ..Scale::default()
            },
            Unfit::InvalidForm,
        ),
    ] {
        assert_eq!(new(encoding, width, scale), Some(expected), "{scale:?}");
    }
}

#[test]
fn a_float_without_scale_keeps_every_bit() {
    let number = Number::new(Encoding::Float, 64, Scale::default()).expect("fits");
    for value in [-0.0, f64::MIN_POSITIVE / 3.0, f64::MAX, 0.1] {
        let (raw, is_beyond) = number.encode(value);
        assert!(!is_beyond);
        assert_eq!(raw, value.to_bits());
        let Decoded::Value(decoded) = number.decode(raw) else {
            panic!("{value}");
        };
        assert_eq!(decoded.to_bits(), value.to_bits());
    }
}

proptest! {
    #[test]
    fn a_value_inside_the_range_returns_within_half_a_resolution(
        width in 2_u32..=32, is_signed: bool, factor in 1e-3..1e3_f64, is_negative: bool,
        offset in -1e3..1e3_f64, place in 0.0..1.0_f64,
    ) {
        let encoding = if is_signed { Encoding::Signed } else { Encoding::Unsigned };
        let factor = if is_negative { -factor } else { factor };
        let number = Number::new(encoding, width, scaled(factor, offset, None)).expect("fits");
        let (low, high) = number.range();
        let value = low + place * (high - low);
        let (raw, _) = number.encode(value);
        prop_assert!(raw <= mask(width));
        let Decoded::Value(decoded) = number.decode(raw) else { panic!("{raw}") };
        let largest = low.abs() + high.abs();
        let half = factor.abs() * 0.500_001 + largest * 1e-15;
        prop_assert!((decoded - value).abs() <= half, "{decoded} {value}");
    }

    #[test]
    fn any_bits_decode_to_a_finite_value_or_a_reason(
        width in 1_u32..=64, raw: u64, factor: f64, offset: f64, value: f64,
    ) {
        for encoding in [Encoding::Unsigned, Encoding::Signed, Encoding::Float] {
            let Ok(number) = Number::new(encoding, width, scaled(factor, offset, None)) else {
                continue;
            };
            if let Decoded::Value(decoded) = number.decode(raw & mask(width)) {
                prop_assert!(decoded.is_finite());
            }
            if !value.is_nan() {
                let (raw, _) = number.encode(value);
                prop_assert!(raw <= mask(width));
            }
        }
    }
}

//! Frames as a whole: what is packed, what is refused, and what arrives.

mod json;

use proptest::prelude::*;
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::quality::SignalSet;
use shared_types::table::Field as Column;
use shared_types::units::Conversion;

use crate::bits::{BitField, ByteOrder};
use crate::checksum::Algorithm;
use crate::frame::{Body, CanId, Content, Counter, Field, Frame, Mistake, Signal};
use crate::number::{Encoding, Number, Scale};
use crate::pack::{Packer, Unusable};
use crate::receive::Receiver;
use crate::row::{FieldResult, Refusal, Row};

const VALID: SignalSet = SignalSet::EMPTY;

fn table() -> SignalTable {
    let fields = ["angle_rad", "rate_radps", "count"];
    let fields = fields.map(|name| Column::signal(name, "1", "A signal."));
    SignalTable::of(SignalKind::Measured, &fields)
}

fn signal(name: &str) -> Signal {
    Signal {
        kind: SignalKind::Measured,
        name: name.into(),
        unit: "1".into(),
    }
}

fn number(encoding: Encoding, width: u32, factor: f64) -> Number {
    let wire = Conversion {
        factor,
        offset: 0.0,
    };
    let scale = Scale {
        wire,
        ..Scale::default()
    };
    Number::new(encoding, width, scale).expect("fits")
}

fn field(name: &str, start: usize, width: u32, order: ByteOrder, content: Content) -> Field {
    Field {
        name: name.into(),
        bits: BitField::new(start, width, order).expect("a field"),
        content,
    }
}

/// Every content of a field in both byte orders, 16 bytes.
fn frame() -> Frame {
    let (little, big) = (ByteOrder::Little, ByteOrder::Big);
    let scale = Scale {
        invalid: Some(0x7FF),
        range: Some((0.0, 2000.0)),
        ..Scale::default()
    };
    let count = Number::new(Encoding::Unsigned, 11, scale).expect("fits");
    let crc = Algorithm::named("crc-16/ibm-3740").expect("a name");
    let sum = Content::Checksum {
        algorithm: crc,
        first: 0,
        end: 16,
    };
    let counter = Content::Counter(Counter {
        width: 4,
        max_jump: 2,
    });
    let of_signal = |name, number| Content::Signal(signal(name), number);
    let fields = vec![
        field("sync", 0, 16, little, Content::Constant(0x55AA)),
        field(
            "angle",
            23,
            16,
            big,
            of_signal("angle_rad", number(Encoding::Signed, 16, 0.01)),
        ),
        field(
            "rate",
            32,
            64,
            little,
            of_signal("rate_radps", number(Encoding::Float, 64, 1.0)),
        ),
        field("count", 96, 11, little, of_signal("count", count)),
        field("alive", 107, 4, little, counter),
        field(
            "angle is valid",
            111,
            1,
            little,
            Content::Valid(signal("angle_rad")),
        ),
        field("crc", 119, 16, big, sum),
    ];
    Frame {
        name: "imu".into(),
        id: None,
        body: Body::Bytes { length: 16, fields },
    }
}

fn both(frame: &Frame) -> (Packer, Receiver) {
    let packer = Packer::new(frame, &table()).expect("sound");
    let receiver = Receiver::new(std::slice::from_ref(frame), &table()).expect("sound");
    (packer, receiver)
}

#[test]
fn a_frame_has_the_bytes_of_its_description() {
    let (mut packer, _) = both(&frame());
    let bytes = packer.pack(&[-1.0, 0.5, 1234.0], &VALID);
    let mut expected = vec![0xAA, 0x55, 0xFF, 0x9C];
    expected.extend(0.5_f64.to_le_bytes());
    // 1234 = 0x4D2 in the lowest 11 bits, the counter 0, then the validity bit.
    expected.extend([0xD2, 0x84]);
    assert_eq!(bytes[..14], expected);
    let sum = Algorithm::named("crc-16/ibm-3740")
        .expect("a name")
        .compute(&expected, b"");
    assert_eq!(bytes[14..], (sum as u16).to_be_bytes());
    // The next frame differs in its counter.
    let next = packer.pack(&[-1.0, 0.5, 1234.0], &VALID);
    assert_eq!(next[13], 0x84 | 1 << 3);
}

#[test]
fn values_arrive_with_their_validity_and_age() {
    let (mut packer, mut receiver) = both(&frame());
    let mut row = Row::new(3);
    let (index, result) =
        receiver.receive(None, packer.pack(&[1.234, -2.5, 7.0], &VALID), &mut row);
    assert_eq!((index, result), (Some(0), Ok(())));
    assert_eq!(row.values(), [1.23, -2.5, 7.0]);
    assert_eq!(row.ages(), [0; 3]);
    assert!((0..3).all(|column| row.is_valid(column)));
    row.advance();
    // Signals 0 and 2 have no value at the sender: one has a bit for it, the other a number.
    let mut invalid = VALID;
    invalid.insert(0);
    invalid.insert(2);
    let bytes = packer.pack(&[9.0, 3.0, f64::NAN], &invalid);
    receiver.receive(None, bytes, &mut row).1.expect("accepted");
    assert_eq!(packer.results()[0], FieldResult::NotAvailable);
    assert_eq!(
        row.results(),
        [
            FieldResult::NotAvailable,
            FieldResult::Value,
            FieldResult::NotAvailable
        ]
    );
    assert_eq!(row.values(), [1.23, 3.0, 7.0]);
    assert!(row.invalid().iter(3).eq([0, 2]));
    assert_eq!(row.ages(), [0, 0, 1]);
}

#[test]
fn values_beyond_the_range_are_packed_as_the_limit_and_counted() {
    let (mut packer, mut receiver) = both(&frame());
    let mut row = Row::new(3);
    for _ in 0..3 {
        packer.pack(&[400.0, f64::INFINITY, -1.0], &VALID);
    }
    assert_eq!(packer.results(), [FieldResult::Saturated; 3]);
    assert_eq!(packer.saturated(), [3; 3]);
    let bytes = packer.pack(&[-400.0, 1.0, 1e9], &VALID);
    receiver.receive(None, bytes, &mut row).1.expect("accepted");
    assert_eq!(row.values(), [-327.68, 1.0, 2000.0]);
}

#[test]
fn every_reason_to_refuse_a_frame_is_named() {
    let sound = frame();
    let (mut packer, mut receiver) = both(&sound);
    let mut row = Row::new(3);
    let bytes = packer.pack(&[1.0, 2.0, 3.0], &VALID).to_vec();
    receiver
        .receive(None, &bytes, &mut row)
        .1
        .expect("accepted");
    let mut refused = |bytes: &[u8]| {
        let refusal = receiver
            .receive(None, bytes, &mut row)
            .1
            .expect_err("refused");
        assert_eq!(row.values(), [1.0, 2.0, 3.0]);
        (refusal.describe(&sound), row.is_valid(0))
    };
    assert_eq!(
        refused(&bytes),
        ("frame `imu` repeats the counter `alive`, 0".into(), true)
    );
    assert_eq!(
        refused(&bytes[..15]),
        ("frame `imu` has 15 bytes and needs 16".into(), false)
    );
    assert_eq!(
        refused(&[&bytes[..], &[0]].concat()).0,
        "frame `imu` has 17 bytes, more than its 16"
    );
    let swapped: Vec<u8> = bytes
        .chunks(2)
        .flat_map(|pair| [pair[1], pair[0]])
        .collect();
    assert_eq!(
        refused(&swapped).0,
        "the constant `sync` of frame `imu` is 0xaa55 and not 0x55aa, in the other byte order"
    );
    let mut damaged = bytes.clone();
    damaged[5] ^= 1;
    let text = refused(&damaged).0;
    assert!(
        text.starts_with("the checksum `crc` of frame `imu` is 0x"),
        "{text}"
    );
    for _ in 0..4 {
        packer.pack(&[1.0, 2.0, 3.0], &VALID);
    }
    assert_eq!(
        refused(packer.pack(&[1.0, 2.0, 3.0], &VALID)).0,
        "the counter `alive` of frame `imu` jumps to 5 instead of 1"
    );
    // After a jump the count goes on from there; one lost frame is accepted.
    packer.pack(&[1.0, 2.0, 3.0], &VALID);
    let bytes = packer.pack(&[1.5, 2.0, 3.0], &VALID);
    receiver.receive(None, bytes, &mut row).1.expect("accepted");
    assert_eq!(row.values()[0], 1.5);
    let counts = receiver.counts(0);
    assert_eq!(
        (
            counts.accepted,
            counts.repeated,
            counts.refused,
            counts.lost
        ),
        (2, 1, 5, 1)
    );
}

#[test]
fn nan_on_the_wire_makes_its_signal_alone_invalid() {
    let sound = Frame {
        body: match frame().body {
            Body::Bytes { length, mut fields } => {
                fields.truncate(4);
                Body::Bytes { length, fields }
            }
            Body::Json(_) => unreachable!(),
        },
        ..frame()
    };
    let (mut packer, mut receiver) = both(&sound);
    let mut row = Row::new(3);
    let mut bytes = packer.pack(&[1.0, 2.0, 3.0], &VALID).to_vec();
    receiver
        .receive(None, &bytes, &mut row)
        .1
        .expect("accepted");
    bytes[4..12].copy_from_slice(&f64::NAN.to_le_bytes());
    // 2001 is beyond the range of the count.
    bytes[12..14].copy_from_slice(&2001_u16.to_le_bytes());
    receiver
        .receive(None, &bytes, &mut row)
        .1
        .expect("accepted");
    let texts = row.results().iter().map(|result| match result {
        FieldResult::Refused(refusal) => refusal.describe(&sound),
        result => format!("{result:?}"),
    });
    assert_eq!(
        texts.collect::<Vec<_>>(),
        [
            "Value",
            "field `rate` of frame `imu` is NaN or infinite",
            "field `count` of frame `imu` is 2001.0, out of range 0.0 to 2000.0"
        ]
    );
    assert_eq!(row.values(), [1.0, 2.0, 3.0]);
    assert_eq!(receiver.counts(0).refused_fields, 2);
}

#[test]
fn an_identifier_or_the_constants_choose_the_frame() {
    let with_id = |id| Frame {
        id: Some(id),
        ..frame()
    };
    let frames = [with_id(CanId::Standard(1)), with_id(CanId::Extended(1))];
    let mut receiver = Receiver::new(&frames, &table()).expect("sound");
    let mut packer = Packer::new(&frames[0], &table()).expect("sound");
    let bytes = packer.pack(&[1.0; 3], &VALID).to_vec();
    let mut row = Row::new(3);
    let mut receive = |id| receiver.receive(Some(id), &bytes, &mut row);
    assert_eq!(receive(CanId::Extended(1)), (Some(1), Ok(())));
    let foreign = CanId::Standard(2);
    assert_eq!(receive(foreign), (None, Err(Refusal::ForeignId(foreign))));
    assert_eq!(receiver.foreign(), 1);

    let other = |constant| {
        let sync = field("sync", 0, 8, ByteOrder::Little, Content::Constant(constant));
        let count = number(Encoding::Unsigned, 8, 1.0);
        let count = Content::Signal(signal("count"), count);
        let count = field("count", 8, 8, ByteOrder::Little, count);
        let fields = vec![sync, count];
        Frame {
            body: Body::Bytes { length: 2, fields },
            ..frame()
        }
    };
    let mut receiver = Receiver::new(&[other(1), other(2)], &table()).expect("sound");
    let mut row = Row::new(3);
    assert_eq!(receiver.receive(None, &[2, 9], &mut row), (Some(1), Ok(())));
    assert_eq!(row.values()[2], 9.0);
    assert_eq!(row.results()[..2], [FieldResult::Missing; 2]);
    let refusal = Refusal::Foreign { bytes: 2 };
    assert_eq!(
        receiver.receive(None, &[3, 9], &mut row),
        (None, Err(refusal))
    );
}

#[test]
fn mistakes_of_a_frame_are_found_and_it_cannot_be_used() {
    let (little, constant) = (ByteOrder::Little, Content::Constant);
    let count = || Content::Signal(signal("count"), number(Encoding::Unsigned, 8, 1.0));
    let alive = |width| Content::Counter(Counter { width, max_jump: 1 });
    let sum = || Content::Checksum {
        algorithm: Algorithm::named("crc-8/smbus").expect("a name"),
        first: 0,
        end: 4,
    };
    let field = |start, width, content| field("f", start, width, little, content);
    for (fields, expected) in [
        (vec![], Mistake::Length),
        (
            vec![field(28, 8, constant(1))],
            Mistake::Outside { field: 0 },
        ),
        (
            vec![field(0, 8, constant(1)), field(7, 2, constant(1))],
            Mistake::Overlap { field: 1, with: 0 },
        ),
        (
            vec![field(0, 8, count()), field(8, 8, count())],
            Mistake::Twice { field: 1, with: 0 },
        ),
        (vec![field(0, 9, count())], Mistake::Width { field: 0 }),
        (
            vec![field(0, 1, Content::Valid(signal("count")))],
            Mistake::NoValue { field: 0 },
        ),
        (vec![field(0, 4, constant(16))], Mistake::Width { field: 0 }),
        (vec![field(0, 4, alive(5))], Mistake::Width { field: 0 }),
        (vec![field(0, 16, sum())], Mistake::Checksum { field: 0 }),
        (vec![field(4, 8, sum())], Mistake::Checksum { field: 0 }),
        (
            vec![field(0, 8, sum()), field(8, 8, sum())],
            Mistake::Checksum { field: 1 },
        ),
    ] {
        let frame = Frame {
            body: Body::Bytes { length: 4, fields },
            ..frame()
        };
        assert_eq!(frame.mistakes(), [expected], "{frame:?}");
        let unusable = Unusable::Mistaken("imu".into());
        assert_eq!(Packer::new(&frame, &table()).err(), Some(unusable));
    }
    let other = SignalTable::of(
        SignalKind::Measured,
        &[Column::signal("angle_rad", "m", "x")],
    );
    let error = Receiver::new(&[frame()], &other).expect_err("another unit");
    assert_eq!(
        error.to_string(),
        "frame `imu`: signal `angle_rad` is needed in `1`, but sent in `m`"
    );
}

fn values() -> impl Strategy<Value = [f64; 3]> {
    (-327.0..327.0_f64, -1e300..1e300_f64, 0.0..2000.0_f64).prop_map(|(a, b, c)| [a, b, c])
}

proptest! {
    #[test]
    fn values_return_within_half_a_resolution(rows in prop::collection::vec(values(), 1..20)) {
        let (mut packer, mut receiver) = both(&frame());
        let mut row = Row::new(3);
        for values in rows {
            let bytes = packer.pack(&values, &VALID);
            prop_assert_eq!(receiver.receive(None, bytes, &mut row), (Some(0), Ok(())));
            prop_assert!((row.values()[0] - values[0]).abs() <= 0.005_000_001);
            prop_assert_eq!(row.values()[1].to_bits(), values[1].to_bits());
            prop_assert_eq!(row.values()[2], values[2].round_ties_even());
        }
    }

    #[test]
    fn a_frame_with_a_changed_bit_is_refused(values in values(), bit in 0_usize..128) {
        let (mut packer, mut receiver) = both(&frame());
        let mut bytes = packer.pack(&values, &VALID).to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let mut row = Row::new(3);
        prop_assert!(receiver.receive(None, &bytes, &mut row).1.is_err());
        prop_assert!((0..3).all(|column| !row.is_valid(column)));
        prop_assert_eq!(row.values(), [0.0; 3]);
    }

    #[test]
    fn any_bytes_leave_a_finite_row(frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..20), 0..20)) {
        let line = json::line(&[("a", json::value("count")), ("b[0]", json::value("angle_rad"))]);
        for frame in [frame(), line] {
            let (_, mut receiver) = both(&frame);
            let mut row = Row::new(3);
            for bytes in &frames {
                if let Err(refusal) = receiver.receive(None, bytes, &mut row).1 {
                    prop_assert!(!refusal.describe(&frame).is_empty());
                }
                row.advance();
                prop_assert!(row.values().iter().all(|value| value.is_finite()));
            }
        }
    }
}

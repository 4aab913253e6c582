//! DBC files: what is read, and what is refused.

use super::*;

const FILE: &str = r#"VERSION "1"
NS_ :
	CM_
	BA_
BS_:
BU_: Rig Law
BO_ 256 IMU: 8 Rig
 SG_ Angle : 7|16@0- (0.01,0) [-180|180] "deg" Law
 SG_ Rate : 16|12@1+ (0.5,-100) [0|0] "" Law,Rig

BO_ 2147484161 Force: 8 Law
 SG_ Force : 0|32@1- (1,0) [0|0] "N" Rig
BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
 SG_ Nowhere : 0|8@1+ (1,0) [0|0] "" Vector__XXX
CM_ SG_ 256 Angle "Two lines:
 SG_ Angle : 9|9@0- (0,0) [0|0] N";
SIG_VALTYPE_ 2147484161 Force : 1;
"#;

#[test]
fn messages_and_signals_are_read_and_comments_are_not() {
    let dbc = Dbc::read(FILE).expect("a sound file");
    let [imu, force] = dbc.messages.as_slice() else {
        panic!("{dbc:?}");
    };
    assert_eq!((imu.id, imu.length), (CanId::Standard(256), 8));
    assert_eq!(force.id, CanId::Extended(513));
    let [angle, rate] = imu.signals.as_slice() else {
        panic!("{imu:?}");
    };
    let big = BitField::new(7, 16, ByteOrder::Big).expect("a field");
    assert_eq!((angle.bits, angle.encoding), (big, Encoding::Signed));
    assert_eq!(angle.range, Some((-180.0, 180.0)));
    assert_eq!((angle.unit.as_str(), rate.unit.as_str()), ("deg", ""));
    let wire = Conversion {
        factor: 0.5,
        offset: -100.0,
    };
    assert_eq!((rate.wire, rate.range), (wire, None));
    assert_eq!(force.signals[0].encoding, Encoding::Float);
    assert_eq!(&FILE[rate.place.clone()].trim()[..8], "SG_ Rate");
}

#[test]
fn a_file_that_contradicts_itself_is_refused_with_every_line() {
    let lines = [
        ("BO_ 1 A: 2 N", None),
        (" SG_ a : 0|8@1+ (1,0) [0|0] \"\" N", None),
        (
            " SG_ b : 4|8@1+ (1,0) [0|0] \"\" N",
            Some("signal `b` of message `A` shares bits with `a`"),
        ),
        (
            " SG_ a : 12|8@1+ (1,0) [5|1] \"\" N",
            Some("signal `a` of message `A` reaches byte 2, and the message has 2 bytes"),
        ),
        (
            "BO_ 1 B: 8 N",
            Some("messages `A` and `B` have the same id 0x1"),
        ),
        ("BO_ 2 A: 8 N", Some("two messages have the name `A`")),
        (
            "BO_ 2048 C: 8 N",
            Some(
                "the id 2048 is out of range: an id has 11 bits, or 29 bits plus 2147483648 (bit 31), which marks it as extended",
            ),
        ),
        (
            "BO_ 3 D: 65 N",
            Some("message `D` needs a length of 0 to 64 bytes"),
        ),
        ("BO_ 4 E: 8 N", None),
        (
            " SG_ f : 0|8@1+ (0,0) [0|0] \"\" N",
            Some("signal `f` needs a factor other than 0 and finite numbers"),
        ),
        (
            " SG_ g : 0|65@1+ (1,0) [0|0] \"\" N",
            Some("signal `g` needs 1 to 64 bits inside of its message"),
        ),
        (
            " SG_ h : 0-8@1+",
            Some(
                "SG_ needs NAME : START|WIDTH@ORDER and SIGN, (FACTOR,OFFSET), [MIN|MAX] and \"UNIT\"",
            ),
        ),
        (" SG_ i : 0|16@1+ (1,0) [0|0] \"\" N", None),
        (
            "SIG_VALTYPE_ 4 i : 1;",
            Some("`i` is a float of 32 bits, and its field has 16"),
        ),
        (
            "SIG_VALTYPE_ 4 j : 1;",
            Some("message `E` has no signal `j`"),
        ),
    ];
    let text: String = lines.iter().map(|(line, _)| format!("{line}\n")).collect();
    let mistakes = Dbc::read(&text).expect_err("contradictions");
    for (line, expected) in lines {
        let Some(expected) = expected else { continue };
        let is_there = |mistake: &DbcMistake| {
            mistake.message == expected && &text[mistake.place.clone()] == line
        };
        assert!(mistakes.iter().any(is_there), "{expected}: {mistakes:#?}");
    }
    // Of the signal that is also described twice and has a range upside down.
    assert_eq!(mistakes.len(), 13, "{mistakes:#?}");
}

#[test]
fn multiplexed_signals_may_share_bits_with_each_other_only() {
    let text = "BO_ 1 A: 2 N\n SG_ s M : 0|8@1+ (1,0) [0|0] \"\" N\n SG_ a m0 : 8|8@1+ (1,0) [0|0] \"\" N\n SG_ b m1 : 8|8@1+ (1,0) [0|0] \"\" N\n";
    let dbc = Dbc::read(text).expect("a sound file");
    let multiplexed = dbc.messages[0]
        .signals
        .iter()
        .map(|signal| signal.is_multiplexed);
    assert_eq!(multiplexed.collect::<Vec<_>>(), [false, true, true]);
    assert!(Dbc::read(&text.replace("b m1 : 8", "b m1 : 7")).is_err());
}

//! Port files: what they describe, and every mistake at its place.

mod apart;
mod dbc;

use std::path::Path;

use hil_codec::frame::{Body, Content};
use hil_config::port::{Carries, Medium, MediumKind, Period, Port, PortTables, is_port};
use hil_config::problem::{Problem, ProblemKind};
use shared_types::table::Field;

/// Valid port file that uses every part of the format.
const BASE: &str = r#"port = 1
name = "rig"
description = "every part of the format"

[[media]]
kind = "udp"
to = "127.0.0.1:9003"
listen = "127.0.0.1:9002"

[[media]]
name = "line"
kind = "serial"
device = "/dev/ttyUSB0"
parity = "even"

[[frames]]
name = "state"
carries = "sample"
medium = "udp"
order = "big"
divider = 2
fields = [
    { kind = "constant", name = "sync", type = "u16", value = 0x55AA, order = "little" },
    { kind = "counter", type = "u8", counter_bits = 4, max_jump = 3 },
    { signal = "measured.surface_angle_rad", type = "i16", unit = "deg", scale = 0.01, range = [-90, 90] },
    { signal = "measured.pressure_pa", type = "u12", unit = "bar", scale = 0.1, invalid = 4095 },
    { kind = "valid", name = "pressure is valid", signal = "measured.pressure_pa", type = "u1" },
    { signal = "reference.surface_angle_rad", type = "f32", byte = 9 },
    { kind = "checksum", algorithm = "crc-16/ibm-3740", type = "u16" },
]

[[frames]]
name = "answer"
carries = "command"
medium = "line"
format = "json"
period_s = 0.01
stale_s = 0.05
fields = [
    { kind = "constant", path = "type", text = "answer" },
    { kind = "counter", path = "n" },
    { signal = "command.voltage", signal_unit = "V", unit = "mV", path = "out[0]" },
]
"#;

fn port(text: &str) -> Port {
    Port::parse(text, Path::new("rig.port.toml"), None)
        .unwrap_or_else(|problems| panic!("{problems}"))
}

fn problems(text: &str) -> Vec<Problem> {
    let port = Port::parse(text, Path::new("rig.port.toml"), None);
    port.expect_err("mistakes").0
}

#[test]
fn a_port_file_becomes_media_frames_and_tables() {
    let port = port(BASE);
    assert_eq!(port.name, "rig");
    let to = "127.0.0.1:9003".parse().ok();
    let listen = "127.0.0.1:9002".parse().ok();
    let udp = Medium {
        name: "udp".into(),
        kind: MediumKind::Udp { to, listen },
    };
    assert_eq!(port.media[0], udp);
    let [state, answer] = port.frames.as_slice() else {
        panic!("{port:?}");
    };
    assert_eq!(
        (state.carries, state.medium, state.period),
        (Carries::Sample, Some(0), Period::Steps(2))
    );
    assert_eq!(
        (answer.period, answer.stale_s),
        (Period::Seconds(0.01), Some(0.05))
    );
    let Body::Bytes { length, fields } = &state.frame.body else {
        panic!("{state:?}");
    };
    assert_eq!(*length, 15);
    let places: Vec<(usize, u32)> = (fields.iter())
        .map(|field| (field.bits.start(), field.bits.width()))
        .collect();
    // Big-endian fields begin with bit 7 of their byte.
    assert_eq!(
        places,
        [
            (0, 16),
            (23, 8),
            (31, 16),
            (47, 12),
            (51, 1),
            (79, 32),
            (111, 16)
        ]
    );
    let Content::Checksum { first, end, .. } = fields[6].content else {
        panic!("{fields:?}");
    };
    assert_eq!((first, end), (0, 15));
    let names = |carries| {
        let table = port.table(carries);
        let name = |signal: &shared_types::layout::Signal| {
            format!(
                "{}.{} {}",
                signal.kind.prefix(),
                signal.field.name,
                signal.field.unit
            )
        };
        table.0.iter().map(name).collect::<Vec<_>>()
    };
    assert_eq!(
        names(Carries::Sample),
        [
            "measured.surface_angle_rad rad",
            "measured.pressure_pa Pa",
            "reference.surface_angle_rad rad"
        ]
    );
    assert_eq!(names(Carries::Command), ["command.voltage V"]);
    let (_, angle) = state.frame.signals().next().expect("a signal");
    let right = std::f64::consts::FRAC_PI_2;
    assert!((angle.range().1 - right).abs() < 1e-15);
    // 0.01 degrees.
    let resolution = angle.resolution().expect("a whole number");
    assert!((resolution - right / 9000.0).abs() < 1e-18);
}

#[test]
fn a_port_file_is_recognised_by_its_first_key() {
    assert!(is_port(BASE));
    assert!(is_port("\n# A comment.\nport=1\n"));
    for text in [
        "",
        "schema = 1\nport = 1\n",
        "portal = 1\n",
        "[port]\n",
        "PK\x03\x04",
    ] {
        assert!(!is_port(text), "{text}");
    }
    let later = BASE.replacen("port = 1\nname = \"rig\"", "name = \"rig\"\nport = 1", 1);
    let problem = &problems(&later)[0];
    assert_eq!(problem.message, "`name` comes before `port`");
}

/// Changes the base file and returns the only problem.
fn problem(from: &str, to: &str) -> Problem {
    assert!(BASE.contains(from), "{from}");
    let mut problems = problems(&BASE.replacen(from, to, 1));
    assert_eq!(problems.len(), 1, "{problems:#?}");
    problems.remove(0)
}

#[test]
fn a_wrong_byte_order_of_a_frame_hides_no_mistake_of_its_fields() {
    let text = BASE.replace("order = \"big\"", "order = \"middle\"");
    let problems = problems(&text.replace("type = \"u12\"", "type = \"u65\""));
    let messages = problems.iter().map(|problem| problem.message.as_str());
    let expected = [
        "`frames[0].order` is `middle`, which does not exist",
        "`frames[0].fields[3].type` is `u65`",
    ];
    assert_eq!(messages.collect::<Vec<_>>(), expected);
}

#[test]
fn each_mistake_is_reported_at_its_place_with_the_expected_value() {
    use ProblemKind::{Duplicate, Mismatch, MissingKey, OutOfRange, UnknownKey, UnknownName};
    for (from, to, kind, key, message, expected) in [
        (
            "port = 1",
            "port = 2",
            OutOfRange,
            "port",
            "`port` is 2, out of range",
            "1",
        ),
        (
            "divider",
            "devider",
            UnknownKey,
            "frames[0].devider",
            "unknown key `devider` in `frames[0]`",
            "one of `name`",
        ),
        (
            "medium = \"udp\"",
            "medium = \"upd\"",
            UnknownName,
            "frames[0].medium",
            "no medium has the name `upd`",
            "one of `udp`, `line`",
        ),
        (
            "medium = \"udp\"\n",
            "",
            MissingKey,
            "frames[0].medium",
            "`frames[0].medium` is missing",
            "one of `udp`, `line`",
        ),
        (
            "to = \"127.0.0.1:9003\"",
            "to = \"localhost\"",
            OutOfRange,
            "media[0].to",
            "`media[0].to` is `localhost`",
            "an address and a port, as 127.0.0.1:9002 or [::1]:9002",
        ),
        (
            "type = \"u12\"",
            "type = \"u65\"",
            OutOfRange,
            "frames[0].fields[3].type",
            "`frames[0].fields[3].type` is `u65`",
            "u1 to u64, i2 to i64, f32 or f64",
        ),
        (
            "byte = 9",
            "byte = 6",
            Mismatch,
            "frames[0].fields[5].byte",
            "field `surface_angle_rad` shares bits with field `pressure_pa` in byte 6",
            "bits outside of bytes 5 to 6; behind it the next is byte 6, bit 3",
        ),
        (
            "divider = 2",
            "length = 14",
            Mismatch,
            "frames[0].fields[6].byte",
            "field `checksum` ends in byte 14, and the frame has 14 bytes",
            "bytes 0 to 13",
        ),
        (
            "counter_bits = 4",
            "counter_bits = 9",
            Mismatch,
            "frames[0].fields[1].counter_bits",
            "the content of field `counter` does not fit its width",
            "a number of at most 8 bits",
        ),
        (
            "value = 0x55AA",
            "value = 0x15555",
            Mismatch,
            "frames[0].fields[0].value",
            "the content of field `sync` does not fit its width",
            "a number of at most 16 bits",
        ),
        (
            "range = [-90, 90]",
            "range = [-90, 900]",
            OutOfRange,
            "frames[0].fields[2].range",
            "the encoding of `measured.surface_angle_rad` is invalid: the range exceeds what the bits can express",
            "a range inside of [-327.68, 327.67] in deg",
        ),
        (
            "scale = 0.01",
            "scale = 0",
            OutOfRange,
            "frames[0].fields[2].scale",
            "the encoding of `measured.surface_angle_rad` is invalid: a factor other than 0 and a finite offset are needed",
            "a scale other than 0",
        ),
        (
            "invalid = 4095",
            "invalid = 7",
            OutOfRange,
            "frames[0].fields[3].invalid",
            "the encoding of `measured.pressure_pa` is invalid: the raw number that stands for no value lies inside the range",
            "a number outside of `range`, or the least or greatest number of the type",
        ),
        (
            "unit = \"deg\"",
            "unit = \"degs\"",
            UnknownName,
            "frames[0].fields[2].unit",
            "`degs` is not a known unit",
            "",
        ),
        (
            "unit = \"deg\"",
            "unit = \"N\"",
            Mismatch,
            "frames[0].fields[2].unit",
            "`measured.surface_angle_rad` is in rad, but its field is in N",
            "a unit of the dimension rad",
        ),
        (
            "crc-16/ibm-3740",
            "crc-8/smbus",
            Mismatch,
            "frames[0].fields[6].algorithm",
            "checksum `checksum` does not fit its field",
            "whole bytes as wide",
        ),
        (
            "crc-16/ibm-3740",
            "crc-16/ibm-3704",
            UnknownName,
            "frames[0].fields[6].algorithm",
            "`frames[0].fields[6].algorithm` is `crc-16/ibm-3704`, which does not exist",
            "one of `sum-8`",
        ),
        (
            "reference.surface_angle_rad",
            "command.surface_angle_rad",
            UnknownName,
            "frames[0].fields[5].signal",
            "a frame that carries a sample has no signal `command.surface_angle_rad`",
            "measured.NAME or reference.NAME",
        ),
        (
            "signal = \"reference.surface",
            "signal = \"measured.surface",
            Mismatch,
            "frames[0].fields[5].signal",
            "field `surface_angle_rad` has the same content as field `surface_angle_rad`",
            "each content at most once in a frame",
        ),
        (
            "path = \"n\"",
            "path = \"out[2]\"",
            Mismatch,
            "frames[1].fields[1].path",
            "the path `out[2]` contradicts another path of the frame",
            "a path of its own",
        ),
        (
            "path = \"n\"",
            "path = \"n..\"",
            OutOfRange,
            "frames[1].fields[1].path",
            "`frames[1].fields[1].path` is `n..`",
            "keys with dots",
        ),
        (
            "path = \"n\"",
            "path = \"n\", type = \"u8\"",
            Mismatch,
            "frames[1].fields[1].type",
            "`frames[1].fields[1].type` has no effect in a line of JSON",
            "",
        ),
        (
            "name = \"answer\"",
            "name = \"state\"",
            Duplicate,
            "frames[1].name",
            "two frames have the name `state`",
            "",
        ),
        (
            "type = \"f32\", byte = 9",
            "type = \"f32\"",
            MissingKey,
            "frames[0].fields[5].byte",
            "`frames[0].fields[5].byte` is missing",
            "a byte: the field before ends inside of one",
        ),
        (
            "divider = 2",
            "id = 2",
            Mismatch,
            "frames[0].id",
            "frame `state` has an identifier, and its medium is not CAN",
            "",
        ),
    ] {
        let problem = problem(from, to);
        assert_eq!(
            (problem.kind, problem.key.as_str()),
            (kind, key),
            "{problem}"
        );
        assert!(problem.message.starts_with(message), "{problem}");
        let text = problem.expected.clone().unwrap_or_default();
        assert!(text.starts_with(expected), "{problem}");
        assert!(problem.excerpt.is_some(), "{problem}");
    }
    let same = BASE.replace("name = \"line\"", "name = \"udp\"");
    let same = problems(&same.replace("medium = \"line\"", "medium = \"udp\""));
    assert_eq!(same.len(), 1, "{same:?}");
    assert_eq!(same[0].message, "two media have the name `udp`");
    assert_eq!(
        (same[0].kind, same[0].key.as_str()),
        (Duplicate, "media[1].name")
    );
    let near = problem("crc-16/ibm-3740", "crc-16/ibm-3704");
    assert_eq!(near.nearest[0], "crc-16/ibm-3740");
}

#[test]
fn all_problems_are_reported_at_once() {
    let text = BASE
        .replace("byte = 9", "byte = 4")
        .replace("medium = \"line\"", "medium = \"lime\"")
        .replace("unit = \"mV\"", "unit = \"mm\"");
    let keys: Vec<String> = problems(&text)
        .into_iter()
        .map(|problem| problem.key)
        .collect();
    assert_eq!(
        keys,
        [
            "frames[0].fields[5].byte",
            "frames[1].medium",
            "frames[1].fields[2].unit"
        ]
    );
}

#[test]
fn signals_are_found_in_the_tables_by_name_and_unit() {
    let measured = [
        Field::signal("surface_angle_rad", "rad", "x"),
        Field::signal("pressure_pa", "Pa", "x"),
    ];
    let reference = [Field::signal("surface_angle_rad", "rad", "x")];
    let commands = [Field::signal("voltage", "V", "x")];
    let tables = PortTables {
        measured: &measured,
        reference: &reference,
        commands: &commands,
    };
    let parse = |text: &str| Port::parse(text, Path::new("rig.port.toml"), Some(&tables));
    assert!(parse(BASE).is_ok());
    let unknown = parse(&BASE.replace("measured.surface_angle_rad", "measured.surface_angel_rad"));
    let problem = unknown.expect_err("an unknown signal").0.remove(0);
    assert_eq!(
        problem.message,
        "there is no signal `measured.surface_angel_rad`"
    );
    assert_eq!(problem.nearest[0], "measured.surface_angle_rad");
    let other = parse(&BASE.replace("signal_unit = \"V\"", "signal_unit = \"kV\""));
    let problem = other.expect_err("another unit").0.remove(0);
    assert_eq!(
        problem.message,
        "`command.voltage` has the unit `V`, not `kV`"
    );
}

//! Lines of JSON: what is packed, what is refused, and what arrives.

use super::{VALID, both, number, signal};
use crate::frame::{Body, Counter, Frame, JsonContent, JsonField, Mistake, Path};
use crate::number::Encoding;
use crate::row::{FieldResult, Row};

pub(super) fn line(fields: &[(&str, JsonContent)]) -> Frame {
    let fields = fields.iter().map(|(path, content)| JsonField {
        path: Path::parse(path).expect("a path"),
        content: content.clone(),
    });
    Frame {
        name: "line".into(),
        id: None,
        body: Body::Json(fields.collect()),
    }
}

pub(super) fn value(name: &str) -> JsonContent {
    JsonContent::Signal(signal(name), number(Encoding::Float, 64, 1.0))
}

#[test]
fn a_json_line_carries_values_constants_and_a_counter() {
    let counter = JsonContent::Counter(Counter {
        width: 8,
        max_jump: 1,
    });
    let frame = line(&[
        ("type", JsonContent::Text("imu".into())),
        ("v", JsonContent::Number(2.0)),
        ("imu.angle", value("angle_rad")),
        ("n", counter),
        ("imu.axes[0]", value("rate_radps")),
        ("imu.axes[1].x", value("count")),
    ]);
    let (mut packer, mut receiver) = both(&frame);
    let mut row = Row::new(3);
    let mut invalid = VALID;
    invalid.insert(1);
    let bytes = packer.pack(&[0.1, 5.0, -3.0], &invalid);
    assert_eq!(
        String::from_utf8_lossy(bytes),
        "{\"type\":\"imu\",\"v\":2.0,\"imu\":{\"angle\":0.1,\"axes\":[null,{\"x\":-3}]},\"n\":0}\n"
    );
    receiver.receive(None, bytes, &mut row).1.expect("accepted");
    assert_eq!(row.values(), [0.1, 0.0, -3.0]);
    assert!(row.invalid().iter(3).eq([1]));
    let mut refused = |line: &str| {
        let (_, result) = receiver.receive(None, line.as_bytes(), &mut row);
        let texts = row.results().iter().filter_map(|result| match result {
            FieldResult::Refused(refusal) => Some(refusal.describe(&frame)),
            _ => None,
        });
        let first = texts
            .collect::<Vec<_>>()
            .into_iter()
            .next()
            .unwrap_or_default();
        (result.is_ok(), first)
    };
    let head = "{\"type\":\"imu\",\"v\":2";
    for (line, is_ok, text) in [
        (
            "{\"type\":\"imu\"".into(),
            false,
            "frame `line` is not JSON at byte 13",
        ),
        (
            "{\"type\":\"gps\",\"v\":2}".into(),
            false,
            "the constant `type` of frame `line` has another value",
        ),
        (
            format!("{head},\"imu\":{{\"angle\":1,\"angle\":2}}}}"),
            false,
            "frame `line` has the field `imu.angle` twice",
        ),
        (
            "{\"type\":\"imu\"}".into(),
            false,
            "frame `line` lacks the field `v`",
        ),
        (
            format!("{head}}}"),
            false,
            "frame `line` lacks the field `n`",
        ),
        (
            format!("{head},\"n\":9}}"),
            false,
            "the counter `n` of frame `line` jumps to 9 instead of 1",
        ),
        (
            format!("{head},\"n\":10}}"),
            true,
            "frame `line` lacks the field `imu.angle`",
        ),
        (
            format!("{head},\"n\":11,\"imu\":{{\"angle\":NaN,\"axes\":[1,{{\"x\":1}}]}}}}"),
            true,
            "field `imu.angle` of frame `line` is NaN or infinite",
        ),
        (
            format!("{head},\"n\":12,\"imu\":{{\"angle\":\"1\",\"axes\":[1,{{\"x\":1}}]}}}}"),
            true,
            "field `imu.angle` of frame `line` is not a number",
        ),
    ] {
        assert_eq!(refused(&line), (is_ok, text.into()), "{line}");
    }
    assert_eq!(row.values()[0], 0.1);
}

#[test]
fn paths_that_cannot_stand_in_one_line_are_mistakes() {
    for (paths, field) in [
        (["a", "a"], 1),
        (["a", "a.b"], 1),
        (["a[0]", "a.b"], 1),
        (["a[0]", "a[2]"], 1),
        (["a[1]", "b"], 0),
        (["", "b"], 1),
    ] {
        let frame = line(&[(paths[0], value("count")), (paths[1], value("angle_rad"))]);
        assert_eq!(frame.mistakes(), [Mistake::Path { field }], "{paths:?}");
    }
    let alone = line(&[("", value("count"))]);
    let (mut packer, _) = both(&alone);
    assert_eq!(packer.pack(&[0.0, 0.0, 42.0], &VALID), b"42\n");
}

//! Frames that share a medium.

use hil_codec::frame::CanId;

use super::{port, problems};

#[test]
fn frames_of_one_medium_must_be_told_apart() {
    let can = |first: &str, second: &str| {
        format!(
            "port = 1\n[[media]]\nkind = \"can\"\ninterface = \"vcan0\"\n\
             [[frames]]\nname = \"a\"\ncarries = \"sample\"\n{first}\nfields = [{{ signal = \"measured.a_m\", type = \"f32\" }}]\n\
             [[frames]]\nname = \"b\"\ncarries = \"sample\"\n{second}\nfields = [{{ signal = \"measured.b_m\", type = \"f32\" }}]\n"
        )
    };
    let sound = port(&can("id = 1", "id = 1\nextended = true"));
    let ids: Vec<Option<CanId>> = sound.frames.iter().map(|one| one.frame.id).collect();
    assert_eq!(ids, [Some(CanId::Standard(1)), Some(CanId::Extended(1))]);
    for (first, second, message) in [
        (
            "id = 7",
            "id = 7",
            "frames `a` and `b` have the same id 0x7",
        ),
        ("id = 1", "", "`frames[1].id` is missing"),
        (
            "id = 1",
            "id = 0x800",
            "`frames[1].id` is 0x800, out of range",
        ),
        ("id = 1", "id = 2\nlength = 9", "frame `b` has 9 bytes"),
    ] {
        let problems = problems(&can(first, second));
        assert_eq!(problems[0].message, message);
        assert_eq!(problems.len(), 1, "{problems:?}");
    }
    let udp = can("", "").replace(
        "kind = \"can\"\ninterface = \"vcan0\"",
        "kind = \"udp\"\nto = \"[::1]:9\"",
    );
    assert_eq!(
        problems(&udp)[0].message,
        "frames `a` and `b` cannot be told apart"
    );
    let same = udp
        .replace("measured.b_m", "measured.a_m")
        .replace("\"f32\" }]\n[[frames]]", "\"f64\" }]\n[[frames]]");
    assert_eq!(
        problems(&same)[0].message,
        "`measured.a_m` is in frame `a` and in frame `b`"
    );
}

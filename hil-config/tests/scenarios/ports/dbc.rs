//! Frames that a DBC file describes.

use hil_codec::frame::{Body, CanId};
use hil_config::port::Port;
use hil_config::problem::Problem;

const DBC: &str = "BO_ 256 Imu: 8 Rig\n SG_ Angle : 7|16@0- (0.01,0) [-180|180] \"deg\" Law\n SG_ Count : 16|8@1+ (1,0) [0|0] \"\" Law\n SG_ Wide : 24|8@1+ (1,0) [0|300] \"\" Law\n SG_ Part m1 : 32|8@1+ (1,0) [0|0] \"\" Law\n";

fn with_dbc(dbc: &[u8], fields: &str) -> Result<Port, Vec<Problem>> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("rig.dbc"), dbc).expect("written");
    let text = format!(
        "port = 1\n[[media]]\nkind = \"cannelloni\"\nto = \"127.0.0.1:1\"\n[[frames]]\nname = \"imu\"\ncarries = \"sample\"\n\
         dbc = \"rig.dbc\"\nmessage = \"Imu\"\nfields = [{fields}]\n"
    );
    let file = folder.path().join("rig.port.toml");
    std::fs::write(&file, text).expect("written");
    Port::read(&file, None).map_err(|problems| problems.0)
}

#[test]
fn a_dbc_file_gives_place_scale_range_and_unit() {
    let angle = "{ signal = \"measured.angle_rad\", dbc_signal = \"Angle\" }";
    let alive = "{ kind = \"counter\", dbc_signal = \"Count\" }";
    // Tools write the degree sign in Latin-1.
    let latin = DBC.replace("\"deg\"", "\"@\"");
    let at = latin.find("\"@\"").expect("the unit") + 1;
    let mut latin = latin.into_bytes();
    latin[at] = 0xB0;
    for dbc in [DBC.as_bytes(), &latin] {
        let port = with_dbc(dbc, &format!("{angle}, {alive}")).expect("a sound port");
        let frame = &port.frames[0].frame;
        assert_eq!(frame.id, Some(CanId::Standard(256)));
        let Body::Bytes { length, fields } = &frame.body else {
            panic!("{frame:?}");
        };
        assert_eq!(
            (*length, fields[0].bits.start(), fields[1].bits.start()),
            (8, 7, 16)
        );
        let (_, number) = frame.signals().next().expect("a signal");
        assert!((number.range().1 - std::f64::consts::PI).abs() < 1e-15);
    }
}

#[test]
fn mistakes_of_a_dbc_file_and_its_use_are_reported_at_their_places() {
    let field = |name: &str| format!("{{ signal = \"measured.a\", dbc_signal = \"{name}\" }}");
    let one = |dbc: &str, fields: &str| {
        let mut problems = with_dbc(dbc.as_bytes(), fields).expect_err("a mistake");
        assert_eq!(problems.len(), 1, "{problems:?}");
        problems.remove(0)
    };
    let problem = one(DBC, &field("Cuont"));
    assert_eq!(problem.message, "message `Imu` has no signal `Cuont`");
    assert_eq!(problem.nearest, ["Count"]);
    let problem = one(DBC, &field("Part"));
    assert_eq!(
        problem.message,
        "signal `Part` is multiplexed, which ports do not support"
    );
    let problem = one(DBC, &field("Wide"));
    assert_eq!(problem.key, "frames[0].fields[0].dbc_signal");
    assert_eq!(
        problem.expected.as_deref(),
        Some("a range inside of [0, 255] in 1")
    );
    let problem = one(
        DBC,
        &field("Count").replace("{ signal =", "{ byte = 1, signal ="),
    );
    assert_eq!(
        problem.message,
        "`frames[0].fields[0].byte` has no effect beside a DBC signal, which gives it"
    );
    let problem = one("not a DBC file", &field("Count"));
    assert_eq!(
        problem.message,
        "`rig.dbc` has no messages; it may be no DBC file"
    );
    let contradicting = DBC.replace("SG_ Count : 16", "SG_ Count : 12");
    let problem = one(&contradicting, &field("Count"));
    assert_eq!(
        problem.message,
        "signal `Count` of message `Imu` shares bits with `Angle` in byte 1"
    );
    assert!(problem.source.ends_with("rig.dbc"), "{problem}");
    assert_eq!(problem.excerpt.expect("a line").line, 3);
}

//! JSBSim as a plant that nobody here wrote, under a law that was written for another one.

use std::net::UdpSocket;

use shared_types::extremes::larger;

use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{shipped, skip};
use crate::support::python::python;

#[test]
fn the_law_of_a_mass_on_a_spring_holds_the_altitude_of_an_f16() {
    let Some(python) = python("jsbsim") else {
        return skip("python3 with JSBSim is missing", "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let free = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").expect("a socket"));
    let ports = free
        .each_ref()
        .map(|socket| socket.local_addr().expect("an address").port());
    drop(free);
    for file in ["f16.py", "f16.port.toml", "altitude.toml"] {
        let text = shipped(format!("examples/jsbsim/{file}"));
        let text = text.replace("9106", &ports[0].to_string());
        let text = text.replace("9107", &ports[1].to_string());
        rig.write(
            file,
            &text.replace(
                "\"python3\"",
                &format!("{:?}", python.display().to_string()),
            ),
        );
    }
    let arguments = ["run", "altitude.toml", "--out", "flight"];
    rig.hil_in(&rig.path(""), &arguments).expect(0);
    let recording = Recording::open(&rig.path("flight").join("run.mcap"));
    let altitude_m = recording.column("measured.altitude_m");
    let pitch_rad = recording.column("measured.pitch_rad");
    // 15,000 ft, converted once: JSBSim's own trim is level.
    assert!(
        (altitude_m[100] - 4572.0).abs() < 1.0,
        "{}",
        altitude_m[100]
    );
    let climbs = pitch_rad[200..600].iter().copied().fold(f64::MIN, larger);
    assert!(climbs > pitch_rad[100] + 0.01, "{climbs}");
    rig.assert_nothing_left();
}

//! A controller behind a serial line: a pair of pseudo-terminals, made by a peer in Python.

use crate::support::harness::Rig;
use crate::support::programs::shipped;
use crate::support::python::python;

/// Replacement for the socket of `pid.py`: each frame begins with two constant bytes.
const LINE: &str = r#"
import os
import tty


class Line:
    def __init__(self):
        self.end, self.other = os.openpty()
        tty.setraw(self.other)
        os.symlink(os.ttyname(self.other), "line")

    def recvfrom(self, _):
        data = b""
        while len(data) < 22:
            data += os.read(self.end, 22 - len(data))
        assert data[:2] == b"\xaa\x55", data
        return data[2:], None

    def sendto(self, data, _):
        os.write(self.end, b"\xaa\x55" + data)


wire = Line()
"#;

#[test]
fn a_pid_loop_behind_a_serial_line_has_the_digest_of_the_built_in_one() {
    let rig = Rig::new();
    if python("tty").is_none() {
        return;
    }
    let peer = shipped("examples/ports/pid.py");
    let (head, rest) = peer.split_once("wire = socket").expect("a socket");
    let (_, tail) = rest.split_once("print(\"ready\"").expect("a ready line");
    rig.write("pid.py", &format!("{head}{LINE}print(\"ready\"{tail}"));
    let port = shipped("examples/ports/pid.port.toml");
    let udp = "kind = \"udp\"\nto = \"127.0.0.1:9103\"";
    assert!(port.contains(udp));
    let serial = format!("kind = \"serial\"\ndevice = {:?}", rig.path("line"));
    let sync = "fields = [\n    { kind = \"constant\", type = \"u16\", value = 0x55AA },";
    let port = port.replace(udp, &serial).replace("fields = [", sync);
    rig.write("pid.port.toml", &port);
    rig.write("wired.toml", &shipped("examples/ports/wired.toml"));
    rig.write("own.toml", &shipped("scenarios/spring-mass.toml"));
    let [own, wired] = ["own", "wired"].map(|name| {
        let scenario = format!("{name}.toml");
        let arguments = ["run", &scenario, "--out", name, "--json"];
        let run = rig.hil_in(&rig.path(""), &arguments);
        run.expect(0).json()
    });
    assert_eq!(own["digest"], wired["digest"]);
    let port = &wired["port"];
    assert_eq!(port["frames"][1]["accepted"], 5000, "{port}");
    assert_eq!(port["media"][0]["skipped_bytes"], 0, "{port}");
    assert_eq!(port["media"][0]["unsent"], 0, "{port}");
    rig.assert_nothing_left();
}

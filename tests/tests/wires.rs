//! Ports judged by programs that know nothing of them: python-can, cantools and can-cannelloni at the far end of a bus,
//! and tcpdump beside a run.

use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, shipped, skip, works, workspace};
use crate::support::python::{python, succeeds};

/// Returns a UDP port that is free now.
fn free_port() -> u16 {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("an address").port()
}

fn run(rig: &Rig, scenario: &str, out: &str) -> Run {
    let run = rig.hil_in(&rig.path(""), &["run", scenario, "--out", out]);
    Run {
        folder: rig.path(out),
        ..run
    }
}

/// Both byte orders, bits across bytes, an identifier of 29 bits, an alive counter, a CRC and a signal that nobody fills.
const DBC: &str = r#"VERSION ""

BS_:

BU_: Rig Law

BO_ 256 Motion: 8 Rig
 SG_ Position : 7|24@0- (1e-07,0) [-0.05|0.05] "m" Law
 SG_ Target : 24|20@1- (1e-07,0) [-0.05|0.05] "m" Law
 SG_ Alive : 44|4@1+ (1,0) [0|15] "" Law
 SG_ Spare : 48|8@1+ (1,0) [0|255] "" Law
 SG_ Sum : 63|8@0+ (1,0) [0|255] "" Law

BO_ 2147484161 Drive: 6 Law
 SG_ Force : 7|32@0- (0.0001,0) [-200000|200000] "N" Rig
 SG_ Alive : 32|4@1+ (1,0) [0|15] "" Rig
 SG_ Sum : 47|8@0+ (1,0) [0|255] "" Rig
"#;

fn port_file(start: &[String], port: u16) -> String {
    format!(
        r#"port = 1
name = "python"
start = {start:?}
ready = "ready"

[[media]]
kind = "cannelloni"
to = "127.0.0.1:{port}"

[[frames]]
name = "motion"
carries = "sample"
dbc = "loop.dbc"
message = "Motion"
fields = [
    {{ signal = "measured.position_m", dbc_signal = "Position" }},
    {{ signal = "reference.position_m", dbc_signal = "Target" }},
    {{ kind = "counter", dbc_signal = "Alive" }},
    {{ kind = "checksum", dbc_signal = "Sum", algorithm = "crc-8/sae-j1850" }},
]

[[frames]]
name = "drive"
carries = "command"
dbc = "loop.dbc"
message = "Drive"
fields = [
    {{ signal = "command.force_n", dbc_signal = "Force" }},
    {{ kind = "counter", dbc_signal = "Alive" }},
    {{ kind = "checksum", dbc_signal = "Sum", algorithm = "crc-8/sae-j1850" }},
]
"#
    )
}

/// Writes a scenario of 0.5 s in which the reference jumps.
fn write_scenario(rig: &Rig, name: &str, controller: &str) {
    let text = format!(
        r#"schema = 1
name = "{name}"
run = {{ duration_s = 0.5, rate_hz = 1000 }}
plant.model = "spring-mass"
{controller}
[[stimuli]]
target = "position_m"
kind = "step"
at_s = 0.1
after = 0.01
"#
    );
    rig.write(&format!("{name}.toml"), &text);
}

#[test]
fn a_law_of_cantools_behind_cannelloni_equals_the_simulated_bus_in_every_bit() {
    const STEPS: usize = 500;
    let Some(python) = python("can, cantools, can_cannelloni, crccheck") else {
        let why = "python3 with python-can, cantools and can-cannelloni is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    rig.write("loop.dbc", DBC);
    let port = free_port();
    let law = workspace().join("tests/python/can_law.py");
    let start = [&*python, &*law, Path::new("loop.dbc")].map(|path| path.display().to_string());
    let start = [&start[..], &[port.to_string()]].concat();
    rig.write("loop.port.toml", &port_file(&start, port));
    let wired = "controller = { law = \"python\", program = \"loop.port.toml\" }";
    write_scenario(&rig, "wired", wired);
    let simulated = "controller.law = \"pid\"\nbus.file = \"loop.port.toml\"";
    write_scenario(&rig, "simulated", simulated);

    let wired = run(&rig, "wired.toml", "wired").expect(0);
    let simulated = run(&rig, "simulated.toml", "simulated").expect(0);
    let [behind_wire, on_bus] = [&wired, &simulated].map(|run| Recording::open(&run.recording()));
    for signal in ["truth.position_m", "truth.velocity_mps", "applied.force_n"] {
        let [one, other] = [&behind_wire, &on_bus].map(|run| run.column(signal));
        assert_eq!(one[..STEPS], other[..STEPS], "{signal}");
    }

    let text = std::fs::read_to_string(rig.path("frames.jsonl")).expect("the law wrote frames");
    let frames: Vec<(String, Value)> = (text.lines())
        .map(|line| serde_json::from_str(line).expect("a frame"))
        .collect();
    assert_eq!(frames.len(), 2 * STEPS);
    // The law on the simulated bus read what cantools decoded, and the wire carried back what cantools encoded.
    for (name, signal, recording, column) in [
        ("Motion", "Position", &on_bus, "measured.position_m"),
        ("Motion", "Target", &on_bus, "reference.position_m"),
        ("Drive", "Force", &behind_wire, "command.force_n"),
    ] {
        let of_message = frames.iter().filter(|(message, _)| message == name);
        let decoded: Vec<f64> = of_message
            .map(|(_, values)| values[signal].as_f64().expect("a number"))
            .collect();
        assert_eq!(decoded, recording.column(column)[..STEPS], "{column}");
    }

    let summary = wired.summary();
    let [motion, drive] = [0, 1].map(|frame| &summary["port"]["frames"][frame]);
    assert_eq!(
        (&motion["sent"], &drive["accepted"]),
        (&500.into(), &500.into())
    );
    for count in ["repeated", "refused", "lost", "refused_fields", "unasked"] {
        assert_eq!(drive[count], 0, "{count}");
    }
    // The same number with 11 bits is another identifier; remote requests are no frames.
    assert_eq!(summary["port"]["media"][0]["foreign"], 500);
}

/// Runs a command in a network of its own, while tcpdump writes a number of datagrams into a file and then ends.
/// The beginning of each is enough, so that the buffer has room for all.
const CAPTURE: &str = r#"
file=$1 count=$2
shift 2
ip link set lo up
tcpdump -i lo -Z root -U --immediate-mode -s 128 -B 16384 -c "$count" -w "$file" udp 2>"$file.log" &
tcpdump=$!
until grep -q 'listening on' "$file.log"; do
    kill -0 $tcpdump || { cat "$file.log" >&2; exit 1; }
    sleep 0.02
done
"$@" && wait $tcpdump
"#;

/// Parses the text of `tcpdump -nn -t -x`: for each datagram the port that it is sent to, and its content.
fn datagrams(text: &str) -> Vec<(u16, Vec<u8>)> {
    let mut datagrams: Vec<(u16, Vec<u8>)> = Vec::new();
    for line in text.lines() {
        if let Some(bytes) = line.strip_prefix('\t') {
            let (_, digits) = bytes.split_once(": ").expect("an offset");
            let digits: Vec<u8> = digits.bytes().filter(u8::is_ascii_hexdigit).collect();
            let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
            let bytes = digits
                .chunks(2)
                .map(|pair| byte(pair).expect("hexadecimal"));
            datagrams.last_mut().expect("a head").1.extend(bytes);
        } else {
            let (_, rest) = line.split_once(" > 127.0.0.1.").expect("two addresses");
            let (port, _) = rest.split_once(':').expect("a port");
            datagrams.push((port.parse().expect("a number"), Vec::new()));
        }
    }
    // Behind the heads of IP (20 bytes) and UDP (8 bytes).
    for (_, bytes) in &mut datagrams {
        bytes.drain(..28);
    }
    datagrams
}

#[test]
fn a_capture_of_tcpdump_has_the_values_of_the_recording() {
    const STEPS: usize = 5000;
    const VARIABLE: &str = "HIL_TEST_TCPDUMP";
    if !works(&["tcpdump", "--version"]) || python("socket").is_none() {
        return skip("tcpdump or python3 is missing", VARIABLE);
    }
    if !works(&["unshare", "--net", "ip", "link", "set", "lo", "up"]) {
        return skip(
            "this user may not capture in a network of their own",
            VARIABLE,
        );
    }
    let rig = Rig::new();
    for file in ["pid.py", "pid.port.toml", "wired.toml"] {
        rig.write(file, &shipped(format!("examples/ports/{file}")));
    }
    let capture = rig.path("wire.pcap");
    let mut command = rig.command("unshare");
    command.args(["--net", "sh", "-c", CAPTURE, "sh"]);
    command.arg(&capture).arg((2 * STEPS).to_string());
    command.arg(program("hil"));
    command.args(["run", "wired.toml", "--out", "run"]);
    command.current_dir(rig.path(""));
    rig.program(command).expect(0);
    rig.assert_nothing_left();

    let mut tcpdump = Command::new("tcpdump");
    let text = succeeds(tcpdump.args(["-nn", "-t", "-x", "-r"]).arg(&capture));
    let (samples, commands): (Vec<_>, Vec<_>) =
        (datagrams(&text).into_iter()).partition(|(port, _)| *port == 9103);
    assert_eq!((samples.len(), commands.len()), (STEPS, STEPS));
    let recording = Recording::open(&rig.path("run").join("run.mcap"));
    for (datagrams, place, column) in [
        (&samples, 4, "measured.position_m"),
        (&samples, 12, "reference.position_m"),
        (&commands, 4, "command.force_n"),
    ] {
        let values = recording.column(column);
        for (step, (_, bytes)) in datagrams.iter().enumerate() {
            let counter = u32::from_le_bytes(bytes[..4].try_into().expect("4 bytes"));
            assert_eq!(counter as usize, step);
            let value = f64::from_le_bytes(bytes[place..place + 8].try_into().expect("8 bytes"));
            assert_eq!(
                value.to_bits(),
                values[step].to_bits(),
                "{column} at {step}"
            );
        }
    }
}

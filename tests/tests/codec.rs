//! The codec of ports beside programs that know nothing of it, on its step path, and in `hil describe`.

mod layouts;

use std::fs;
use std::process::Command;

use hil_codec::dbc::{Dbc, DbcSignal, Message};
use hil_codec::frame::{CanId, Frame};
use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::Row;
use hil_config::port::{Carries, Port};
use serde_json::{Value, json};
use shared_types::quality::SignalSet;
use shared_types::random::RandomStream;

use crate::support::harness::Rig;
use crate::support::programs::{shipped, skip, workspace};
use crate::support::python::{python, succeeds};

const VALID: SignalSet = SignalSet::EMPTY;

/// Signals in both byte orders, with and without sign, across bytes, with scale and offset, and floats.
const BUS: &str = r#"VERSION ""

BS_:

BU_: Rig Law

BO_ 256 Motorola: 8 Rig
 SG_ Angle : 7|16@0- (0.01,0) [-180|180] "deg" Law
 SG_ Rate : 19|12@0- (0.25,-100) [-612|411.75] "deg/s" Law
 SG_ Count : 39|5@0+ (1,0) [0|31] "" Law
 SG_ Odd : 34|23@0- (0.001,5) [0|0] "" Law

BO_ 512 Intel: 8 Rig
 SG_ Height : 0|16@1- (0.01,0) [-327|327] "m" Law
 SG_ Pressure : 16|13@1+ (0.125,-10) [-10|1000] "Pa" Law
 SG_ Flag : 29|1@1+ (1,0) [0|1] "" Law
 SG_ Wide : 30|33@1- (1e-06,0) [0|0] "" Law

BO_ 2566853172 Floats: 12 Rig
 SG_ Force : 0|32@1- (1,0) [0|0] "N" Law
 SG_ Energy : 39|64@0- (1,0) [0|0] "J" Law

SIG_VALTYPE_ 2566853172 Force : 1;
SIG_VALTYPE_ 2566853172 Energy : 2;
"#;

/// Returns a port with every signal of every message, in the unit of the wire.
fn bus_port(bus: &str) -> String {
    let bus = Dbc::read(bus).unwrap_or_else(|mistakes| panic!("{mistakes:?}"));
    let mut text =
        "port = 1\n[[media]]\nkind = \"can\"\ninterface = \"vcan0\"\nfd = true\n".to_owned();
    for Message { name, signals, .. } in bus.messages {
        let fields = signals.iter().map(|DbcSignal { name, unit, .. }| {
            let unit = if unit.is_empty() { "1" } else { unit };
            format!("{{ signal = \"measured.{name}\", signal_unit = \"{unit}\", dbc_signal = \"{name}\" }}")
        });
        let fields = fields.collect::<Vec<_>>().join(", ");
        text += &format!(
            "[[frames]]\nname = \"{name}\"\ncarries = \"sample\"\ndbc = \"bus.dbc\"\nmessage = \"{name}\"\nfields = [{fields}]\n"
        );
    }
    text
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn from_hex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    digits
        .map(|pair| byte(pair).expect("hexadecimal digits"))
        .collect()
}

#[test]
fn cantools_and_python_can_read_and_write_the_same_frames() {
    judge(BUS, 2000);
}

#[test]
fn cantools_and_python_can_agree_on_random_layouts() {
    for seed in 0..6 {
        judge(&layouts::random(seed), 50);
    }
}

/// Lets cantools decode the frames of random rows, and decodes as many frames that cantools encoded.
fn judge(bus: &str, rows: usize) {
    let Some(python) = python("can, cantools") else {
        let why = "python3 with python-can and cantools is missing";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    rig.write("bus.dbc", bus);
    let file = rig.write("bus.port.toml", &bus_port(bus));
    let port = Port::read(&file, None).unwrap_or_else(|problems| panic!("{problems}"));
    let frames: Vec<Frame> = port.frames.into_iter().map(|one| one.frame).collect();
    let table = Port::read(&file, None)
        .expect("as before")
        .table(Carries::Sample);
    let names: Vec<&str> = table
        .0
        .iter()
        .map(|signal| signal.field.name.as_str())
        .collect();
    let mut receiver = Receiver::new(&frames, &table).expect("sound");
    let mut packers: Vec<Packer> = (frames.iter())
        .map(|frame| Packer::new(frame, &table).expect("sound"))
        .collect();
    let mut random = RandomStream::new(49, "codec");
    let mut row = Row::new(table.len());
    let mut packed = Vec::new();
    for _ in 0..rows {
        // Also beyond the range, where the limit is packed.
        let values: Vec<f64> = (table.0.iter())
            .map(|signal| {
                let (low, high) = (signal.field.min, signal.field.max);
                let (low, high) = if high > 1e300 {
                    (-1e6, 1e6)
                } else {
                    (low, high)
                };
                low + (random.uniform() * 1.1 - 0.05) * (high - low)
            })
            .collect();
        for (frame, packer) in frames.iter().zip(&mut packers) {
            let bytes = packer.pack(&values, &VALID);
            let (index, result) = receiver.receive(frame.id, bytes, &mut row);
            result.expect("what was packed is accepted");
            let columns = receiver.columns(index.expect("a known frame"));
            let values = columns.iter().map(|column| {
                let value = row.values()[*column];
                (names[*column].to_owned(), json!(value))
            });
            let (id, extended) = match frame.id.expect("an identifier") {
                CanId::Standard(id) => (u32::from(id), false),
                CanId::Extended(id) => (id, true),
            };
            let values: serde_json::Map<String, Value> = values.collect();
            packed.push(
                json!({"id": id, "extended": extended, "data": hex(bytes), "values": values}),
            );
        }
    }
    let folder = file.parent().expect("a folder");
    fs::write(folder.join("packed.json"), json!(packed).to_string()).expect("written");
    let script = workspace().join("tests/python/judge_codec.py");
    succeeds(Command::new(python).arg(script).arg(folder));

    let encoded = fs::read_to_string(folder.join("encoded.json")).expect("cantools wrote frames");
    let encoded: Value = serde_json::from_str(&encoded).expect("JSON");
    let encoded = encoded.as_array().expect("a list");
    assert_eq!(encoded.len(), packed.len());
    for one in encoded {
        let place = frames
            .iter()
            .position(|frame| one["message"] == *frame.name);
        let place = place.expect("a known message");
        let bytes = from_hex(one["data"].as_str().expect("text"));
        let (_, result) = receiver.receive(frames[place].id, &bytes, &mut row);
        result.unwrap_or_else(|refusal| panic!("{}", refusal.describe(&frames[place])));
        for column in receiver.columns(place) {
            let expected = one["values"][names[*column]].as_f64();
            assert_eq!(
                Some(row.values()[*column]),
                expected,
                "{} {one}",
                names[*column]
            );
        }
        // What the codec reads it packs again into the same bytes.
        let again = packers[place].pack(row.values(), &VALID);
        assert_eq!(hex(again), one["data"], "{one}");
    }
}

#[test]
fn frames_cost_no_allocation() {
    let file = workspace().join("examples/ports/flight.port.toml");
    let lines = workspace().join("examples/ports/lines.port.toml");
    for file in [file, lines] {
        let port = Port::read(&file, None).unwrap_or_else(|problems| panic!("{problems}"));
        let table = port.table(Carries::Sample);
        let frame = [port.frames[0].frame.clone()];
        let mut packer = Packer::new(&frame[0], &table).expect("sound");
        let mut receiver = Receiver::new(&frame, &table).expect("sound");
        let mut row = Row::new(table.len());
        let values = vec![1.25; table.len()];
        let counted = allocation_counter::measure(|| {
            for _ in 0..100 {
                let bytes = packer.pack(&values, &VALID);
                let _ = receiver.receive(None, bytes, &mut row);
                let _ = receiver.receive(None, &bytes[1..], &mut row);
                row.advance();
            }
        });
        assert_eq!(counted.count_total, 0, "{}", file.display());
        assert_eq!(receiver.counts(0).accepted, 100);
    }
}

#[test]
fn a_port_file_is_described_with_its_signals_and_frames() {
    let rig = Rig::new();
    let file = workspace().join("examples/ports/board.port.toml");
    let file = file.to_str().expect("text");
    rig.hil(&["describe", file]).expect(0).prints(&[
        "port board: a control surface with its drive on CAN",
        "measured.surface_angle_rad",
        "frame motion: sample, on can, id 0x100, 8 bytes, every 10 steps",
        "i16 big     Angle",
        "4[3:0], 5 to 6",
        "counter of 4 bits, steps up to 2",
        "crc-8/sae-j1850 of bytes 0 to 7",
        "frame drive: command, on can, id 0x201 (extended), 4 bytes, every 0.01 s, 100 Hz, stale after 0.05 s",
        "safe values: none, so that the port can be a controller only",
    ]);
    let json = rig.hil(&["describe", "--json", file]).expect(0);
    let described: Value = serde_json::from_str(&json.stdout).expect("JSON");
    let angle = &described["port"]["frames"][0]["fields"][0];
    assert_eq!(angle["signal"], "measured.surface_angle_rad");
    assert_eq!((&angle["byte"], &angle["bit"]), (&json!(0), &json!(7)));
    // A hundredth of a degree.
    let resolution = angle["resolution"].as_f64().expect("a number");
    assert!((resolution - 0.01 * std::f64::consts::PI / 180.0).abs() < 1e-18);

    let plant = workspace().join("examples/ports/rig.port.toml");
    let plant = plant.to_str().expect("text");
    rig.hil(&["describe", plant]).expect(0).prints(&[
        "safe values: sent 5 times, 0.02 s apart, by the keeper when the port ends",
        "command.force_n  0 N",
        "watchdog: none",
    ]);
    let json = rig.hil(&["describe", "--json", plant]).expect(0).json();
    let safe = json!([{"signal": "command.force_n", "unit": "N", "value": 0.0}]);
    assert_eq!(json["port"]["safety"]["values"], safe);

    let wrong = shipped("examples/ports/flight.port.toml").replace("u20", "u21");
    let wrong = rig.write("wrong.port.toml", &wrong.replace("deg/s", "degs"));
    let wrong = wrong.to_str().expect("text");
    let refused = rig.hil(&["describe", wrong]).expect(2);
    assert!(
        refused.stderr.contains("`degs` is not a known unit"),
        "{}",
        refused.stderr
    );
    let load = rig.hil(&["describe", file, "--load"]).expect(2);
    assert!(
        load.stderr.contains("--load has an effect on FMUs only"),
        "{}",
        load.stderr
    );
}

#[test]
fn every_example_on_the_page_of_ports_is_a_sound_port_file() {
    let page = shipped("docs/ports.md");
    let blocks = page.split("```toml\n").skip(1);
    let blocks: Vec<&str> = blocks
        .map(|block| block.split("```").next().unwrap_or_default())
        .collect();
    let origin = workspace().join("examples/ports/page.port.toml");
    let mut count = 0;
    for block in blocks {
        // A piece of a file stands behind the head that it needs.
        let head = match block.split(' ').next() {
            Some("fields") => "port = 1\n[[frames]]\nname = \"a\"\ncarries = \"sample\"\n",
            Some("port") => "",
            _ => "port = 1\n",
        };
        let text = format!("{head}{block}");
        Port::parse(&text, &origin, None).unwrap_or_else(|problems| panic!("{problems}\n{text}"));
        count += 1;
    }
    assert!(count >= 9, "{count} examples");
}

#[test]
fn the_port_file_on_the_page_of_plants_has_its_safe_values() {
    let page = shipped("docs/port-rig.md");
    let block = page
        .split("```toml\n")
        .find(|block| block.starts_with("port = 1"));
    let block = block
        .and_then(|block| block.split("```").next())
        .expect("a port file");
    let port = Port::parse(block, "page.port.toml".as_ref(), None);
    let port = port.unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(port.safe_row(), Ok(vec![0.0]));
}

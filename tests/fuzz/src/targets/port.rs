//! A port file and what arrives at it: the text up to the first byte 0, then frames with a byte 0 between them.
//!
//! Whatever is refused is refused by name and place. Of a port that is taken, any bytes leave rows of
//! finite numbers, and every frame that is packed is one that its receiver takes. The text is also
//! read as a DBC file.

use std::path::Path;

use hil_codec::dbc::Dbc;
use hil_codec::frame::Frame;
use hil_codec::pack::Packer;
use hil_codec::receive::Receiver;
use hil_codec::row::Row;
use hil_config::port::{Carries, Port};

use super::assert_told;
use super::numbers::OddNumbers;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let mut parts = bytes.split(|byte| *byte == 0);
    let text = parts.next().unwrap_or_default();
    // A file that is no text is refused when it is read.
    let Ok(text) = std::str::from_utf8(text) else {
        return;
    };
    if let Err(mistakes) = Dbc::read(text) {
        assert!(!mistakes.is_empty());
        for mistake in mistakes {
            assert!(!mistake.message.is_empty());
            assert!(text.get(mistake.place).is_some());
        }
    }
    // No DBC file is there, wherever the fuzzer runs.
    match Port::parse(text, Path::new("/dev/null/rig.port.toml"), None) {
        Ok(port) => {
            let wire: Vec<&[u8]> = parts.collect();
            taken(&port, &wire, OddNumbers::of(bytes));
        }
        Err(problems) => {
            assert!(!problems.0.is_empty());
            for problem in &problems.0 {
                assert!(!problem.message.is_empty(), "{problem:?}");
            }
            assert_told(&problems.to_string());
        }
    }
}

fn taken(port: &Port, wire: &[&[u8]], mut numbers: OddNumbers) {
    for carries in [Carries::Sample, Carries::Command] {
        let table = port.table(carries);
        let of_direction = port.frames.iter().filter(|one| one.carries == carries);
        let frames: Vec<Frame> = of_direction.map(|one| one.frame.clone()).collect();
        // A frame of the link carries 512 signals at most.
        if table.len() > 512 {
            continue;
        }
        let mut all = Receiver::new(&frames, &table).expect("what was checked can be received");
        let mut row = Row::new(table.len());
        for frame in &frames {
            for bytes in wire {
                if let Err(refusal) = all.receive(frame.id, bytes, &mut row).1 {
                    assert!(!refusal.describe(frame).is_empty());
                }
                row.advance();
                assert!(row.values().iter().all(|value| value.is_finite()));
            }
            let alone = std::slice::from_ref(frame);
            let mut receiver = Receiver::new(alone, &table).expect("as before");
            let mut packer = Packer::new(frame, &table).expect("as before");
            let mut arrived = Row::new(table.len());
            for _ in 0..3 {
                let bytes = packer.pack(&numbers.row(table.len()), row.invalid());
                let (_, result) = receiver.receive(frame.id, bytes, &mut arrived);
                result.unwrap_or_else(|refusal| panic!("{}", refusal.describe(frame)));
                assert!(arrived.values().iter().all(|value| value.is_finite()));
            }
        }
    }
}

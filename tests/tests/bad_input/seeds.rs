//! Writes the seeds of the corpus that cannot be written by hand: recordings, frames, messages and job files, each
//! of a run of a few steps.
//!
//! States of checkpoints come from a real run, `hil run tests/fuzz/corpus/scenario/small.toml --checkpoint-at
//! 0.003`, with the name of the file in a line before them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use hil_recording::compression::Compression;
use hil_recording::writer::{Attachment, Provenance, Recording};
use shared_types::describe::Description;
use shared_types::frame::{Frame, FrameIdentity, FrameKind, Header, words};
use shared_types::hello::{Control, Hello, Offer, agree};
use shared_types::record::{Event, FaultBegun, Outcome, RecordLayout, RunEnd, Timing};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};
use shared_types::zerocopy::{FromBytes, IntoBytes};

use super::targets::{rig, session};
use crate::support::fmus;
use crate::support::programs::workspace;

const IDENTITY: FrameIdentity = FrameIdentity {
    session: 7,
    layout: 8,
    epoch: 1,
};

#[test]
#[ignore = "writes files of the repository; run it when a format has changed"]
fn seeds_are_written() {
    let corpus = workspace().join("tests/fuzz/corpus");
    recordings(&corpus.join("recording"));
    frames(&corpus.join("frame"));
    messages(&corpus.join("hello"));
    files(&corpus.join("session"));
    fmus(&corpus.join("fmu"));
}

fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// Returns the descriptions of the small scenario's plant and law alone.
fn described() -> (Description, Description) {
    let (all, plan) = (rig::rig(), rig::small_plan());
    let mut plant = Description::new("plant-process", "0.1.0");
    let mut controller = Description::new("controller-process", "0.1.0");
    plant.plants = all.plants.clone();
    plant.plants.retain(|one| one.name == plan.plant.model);
    plant.faults = all.kinds.clone();
    plant
        .faults
        .retain(|kind| ["bias", "late"].contains(&kind.kind.as_str()));
    controller.laws = all.laws.clone();
    controller
        .laws
        .retain(|law| law.name == plan.controller.law && law.plants.contains(&plan.plant.model));
    (plant, controller)
}

fn reference() -> Vec<Field> {
    let stimuli = rig::small_plan().stimuli.iter();
    stimuli.flat_map(|stimulus| stimulus.fields()).collect()
}

fn layout() -> RecordLayout {
    let (plant, controller) = described();
    let (plant, law) = (&plant.plants[0], &controller.laws[0]);
    let faultable = plant.parameters.iter().filter(|field| field.faultable);
    RecordLayout {
        truth: plant.truth.clone(),
        measured: plant.measured.clone(),
        reference: reference(),
        command: plant.commands.clone(),
        internal: law.internals.clone(),
        input: Vec::new(),
        command_signals: plant.commands.len() + law.internals.len(),
        command_places: (0..plant.commands.len()).collect(),
        parameter: faultable.cloned().collect(),
        sensor: Vec::new(),
        actuator: Vec::new(),
        cut: Vec::new(),
    }
}

fn recordings(folder: &Path) {
    let layout = layout();
    let (plant, controller) = described();
    let json = |description: &Description| serde_json::to_string(description).expect("plain data");
    let attachment = |name, text| Attachment {
        name,
        media_type: "text/plain",
        text,
    };
    let provenance = Provenance {
        facts: BTreeMap::from([
            ("rate_hz".into(), "1000".into()),
            ("steps".into(), "10".into()),
        ]),
        attachments: vec![
            attachment(
                "scenario.toml",
                include_str!("../../fuzz/corpus/scenario/small.toml").into(),
            ),
            attachment("plant-description.json", json(&plant)),
            attachment("controller-description.json", json(&controller)),
        ],
    };
    let end = Event::End(RunEnd::new(10, Outcome::Completed));
    let taken = Event::Fault(FaultBegun {
        id: 1,
        effect: 0,
        step: 4,
        kind: "bias".into(),
        target: "measured.position_m".into(),
        parameter: "measured.position_m".into(),
        canonical: "bias=3f50624dd2f1a9fc step".into(),
        wall_only: false,
    });
    for (name, compression) in [
        ("plain.mcap", Compression::None),
        ("lz4.mcap", Compression::Lz4),
        ("zstd.mcap", Compression::Zstd),
    ] {
        let path = folder.join(name);
        let recording = Recording::create(&path, compression, &layout, &provenance, None);
        let mut recording = recording.expect("created");
        for step in 0..=10 {
            if step == 4 {
                recording.event(&taken, None, 0).expect("written");
            }
            let mut words = vec![0; layout.words()];
            words[0] = step;
            let values = layout.values_start()..layout.values_start() + layout.values();
            for (place, word) in words[values].iter_mut().enumerate() {
                *word = (0.001 * (step as f64 + place as f64)).to_bits();
            }
            let timing = layout.words() - Timing::WORDS;
            (words[timing], words[timing + 1], words[timing + 5]) = (step * 1_000_000, 1, 20_000);
            recording
                .record(&words, &layout.view(&words))
                .expect("written");
        }
        recording.event(&end, None, 0).expect("written");
        let result = BTreeMap::from([("outcome".into(), "completed".into())]);
        recording.finish(result).expect("finished");
    }
}

/// Seeds that are frames: name, kind and number of values.
const FRAMES: [(&str, FrameKind, usize); 4] = [
    ("sample", FrameKind::Sample, 4),
    ("command", FrameKind::Command, 1),
    ("end", FrameKind::End, 0),
    ("abort", FrameKind::Abort, 0),
];

#[test]
fn the_frames_among_the_seeds_open() {
    for (name, kind, count) in FRAMES {
        let path = workspace().join("tests/fuzz/corpus/frame").join(name);
        let bytes = fs::read(path).expect("a seed");
        let frame = Frame::<{ words(16) }>::read_from_bytes(&bytes).expect("as long as a frame");
        let header = frame.open(IDENTITY, &mut vec![0.0; count]);
        assert_eq!(header.expect("a whole frame").kind(), Some(kind), "{name}");
    }
}

fn frames(folder: &Path) {
    let values = [1.0, -2.0, f64::NAN, f64::INFINITY];
    for (name, kind, count) in FRAMES {
        let header = Header {
            sequence: 3,
            directive: 5,
            ..Header::new(kind, Step(2))
        };
        let frame = Frame::<{ words(16) }>::sealed(&header, &values[..count], IDENTITY);
        write(&folder.join(name), frame.as_bytes());
    }
    let event = br#"{"event":"fault-ended","id":1,"effect":0,"step":9,"cleared":true}"#;
    let mut items = vec![1_u64, 2, 64];
    let item = |from: usize| {
        let mut word = [0; 8];
        let part = &event[from..event.len().min(from + 8)];
        word[..part.len()].copy_from_slice(part);
        u64::from_le_bytes(word)
    };
    items.extend((0..8).map(|word| item(8 * word)));
    items.extend([2, 3, 1, item(64), 9, 1, 16, 1, 2, 3]);
    write(&folder.join("items"), items.as_bytes());
}

fn messages(folder: &Path) {
    let (plant, controller) = described();
    let (plant, law, reference) = (&plant.plants[0], &controller.laws[0], reference());
    let hello = Hello {
        tunable: vec![],
        ..Hello::of(law, 7)
    };
    let offer = Offer {
        session: 7,
        epoch: 1,
        rate: Rate::new(1000.0).expect("a legal rate"),
        steps: 10,
        first: Step(0),
        against_clock: false,
        measured: &plant.measured,
        reference: &reference,
        commands: &plant.commands,
    };
    let welcome = agree(&hello, &offer).expect("they fit");
    for (name, control) in [
        ("hello", Control::Hello(hello)),
        ("welcome", Control::Welcome(Box::new(welcome))),
        (
            "refusal",
            Control::Refusal {
                reason: "no".into(),
            },
        ),
        ("ready", Control::Ready { epoch: 1 }),
    ] {
        write(&folder.join(name), &control.to_bytes());
    }
}

fn files(folder: &Path) {
    let file = |name: &str, line: &str, json: serde_json::Value| {
        write(&folder.join(name), format!("{line}\n{json}").as_bytes());
    };
    let plain = "plain data";
    file(
        "plant-job",
        "plant.json",
        serde_json::to_value(session::plant_job()).expect(plain),
    );
    let job = session::controller_job();
    file(
        "controller-job",
        "controller.json",
        serde_json::to_value(job).expect(plain),
    );
    file(
        "layout",
        "layout.json",
        serde_json::to_value(layout()).expect(plain),
    );
    let (_, controller) = described();
    file(
        "description",
        "description.json",
        serde_json::to_value(controller).expect(plain),
    );
}

/// Writes model descriptions like those of the Reference-FMUs and ours, and archives: a valid one, a compressed
/// one, and invalid ones.
fn fmus(folder: &Path) {
    let file = |path: &str| {
        let path = workspace().join("tests").join(path);
        fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let ours = file("fmus/slider.xml");
    #[rustfmt::skip] // a table
    let cases = [
        ("arrays.xml", "third-party/reference-fmus/StateSpace/FMI3.xml"),
        ("types-2.xml", "third-party/reference-fmus/Feedthrough/FMI2.xml"),
        ("types-3.xml", "third-party/reference-fmus/Feedthrough/FMI3.xml"),
        ("state-2.xml", "third-party/reference-fmus/VanDerPol/FMI2.xml"),
        ("units.xml", "fmus/slider.xml"),
    ];
    for (name, path) in cases {
        write(&folder.join(name), &file(path));
    }
    let entries = |second: &str| {
        vec![
            ("modelDescription.xml".to_owned(), ours.clone()),
            (second.to_owned(), b"no library".to_vec()),
        ]
    };
    let library = "binaries/x86_64-linux/slider.so";
    let of = |name: &str, second: &str| {
        let path = folder.join(name);
        fmus::write(&path, &entries(second));
        fs::read(&path).expect("it was just written")
    };
    let sound = of("sound.fmu", library);
    of("climbs-out.fmu", "../../outside");
    of("file-as-folder.fmu", "modelDescription.xml/x");
    let changed = |name: &str, place: usize, bytes: &[u8]| {
        let mut archive = sound.clone();
        archive[place..place + bytes.len()].copy_from_slice(bytes);
        write(&folder.join(name), &archive);
    };
    let places = sound.windows(4).enumerate();
    let listed = places.filter_map(|(place, mark)| (mark == b"PK\x01\x02").then_some(place));
    let [first, second] = listed.collect::<Vec<_>>()[..] else {
        panic!("two entries are listed");
    };
    changed(
        "link.fmu",
        second + 38,
        &(0o120_777_u32 << 16).to_le_bytes(),
    );
    changed("encrypted.fmu", second + 8, &[1, 0]);
    changed("shared-bytes.fmu", second + 42, &[0; 4]);
    // States an unpacked size of 600 MiB.
    changed("bomb.fmu", first + 10, &[8, 0]);
    let mut bomb = fs::read(folder.join("bomb.fmu")).expect("it was just written");
    bomb[first + 24..first + 28].copy_from_slice(&(600_u32 << 20).to_le_bytes());
    write(&folder.join("bomb.fmu"), &bomb);
    let end = sound.len() - 22;
    changed("list-elsewhere.fmu", end + 16, &[0xff, 0xff, 0xff, 0x7f]);
    write(&folder.join("cut-off.fmu"), &sound[..end + 10]);
    write(&folder.join("packed.fmu"), &packed(folder, &ours));
    let entities = "<!DOCTYPE d [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;\">]>\n<fmiModelDescription";
    let text = String::from_utf8(ours.clone()).expect("text");
    let bomb = text.replace("<fmiModelDescription", entities);
    write(&folder.join("entities.xml"), bomb.as_bytes());
}

/// Returns an archive whose only entry is compressed, in a stored block.
fn packed(folder: &Path, content: &[u8]) -> Vec<u8> {
    let length = u16::try_from(content.len()).expect("short");
    let mut block = vec![1];
    block.extend(length.to_le_bytes());
    block.extend((!length).to_le_bytes());
    block.extend(content);
    let path = folder.join("packed.fmu");
    fmus::write(&path, &[("modelDescription.xml".into(), block)]);
    let mut archive = fs::read(&path).expect("it was just written");
    let list = { archive.windows(4) }.rposition(|mark| mark == b"PK\x01\x02");
    for (method, sum, size) in [(8, 14, 22), (10, 16, 24)] {
        let head = if method == 8 {
            0
        } else {
            list.expect("a list")
        };
        archive[head + method] = 8;
        archive[head + sum..head + sum + 4]
            .copy_from_slice(&crc32fast::hash(content).to_le_bytes());
        let output = u32::from(length).to_le_bytes();
        archive[head + size..head + size + 4].copy_from_slice(&output);
    }
    archive
}

//! Tests of the frames of a port on real media.

use std::fs::File;
use std::io::Read;
use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::*;

/// Opens a port that sends samples, with the given media and frames.
fn wire(folder: &Path, text: &str) -> Wire {
    let text = format!("port = 1\n{text}");
    let port = Port::parse(&text, &folder.join("test.port.toml"), None).expect("a port file");
    Wire::open(&port, Carries::Sample, 0.001, folder).expect("opened")
}

/// Frame of a direction with one signal as `f64`.
fn frame(name: &str, carries: &str, signal: &str) -> String {
    format!(
        "[[frames]]\nname = \"{name}\"\ncarries = \"{carries}\"\nfields = [{{ signal = \"{signal}\", type = \"f64\" }}]\n"
    )
}

#[test]
fn only_the_frame_that_was_not_delivered_is_sent_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("peer");
    let peer = UnixDatagram::bind(&path).expect("a socket");
    peer.set_nonblocking(true).expect("a socket");
    let text = [
        "[[media]]\nkind = \"unix\"\npath = \"peer\"\n",
        &frame("first", "sample", "measured.a"),
        // Another length, by which it can be told apart.
        &frame("second", "sample", "measured.b").replace("f64", "f32"),
    ];
    let mut wire = wire(folder.path(), &text.concat());
    // The queue of the peer is full except for one place.
    let other = UnixDatagram::unbound().expect("a socket");
    other.set_nonblocking(true).expect("a socket");
    while other.send_to(b"other", &path).is_ok() {}
    let mut buffer = [0; 16];
    peer.recv(&mut buffer).expect("a frame of another program");
    wire.send(0, &[1.0, 2.0], &SignalSet::default())
        .expect("sent");
    let mut read = || {
        let mut frames = Vec::new();
        while let Ok(length) = peer.recv(&mut buffer) {
            frames.extend(match buffer[..length] {
                [a, b, c, d] => Some(f64::from(f32::from_le_bytes([a, b, c, d]))),
                ref bytes => bytes.try_into().ok().map(f64::from_le_bytes),
            });
        }
        frames
    };
    assert_eq!(read(), [1.0]);
    wire.send_again(0).expect("sent again");
    assert_eq!(read(), [2.0]);
    let counts = wire.counts();
    assert_eq!(counts.frames[0].sent, 1);
    assert_eq!(counts.frames[1].sent, 1);
    assert_eq!(counts.media[0].unsent, 1);
}

#[test]
fn a_frame_that_fits_a_serial_line_in_part_is_continued() {
    const LENGTH: usize = 4000;
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pair of terminals");
    grantpt(&master).expect("granted");
    unlockpt(&master).expect("unlocked");
    let device = ptsname(&master, Vec::new()).expect("a name");
    let device = device.to_str().expect("text");
    let folder = tempfile::tempdir().expect("a folder");
    let sync = "{ kind = \"constant\", type = \"u16\", value = 0x55AA }";
    let text = format!(
        r#"
[[media]]
kind = "serial"
device = "{device}"

[[frames]]
name = "motion"
carries = "sample"
length = {LENGTH}
fields = [{sync}, {{ kind = "counter", type = "u16" }}, {{ signal = "measured.a", type = "f64" }}]

[[frames]]
name = "drive"
carries = "command"
fields = [{sync}, {{ signal = "command.b", type = "f64" }}]
"#
    );
    let mut wire = wire(folder.path(), &text);
    // Nobody reads, so that the line takes a part of a frame and then no more.
    for step in 0..40 {
        wire.send(step, &[1.0], &SignalSet::default())
            .expect("sent");
    }
    assert!(wire.counts().media[0].unsent > 0, "the line was never full");
    let mut reader = File::from(master);
    let (mut bytes, mut buffer) = (Vec::new(), [0; LENGTH]);
    let mut read = |wire: &mut Wire| {
        while bytes.len() < LENGTH * wire.counts().frames[0].sent as usize {
            wire.receive().expect("nothing arrives");
            let mut ready = [PollFd::new(&reader, PollFlags::IN)];
            // The line takes the rest of a frame some time after it was read.
            let pause = Timespec {
                tv_sec: 0,
                tv_nsec: 1_000_000,
            };
            if poll(&mut ready, Some(&pause)).expect("polled") > 0 {
                let count = reader.read(&mut buffer).expect("read");
                bytes.extend_from_slice(&buffer[..count]);
            }
        }
    };
    read(&mut wire);
    wire.send(40, &[1.0], &SignalSet::default()).expect("sent");
    read(&mut wire);
    let mut last = None;
    for frame in bytes.chunks(LENGTH) {
        assert_eq!(frame[..2], [0xAA, 0x55]);
        let counter = u16::from_le_bytes([frame[2], frame[3]]);
        assert!(last < Some(counter), "{last:?} before {counter}");
        last = Some(counter);
        assert!(frame[12..].iter().all(|byte| *byte == 0));
    }
}

/// Port that reads a command from a file of text.
fn from_file(folder: &Path, path: &str) -> Wire {
    let text = format!(
        "[[media]]\nkind = \"file\"\npath = \"{path}\"\n\n[[frames]]\nname = \"level\"\ncarries = \"command\"\nformat = \"json\"\nfields = [{{ signal = \"command.a\", path = \"\" }}]\n"
    );
    wire(folder, &text)
}

#[test]
fn an_empty_or_garbled_file_is_refused_and_an_equal_value_is_accepted() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("level");
    let write = |text: &str| std::fs::write(&path, text).expect("written");
    write("");
    let mut wire = from_file(folder.path(), "level");
    let mut receive = |step| {
        wire.send(step, &[], &SignalSet::default()).expect("sent");
        wire.receive().expect("read");
        let counts = wire.counts();
        (counts.frames[0].accepted, counts.frames[0].refused)
    };
    // A step reads twice: what arrived before its sample, and the answer.
    assert_eq!(receive(0), (0, 2));
    write("12 volts\n");
    assert_eq!(receive(1), (0, 4));
    write("12\n");
    assert_eq!(receive(2), (2, 4));
    assert_eq!(receive(3), (4, 4));
}

#[test]
fn a_file_that_cannot_be_read_is_refused_and_ends_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    // Address 0 is mapped by no program.
    let mut wire = from_file(folder.path(), "/proc/self/mem");
    wire.send(0, &[], &SignalSet::default()).expect("sent");
    wire.receive().expect("no end");
    assert_eq!(wire.counts().frames[0].refused, 2);
    assert_eq!(wire.awaited(0), Some(0));
}

#[test]
fn a_datagram_with_more_frames_than_a_page_is_read_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let to = peer.local_addr().expect("an address");
    let can = |name: &str, carries: &str, id: u16, signal: &str| {
        frame(name, carries, signal).replace("fields", &format!("id = {id}\nfields"))
    };
    let text = [
        format!("[[media]]\nkind = \"cannelloni\"\nto = \"{to}\"\n"),
        can("motion", "sample", 1, "measured.a"),
        can("drive", "command", 2, "command.b"),
    ];
    let mut wire = wire(folder.path(), &text.concat());
    wire.send(0, &[1.0], &SignalSet::default()).expect("sent");
    let mut buffer = [0; 64];
    let (_, own) = peer.recv_from(&mut buffer).expect("a sample");
    const COUNT: u16 = 3000;
    let mut datagram = vec![2, 0, 0];
    datagram.extend(COUNT.to_be_bytes());
    for number in 0..COUNT {
        datagram.extend([0, 0, 0, 2, 8]);
        datagram.extend(f64::from(number).to_le_bytes());
    }
    peer.send_to(&datagram, own).expect("sent");
    wire.receive().expect("received");
    assert_eq!(wire.counts().frames[1].accepted, u64::from(COUNT));
    assert_eq!(wire.row().values(), [f64::from(COUNT - 1)]);
}

#[test]
fn a_counter_that_jumps_is_an_answer_of_a_controller_and_no_sign_of_a_plant() {
    let folder = tempfile::tempdir().expect("a folder");
    for (sends, receives, signal) in [
        (Carries::Sample, "command", "command.a"),
        (Carries::Command, "sample", "measured.a"),
    ] {
        let text = format!(
            "port = 1\n[[media]]\nkind = \"unix\"\npath = \"{receives}\"\nlistens = true\n[[frames]]\nname = \"one\"\ncarries = \"{receives}\"\nfields = [{{ kind = \"counter\", type = \"u8\", max_jump = 3 }}, {{ signal = \"{signal}\", type = \"u8\" }}]\n"
        );
        let file = folder.path().join("test.port.toml");
        let port = Port::parse(&text, &file, None).expect("a port file");
        let mut wire = Wire::open(&port, sends, 0.001, folder.path()).expect("opened");
        let peer = UnixDatagram::bind(folder.path().join(signal)).expect("a socket");
        for (counter, is_heard) in [(0, true), (9, sends == Carries::Sample), (10, true)] {
            wire.begin();
            peer.send_to(&[counter, 1], folder.path().join(receives))
                .expect("sent");
            wire.receive().expect("a medium");
            assert_eq!(wire.has_heard(), is_heard, "{receives} {counter}");
            assert_eq!(wire.awaited(0).is_none(), is_heard, "{receives} {counter}");
        }
    }
}

#[test]
fn frames_behind_an_answer_wait_for_the_next_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let to = peer.local_addr().expect("an address");
    let text = [
        format!("[[media]]\nkind = \"udp\"\nto = \"{to}\"\n"),
        frame("motion", "sample", "measured.a"),
        frame("drive", "command", "command.b"),
    ];
    let mut wire = wire(folder.path(), &text.concat());
    for (step, value) in [(0, 1.0), (1, 2.0)] {
        wire.send(step, &[0.0], &SignalSet::default())
            .expect("sent");
        let mut buffer = [0; 16];
        let (_, own) = peer.recv_from(&mut buffer).expect("a sample");
        peer.send_to(b"early", own).expect("sent");
        peer.send_to(&f64::to_le_bytes(value), own).expect("sent");
        peer.send_to(b"late", own).expect("sent");
        peer.send_to(&f64::to_le_bytes(9.0), own).expect("sent");
        wire.receive_answers(step).expect("received");
        assert_eq!(wire.awaited(step), None);
        assert_eq!(
            (wire.row().values()[0], wire.row().is_valid(0)),
            (value, true)
        );
    }
    let counts = &wire.counts().frames[1];
    assert_eq!((counts.accepted, counts.refused, counts.unasked), (3, 3, 1));
}

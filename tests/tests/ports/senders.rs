//! Senders that a port does not expect: another program, a peer that floods, and bytes that are no frames.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};

use serde_json::Value;

use super::{PEER, scenario};
use crate::support::harness::{EXPIRES_S, Rig, text, until};

/// Law of the peers: gain, bias and number of answers.
const LAW: [&str; 3] = ["20", "0.5", "1000000"];

/// Runs the scenario into the folder `out`; returns the summary and the log of the port.
fn run(rig: &Rig) -> (Value, String) {
    let arguments = ["run", "wire.toml", "--out", "out", "--json"];
    let summary = rig.hil_in(&rig.path(""), &arguments).expect(0).json();
    let log = std::fs::read_to_string(rig.path("out/controller.log")).expect("a log");
    (summary, log)
}

/// Returns the end of the line of a log that begins with this text.
fn after<'a>(log: &'a str, begin: &str) -> &'a str {
    let line = log.lines().find_map(|line| line.split_once(begin));
    line.unwrap_or_else(|| panic!("{begin}: {log}")).1
}

/// Peer with a second sender at another address, which sends in front of each answer.
fn with_another() -> String {
    PEER.replace(
        "print(\"ready\"",
        "other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\nother.bind((\"127.0.0.1\", 0))\nprint(\"other\", \"%s:%d\" % other.getsockname(), flush=True)\nprint(\"ready\"",
    )
    .replace(
        "    peer.sendto",
        "    other.sendto(b\"\\x07\\xff\", sender)\n    peer.sendto",
    )
}

#[test]
fn a_second_sender_is_named_with_its_address_and_bytes() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    rig.write("peer.py", &with_another());
    let (summary, log) = run(&rig);
    let other = after(&log, "peer: other ");
    let medium = &summary["port"]["media"][0];
    // At step 0 the peer has not spoken yet, so that the other one is taken for it and its frame is refused.
    assert_eq!(medium["strangers"], 199, "{medium}");
    assert_eq!(medium["first_stranger"], *other);
    let note = format!("medium `udp`: a frame of {other}, while the peer is 127.0.0.1:");
    let rest = after(&log, &note);
    assert!(rest.contains("; bytes: 07 ff "), "{rest}");
    assert_eq!(log.matches(&note).count(), 1, "{log}");
}

#[test]
fn a_second_sender_is_named_in_the_error_of_a_silent_peer() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    // The peer falls silent after 100 answers.
    let silent = with_another().replace("    peer.sendto", "    if _ < 100: peer.sendto");
    rig.write("peer.py", &silent);
    let limit = EXPIRES_S.to_string();
    let arguments = ["run", "wire.toml", "--out", "out", "--wait-limit", &limit];
    let run = rig.hil_in(&rig.path(""), &arguments).expect(3);
    let log = std::fs::read_to_string(rig.path("out/controller.log")).expect("a log");
    let other = after(&log, "peer: other ");
    run.says(&[&format!("of other senders (the first is {other})")]);
}

#[test]
fn a_peer_that_floods_without_an_answer_is_named_with_its_rate() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let flood = "    while True: peer.sendto(b\"garbage\", sender)\n    peer.sendto";
    rig.write("peer.py", &PEER.replace("    peer.sendto", flood));
    let limit = EXPIRES_S.to_string();
    let arguments = ["run", "wire.toml", "--out", "out", "--wait-limit", &limit];
    let run = rig.hil_in(&rig.path(""), &arguments).expect(3);
    run.says(&[
        "frame `drive` has 7 bytes and needs 8; bytes: 67 61 72 62 61 67 65 ",
        "no frame `drive` within ",
        " refused",
        "; a flood of ",
        " frames a second",
    ]);
    rig.assert_nothing_left();
}

#[test]
fn garbage_behind_each_answer_changes_no_command() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let (plain, _) = run(&rig);
    std::fs::remove_dir_all(rig.path("out")).expect("removed");
    let answer = "    for _ in range(3): peer.sendto(b\"garbage\", sender)\n";
    rig.write(
        "peer.py",
        &PEER.replace("sys.exit", &format!("{answer}sys.exit")),
    );
    let (flooded, _) = run(&rig);
    assert_eq!(flooded["digest"], plain["digest"]);
    assert_eq!(flooded["held_commands"], plain["held_commands"]);
    let refused = flooded["port"]["frames"][1]["refused"].as_u64();
    // Those behind the last answer may not be read.
    assert!(
        (597..=600).contains(&refused.expect("a count")),
        "{refused:?}"
    );
}

#[test]
fn a_frame_longer_than_any_is_named_with_its_real_size() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let long = "    peer.sendto(bytes(60000), sender)\n    peer.sendto";
    rig.write("peer.py", &PEER.replace("    peer.sendto", long));
    let (summary, log) = run(&rig);
    assert_eq!(summary["port"]["frames"][1]["refused"], 200);
    let rest = after(
        &log,
        "frame `drive` has 60000 bytes, more than its 8; bytes: 00 00 ",
    );
    assert!(rest.contains(" .. (60000 in all)"), "{rest}");
}

#[test]
fn a_datagram_that_is_none_of_cannellonis_is_named_with_its_bytes() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(path).expect("it was written");
    let text = (text.replace("kind = \"udp\"", "kind = \"cannelloni\""))
        .replacen("carries", "id = 0x101\ncarries", 1)
        .replace("carries = \"command\"", "id = 0x102\ncarries = \"command\"");
    rig.write("bench.port.toml", &text);
    let peer = PEER
        .replace("\"<d\", data)", "\"<d\", data[10:])")
        .replace("struct.pack(\"<d\", ", "struct.pack(\">BBBHIB\", 2, 0, 0, 1, 0x102, 8) + struct.pack(\"<d\", ")
        // One datagram is of version 1, and one ends in its second frame.
        .replace("    peer.sendto", "    peer.sendto(bytes([1, 0, 7, 0, 0]), sender)\n    peer.sendto(bytes([2, 0, 0, 0, 2, 0, 0, 1, 2, 0, 9]), sender)\n    peer.sendto");
    rig.write("peer.py", &peer);
    let (summary, log) = run(&rig);
    assert_eq!(summary["port"]["frames"][1]["accepted"], 200);
    assert_eq!(summary["port"]["media"][0]["skipped_bytes"], 200 * (5 + 11));
    let rest = after(
        &log,
        "medium `cannelloni`: a datagram that is none of cannelloni's: its version is 1 and not 2, instead of frame `drive`; bytes: ",
    );
    assert!(rest.starts_with("01 00 07 00 00 "), "{rest}");
}

/// Writes a port whose peer connects to this address and speaks lines of JSON.
fn lines(rig: &Rig, address: &str) {
    rig.write(
        "bench.port.toml",
        &format!(
            r#"port = 1
name = "bench"
[[media]]
kind = "tcp"
listen = "{address}"
[[frames]]
name = "motion"
carries = "sample"
format = "json"
fields = [{{ signal = "measured.position_m", path = "x" }}]
[[frames]]
name = "drive"
carries = "command"
format = "json"
fields = [{{ signal = "command.force_n", path = "f" }}]
"#
        ),
    );
}

#[test]
fn a_peer_on_a_stream_that_starts_again_gets_the_sample_that_it_has_not_answered() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let (plain, _) = run(&rig);
    std::fs::remove_dir_all(rig.path("out")).expect("removed");
    let path = rig.path("bench.port.toml");
    let text = std::fs::read_to_string(path).expect("it was written");
    let stream = "kind = \"unix\"\npath = \"peer\"\nsocket = \"stream\"\n\n[[frames]]";
    let (head, rest) = text.split_once("kind = \"udp\"").expect("a medium");
    let (_, frames) = rest.split_once("[[frames]]").expect("frames");
    rig.write("bench.port.toml", &format!("{head}{stream}{frames}"));
    // The first program reads a sample and ends in front of its answer.
    let peer = PEER
        .replace("AF_INET, socket.SOCK_DGRAM", "AF_UNIX, socket.SOCK_STREAM")
        .replace("(\"127.0.0.1\", int(sys.argv[1]))", "\"peer\"")
        .replace("print(\"ready\"", "peer.listen()\nprint(\"ready\"")
        .replace("for _ in range(answers):", "end, count = None, 0\nwhile True:\n    end = end or peer.accept()[0]")
        .replace("data, sender = peer.recvfrom(4096)", "data = end.recv(8)")
        .replace(
            "    (position_m,)",
            "    count += 1\n    if count == 100:\n        end.close()\n        end = None\n        continue\n    (position_m,)",
        )
        .replace("peer.sendto(", "end.sendall(")
        .replace(", sender)", ")");
    rig.write("peer.py", &peer);
    let (again, log) = run(&rig);
    assert_eq!(again["digest"], plain["digest"]);
    assert_eq!(again["port"]["media"][0]["new_peers"], 1);
    after(&log, "medium `unix`: process ");
}

#[test]
fn a_second_client_and_a_line_that_is_too_long_are_named() {
    let rig = Rig::new();
    let Some(()) = scenario(&rig, LAW) else {
        return;
    };
    let free = TcpListener::bind("127.0.0.1:0").expect("a listener");
    let address = free.local_addr().expect("an address").to_string();
    drop(free);
    lines(&rig, &address);
    let [scenario, out] = ["wire.toml", "out"].map(|name| rig.path(name));
    let session = ["--session", rig.session(), "--wait-limit", "60"];
    let run = ["run", text(&scenario), "--out", text(&out)];
    let running = rig.start_hil(&[&run[..], &session].concat());
    let connect = || {
        let mut end = None;
        until("the port", || {
            end = TcpStream::connect(&address).ok();
            end.is_some()
        });
        end.expect("connected")
    };
    let mut peer = BufReader::new(connect());
    let mut line = String::new();
    peer.read_line(&mut line).expect("a sample");
    let other = connect();
    let own = other.local_addr().expect("an address");
    let mut end = peer.get_ref().try_clone().expect("a socket");
    (end.write_all(&[b'x'; 5000])).expect("written");
    end.write_all(b"\n").expect("written");
    // The log names the other one while the peer may still answer.
    until("a note", || {
        let log = std::fs::read_to_string(rig.path("out/controller.log")).unwrap_or_default();
        log.contains(&own.to_string())
    });
    loop {
        if end.write_all(b"{\"f\": 0.5}\n").is_err() {
            break;
        }
        line.clear();
        if peer.read_line(&mut line).unwrap_or(0) == 0 {
            break;
        }
    }
    running.finish().expect(0);
    let log = std::fs::read_to_string(rig.path("out/controller.log")).expect("a log");
    after(
        &log,
        &format!("medium `tcp`: {own} has connected beside the peer, 127.0.0.1:"),
    );
    after(
        &log,
        "medium `tcp`: a line of more than 4096 bytes, instead of frame `drive`; bytes: 78 78 ",
    );
    let summary = std::fs::read_to_string(rig.path("out/summary.json")).expect("a summary");
    let summary: Value = serde_json::from_str(&summary).expect("JSON");
    let medium = &summary["port"]["media"][0];
    assert_eq!(medium["strangers"], 1);
    assert_eq!(medium["first_stranger"], own.to_string());
    assert_eq!(medium["skipped_bytes"], 5001);
}

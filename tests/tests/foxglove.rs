//! `hil monitor --foxglove`: an independent client receives the recorded data.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::support::company::Companion;
use crate::support::harness::{Rig, ended, send};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, skip, workspace};
use crate::support::python::python;

const FIELD: &str = "truth.position_m";

/// Monitor that serves the session of a test.
struct Server {
    process: Companion,
    /// Kept open: it still has output.
    _stderr: BufReader<ChildStderr>,
    url: String,
}

impl Server {
    fn start(rig: &Rig, arguments: &[&str]) -> Self {
        let mut hil = rig.command(program("hil"));
        hil.args(["monitor", "--session", rig.session(), "--foxglove", "0"])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut process = Companion::start(&mut hil);
        let mut text = String::new();
        let mut stderr = BufReader::new(process.stderr.take().expect("piped"));
        stderr.read_line(&mut text).expect("it tells where");
        let url = text
            .split_ascii_whitespace()
            .find(|word| word.starts_with("ws://"));
        let url = url.unwrap_or_else(|| panic!("{text}")).to_owned();
        Self {
            process,
            _stderr: stderr,
            url,
        }
    }

    fn address(&self) -> &str {
        self.url.trim_start_matches("ws://")
    }

    /// Waits for the end of the program; returns its output.
    fn finish(mut self) -> (Option<i32>, String) {
        let status = ended(&mut self.process);
        let mut text = String::new();
        let stdout = self.process.stdout.as_mut().expect("piped");
        stdout.read_to_string(&mut text).expect("text");
        (status.code(), text)
    }
}

/// Client with the messages received so far.
struct Client {
    process: Child,
    lines: BufReader<ChildStdout>,
}

impl Client {
    fn start(python: &std::path::Path, server: &Server, subprotocol: &str) -> Self {
        let script = workspace().join("tests/python/foxglove_client.py");
        let mut process = Command::new(python)
            .arg(script)
            .args([&server.url, subprotocol, FIELD])
            .stdout(Stdio::piped())
            .spawn()
            .expect("python");
        let lines = BufReader::new(process.stdout.take().expect("piped"));
        Self { process, lines }
    }

    fn next(&mut self) -> Option<Value> {
        let mut line = String::new();
        self.lines.read_line(&mut line).expect("text");
        (!line.is_empty()).then(|| serde_json::from_str(&line).expect("JSON"))
    }

    /// Reads all messages until the connection is closed.
    fn rest(&mut self) -> Vec<Value> {
        let rest: Vec<Value> = std::iter::from_fn(|| self.next()).collect();
        assert!(self.process.wait().expect("our child").success());
        rest
    }
}

#[test]
fn a_client_receives_the_recorded_records_and_changes_nothing() {
    let Some(python) = python("mcap_ros2, websockets.sync.client") else {
        let why = "there is no Python with mcap-ros2-support and websockets";
        return skip(why, "HIL_TEST_PYTHON");
    };
    let rig = Rig::new();
    let alone = rig.run("scenarios/spring-mass.toml").expect(0).digest();

    let run = rig.start("scenarios/spring-mass.toml --pace 10 --pause-at 0.001 --wait-limit 60");
    rig.until_held_at(1);
    let server = Server::start(&rig, &["--rate", "500"]);
    let mut clients: Vec<Client> = ["foxglove.websocket.v1", "foxglove.sdk.v1"]
        .map(|subprotocol| Client::start(&python, &server, subprotocol))
        .into();
    for (client, subprotocol) in clients
        .iter_mut()
        .zip(["foxglove.websocket.v1", "foxglove.sdk.v1"])
    {
        assert_eq!(client.next(), Some(json!({"subprotocol": subprotocol})));
        let info = client.next().expect("who serves");
        assert_eq!(info["said"]["op"], "serverInfo");
        assert_eq!(info["said"]["metadata"]["scenario"], "spring-mass");
        let channels = client.next().expect("channels");
        let topics: Vec<&Value> = (channels["said"]["channels"]
            .as_array()
            .expect("a list")
            .iter())
        .map(|channel| &channel["topic"])
        .collect();
        assert_eq!(topics, ["/record", "/events"]);
        // This answer shows that the subscriptions arrived, too.
        let refused = client.next().expect("an answer");
        assert_eq!(refused["said"]["op"], "status", "{refused}");
        let message = refused["said"]["message"].as_str().expect("text");
        assert!(message.contains("`setParameters`"), "{message}");
    }
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    assert_eq!(run.digest(), alone);

    let recorded = recorded(&Recording::open(&run.recording()));
    for client in &mut clients {
        let rest = client.rest();
        assert_eq!(rest.last(), Some(&json!({"closed": true})));
        let of = |topic: &str| -> Vec<Value> {
            let mut messages = rest.clone();
            messages.retain(|message| message["topic"] == topic);
            messages
        };
        let records = of("/record");
        let wall_time_s = run.summary()["wall_time_s"].as_f64().expect("a time");
        let most = 500.0 * wall_time_s + 2.0;
        let count = records.len();
        assert!(
            (3.0..most).contains(&(count as f64)),
            "{count} of at most {most}"
        );
        let mut last = None;
        for record in &records {
            let step = record["content"]["step"].as_u64().expect("a step");
            assert!(last < Some(step), "steps rise");
            last = Some(step);
            let value = record["content"]["value"].as_f64().expect("a number");
            let log_time_ns = record["log_time"].as_u64().expect("a time");
            assert_eq!(
                (log_time_ns, value.to_bits()),
                recorded[&step],
                "step {step}"
            );
        }
        let events = of("/events");
        assert_eq!(events.last().expect("one")["content"]["event"], "end");
        let output = rest.iter().rev().find(|line| line["said"]["id"] == "ended");
        let output = output.expect("the end is told")["said"]["message"].to_string();
        assert!(output.contains("spring-mass ended: pass"), "{output}");
    }
    let (code, text) = server.finish();
    assert_eq!(code, Some(0));
    assert!(
        text.starts_with("spring-mass ended: pass, 5000 steps"),
        "{text}"
    );
    rig.assert_nothing_left();
}

/// Returns log time and value of the field at each step.
fn recorded(recording: &Recording) -> BTreeMap<u64, (u64, u64)> {
    let at = recording.columns.iter().position(|column| column == FIELD);
    let at = at.expect("it is recorded");
    (recording.records())
        .map(|record| (record.step(), (record.log_time_ns, record.words[at])))
        .collect()
}

#[test]
fn a_client_with_another_protocol_is_refused_and_delays_nobody() {
    let rig = Rig::new();
    let run = rig.held();
    let server = Server::start(&rig, &[]);
    // A silent client, one that sends nonsense, one with another protocol.
    let _silent = TcpStream::connect(server.address()).expect("it listens");
    let mut nonsense = TcpStream::connect(server.address()).expect("it listens");
    nonsense
        .write_all(b"\0\xff\r\n\r\n")
        .expect("it takes bytes");
    let mut other = TcpStream::connect(server.address()).expect("it listens");
    let request = "GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
                   Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\
                   Sec-WebSocket-Protocol: chat\r\n\r\n";
    other.write_all(request.as_bytes()).expect("it takes bytes");
    let mut answer = String::new();
    other.read_to_string(&mut answer).expect("it closes");
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    assert!(answer.contains("foxglove.websocket.v1"), "{answer}");
    rig.in_session(&format!("monitor --foxglove {}", server.address()))
        .expect(3)
        .says(&["cannot serve at"]);
    rig.in_session("monitor --foxglove nowhere")
        .expect(2)
        .says(&["a port or an address"]);
    send(server.process.id(), Signal::TERM);
    assert_eq!(server.finish().0, Some(130));
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

//! Panels of recorded runs: what is refused, and readings and figures compared with the records.

use std::net::TcpStream;

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use super::{Panel, SCENARIO};
use crate::panel_socket::{connected, parts};
use crate::support::harness::{Rig, WATCHDOG, send};
use crate::support::mcap_reader::Recording;

/// Page without a browser.
pub(super) struct Page {
    socket: WebSocket<TcpStream>,
    pub(super) about: Value,
}

/// Signals over a part of a run, parsed like in the page.
struct Reading {
    first: u64,
    length: u64,
    /// Least and greatest values of each signal.
    signals: Vec<(usize, Vec<[f64; 2]>)>,
}

impl Page {
    pub(super) fn open(url: &str) -> Self {
        let mut socket = connected(url);
        let limit = socket.get_ref().set_read_timeout(Some(WATCHDOG));
        limit.expect("a limit");
        let (_, secret) = parts(url);
        let greeting = json!({ "secret": secret }).to_string();
        socket.send(greeting.into()).expect("sent");
        let mut page = Self {
            socket,
            about: Value::Null,
        };
        page.about = page.hear("about");
        page
    }

    pub(super) fn say(&mut self, message: &Value) {
        let sent = self.socket.send(message.to_string().into());
        sent.expect("it takes messages");
    }

    /// Reads up to a message of this kind.
    pub(super) fn hear(&mut self, kind: &str) -> Value {
        loop {
            if let Message::Text(text) = self.socket.read().expect("a message") {
                let message: Value = serde_json::from_str(&text).expect("JSON");
                if message["tell"] == kind {
                    return message;
                }
            }
        }
    }

    fn read(&mut self, span: [u64; 2], most: u64, signals: &[usize]) -> Reading {
        self.read_of(false, span, most, signals)
    }

    /// Reads signals of the run or of the one that is laid over it.
    fn read_of(
        &mut self,
        over: bool,
        [from, to]: [u64; 2],
        most: u64,
        signals: &[usize],
    ) -> Reading {
        self.say(&json!({
            "ask": "read", "number": 7, "from": from, "to": to, "most": most, "signals": signals, "over": over,
        }));
        loop {
            let Message::Binary(bytes) = self.socket.read().expect("a message") else {
                continue;
            };
            let (words, rest) = bytes.as_chunks::<8>();
            assert!(rest.is_empty());
            let kind = u64::from_le_bytes(words[0]);
            if kind & 0xff != 2 {
                continue; // points of the session, not the answer
            }
            assert_eq!(kind, 2 | u64::from(over) << 8 | 7 << 32);
            let mut numbers = words[1..].iter().map(|word| f64::from_le_bytes(*word));
            let mut next = || numbers.next().expect("a number");
            let [first, length, count, all] = [(); 4].map(|()| next() as u64);
            let signals = (0..all).map(|_| {
                let index = next() as usize;
                let range = |_| {
                    let least = next();
                    [least, if length == 1 { least } else { next() }]
                };
                (index, (0..count).map(range).collect())
            });
            let signals = signals.collect();
            assert_eq!(numbers.next(), None);
            return Reading {
                first,
                length,
                signals,
            };
        }
    }

    /// Returns the index of a signal.
    fn place(&self, name: &str) -> usize {
        let signals = self.about["signals"].as_array().expect("signals");
        let place = signals.iter().position(|one| one["name"] == name);
        place.unwrap_or_else(|| panic!("no {name} in {}", self.about))
    }
}

#[test]
fn a_recorded_run_is_read_step_by_step_or_by_its_extremes() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let mut panel = Panel::recorded(&rig, &run.folder, &[]);
    let mut page = Page::open(&panel.url);
    assert_eq!(page.about["recorded"], true);
    assert_eq!(page.about["steps"], 5000);
    let state = page.hear("state");
    assert_eq!(state["ending"]["verdict"], "pass");
    assert_eq!(state["requirements"].as_array().map(Vec::len), Some(2));

    let recording = Recording::open(&run.recording());
    let names = ["truth.position_m", "command.force_n", "tracking_error_m"];
    let places = names.map(|name| page.place(name));
    let (truth, reference) = (
        recording.column("truth.position_m"),
        recording.column("reference.position_m"),
    );
    let error: Vec<f64> = truth.iter().zip(&reference).map(|(a, b)| a - b).collect();
    let columns = [truth, recording.column("command.force_n"), error];
    for (span, most, length) in [
        ([1234, 1300], 800, 1),
        ([0, 5000], 800, 9),
        ([700, 4900], 100, 45),
        ([0, 5000], 2048, 3),
        ([4990, 9999], 800, 1),
    ] {
        let reading = page.read(span, most, &places);
        assert_eq!(reading.length, length, "{span:?}");
        assert_eq!(reading.first, span[0] / length * length);
        for ((index, ranges), (place, column)) in
            reading.signals.iter().zip(places.iter().zip(&columns))
        {
            assert_eq!(index, place);
            for (nth, range) in (0..).zip(ranges) {
                let begin = reading.first + nth * length;
                // A wide reading has every step of its last stretch.
                let last = if length == 1 { span[1].min(5000) } else { 5000 };
                let steps = (begin..begin + length).filter(|step| *step <= last);
                let values = steps.map(|step| column[step as usize]);
                let values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
                let least = values.iter().copied().min_by(f64::total_cmp);
                let greatest = values.iter().copied().max_by(f64::total_cmp);
                let expected = [least, greatest].map(|one| one.unwrap_or(f64::NAN).to_bits());
                assert_eq!(range.map(f64::to_bits), expected, "{span:?} {nth}");
            }
        }
    }

    page.say(
        &json!({ "ask": "measure", "number": 3, "from": 1250, "to": 1750, "signals": places }),
    );
    let measured = page.hear("measured");
    assert_eq!(
        (&measured["length"], &measured["number"]),
        (&json!(1), &json!(3))
    );
    for (figures, column) in measured["signals"]
        .as_array()
        .expect("figures")
        .iter()
        .zip(&columns)
    {
        let part = &column[1250..=1750];
        let count = part.len() as f64;
        let mean = part.iter().sum::<f64>() / count;
        let rms = (part.iter().map(|value| value * value).sum::<f64>() / count).sqrt();
        let is_near = |name: &str, expected: f64| {
            let value = figures[name].as_f64().expect("a number");
            assert!(
                (value - expected).abs() <= 1e-12 * rms,
                "{name}: {value} {expected}"
            );
        };
        is_near("mean", mean);
        is_near("rms", rms);
        let ends = [part[0], part[500]].map(|value| json!(value));
        assert_eq!(figures["at"], json!(ends));
        assert_eq!(figures["count"], 501);
    }

    // No action reaches anything, and what is no request closes the connection.
    page.say(&json!({ "ask": "do", "number": 1, "action": { "kind": "pause" } }));
    page.say(&json!({ "ask": "read", "number": 1, "from": 5, "to": 4, "most": 1, "signals": [] }));
    while page.socket.read().is_ok() {}
    send(panel.process.id(), rustix::process::Signal::INT);
    assert_eq!(panel.wait(), Some(0));
}

#[test]
fn only_complete_recordings_of_ended_runs_are_opened() {
    let rig = Rig::new();
    let refused = |run: &std::path::Path, more: &[&str], texts: &[&str]| {
        let path = run.display().to_string();
        let arguments = [&["panel", "--no-open", path.as_str()], more].concat();
        rig.beside(&arguments).expect(2).says(texts);
    };
    refused(&rig.path("nothing"), &[], &["nothing", "No such file"]);
    let text = rig.write("notes.txt", "these are notes");
    refused(&text, &[], &["notes.txt"]);
    let run = rig.run(SCENARIO).expect(0);
    refused(
        &run.folder,
        &["--inject", "leek"],
        &["a recorded run takes none"],
    );
    refused(
        &run.folder,
        &["--signal", "truth.nothing"],
        &["no run has a signal"],
    );
    refused(&run.folder, &["--session", "x"], &["cannot be used with"]);
    let bytes = std::fs::read(run.recording()).expect("the recording");
    let torn = rig.path("torn.mcap");
    std::fs::write(&torn, &bytes[..bytes.len() / 2]).expect("written");
    refused(&torn, &[], &["was cut off after", "hil recover"]);
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 1;
    let damaged = rig.path("damaged.mcap");
    std::fs::write(&damaged, &changed).expect("written");
    refused(&damaged, &[], &["damaged.mcap"]);
    refused(
        &run.folder,
        &["--over", damaged.to_str().expect("text")],
        &["damaged.mcap"],
    );

    let held = rig.held();
    let folder = held.folder().to_owned();
    refused(&folder, &[], &["is still writing", "shows a session"]);
    rig.in_session("resume").expect(0);
    held.finish().expect(0);
}

#[test]
fn a_session_has_a_recorded_run_behind_it_at_the_same_rate() {
    let rig = Rig::new();
    let recorded = rig.run(SCENARIO).expect(0);
    let slow = rig.run(&format!(
        "{SCENARIO} --set run.rate_hz=500 --set requirements=[]"
    ));
    let slow = slow.expect(0);
    let [over, slow] = [&recorded, &slow].map(|run| run.folder.to_str().expect("text").to_owned());
    let run = rig.held();
    for arguments in [
        &[
            "panel",
            "--no-open",
            "--session",
            rig.session(),
            "--over",
            &slow,
        ][..],
        &["panel", "--no-open", &over, "--over", &slow],
    ] {
        let texts = ["was recorded at 500 Hz, but the other run has 1000 Hz"];
        rig.beside(arguments).expect(2).says(&texts);
    }
    let panel = Panel::start(&rig, &["--over", &over]);
    let mut page = Page::open(&panel.url);
    assert!(
        page.about["over"]
            .as_str()
            .expect("a path")
            .ends_with(&over)
    );
    let place = page.place("truth.position_m");
    let reading = page.read_of(true, [600, 700], 800, &[place]);
    let column = Recording::open(&recorded.recording()).column("truth.position_m");
    let (index, ranges) = &reading.signals[0];
    assert_eq!((*index, reading.first, reading.length), (place, 600, 1));
    let values: Vec<f64> = ranges.iter().map(|[value, _]| *value).collect();
    assert_eq!(values, column[600..=700]);
    assert_eq!(panel.interrupt(), Some(130));
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn a_vacuous_requirement_is_no_pass_in_the_panel() {
    let rig = Rig::new();
    let far = "[[requirements]]\nname = \"far\"\nformula = \"always(truth.position_m > 5 implies truth.position_m < 1)\"\n";
    let scenario = rig.write(
        "far.toml",
        &(crate::support::programs::shipped(SCENARIO) + far),
    );
    let run = rig.run(&format!("{} --link in-process", scenario.display()));
    let run = run.expect(0);
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let state = Page::open(&panel.url).hear("state");
    assert_eq!(state["ending"]["verdict_in_words"], "pass, 1 vacuous");
    assert_eq!(state["requirements"][2]["vacuous"], "truth.position_m > 5");
    assert_eq!(state["requirements"][0]["vacuous"], Value::Null);
}

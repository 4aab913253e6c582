//! Points sent to a page, compared with the recording; and a page that reads nothing.

use std::net::TcpStream;
use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use super::{Panel, SCENARIO};
use crate::panel_socket::{connected, parts};
use crate::support::harness::{Rig, Running, WATCHDOG, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

/// Points of a message, parsed like in the page.
pub(super) struct Points {
    pub(super) view: u32,
    pub(super) newest: u64,
    first: u64,
    /// Length of an interval in steps.
    length: u64,
    /// Newest value and intervals of each signal.
    signals: Vec<(f64, Vec<[f32; 2]>)>,
}

impl Points {
    fn read(bytes: &[u8]) -> Self {
        let word = |at: usize| <[u8; 8]>::try_from(&bytes[8 * at..8 * at + 8]).expect("8 bytes");
        let float = |at: usize| f64::from_le_bytes(word(at));
        let whole = |at: usize| float(at) as u64;
        let kind = u64::from_le_bytes(word(0));
        assert_eq!(kind & 0xff, 1, "points");
        let (count, signals) = (whole(4) as usize, whole(6) as usize);
        let ranges = &bytes[8 * (7 + signals)..];
        assert_eq!(ranges.len(), 8 * signals * count, "nothing more");
        let (halves, _) = ranges.as_chunks::<4>();
        let halves: Vec<f32> = halves.iter().map(|one| f32::from_le_bytes(*one)).collect();
        let (stretches, _) = halves.as_chunks::<2>();
        let of = |signal: usize| stretches[signal * count..(signal + 1) * count].to_vec();
        Self {
            view: (kind >> 32) as u32,
            newest: whole(2),
            first: whole(3),
            length: whole(5),
            signals: (0..signals)
                .map(|signal| (float(7 + signal), of(signal)))
                .collect(),
        }
    }
}

/// Page without a browser.
pub(super) struct Client {
    socket: WebSocket<TcpStream>,
}

impl Client {
    /// Connects like the page.
    pub(super) fn connected(url: &str) -> Self {
        let socket = connected(url);
        let limit = socket.get_ref().set_read_timeout(Some(WATCHDOG));
        limit.expect("a limit");
        Self { socket }
    }

    /// Connects and sends the secret.
    pub(super) fn greeted(url: &str) -> Self {
        let mut client = Self::connected(url);
        let (_, secret) = parts(url);
        client.say(&json!({ "secret": secret }));
        client
    }

    pub(super) fn say(&mut self, message: &Value) {
        let sent = self.socket.send(message.to_string().into());
        sent.expect("it takes messages");
    }

    pub(super) fn do_it(&mut self, action: &Value) {
        self.say(&json!({ "ask": "do", "number": 1, "action": action }));
    }

    pub(super) fn look(&mut self, number: u32, window_s: f64) {
        self.say(&json!({ "ask": "view", "number": number, "window_s": window_s }));
    }

    /// Returns the next message; acknowledges points.
    pub(super) fn next(&mut self) -> Result<Result<Value, Points>, tungstenite::Error> {
        loop {
            match self.socket.read()? {
                Message::Text(text) => return Ok(Ok(serde_json::from_str(&text).expect("JSON"))),
                Message::Binary(bytes) => {
                    let number = u64::from_le_bytes(bytes[8..16].try_into().expect("8 bytes"));
                    let _ = self.socket.send(
                        json!({ "ask": "seen", "number": number })
                            .to_string()
                            .into(),
                    );
                    return Ok(Err(Points::read(&bytes)));
                }
                Message::Close(_) => return Err(tungstenite::Error::ConnectionClosed),
                _ => {}
            }
        }
    }

    /// Reads up to a message of this kind.
    pub(super) fn until(&mut self, is_it: impl Fn(&Value) -> bool) -> Value {
        self.find(|next| next.ok().filter(&is_it))
    }

    /// Reads up to points of this kind.
    pub(super) fn until_points(&mut self, is_it: impl Fn(&Points) -> bool) -> Points {
        self.find(|next| next.err().filter(&is_it))
    }

    fn find<T>(&mut self, text: impl Fn(Result<Value, Points>) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            if let Some(text) = text(self.next().expect("more is told")) {
                return text;
            }
            assert!(began.elapsed() < WATCHDOG, "it is not told");
        }
    }

    /// Waits until the connection is closed.
    pub(super) fn until_closed(&mut self) -> Vec<Value> {
        let mut output = Vec::new();
        while let Ok(message) = self.next() {
            output.extend(message.ok());
        }
        output
    }
}

/// Returns the index of a signal among those described.
fn place(about: &Value, name: &str) -> usize {
    let signals = about["signals"].as_array().expect("signals");
    let place = signals.iter().position(|one| one["name"] == name);
    place.unwrap_or_else(|| panic!("no {name} in {about}"))
}

#[test]
fn points_are_the_extremes_of_all_their_records() {
    let rig = Rig::new();
    let spike = "\n[[faults]]\nkind = \"spike\"\nat_s = 0.789\neffects = [{ target = \"measured.position_m\", amplitude = 0.5 }]\n";
    let scenario = rig.write("spike.toml", &(shipped(SCENARIO) + spike));
    let run = held(&rig, &scenario, "--set requirements=[] --pause-at 0.001");
    let names = ["truth.position_m", "measured.position_m", "command.force_n"];
    let signals = names.map(|name| ["--signal", name]);
    let mut panel = Panel::start(&rig, signals.as_flattened());
    let mut client = Client::greeted(&panel.url);
    let about = client.until(|message| message["tell"] == "about");
    // In parts that fit an observer's queue, so that nothing is lost however slow the panel is.
    let mut state = client.until(|message| message["step"].is_u64());
    while state["state"] != "ended" {
        let last = state["step"].as_u64().expect("a step") + 1000;
        client.do_it(&json!({ "kind": "step", "steps": 1000 }));
        state = client
            .until(|message| message["state"] == "ended" || message["step"].as_u64() >= Some(last));
    }
    assert_eq!(state["lost"], 0);
    // A window longer than the run, a shorter one, and every step of a short one.
    let windows: Vec<Points> = [(1, 5.0), (2, 1.0), (3, 0.2)]
        .into_iter()
        .map(|(number, window_s)| {
            client.look(number, window_s);
            client.until_points(|points| points.view == number)
        })
        .collect();
    let run = run.finish().expect(0);
    drop(client);
    assert_eq!(panel.wait(), Some(0));

    let recording = Recording::open(&run.recording());
    let records: Vec<_> = recording.records().collect();
    assert_eq!(records.len(), 5001);
    for points in &windows {
        assert_eq!(points.newest, 5000);
        for name in names {
            let (newest, stretches) = &points.signals[place(&about, name)];
            let value = |step: u64| recording.value(&records[step as usize], name);
            // No command answers the last sample: the previous one stays.
            let last = if name.starts_with("command.") {
                4999
            } else {
                5000
            };
            assert_eq!(newest.to_bits(), value(last).to_bits(), "{name}");
            for (number, stretch) in (points.first..).zip(stretches) {
                let steps = number * points.length..(number + 1) * points.length;
                let there = steps.filter(|step| *step <= 5000).map(value);
                let there: Vec<f64> = there.filter(|value| value.is_finite()).collect();
                let least = there.iter().copied().min_by(f64::total_cmp);
                let greatest = there.iter().copied().max_by(f64::total_cmp);
                let expected = [least, greatest].map(|one| one.unwrap_or(f64::NAN));
                let result = stretch.map(f32::to_bits);
                assert_eq!(
                    result,
                    expected.map(|one| (one as f32).to_bits()),
                    "{name} {number}"
                );
            }
        }
    }
    // The spike of one step in 5,001 is present, however many steps an interval has.
    let (_, stretches) = &windows[0].signals[place(&about, "measured.position_m")];
    assert!(windows[0].length > 1 && stretches.iter().any(|[_, most]| *most > 0.4));
}

/// Starts a scenario and waits until it is paused.
pub(super) fn held<'r>(rig: &'r Rig, scenario: &Path, options: &str) -> Running<'r> {
    let run = rig.start(&format!("{} {options} --wait-limit 60", scenario.display()));
    until("the run is held", || rig.status().paused);
    run
}

#[test]
fn the_panel_of_a_scenario_chooses_readings_sliders_and_buttons() {
    let rig = Rig::new();
    let panel = "\n[panel]\nwindow_s = 2.0\nreadings = [\"tracking_error_m\", \"truth.*\"]\n\
                 tune = [\"reference.*\", \"plant.parameters.mass_kg\"]\ninject = [\"dropout measured.position_m\"]\n";
    let scenario = rig.write("panel.toml", &(shipped(SCENARIO) + panel));
    let run = held(&rig, &scenario, "--pause-at 0.001");
    let panel = Panel::start(&rig, &[]);
    let mut client = Client::greeted(&panel.url);
    let about = client.until(|message| message["tell"] == "about");
    assert_eq!(about["window_s"], 2.0);
    assert_eq!(about["buttons"][0]["words"], "dropout measured.position_m");
    let names = about["readings"].as_array().expect("readings").iter();
    let names =
        names.map(|place| &about["signals"][place.as_u64().expect("a place") as usize]["name"]);
    let names: Vec<&Value> = names.collect();
    assert_eq!(names[0], "tracking_error_m");
    assert!(
        names.len() > 2
            && names[1..]
                .iter()
                .all(|name| name.as_str().is_some_and(|name| name.starts_with("truth.")))
    );
    let tunable = client.until(|message| message["tell"] == "tunable");
    let keys = tunable["values"].as_array().expect("values").iter();
    let keys: Vec<&Value> = keys.map(|one| &one["key"]).collect();
    assert_eq!(keys, ["plant.parameters.mass_kg", "reference.position_m"]);
    // A page may change values without a slider, and is refused what the session refuses.
    for (value, is_done) in [(600.0, true), (1e30, false)] {
        let set = json!([{ "key": "controller.pid.proportional_n_per_m", "value": value }]);
        client.do_it(&json!({ "kind": "set", "change": { "set": set } }));
        let answer = client.until(|message| message["tell"] == "answer");
        assert_eq!(answer["is_done"], is_done, "{answer}");
    }
    rig.in_session("resume").expect(0);
    let run = run.finish();
    assert_eq!(run.summary()["changes"].as_array().map(Vec::len), Some(1));
    drop((client, panel));

    let wrong = "\n[panel]\ninject = [\"leek\"]\n";
    let scenario = rig.write("wrong.toml", &(shipped(SCENARIO) + wrong));
    let run = held(&rig, &scenario, "--pause-at 0.001");
    rig.in_session("panel --no-open")
        .expect(2)
        .says(&["prepared fault 'leek'"]);
    rig.in_session("resume").expect(0);
    run.finish();
}

/// Returns the private memory of a process in KiB.
fn memory_kib(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it lives");
    let line = status.lines().find(|line| line.starts_with("RssAnon"));
    let words = line.expect("a size").split_ascii_whitespace();
    words
        .clone()
        .nth(1)
        .and_then(|word| word.parse().ok())
        .expect("a number")
}

#[test]
fn a_stalled_page_costs_nothing_and_receives_no_outdated_data() {
    let rig = Rig::new();
    let alone = rig.run("tests/scenarios/leakage.toml").expect(0).digest();
    // 20,000 steps at half of their speed, which gives time for very many messages.
    let scenario = Path::new("tests/scenarios/leakage.toml");
    let run = held(&rig, scenario, "--pace 0.5 --pause-at 0.001");
    let panel = Panel::start(&rig, &[]);
    let mut client = Client::greeted(&panel.url);
    client.until(|message| message["tell"] == "about");
    client.look(1, 1.0);
    let first = client.until_points(|points| points.view == 1);
    assert!(first.newest < 20, "{}", first.newest);
    let before_kib = memory_kib(panel.process.id());
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    assert_eq!(run.digest(), alone);
    let after_kib = memory_kib(panel.process.id());
    assert!(
        after_kib < before_kib + 4096,
        "{before_kib} KiB grew to {after_kib} KiB"
    );
    // Three messages may have been in flight; the newest data follows: the panel may see the end of the run after
    // that.
    let mut points = Vec::new();
    let last = run.summary()["steps"].as_u64().expect("steps");
    while points.last().is_none_or(|newest| *newest < last) {
        points.push(client.until_points(|points| points.view == 1).newest);
    }
    let after = points.get(3).copied().unwrap_or(last);
    assert!(points.len() <= 8 && after > last / 2, "{points:?}");
    drop(client);
}

#[test]
fn a_fault_by_words_is_checked_and_no_file_of_the_machine_is_read() {
    let rig = Rig::new();
    let run = rig.held();
    let panel = Panel::start(&rig, &[]);
    let mut client = Client::greeted(&panel.url);
    client.until(|message| message["tell"] == "faults");
    for (words, message) in [
        ("bias measured.position_m --bias=x", "is not a number"),
        ("leek", "no fault `leek`"),
        ("--list", "a kind of fault"),
        (
            "bias measured.position_m --table=/etc/passwd",
            "reads a file",
        ),
        (
            "bias measured.position_m --tabl /etc/passwd",
            "reads a file",
        ),
        ("bias measured.position_m 1 --session other", "--session"),
        ("bias 'measured.position_m", "quote"),
    ] {
        client.do_it(&json!({ "kind": "inject", "words": words }));
        let answer = client.until(|message| message["tell"] == "answer");
        assert_eq!(answer["is_done"], false, "{words}: {answer}");
        let text = answer["text"].as_str().expect("text");
        assert!(text.contains(message), "{words}: {text}");
    }
    client.do_it(&json!({ "kind": "mark", "text": " " }));
    let answer = client.until(|message| message["tell"] == "answer");
    assert_eq!(answer["is_done"], false);
    assert_eq!(panel.interrupt(), Some(130));
    assert_eq!(
        client.until_closed().last().expect("a word")["tell"],
        "over"
    );
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    assert_eq!(run.summary()["faults"], json!([]));
}

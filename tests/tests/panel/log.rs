//! Log of a panel: every event of the recording once and in order, for any page at any time.

use std::time::Instant;

use serde_json::{Value, json};

use super::browser::begun;
use super::stream::{Client, held};
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, WATCHDOG};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

/// Page that stores the log it receives, without a browser.
struct Page {
    client: Client,
    edition: Value,
    log: Vec<String>,
}

impl Page {
    fn at(url: &str) -> Self {
        let client = Client::greeted(url);
        let (edition, log) = (Value::Null, Vec::new());
        Self {
            client,
            edition,
            log,
        }
    }

    /// Reads until a condition holds.
    fn until(&mut self, is_it: impl Fn(&Value, &[String]) -> bool) -> Value {
        let began = Instant::now();
        loop {
            let next = self.client.next().expect("another message");
            let output = next.unwrap_or_default();
            if output["tell"] == "log" {
                if output["edition"] != self.edition {
                    self.edition = output["edition"].clone();
                    self.log.clear();
                }
                assert_eq!(output["from"], self.log.len(), "no gap, and nothing twice");
                let events = output["events"].as_array().expect("events").iter();
                let texts = events.map(|event| event["text"].as_str().expect("text").to_owned());
                self.log.extend(texts);
            }
            if is_it(&output, &self.log) {
                return output;
            }
            assert!(began.elapsed() < WATCHDOG, "{:?}", self.log);
        }
    }

    fn does(&mut self, action: &Value) {
        self.client.do_it(action);
        let answer = self.until(|message, _| message["tell"] == "answer");
        assert_eq!(answer["is_done"], true, "{answer}");
    }

    /// Reads the log of the whole session.
    fn until_the_end(mut self) -> Vec<String> {
        self.until(|message, _| message["ending"]["verdict"].is_string());
        self.log
    }
}

/// Returns an event of a recording in the form of the log; `None` for events that the log omits.
fn entry_of(event: &Value) -> Option<String> {
    let step = event["step"].as_u64();
    let at = step.map(|step| format!("step {step} ({} s)", step as f64 / 1000.0));
    let (at, text) = (at.unwrap_or_default(), |name: &str| event[name].as_str());
    let id = &event["id"];
    Some(match text("event")? {
        "fault" => {
            let (kind, target) = text("kind").zip(text("target"))?;
            format!("fault {id} {kind} on {target} from {at}")
        }
        "fault-ended" => {
            let effect = event["effect"].as_u64()? + 1;
            format!("fault {id} effect {effect} ended at {at}")
        }
        "mark" => format!("mark at {at}: {}", text("text")?),
        "change" => {
            let of = |set: &Value| {
                let (key, unit) = set["key"].as_str().zip(set["unit"].as_str())?;
                Some(format!("{key} = {} {unit}", set["value"]))
            };
            let set = event["set"].as_array()?.iter().filter_map(of);
            format!("changed at {at}: {}", set.collect::<Vec<_>>().join(", "))
        }
        "controller" => {
            let (epoch, law) = (&event["epoch"], text("law")?);
            format!("controller {epoch} ({law}) from {at}")
        }
        "accepted" | "end" => return None,
        other => panic!("an event that is not looked at: {other}"),
    })
}

#[test]
fn the_log_has_every_event_once_and_in_order_even_for_late_pages() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &[]);
    let mut first = Page::at(&panel.url);
    let mark = |text: &str| json!({ "kind": "mark", "text": text });
    let set = |key: &str, value: f64| {
        let set = json!([{ "key": key, "value": value }]);
        json!({ "kind": "set", "change": { "set": set } })
    };
    // All at one step, within one update of the state; two marks are equal.
    let dropout = "dropout measured.position_m --duration 0.002";
    first.does(&json!({ "kind": "inject", "words": dropout }));
    first.does(&mark("beside it"));
    first.does(&mark("beside it"));
    for mass_kg in [1.25, 1.5, 1.25] {
        first.does(&set("plant.parameters.mass_kg", mass_kg));
    }
    first.does(&set("reference.position_m", 0.02));
    first.does(&json!({ "kind": "step", "steps": 10 }));
    first.does(&mark("behind it"));
    let is_behind = |_: &Value, log: &[String]| (log.iter()).any(|row| row.ends_with("behind it"));
    first.until(is_behind);
    // Another page, and another panel, which observed nothing of it.
    let mut second = Page::at(&panel.url);
    second.until(is_behind);
    let late = Panel::start(&rig, &[]);
    let mut third = Page::at(&late.url);
    third.until(is_behind);
    third.does(&mark("from the third"));
    third.does(&json!({ "kind": "resume" }));
    let logs = [first, second, third].map(Page::until_the_end);
    let fourth = Page::at(&panel.url).until_the_end();
    let run = run.finish().expect(0);

    let recording = Recording::open(&run.recording());
    let expected: Vec<String> = recording.events.iter().filter_map(entry_of).collect();
    let is_of = |part: &str| expected.iter().filter(|row| row.contains(part)).count();
    assert_eq!(
        [
            is_of("fault 1"),
            is_of("beside it"),
            is_of("mass_kg"),
            is_of("mark")
        ],
        [2, 2, 3, 4],
        "{expected:?}"
    );
    for log in logs.iter().chain([&fourth]) {
        assert_eq!(*log, expected);
    }
}

#[test]
fn a_log_of_very_many_changes_is_complete() {
    let rig = Rig::new();
    let changes: String = (1..=1200)
        .map(|step| {
            let mass_kg = 1.0 + f64::from(1 + step % 7) / 64.0;
            format!(
                "\n[[changes]]\nat_s = {}\nset = {{ \"plant.parameters.mass_kg\" = {mass_kg} }}\n",
                f64::from(step) / 1000.0
            )
        })
        .collect();
    let scenario = rig.write("many.toml", &(shipped(SCENARIO) + &changes));
    let run = held(&rig, &scenario, "--set requirements=[] --pause-at 2.0");
    let panel = Panel::start(&rig, &[]);
    let mut page = Page::at(&panel.url);
    page.until(|_, log| log.iter().filter(|row| row.starts_with("changed")).count() == 1200);
    page.does(&json!({ "kind": "resume" }));
    let log = page.until_the_end();
    let run = run.finish().expect(0);
    let recording = Recording::open(&run.recording());
    let expected: Vec<String> = recording.events.iter().filter_map(entry_of).collect();
    let other = (log.iter().zip(&expected)).find(|(entry, expected)| entry != expected);
    assert_eq!((other, log.len()), (None, expected.len()));
}

//! Searches of a session by a formula: every step that its panel saw, judged as the recording judges it.

use std::path::Path;

use serde_json::{Value, json};

use super::browser::{Play, begun};
use super::stream::{Client, held};
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::{Recording, intervals};

/// Holds in some hundred intervals, of which many are short: late accelerations are errors of rounding.
const FORMULA: &str = "abs(tracking_error_m) > 2e-3 or truth.acceleration_mps2 > 0";
/// Steps that fit an observer's queue, so that nothing is lost however slow the panel is.
const PART: u64 = 1000;

/// Answer to a search, with all of its intervals.
struct Answer {
    intervals: Vec<[u64; 2]>,
    last: Value,
}

/// Asks for the steps at which a formula holds.
fn search(client: &mut Client, number: u32, formula: &str) -> Answer {
    client.say(&json!({ "ask": "where", "number": number, "formula": formula }));
    Answer {
        intervals: Vec::new(),
        last: json!({ "number": number }),
    }
}

impl Answer {
    /// Reads answers until one covers so many steps or more.
    fn until(&mut self, client: &mut Client, judged: u64) -> &Self {
        let number = self.last["number"].clone();
        while self.last["judged"].as_u64() < Some(judged) {
            let next = client.until(|one| one["tell"] == "where" && one["number"] == number);
            assert_eq!(next["error"], Value::Null, "{next}");
            let from = next["from"].as_u64().expect("a number") as usize;
            self.intervals.truncate(from);
            let list = next["intervals"].as_array().expect("intervals");
            let step = |one: &Value| one.as_u64().expect("a step");
            (self.intervals).extend(list.iter().map(|one| [0, 1].map(|end| step(&one[end]))));
            self.last = next;
        }
        self
    }

    fn assert(&self, first: u64, holds: &[bool]) {
        assert_eq!(self.intervals, intervals(first, holds), "{}", self.last);
        let count = holds.iter().filter(|one| **one).count();
        assert_eq!(self.last["steps"], count, "{}", self.last);
        assert_eq!(self.last["lost"], 0, "{}", self.last);
    }
}

/// Lets a held run go on to its end in parts.
fn finish(rig: &Rig, client: &mut Client, mut step: u64) {
    while step + PART < 5000 {
        client.do_it(&json!({ "kind": "step", "steps": PART }));
        step += PART;
        client.until(|message| message["step"].as_u64() >= Some(step));
    }
    rig.in_session("resume").expect(0);
}

/// Steps of a recorded run at which [`FORMULA`] holds.
fn held_steps(run: &Run) -> Vec<bool> {
    let recording = Recording::open(&run.recording());
    let names = [
        "truth.position_m",
        "reference.position_m",
        "truth.acceleration_mps2",
    ];
    let [truth, reference, acceleration] = names.map(|name| recording.column(name));
    let errors = truth.iter().zip(&reference).map(|(a, b)| (a - b).abs());
    let both = errors.zip(&acceleration);
    both.map(|(error, acceleration)| error > 2e-3 || *acceleration > 0.0)
        .collect()
}

#[test]
fn a_search_of_a_session_covers_every_step_and_grows_until_the_end() {
    let rig = Rig::new();
    let run = held(&rig, Path::new(SCENARIO), "--pause-at 0.001");
    let mut panel = Panel::start(&rig, &[]);
    let mut client = Client::greeted(&panel.url);
    let mut costly = Client::greeted(&panel.url);
    for client in [&mut client, &mut costly] {
        client.until(|message| message["tell"] == "about");
    }
    let mut plain = search(&mut client, 7, FORMULA);
    // As long as a message may be, so that each step takes long, and at the same time.
    let more = " + truth.position_m * 0".repeat(600);
    let formula = format!("abs(tracking_error_m{more}) > 2e-3 or truth.acceleration_mps2 > 0");
    let mut long = search(&mut costly, 8, &formula);
    rig.in_session("step 999").expect(0);
    rig.until_held_at(1000);
    // The newest record of a run that is held is some steps older.
    plain.until(&mut client, 990);
    assert_eq!(plain.last["begin"], 0);
    let (growing, judged) = (plain.intervals.clone(), plain.last["judged"].clone());
    finish(&rig, &mut client, 1000);
    plain.until(&mut client, 5001);
    long.until(&mut costly, 5001);
    client.until(|message| message["state"] == "ended");
    // After the end, from what was kept: a formula that looks ahead is judged as much later, and not at the last steps.
    let mut ahead = search(&mut client, 9, &format!("eventually[0,100ms]({FORMULA})"));
    ahead.until(&mut client, 4901);
    assert_eq!(ahead.last["delay"], 100);
    let mut past = search(&mut client, 10, &format!("once({FORMULA})"));
    past.until(&mut client, 5001);
    let run = run.finish().expect(0);
    drop((client, costly));
    assert_eq!(panel.wait(), Some(0));

    let holds = held_steps(&run);
    let judged = judged.as_u64().expect("a number") as usize;
    assert_eq!(growing, intervals(0, &holds[..judged]));
    assert!(plain.intervals.len() > 20, "{:?}", plain.intervals);
    plain.assert(0, &holds);
    long.assert(0, &holds);
    let window = |step: usize| holds[step..=step + 100].contains(&true);
    ahead.assert(0, &(0..=4900).map(window).collect::<Vec<_>>());
    let before = |step: usize| holds[..=step].contains(&true);
    past.assert(0, &(0..=5000).map(before).collect::<Vec<_>>());
}

#[test]
fn a_panel_that_joins_late_says_from_which_step_on_its_answer_holds() {
    let rig = Rig::new();
    let run = rig.held();
    let panel = Panel::start(&rig, &[]);
    let mut client = Client::greeted(&panel.url);
    client.until(|message| message["tell"] == "about");
    let mut plain = search(&mut client, 1, FORMULA);
    plain.until(&mut client, 1);
    let first = plain.last["first"].as_u64().expect("a step");
    assert!((2490..2500).contains(&first), "{first}");
    finish(&rig, &mut client, 2500);
    plain.until(&mut client, 5001 - first);
    let mut back = search(&mut client, 2, &format!("once[0,100ms]({FORMULA})"));
    back.until(&mut client, 5001 - first - 100);
    let mut open = search(&mut client, 3, &format!("once({FORMULA})"));
    open.until(&mut client, 5001 - first);
    // Nothing is left at which it could be judged.
    client.say(&json!({ "ask": "where", "number": 4, "formula": "eventually[3s,4s](truth.position_m > 0)" }));
    let refused = client.until(|one| one["tell"] == "where" && one["number"] == 4);
    assert_eq!(
        refused["error"],
        format!(
            "the formula looks further ahead than the run goes on after step {first}, the first one that was kept"
        )
    );
    let run = run.finish().expect(0);
    drop((client, panel));

    let holds = held_steps(&run);
    let from = first as usize;
    plain.assert(first, &holds[from..]);
    assert_eq!([&plain.last["first"], &plain.last["begin"]], [first, first]);
    // Exactly what holds in the whole run.
    let window = |step: usize| holds[step - 100..=step].contains(&true);
    back.assert(
        first + 100,
        &(from + 100..=5000).map(window).collect::<Vec<_>>(),
    );
    assert_eq!(
        [&back.last["first"], &back.last["begin"]],
        [first, first + 100]
    );
    let before = |step: usize| holds[from..=step].contains(&true);
    open.assert(first, &(from..=5000).map(before).collect::<Vec<_>>());
    assert_eq!(
        [&back.last["is_past_open"], &open.last["is_past_open"]],
        [false, true]
    );
}

#[test]
fn a_page_lists_and_marks_intervals_while_they_grow_and_refuses_as_a_recorded_run() {
    let rig = Rig::new();
    // So slow that a panel without a core of its own sees every step.
    let (run, panel) = begun(&rig, "--pace 1", &[]);
    let Some(mut play) = Play::closer("growing", &panel.url) else {
        return;
    };
    play.at_go(|| {
        rig.in_session("step 1000").expect(0);
        rig.until_held_at(3500);
    });
    let output = play.result();
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);
    drop(panel);

    let column = Recording::open(&run.recording()).column("truth.velocity_mps");
    let holds: Vec<bool> = column.iter().map(|velocity| *velocity > 0.0).collect();
    for (part, most) in [("held", 2500), ("grown", 3500)] {
        let output = &output[part];
        let judged = output["judged"].as_str().expect("a number");
        let judged: usize = judged.parse().expect("a number");
        assert!((most - 2..=most).contains(&judged), "{output}");
        let steps = &holds[..judged];
        let expected = intervals(0, steps).into_iter().map(|[first, last]| {
            let time = |step: u64| step as f64 / 1000.0;
            match first == last {
                _ if last as usize + 1 == judged => format!("since {} s", time(first)),
                true => format!("{} s", time(first)),
                false => format!("{} s to {} s", time(first), time(last)),
            }
        });
        assert_eq!(output["list"], json!(expected.collect::<Vec<_>>()));
        let says = output["says"].as_str().expect("text");
        let ends = format!(" % of {judged} steps; from step 0");
        assert!(says.ends_with(&ends), "{says}");
        let share = steps.iter().filter(|one| **one).count() as f64 / 5000.0;
        for marked in output["marked"].as_array().expect("plots") {
            let marked = marked.as_f64().expect("a share");
            assert!(
                (marked - share).abs() < 0.02,
                "{marked} of {share}: {output}"
            );
        }
    }
    let panel = Panel::recorded(&rig, &run.folder, &[]);
    let Some(recorded) = Play::closer("refused", &panel.url) else {
        return;
    };
    assert_eq!(output["focused"], true, "a row keeps the focus");
    assert_eq!(output["refused"], recorded.result()["refused"]);
}

//! A bus in the fault layer, step by step, with the built-in kinds of faults.

mod orders;
mod saved;
mod two_networks;

use std::collections::BTreeMap;

use hil_config::plan::{
    BusPlan, FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Profile, Trigger,
};
use shared_types::describe::{PlantDescription, Settings};
use shared_types::frame::VALIDITY_WORDS;
use shared_types::record::{BusCounts, Event, RecordLayout};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use super::Bus;
use crate::faults::{FaultBuilder, FaultLayer, kinds};

/// Resolution of `measured.a_m` in [`PORT`].
const STEP_M: f64 = 0.25;

/// Port file with a field of whole numbers, a float, an alive counter, and a command at half the rate.
const PORT: &str = r#"port = 1
[[frames]]
name = "motion"
carries = "sample"
stale_s = 0.3
fields = [
    { signal = "measured.a_m", type = "i16", scale = 0.25, range = [-1000, 8000], invalid = 0x8000 },
    { signal = "reference.r_m", type = "f64" },
    { kind = "counter", type = "u8" },
]
[[frames]]
name = "drive"
carries = "command"
divider = 2
fields = [{ signal = "command.u_n", type = "f32" }]
"#;

fn field(name: &str, unit: &str) -> Field {
    Field::signal(name, unit, "A signal.")
}

/// Layer around a bus, at 10 steps a second.
struct Rig {
    layer: FaultLayer,
    step: u64,
    marks: Vec<String>,
}

/// Rows that both ends receive at a step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Passed {
    a_m: f64,
    r_m: f64,
    /// Bits of `a_m`, `b_m`, its age and `r_m`.
    invalid: u64,
    age_steps: u32,
    u_n: f64,
}

fn plant() -> PlantDescription {
    PlantDescription {
        name: "plant".into(),
        summary: "A plant.".into(),
        parameters: Vec::new(),
        truth: Vec::new(),
        measured: vec![
            field("a_m", "m"),
            field("b_m", "m"),
            field("a_m_age_steps", "steps"),
        ],
        commands: vec![field("u_n", "N")],
        faults: Vec::new(),
        saves: false,
        port: None,
        state: None,
    }
}

fn plan(text: &str, networks: u8) -> BusPlan {
    BusPlan {
        text: text.into(),
        dbc: BTreeMap::new(),
        networks,
        skew_limit_steps: None,
    }
}

/// Event with these effects: target and parameters by name.
fn event(id: u32, kind: &str, at: u64, effects: &[(&str, &[(&str, f64)])]) -> FaultEvent {
    let effect = |(target, parameters): &(&str, &[(&str, f64)])| {
        let entry = kinds::all().into_iter();
        let entry = { entry }.find(|entry| entry.description.kind == kind);
        let fields = entry.expect("a built-in kind").description.parameters;
        let mut settings = Settings::default();
        for field in &fields {
            let parameter = parameters.iter().find(|(name, _)| *name == field.name);
            let value = parameter.map_or(field.default, |(_, value)| Some(*value));
            settings.set(&field.name, value.expect("given or with a default"));
        }
        FaultEffect {
            target: (*target).into(),
            skew_steps: 0,
            profile: Profile::Step,
            action: FaultAction::Kind {
                parameters: settings,
                list: Vec::new(),
            },
        }
    };
    FaultEvent {
        id,
        name: None,
        kind: kind.into(),
        source: FaultSource::Scenario,
        trigger: Trigger::Step {
            step: Step(at),
            at_s: at as f64 / 10.0,
        },
        end: FaultEnd::default(),
        effects: effects.iter().map(effect).collect(),
    }
}

impl Rig {
    fn new(text: &str, networks: u8, events: &[FaultEvent]) -> Self {
        let (plant, reference) = (plant(), [field("r_m", "m")]);
        let rate = Rate::new(10.0).expect("legal");
        let settings = Settings::default();
        let builder =
            FaultBuilder::new(&plant, &reference, &kinds::all(), &settings, (rate, 1), &[]);
        let builder = builder.expect("no parameter").with_networks(networks);
        let bus = Bus::new(&plan(text, networks), &plant, &reference, rate).expect("a sound bus");
        let layer = FaultLayer::new(&builder, events).expect("faults that can be");
        let mut layer = layer.with_bus(Some(bus));
        let layout = RecordLayout {
            measured: plant.measured.clone(),
            reference: reference.to_vec(),
            command: plant.commands,
            command_signals: 1,
            ..RecordLayout::default()
        };
        layer.open(&builder, &layout).expect("signals that are");
        Self {
            layer,
            step: 0,
            marks: Vec::new(),
        }
    }

    /// Sends this reading, 5 as reference and the reading as command.
    fn send(&mut self, a_m: f64, is_valid: bool) -> Passed {
        let step = Step(self.step);
        self.layer.advance(step, None);
        let (mut row, mut invalid) = ([f64::NAN; 4], [0; VALIDITY_WORDS]);
        invalid[0] = u64::from(!is_valid);
        let sensed = ([a_m, 7.0, 0.0], [5.0]);
        let age_steps = (self.layer).sample(step, (&sensed.0, &sensed.1), &mut row, &mut invalid);
        self.layer.timing(step);
        let (mut applied, mut no_mark) = ([f64::NAN], [0; VALIDITY_WORDS]);
        (self.layer).command(step, (0, 0), (&[a_m], &mut no_mark), &mut applied);
        while let Some(event) = self.layer.next_event() {
            if let Event::Mark(mark) = event {
                self.marks.push(format!("{}: {}", mark.step, mark.text));
            }
        }
        self.step += 1;
        let age_of_a = row[2];
        assert!(
            invalid[0] & 1 == 1 || age_of_a == 0.0,
            "one frame has one age"
        );
        Passed {
            a_m: row[0],
            r_m: row[3],
            invalid: invalid[0],
            age_steps,
            u_n: applied[0],
        }
    }

    /// Sends 0, 1, 2 .. as readings; returns the received readings, their validity and the age.
    fn count(&mut self, steps: u64) -> Vec<(f64, bool, u32)> {
        let passed = |k: u64| {
            let passed = self.send(k as f64, true);
            (passed.a_m, passed.invalid & 1 == 0, passed.age_steps)
        };
        (0..steps).map(passed).collect()
    }

    fn counts(&self, frame: &str) -> BusCounts {
        let mut counts = self.layer.bus_counts().into_iter();
        counts.find(|one| one.frame == frame).expect("a frame")
    }
}

#[test]
fn values_are_rounded_to_the_raw_number_and_limited_to_the_range() {
    let mut rig = Rig::new(PORT, 1, &[]);
    let closed_form = |value: f64| {
        let raw = (value / STEP_M).round_ties_even();
        (raw * STEP_M).clamp(-1000.0, 8000.0)
    };
    // Halves go to the even raw number; nothing wraps, neither beyond the range nor beyond the bits.
    let values = [0.1, 0.125, 0.375, -0.126, 7999.9, 8001.0, 1e9, -1e300, -3.0];
    for value in values {
        let passed = rig.send(value, true);
        assert_eq!(passed.a_m, closed_form(value), "{value}");
        assert_eq!((passed.r_m, passed.invalid & 0b1001), (5.0, 0));
    }
    let counts = rig.counts("motion");
    assert_eq!((counts.sent, counts.accepted), (9, 9));
    assert_eq!(counts.saturated.len(), 1);
    assert_eq!(counts.saturated[0].signal, "measured.a_m");
    assert_eq!(counts.saturated[0].count, 3);
    let events = [
        "5: measured.a_m exceeds its range in frame motion",
        "6: command.u_n exceeds its range in frame drive",
    ];
    let mut marks = rig.marks.clone();
    marks.sort();
    // The float of 32 bits takes 1e9; -1e300 falls on a step without a frame.
    assert_eq!(marks, events[..1]);
}

#[test]
fn a_frame_is_sent_at_its_period_and_held_between() {
    let mut rig = Rig::new(PORT, 1, &[]);
    let applied: Vec<f64> = (0..6).map(|k| rig.send(f64::from(k), true).u_n).collect();
    assert_eq!(applied, [0.0, 0.0, 2.0, 2.0, 4.0, 4.0]);
    assert_eq!(rig.counts("drive").sent, 3);
    assert_eq!(rig.counts("motion").sent, 6);
}

#[test]
fn a_signal_that_no_frame_carries_is_invalid_and_its_age_is_made_by_the_receiver() {
    let mut rig = Rig::new(PORT, 1, &[]);
    // `b_m` is in no frame; neither is the age of `a_m`.
    assert_eq!(rig.send(1.0, true).invalid, 0b0010);
}

#[test]
fn an_invalid_reading_is_sent_as_the_number_for_no_value() {
    let mut rig = Rig::new(PORT, 1, &[]);
    rig.send(3.0, true);
    let passed = rig.send(3.0, false);
    assert_eq!((passed.a_m, passed.invalid & 1), (3.0, 1));
    assert_eq!(rig.send(4.0, true).invalid & 1, 0);
}

#[test]
fn a_field_without_a_number_for_no_value_hides_that_a_reading_is_invalid() {
    let text = PORT.replace(", invalid = 0x8000", "");
    let mut rig = Rig::new(&text, 1, &[]);
    rig.send(3.0, true);
    let passed = rig.send(8.0, false);
    assert_eq!((passed.a_m, passed.invalid & 1), (3.0, 0));
}

#[test]
fn a_lost_frame_leaves_the_last_value_until_it_is_stale() {
    let lost = event(1, "message-loss", 2, &[("link.sample", &[])]);
    let mut rig = Rig::new(PORT, 1, &[lost]);
    let expected = [
        (0.0, true, 0),
        (1.0, true, 0),
        (1.0, true, 1),
        (1.0, true, 2),
        (1.0, true, 3),
        (1.0, false, 4),
        (1.0, false, 5),
    ];
    assert_eq!(rig.count(7), expected);
}

#[test]
fn nothing_is_valid_before_the_first_frame() {
    let lost = event(1, "message-loss", 0, &[("link.sample", &[])]);
    let mut rig = Rig::new(PORT, 1, &[lost]);
    assert_eq!(rig.count(2), [(0.0, false, 1), (0.0, false, 2)]);
}

#[test]
fn a_delayed_frame_has_an_age_from_its_arrival_on() {
    let late = event(1, "message-delay", 0, &[("link.sample", &[("steps", 2.0)])]);
    let mut rig = Rig::new(PORT, 1, &[late]);
    let expected = [
        (0.0, false, 1),
        (0.0, false, 2),
        (0.0, true, 0),
        (1.0, true, 0),
    ];
    assert_eq!(rig.count(4), expected);
    assert_eq!(rig.layer.effects()[0].max_effect, 2.0);
}

#[test]
fn a_frame_whose_counter_jumps_is_refused_and_the_next_is_accepted() {
    let mut lost = event(1, "message-loss", 2, &[("link.sample", &[])]);
    lost.end.after_steps = Some(1);
    let mut rig = Rig::new(PORT, 1, &[lost]);
    let expected = [
        (0.0, true, 0),
        (1.0, true, 0),
        (1.0, true, 1),
        (1.0, false, 2),
        (4.0, true, 0),
    ];
    assert_eq!(rig.count(5), expected);
    assert_eq!(rig.counts("motion").refused, 1);
}

#[test]
fn a_frame_with_inverted_bits_is_refused_by_the_check_of_the_network() {
    let broken = event(
        1,
        "message-corruption",
        1,
        &[("link.sample", &[("bits", 3.0)])],
    );
    let mut rig = Rig::new(PORT, 1, &[broken]);
    let passed = rig.count(4);
    assert_eq!(passed[3], (0.0, true, 3));
    assert_eq!(rig.counts("motion").corrupted, 3);
    assert_eq!(rig.layer.rejected(), 3);
}

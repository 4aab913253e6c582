//! Plant, faults and steps for these tests.

use hil_config::plan::{Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, Move};
use hil_config::plan::{FaultSource, Profile, Trigger};
use shared_types::describe::{Operation, PlantDescription, Settings};
use shared_types::directive::Directive;
use shared_types::frame::{FrameKind, Header, VALIDITY_WORDS};
use shared_types::record::{Event, FaultEffectSize, RecordLayout};
use shared_types::table::{Field, Table};
use shared_types::time::{Rate, Step};

use super::kinds;
use crate::faults::{FaultBuilder, FaultLayer};

shared_types::table! {
    /// Parameters of the plant.
    pub(super) struct Parameters {
        /// Not faultable.
        mass_kg: "kg" = 1.0 in 0.0..=10.0,
        /// Gain.
        gain: "1" = 10.0 in 0.0..=100.0 [faultable],
        /// Load.
        load_n: "N" = 0.0 in (-5.0)..=5.0 [faultable],
    }
}

pub(super) fn signals(names: &[(&str, &str)]) -> Vec<Field> {
    let signal = |(name, unit): &(&str, &str)| Field::signal(name, unit, "A signal.");
    names.iter().map(signal).collect()
}

pub(super) fn builder() -> FaultBuilder {
    let plant = PlantDescription {
        name: "plant".into(),
        summary: "A plant.".into(),
        parameters: Parameters::fields(),
        truth: Vec::new(),
        measured: signals(&[("a_m", "m"), ("b_m", "m")]),
        commands: signals(&[("u_n", "N"), ("v_n", "N")]),
        faults: Vec::new(),
        saves: false,
        port: None,
        state: None,
    };
    FaultBuilder::new(
        &plant,
        &signals(&[("r_m", "m")]),
        &kinds::all(),
        &Settings::of(&Parameters::default()),
        (Rate::new(10.0).expect("legal"), 1),
        &[("twice".into(), "2 * sensed.a_m".into())],
    )
    .expect("every parameter has a value")
}

/// Creates an effect of a kind that begins at once with its full size.
pub(super) fn on(target: &str, by: f64) -> FaultEffect {
    let mut parameters = Settings::default();
    parameters.set("by", by);
    FaultEffect {
        target: target.into(),
        skew_steps: 0,
        profile: Profile::Step,
        action: FaultAction::Kind {
            parameters,
            list: Vec::new(),
        },
    }
}

/// Creates an effect of the plant's own.
pub(super) fn moving(moves: &[(&str, Operation, f64)]) -> FaultEffect {
    let moves = moves.iter().map(|&(parameter, operation, by)| Move {
        parameter: parameter.into(),
        operation,
        by,
    });
    FaultEffect {
        action: FaultAction::Move {
            sizes: Settings::default(),
            moves: moves.collect(),
        },
        ..on("plant", 0.0)
    }
}

pub(super) fn skewed(skew_steps: u64, effect: FaultEffect) -> FaultEffect {
    FaultEffect {
        skew_steps,
        ..effect
    }
}

/// Alternates between full and none, for N steps each.
pub(super) fn on_and_off(steps: u32, effect: FaultEffect) -> FaultEffect {
    FaultEffect {
        profile: Profile::Intermittent {
            period_s: f64::from(2 * steps) / 10.0,
            duty: 0.5,
        },
        ..effect
    }
}

pub(super) fn at(step: u64) -> Trigger {
    Trigger::Step {
        step: Step(step),
        at_s: step as f64 / 10.0,
    }
}

pub(super) fn after(event: u32, delay_steps: u64) -> Trigger {
    Trigger::After { event, delay_steps }
}

pub(super) fn when(expression: &str, records: u64) -> Condition {
    Condition {
        expression: expression.into(),
        records,
    }
}

pub(super) fn event(id: u32, kind: &str, trigger: Trigger, effects: &[FaultEffect]) -> FaultEvent {
    FaultEvent {
        id,
        name: None,
        kind: kind.into(),
        source: FaultSource::Scenario,
        trigger,
        end: FaultEnd::default(),
        effects: effects.to_vec(),
    }
}

pub(super) fn until(end: FaultEnd, event: FaultEvent) -> FaultEvent {
    FaultEvent { end, ..event }
}

/// Creates an end N steps after the beginning.
pub(super) fn lasting(steps: u64) -> FaultEnd {
    FaultEnd {
        after_steps: Some(steps),
        ..FaultEnd::default()
    }
}

/// Result of one step.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Passed {
    /// `a_m`, `b_m` and `r_m` as received by the controller.
    pub(super) sample: [f64; 3],
    /// Bits of the invalid signals of `sample`, one each.
    pub(super) invalid: u64,
    pub(super) sample_age_steps: u32,
    pub(super) directive: Directive,
    pub(super) busy_ns: u64,
    /// `u_n` and `v_n`.
    pub(super) applied: [f64; 2],
    pub(super) command_age_steps: u32,
    /// `mass_kg`, `gain` and `load_n`.
    pub(super) parameters: [f64; 3],
    pub(super) retuned: bool,
}

/// A layer driven as by the engine.
pub(super) struct Rig {
    pub(super) builder: FaultBuilder,
    pub(super) layout: RecordLayout,
    pub(super) layer: FaultLayer,
    pub(super) next: u64,
    pub(super) last: Option<Vec<f64>>,
    /// Header that the controller sends in a test.
    pub(super) answer: Header,
    pub(super) command_invalid: u64,
    /// Reports: event, effect, step; then `+` or `-`, or `x` if the fault was cleared.
    pub(super) events: Vec<(u32, u32, u64, char)>,
}

impl Rig {
    pub(super) fn new(events: &[FaultEvent]) -> Self {
        let builder = builder();
        let layout = RecordLayout {
            measured: signals(&[("a_m", "m"), ("b_m", "m")]),
            reference: signals(&[("r_m", "m")]),
            command: signals(&[("u_n", "N"), ("v_n", "N")]),
            command_signals: 2,
            parameter: (Parameters::fields().into_iter())
                .filter(|field| field.faultable)
                .collect(),
            ..RecordLayout::default()
        };
        let mut layer = FaultLayer::new(&builder, events).expect("faults that can be");
        layer.open(&builder, &layout).expect("signals that are");
        Self {
            builder,
            layout,
            layer,
            next: 0,
            last: None,
            answer: Header::new(FrameKind::Command, Step(0)),
            command_invalid: 0,
            events: Vec::new(),
        }
    }

    pub(super) fn step(&mut self) -> Passed {
        let step = Step(self.next);
        let k = step.0 as f64;
        let layer = &mut self.layer;
        let retuned = layer.advance(step, self.last.as_deref());
        let parameters = layer.parameters().try_into().expect("three of them");
        let (sensed, stimulus) = ([k, 10.0], [5.0]);
        let (mut sample, mut invalid) = ([f64::NAN; 3], [0; VALIDITY_WORDS]);
        let sample_age_steps = layer.sample(step, (&sensed, &stimulus), &mut sample, &mut invalid);
        let (directive, busy_ns) = layer.timing(step);
        let (command, mut applied) = ([k, -1.0], [f64::NAN; 2]);
        let mut command_invalid = [0; VALIDITY_WORDS];
        command_invalid[0] = self.command_invalid;
        let command_age_steps = layer.command(
            step,
            (self.answer.age_steps, self.answer.work_ns),
            (&command, &mut command_invalid),
            &mut applied,
        );
        let mut faultable = [f64::NAN; 2];
        layer.faultable(&mut faultable);
        let groups: [&[f64]; 6] = [&sample, &command, &applied, &sensed, &stimulus, &faultable];
        self.last = Some(groups.concat());
        while let Some(event) = self.layer.next_event() {
            self.events.push(match event {
                Event::Fault(begun) => (begun.id, begun.effect, begun.step, '+'),
                Event::FaultEnded(ended) => {
                    let how = if ended.cleared { 'x' } else { '-' };
                    (ended.id, ended.effect, ended.step, how)
                }
                other => panic!("{other:?} is none of the layer's"),
            });
        }
        self.next += 1;
        Passed {
            sample,
            invalid: invalid[0],
            sample_age_steps,
            directive,
            busy_ns,
            applied,
            command_age_steps,
            parameters,
            retuned,
        }
    }

    pub(super) fn run(&mut self, steps: usize) -> Vec<Passed> {
        (0..steps).map(|_| self.step()).collect()
    }

    /// Collects a value from each of the next steps.
    pub(super) fn each<T>(&mut self, steps: usize, of: impl Fn(&Passed) -> T) -> Vec<T> {
        self.run(steps).iter().map(of).collect()
    }

    /// Returns the report on an effect.
    pub(super) fn size(&self, id: u32, effect: u32) -> FaultEffectSize {
        let sizes = self.layer.effects();
        let sizes_found = (sizes.into_iter()).find(|size| (size.id, size.effect) == (id, effect));
        sizes_found.expect("it exists")
    }

    /// Returns the number of steps at which an effect acted, and its largest change.
    pub(super) fn acted(&self, id: u32, effect: u32) -> (u64, f64) {
        let size = self.size(id, effect);
        (size.acted_steps, size.max_effect)
    }
}

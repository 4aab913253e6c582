//! The layer step by step, against sequences worked out by hand.
//!
//! At step k the healthy plant measures `a_m` = k and `b_m` = 10, the rig asks for `r_m` = 5, and the
//! controller answers with `u_n` = k and `v_n` = -1. The kinds of faults here are as plain as can be.

mod live;
mod schedule;
mod targets;

use hil_config::plan::{
    Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Move, Profile, Trigger,
};
use shared_types::describe::{ActsOn, Invalid, Operation, PlantDescription, Settings};
use shared_types::directive::Directive;
use shared_types::frame::{FrameKind, Header, VALIDITY_WORDS};
use shared_types::random::RandomStream;
use shared_types::record::{Event, FaultEffectSize, RecordLayout};
use shared_types::table::{Empty, Field, Table};
use shared_types::time::{Rate, Step};

use super::kind::{FaultKind, Moment, Passage, Reading, Setup};
use super::{FaultKindEntry, FaultLayer, FaultWorkshop};

shared_types::table! {
    /// What the plant can be told.
    struct Parameters {
        /// Not open to faults.
        mass_kg: "kg" = 1.0 in 0.0..=10.0,
        /// Gain.
        gain: "1" = 10.0 in 0.0..=100.0 [faultable],
        /// Load.
        load_n: "N" = 0.0 in (-5.0)..=5.0 [faultable],
    }
}

shared_types::table! {
    /// The one parameter of most kinds here.
    struct By {
        /// How much.
        by: "target",
    }
}

/// Declares a kind of fault with the parameter `by`, or with none.
macro_rules! kind {
    ($kind:ident, $name:literal, $acts_on:ident, $parameters:ident, $method:ident, $body:expr, $at:ty $(, $result:ty)?) => {
        struct $kind($parameters, Option<RandomStream>);

        impl FaultKind for $kind {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = $name;
            const EQUATION: &'static str = $name;
            const ACTS_ON: ActsOn = ActsOn::$acts_on;
            type Parameters = $parameters;

            fn start(setup: &Setup<'_, $parameters>) -> Result<Self, Invalid> {
                Ok(Self(setup.parameters, None))
            }

            fn hold(&mut self, random: RandomStream) {
                self.1 = Some(random);
            }

            fn $method(&mut self, at: &Moment, what: $at) $(-> $result)? {
                let act: fn(&mut Self, &Moment, $at) $(-> $result)? = $body;
                act(self, at, what)
            }
        }
    };
}

kind!(
    Plus,
    "plus",
    Numbers,
    By,
    number,
    |this, at, x| {
        Reading {
            value: x.value + this.0.by * at.gain,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Times,
    "times",
    Numbers,
    By,
    number,
    |this, _, x| {
        Reading {
            value: x.value * this.0.by,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Gone,
    "gone",
    Signals,
    Empty,
    number,
    |_, at, x| {
        Reading {
            valid: x.valid && at.gain == 0.0,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Infinite,
    "infinite",
    Numbers,
    Empty,
    number,
    |_, _, x| {
        Reading {
            value: f64::INFINITY,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    NoNumber,
    "no-number",
    Numbers,
    Empty,
    number,
    |_, _, x| {
        Reading {
            value: f64::NAN,
            ..x
        }
    },
    Reading,
    Reading
);
kind!(
    Dice,
    "dice",
    Signals,
    Empty,
    number,
    |this, _, x| {
        let drawn = this.1.as_mut().map_or(f64::NAN, RandomStream::uniform);
        Reading { value: drawn, ..x }
    },
    Reading,
    Reading
);
kind!(
    Lost,
    "lost",
    Links,
    Empty,
    message,
    |_, at, passage| {
        if at.gain != 0.0 {
            passage.copies = [None; Passage::MOST_COPIES];
        }
    },
    &mut Passage
);
kind!(
    Late,
    "late",
    Links,
    By,
    message,
    |this, at, passage| {
        for copy in &mut passage.copies {
            *copy = copy.map(|late| late + (this.0.by * at.gain) as u32);
        }
    },
    &mut Passage
);
kind!(
    Broken,
    "broken",
    Links,
    Empty,
    message,
    |_, at, passage| {
        if at.gain != 0.0 {
            passage.flips[passage.flipped] = passage.bits - 1;
            passage.flipped += 1;
        }
    },
    &mut Passage
);
kind!(
    Busy,
    "busy",
    Sides,
    By,
    timing,
    |this, at, directive| {
        directive.busy_ns += (this.0.by * at.gain) as u32;
    },
    &mut Directive
);
kind!(
    Jump,
    "jump",
    Controller,
    By,
    timing,
    |this, at, directive| {
        directive.late_steps += (this.0.by * at.gain) as u32;
    },
    &mut Directive
);

/// The reading of the step before, its validity included.
struct Before(Option<Reading>);

impl FaultKind for Before {
    const NAME: &'static str = "before";
    const SUMMARY: &'static str = "before";
    const EQUATION: &'static str = "before";
    const ACTS_ON: ActsOn = ActsOn::Signals;
    type Parameters = Empty;

    fn start(_: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        Ok(Self(None))
    }

    fn number(&mut self, _: &Moment, x: Reading) -> Reading {
        self.0.replace(x).unwrap_or(x)
    }
}

fn signals(names: &[(&str, &str)]) -> Vec<Field> {
    let signal = |(name, unit): &(&str, &str)| Field::signal(name, unit, "A signal.");
    names.iter().map(signal).collect()
}

fn workshop() -> FaultWorkshop {
    let plant = PlantDescription {
        name: "plant".into(),
        summary: "A plant.".into(),
        parameters: Parameters::fields(),
        truth: Vec::new(),
        measured: signals(&[("a_m", "m"), ("b_m", "m")]),
        commands: signals(&[("u_n", "N"), ("v_n", "N")]),
        faults: Vec::new(),
    };
    let kinds = [
        FaultKindEntry::of::<Plus>(),
        FaultKindEntry::of::<Times>(),
        FaultKindEntry::of::<Gone>(),
        FaultKindEntry::of::<Infinite>(),
        FaultKindEntry::of::<NoNumber>(),
        FaultKindEntry::of::<Dice>(),
        FaultKindEntry::of::<Before>(),
        FaultKindEntry::of::<Lost>(),
        FaultKindEntry::of::<Late>(),
        FaultKindEntry::of::<Broken>(),
        FaultKindEntry::of::<Busy>(),
        FaultKindEntry::of::<Jump>(),
    ];
    FaultWorkshop::new(
        &plant,
        &signals(&[("r_m", "m")]),
        &kinds,
        &Settings::of(&Parameters::default()),
        (Rate::new(10.0).expect("legal"), 1),
        &[("twice".into(), "2 * sensed.a_m".into())],
    )
    .expect("every parameter has a value")
}

/// An effect of a kind that takes hold at once, fully.
fn on(target: &str, by: f64) -> FaultEffect {
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

/// An effect of the plant's own.
fn moving(moves: &[(&str, Operation, f64)]) -> FaultEffect {
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

fn skewed(skew_steps: u64, effect: FaultEffect) -> FaultEffect {
    FaultEffect {
        skew_steps,
        ..effect
    }
}

/// Full, then gone, for so many steps each.
fn on_and_off(steps: u32, effect: FaultEffect) -> FaultEffect {
    FaultEffect {
        profile: Profile::Intermittent {
            period_s: f64::from(2 * steps) / 10.0,
            duty: 0.5,
        },
        ..effect
    }
}

fn at(step: u64) -> Trigger {
    Trigger::Step {
        step: Step(step),
        at_s: step as f64 / 10.0,
    }
}

fn after(event: u32, delay_steps: u64) -> Trigger {
    Trigger::After { event, delay_steps }
}

fn when(expression: &str, records: u64) -> Condition {
    Condition {
        expression: expression.into(),
        records,
    }
}

fn event(id: u32, kind: &str, trigger: Trigger, effects: &[FaultEffect]) -> FaultEvent {
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

fn until(end: FaultEnd, event: FaultEvent) -> FaultEvent {
    FaultEvent { end, ..event }
}

/// An end so many steps after the begin.
fn lasting(steps: u64) -> FaultEnd {
    FaultEnd {
        after_steps: Some(steps),
        ..FaultEnd::default()
    }
}

/// What came of one step.
#[derive(Clone, Debug, PartialEq)]
struct Passed {
    /// `a_m`, `b_m` and `r_m` as the controller gets them.
    sample: [f64; 3],
    /// Which of them are invalid, one bit each.
    invalid: u64,
    sample_age_steps: u32,
    directive: Directive,
    busy_ns: u64,
    /// `u_n` and `v_n`.
    applied: [f64; 2],
    command_age_steps: u32,
    /// `mass_kg`, `gain` and `load_n`.
    parameters: [f64; 3],
    retuned: bool,
}

/// A layer with what the engine does around it.
struct Rig {
    workshop: FaultWorkshop,
    layout: RecordLayout,
    layer: FaultLayer,
    next: u64,
    last: Option<Vec<f64>>,
    /// What a test has the controller say.
    answer: Header,
    command_invalid: u64,
    /// What was told: event, effect, step; then `+` or `-`, or `x` if it was cleared.
    told: Vec<(u32, u32, u64, char)>,
}

impl Rig {
    fn new(events: &[FaultEvent]) -> Self {
        let workshop = workshop();
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
        let mut layer = FaultLayer::new(&workshop, events).expect("faults that can be");
        layer.open(&workshop, &layout).expect("signals that are");
        Self {
            workshop,
            layout,
            layer,
            next: 0,
            last: None,
            answer: Header::new(FrameKind::Command, Step(0)),
            command_invalid: 0,
            told: Vec::new(),
        }
    }

    fn step(&mut self) -> Passed {
        let step = Step(self.next);
        let k = step.0 as f64;
        let layer = &mut self.layer;
        let retuned = layer.advance(step, self.last.as_deref());
        let parameters = layer.parameters().try_into().expect("three of them");
        let (sensed, stimulus) = ([k, 10.0], [5.0]);
        let (mut sample, mut invalid) = ([f64::NAN; 3], [u64::MAX; VALIDITY_WORDS]);
        let sample_age_steps = layer.sample(step, (&sensed, &stimulus), &mut sample, &mut invalid);
        let (directive, busy_ns) = layer.timing(step);
        let (command, mut applied) = ([k, -1.0], [f64::NAN; 2]);
        let mut command_invalid = [0; VALIDITY_WORDS];
        command_invalid[0] = self.command_invalid;
        let command_age_steps = layer.command(
            step,
            &self.answer,
            (&command, &command_invalid),
            &mut applied,
        );
        let mut faultable = [f64::NAN; 2];
        layer.faultable(&mut faultable);
        let groups: [&[f64]; 6] = [&sample, &command, &applied, &sensed, &stimulus, &faultable];
        self.last = Some(groups.concat());
        while let Some(event) = self.layer.next_event() {
            self.told.push(match event {
                Event::Fault(taken) => (taken.id, taken.effect, taken.step, '+'),
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

    fn run(&mut self, steps: usize) -> Vec<Passed> {
        (0..steps).map(|_| self.step()).collect()
    }

    /// One number of each of the next steps.
    fn each<T>(&mut self, steps: usize, of: impl Fn(&Passed) -> T) -> Vec<T> {
        self.run(steps).iter().map(of).collect()
    }

    /// What became of an effect.
    fn size(&self, id: u32, effect: u32) -> FaultEffectSize {
        let sizes = self.layer.effects();
        let found = (sizes.into_iter()).find(|size| (size.id, size.effect) == (id, effect));
        found.expect("it exists")
    }

    /// Steps at which an effect acted, and its largest change.
    fn acted(&self, id: u32, effect: u32) -> (u64, f64) {
        let size = self.size(id, effect);
        (size.acted_steps, size.max_effect)
    }
}

#[test]
fn without_a_fault_everything_passes_as_it_is() {
    for events in [
        vec![],
        vec![event(1, "plus", at(1000), &[on("measured.a_m", 1.0)])],
    ] {
        let mut rig = Rig::new(&events);
        for (k, passed) in (0..).zip(rig.run(50)) {
            let healthy = Passed {
                sample: [f64::from(k), 10.0, 5.0],
                invalid: 0,
                sample_age_steps: 0,
                directive: Directive::default(),
                busy_ns: 0,
                applied: [f64::from(k), -1.0],
                command_age_steps: 0,
                parameters: [1.0, 10.0, 0.0],
                retuned: false,
            };
            assert_eq!(passed, healthy);
        }
        assert_eq!((rig.told, rig.layer.rejected()), (vec![], 0));
    }
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let cases = [
        (
            "plus",
            on("measured.c_m", 1.0),
            "`plus` cannot act on `measured.c_m`",
        ),
        (
            "plus",
            on("link.sample", 1.0),
            "`plus` cannot act on `link.sample`",
        ),
        (
            "gone",
            on("parameter.gain", 1.0),
            "`gone` cannot act on `parameter.gain`",
        ),
        (
            "plus",
            on("parameter.mass_kg", 1.0),
            "`mass_kg` is not open to faults",
        ),
        (
            "late",
            on("measured.a_m", 1.0),
            "`late` cannot act on `measured.a_m`",
        ),
        (
            "late",
            on("link.other", 1.0),
            "`late` cannot act on `link.other`",
        ),
        ("jump", on("plant", 1.0), "`jump` cannot act on `plant`"),
        ("sabotage", on("plant", 1.0), "there is no fault `sabotage`"),
        (
            "x",
            moving(&[("mass_kg", Operation::Add, 1.0)]),
            "`mass_kg` is not open to faults",
        ),
        ("x", moving(&[]), "moves no parameter"),
    ];
    let workshop = workshop();
    for (kind, effect, expected) in cases {
        let event = event(1, kind, at(0), &[effect]);
        let refused = FaultLayer::new(&workshop, &[event]);
        let refused = refused.map(|_| ()).expect_err(expected).to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn a_condition_on_a_signal_that_is_not_there_is_refused_when_the_signals_are_known() {
    let condition = Trigger::Condition(when("internal.z > 0", 1));
    let event = event(1, "plus", condition, &[on("measured.a_m", 1.0)]);
    let workshop = workshop();
    let mut layer = FaultLayer::new(&workshop, &[event]).expect("not known yet");
    let refused = layer.open(&workshop, &RecordLayout::default());
    assert!(
        refused
            .expect_err("unknown")
            .to_string()
            .contains("internal.z")
    );
}

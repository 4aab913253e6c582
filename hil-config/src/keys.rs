//! Every key of a scenario: type, unit, range, default and meaning, defined once.
//!
//! The reader, the JSON schema and `show` are driven by these tables, so that they cannot disagree. Parameters of
//! plants and laws are not here: they come from the descriptions of the binaries.

/// Makes a key of a row `name: type, text`. A `!` behind the name makes the key required.
macro_rules! key {
    ($name:ident: $kind:expr, $text:literal) => {
        Key::new(stringify!($name), $kind, $text)
    };
    ($name:ident!: $kind:expr, $text:literal) => {
        Key::new(stringify!($name), $kind, $text).required()
    };
}

/// Makes a table of such rows. A row `..KEY` stands for a key that several tables share.
macro_rules! keys {
    (@ [$($key:expr,)*]) => { &[$($key),*] };
    (@ [$($key:expr,)*] ..$shared:path; $($rest:tt)*) => {
        keys!(@ [$($key,)* $shared,] $($rest)*)
    };
    (@ [$($key:expr,)*] $name:ident: $kind:expr, $text:literal; $($rest:tt)*) => {
        keys!(@ [$($key,)* key!($name: $kind, $text),] $($rest)*)
    };
    (@ [$($key:expr,)*] $name:ident!: $kind:expr, $text:literal; $($rest:tt)*) => {
        keys!(@ [$($key,)* key!($name!: $kind, $text),] $($rest)*)
    };
    ($table:path) => { $table };
    ($($rows:tt)*) => { keys!(@ [] $($rows)*) };
}

/// Makes a table of kinds `name: text`, each with its keys.
macro_rules! kinds {
    ($($name:literal: $text:literal { $($rows:tt)* })*) => {
        &[$(SectionKind { name: $name, text: $text, keys: keys! { $($rows)* } }),*]
    };
}

mod bus;
mod changes;
mod faults;
mod instruments;
mod metrics;
mod model;
mod plots;
mod port;
mod realtime;
mod requirements;
mod stimuli;
mod study;
mod tables;
mod waveforms;

use shared_types::time::Rate;

use changes::CHANGE;
use faults::FAULT;

pub(crate) use bus::BUS;
pub(crate) use changes::LIVE_CHANGE;
pub(crate) use faults::{EFFECT, PROFILE, PROFILES, REQUEST, TARGET, TRIGGERS};
pub(crate) use instruments::{ACTUATOR, SENSOR};
pub(crate) use metrics::{EXPRESSION, METRIC, METRICS, PUBLISHED};
pub(crate) use plots::{PANEL, PLOT, PLOTS};
pub(crate) use port::{FIELD, FIELDS, MEDIA, MEDIUM, MOST_FIELDS, MOST_FRAMES, PORT};
pub(crate) use realtime::REALTIME;
pub(crate) use requirements::REQUIREMENT;
pub(crate) use stimuli::{SEQUENCE_KIND, STIMULUS, WAVEFORMS};
pub(crate) use study::{MOST_CASES, PROBES, RUNS, SPREADS, STUDY, TOLERANCE, VARY};
pub(crate) use tables::{DERIVED, TABLE_FILE};
pub(crate) use waveforms::{MOST_PARTS, MOST_TONES, PART};

/// Supported version of the scenario format.
pub(crate) const SCHEMA: i64 = 1;

/// Maximum number of steps of a run.
pub(crate) const MAX_STEPS: u64 = 1 << 40;

/// A key.
#[derive(Debug)]
pub(crate) struct Key {
    /// Name.
    pub name: &'static str,
    /// Kind of value that the key takes.
    pub kind: KeyKind,
    /// `true` if the key is required.
    pub required: bool,
    /// Meaning of the key.
    pub text: &'static str,
}

/// Type of a key's value.
#[derive(Debug)]
pub(crate) enum KeyKind {
    /// A number.
    Number {
        /// Unit.
        unit: &'static str,
        /// Smallest valid value.
        min: f64,
        /// Largest valid value.
        max: f64,
        /// Default value.
        default: Option<f64>,
    },
    /// A whole number.
    Integer {
        /// Smallest valid value.
        min: i64,
        /// Largest valid value.
        max: i64,
        /// Default value.
        default: Option<i64>,
    },
    /// Text.
    Text {
        /// Valid texts; empty means any text.
        choices: &'static [&'static str],
        /// Default value.
        default: Option<&'static str>,
    },
    /// True or false.
    Boolean {
        /// Default value.
        default: bool,
    },
    /// A list of numbers.
    Numbers,
    /// A list of texts.
    Texts,
    /// A list of numbers, of texts, or of booleans.
    Values,
    /// Two numbers.
    Pair,
    /// A list of pairs of numbers.
    Pairs,
    /// A number, or text with a number and a unit.
    Quantity {
        /// Unit; `target` in it stands for that of a signal.
        unit: &'static str,
        /// Smallest legal value.
        min: f64,
        /// Largest legal value.
        max: f64,
    },
    /// Two quantities of a signal, the smaller one first.
    Range,
    /// A name or number of a fault event.
    Event,
    /// A table with these keys; some tables have further keys, which depend on other values.
    Section(&'static [Key]),
    /// A list of tables with these keys; some tables have further keys.
    List(&'static [Key]),
    /// A table whose keys come from the description of a plant or law.
    Described,
    /// A file, or one per machine type.
    Program,
}

impl Key {
    const fn new(name: &'static str, kind: KeyKind, text: &'static str) -> Self {
        Self {
            name,
            kind,
            required: false,
            text,
        }
    }

    const fn required(self) -> Self {
        Self {
            required: true,
            ..self
        }
    }
}

/// Kind of section with keys of its own.
#[derive(Debug)]
pub(crate) struct SectionKind {
    /// Value of its key `kind`.
    pub name: &'static str,
    /// Description of the kind.
    pub text: &'static str,
    /// Keys specific to this kind.
    pub keys: &'static [Key],
}

const fn number(unit: &'static str, min: f64, max: f64) -> KeyKind {
    KeyKind::Number {
        unit,
        min,
        max,
        default: None,
    }
}

const fn number_or(unit: &'static str, min: f64, max: f64, default: f64) -> KeyKind {
    KeyKind::Number {
        unit,
        min,
        max,
        default: Some(default),
    }
}

const fn integer(min: i64, max: i64) -> KeyKind {
    KeyKind::Integer {
        min,
        max,
        default: None,
    }
}

const fn integer_or(min: i64, max: i64, default: i64) -> KeyKind {
    KeyKind::Integer {
        min,
        max,
        default: Some(default),
    }
}

/// Returns the type of a text from a list, by default the first.
const fn choice(choices: &'static [&'static str]) -> KeyKind {
    KeyKind::Text {
        choices,
        default: Some(choices[0]),
    }
}

pub(crate) const TEXT: KeyKind = KeyKind::Text {
    choices: &[],
    default: None,
};

/// Longest valid time in s: 2^40 steps at the lowest rate.
const MAX_S: f64 = MAX_STEPS as f64 / Rate::MIN_HZ;

const LENGTH: KeyKind = number("s", 1e-9, MAX_S);

/// Table that names a file.
pub(crate) const FILE: &[Key] = keys! {
    file!: TEXT, "CSV file, relative to the scenario.";
};

const VERSION: Key = key! { schema!: integer(SCHEMA, SCHEMA), "Version of this format." };

/// The whole scenario.
pub(crate) const SCENARIO: &[Key] = keys! {
    ..VERSION;
    name: TEXT, "Name of the scenario: letters, digits, - and _. Default: the file's name.";
    description: TEXT, "Purpose of the scenario.";
    further_plots: KeyKind::Boolean { default: true },
        "Plots of other signals worth one follow those of `plots`; false: they do not. The run does not depend on it.";
    run!: KeyKind::Section(RUN), "Duration, rate and clock.";
    plant!: KeyKind::Section(PLANT), "The plant.";
    controller!: KeyKind::Section(CONTROLLER), "The controller.";
    connect: KeyKind::List(CONNECT),
        "Signals of the law that are bound to signals of the plant with another name or unit; all other signals are bound by their own name and unit.";
    realtime: KeyKind::Section(REALTIME),
        "Real-time settings of plant, controller and recorder; they change timing, never values. Cores are checked when a run starts.";
    sensors: KeyKind::List(SENSOR),
        "Sensors between the readings of the model and the faults of its signals. One entry a signal; the keys act in the order of this page.";
    actuators: KeyKind::List(ACTUATOR),
        "Actuators between the received commands and the model. One entry a command; the keys act in the order of this page.";
    bus: KeyKind::Section(BUS),
        "Bus in simulation: frames that carry the sample and the command, as on a wire, with its resolution, periods and stale values.";
    stimuli: KeyKind::List(STIMULUS),
        "Reference signals of the rig, sent with the derivatives that the waveform has, and inputs of the plant that no law commands.";
    faults: KeyKind::List(FAULT), "Fault events. All effects of an event take effect at the same step.";
    changes: KeyKind::List(CHANGE),
        "Changes of parameters and reference signals during the run, as by `hil set`. All keys of a change change at the same step.";
    derived: KeyKind::List(DERIVED), "Signals computed from other signals at every step, or played back from a file.";
    metrics: KeyKind::List(METRIC),
        "Numbers computed from the records: reductions over windows of time, or ready-made analyses.";
    requirements: KeyKind::List(REQUIREMENT), "Conditions that the run must meet to pass.";
    plots: KeyKind::List(PLOT),
        "First plots of the report, the monitor and the layouts of the run, and its figures for documents; the run does not depend on them.";
    panel: KeyKind::Section(PANEL),
        "Contents of `hil panel` beside the plots; the run does not depend on them.";
};

/// `[run]`.
pub(crate) const RUN: &[Key] = keys! {
    duration_s!: number("s", 1e-6, MAX_S), "Simulated time; a whole number of steps.";
    rate_hz!: number("Hz", Rate::MIN_HZ, Rate::MAX_HZ), "Exchanges between plant and controller per second.";
    seed: integer_or(0, i64::MAX, 1), "Seed of every random stream.";
    clock: choice(&["lockstep", "paced", "realtime"]),
        "Release of each step: lockstep runs as fast as both sides can; paced is lockstep that also waits for the clock; realtime waits for the clock alone, and a late command is replaced by the last one.";
    pace: number_or("1", 1e-6, 1e6, 1.0), "Simulated seconds per second of the paced clock.";
    overrun: choice(&["catch-up", "skip", "stretch", "abort"]),
        "Handling of a step that is due before the previous step is done, paced or in real time: catch-up begins late steps at once, skip waits for the next point of the grid, stretch moves the grid, abort ends the run (in real time also for a missed command).";
    deadline: number_or("1", 0.01, 1.0, 0.8),
        "In real time: share of the period within which the command of a step must arrive; the rest is left to the plant.";
    on_controller_loss: choice(&["abort", "hold", "safe-command", "wait-for-restart"]),
        "Reaction of the plant when its controller dies, stops answering or breaks the protocol: abort ends the run; hold continues with the last command; safe-command continues with plant.safe_command; wait-for-restart restarts the controller and waits for it, in real time with the last command.";
};

/// `[plant]`.
pub(crate) const PLANT: &[Key] = keys! {
    model!: TEXT, "Name of the plant.";
    program: TEXT,
        "Plant program or FMU, relative to the scenario; a scenario that names a program runs it. Default: plant-process beside hil.";
    locals: KeyKind::Texts,
        "Inner signals of an FMU that are part of the truth: patterns with * and ? for their names in the FMU or in hil. Default: none.";
    ..model::TRUST_ARCHIVE;
    ..model::ALLOW_EXECUTION_TOOL;
    ..model::TOLERANCE;
    ..model::START_TIME_S;
    ..model::STOP_TIME_S;
    ..model::INITIAL;
    ..model::TEXTS;
    ..model::FILES;
    ..model::STRUCTURAL;
    substeps: integer_or(1, 1000, 4), "Integration steps in one exchange step.";
    parameters: KeyKind::Described,
        "The plant's parameters: a full name (actuator1.x), or the last part alone (x) for every parameter whose name ends with that part; the full name wins.";
    inputs: KeyKind::Described,
        "Constant inputs of the plant that no law commands, such as an ambient temperature: a number, or \"start\" for the start value that the plant declares. A [[stimuli]] with target = \"plant.NAME\" gives an input a course.";
    limits: KeyKind::Described,
        "Ranges [min, max] of true signals, outside which the run ends as diverged; they replace the plant's own ranges.";
    safe_command: KeyKind::Described,
        "Commands that the plant gets while run.on_controller_loss = \"safe-command\" acts. Default: 0.";
};

/// `[controller]`; in addition a table for every law.
pub(crate) const CONTROLLER: &[Key] = keys! {
    law!: TEXT, "Name of the control law.";
    made_for: TEXT,
        "Plant that the law is made for, if not plant.model: [[connect]] then binds its signals. Default: plant.model.";
    program: KeyKind::Program,
        "Controller program or FMU, relative to the scenario, or a table of programs by machine name, as printed by `uname -m`; a scenario that names a program runs it. Default: controller-process beside hil.";
    ..model::TRUST_ARCHIVE;
    ..model::ALLOW_EXECUTION_TOOL;
    ..model::TOLERANCE;
    ..model::START_TIME_S;
    ..model::STOP_TIME_S;
    ..model::INITIAL;
    ..model::TEXTS;
    ..model::FILES;
    ..model::STRUCTURAL;
    rate_hz: number("Hz", Rate::MIN_HZ, Rate::MAX_HZ),
        "Rate of the law, a whole fraction of run.rate_hz; the command is held between steps of the law. Default: run.rate_hz.";
    command_delay_steps: integer_or(0, 1, 0), "Steps between a sample and the command that answers it.";
    model: KeyKind::Described,
        "Plant parameters that the law assumes. Default: the plant's parameter of the same name and unit, as set by plant.parameters and unaffected by faults; else the law's own default.";
};

/// `[[connect]]`.
pub(crate) const CONNECT: &[Key] = keys! {
    law!: TEXT, "Signal of the law: measured.NAME, reference.NAME or command.NAME.";
    plant!: TEXT,
        "Signal of the same kind of the plant; for reference.NAME the target of a [[stimuli]], or its derivative.";
    factor: ANY_NUMBER,
        "Conversion: received = factor * sent + offset; a command is sent by the law, all other signals to the law. Default: the conversion between both units.";
    offset: ANY_NUMBER, "Added value, in the unit of the receiver; only with factor. Default: 0.";
};

const ANY_NUMBER: KeyKind = number("", f64::MIN, f64::MAX);

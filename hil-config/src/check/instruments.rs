//! `[[sensors]]` and `[[actuators]]`: existing signals, consistent keys, and values that the run can have.

use std::collections::{BTreeMap, BTreeSet};

use shared_types::describe::PlantDescription;
use shared_types::number::exact as number;
use shared_types::table::Field;
use shared_types::time::Rate;

use super::controller::rate_divisor;
use super::data_sheet::Scales;
use super::parameters::{Written, collect};
use super::run::Grid;
use crate::document::Value;
use crate::keys::KeyKind;
use crate::plan::{Instrument, indistinguishable};
use crate::problem::{ProblemKind, listed};
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Longest delay in steps, equal to that of the stage.
const MOST_STEPS: f64 = 1e5;

/// Keys that need another key.
const OWNERS: [(&str, &str); 4] = [
    ("bias_tau_s", "bias_sigma"),
    ("lag_damping", "lag_hz"),
    ("phase_steps", "rate_hz"),
    ("bits", "range"),
];
/// Keys that draw random numbers.
const NOISE: [&str; 4] = ["bias_sigma", "bias_walk", "noise_density", "noise_sigma"];

/// Keys that keep the values of an enumeration or a Boolean.
const KEEP_ITEMS: [&str; 5] = ["signal", "rate_hz", "phase_steps", "delay_s", "dead_time_s"];

/// Plant of a scenario, once as the law commands it and once with the inputs that the scenario drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plants<'a> {
    pub(super) commanded: &'a PlantDescription,
    pub(super) whole: &'a PlantDescription,
}

impl<'a> Plants<'a> {
    /// Returns the signals that the instruments of a table can have.
    fn fields(self, table: &str) -> &'a [Field] {
        match table {
            "sensors" => &self.commanded.measured,
            _ => &self.commanded.commands,
        }
    }

    /// Describes the place of a signal that belongs elsewhere; `None` for an unknown name.
    fn advice(self, table: &str, name: &str) -> Option<String> {
        let has = |fields: &[Field]| fields.iter().any(|field| field.is_called(name));
        match table {
            "sensors" if has(&self.commanded.commands) => Some(format!(
                "`{name}` is a command of the plant; use [[actuators]]"
            )),
            "actuators" if has(&self.commanded.measured) => Some(format!(
                "`{name}` is a measured signal of the plant; use [[sensors]]"
            )),
            "actuators" if has(&self.whole.commands) => {
                Some(format!("no law commands `{name}`, so it has no actuator"))
            }
            _ => None,
        }
    }
}

/// Returns the sensors and the actuators; `None` if one of them is faulty or the plant is unknown.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    plants: Option<Plants<'_>>,
    grid: Option<Grid>,
) -> Option<(Vec<Instrument>, Vec<Instrument>)> {
    let sensors = all(reader, root, "sensors", plants, grid);
    let actuators = all(reader, root, "actuators", plants, grid);
    Some((sensors?, actuators?))
}

/// Reports two inputs of stages that a recording could not distinguish.
pub(super) fn refuse_indistinguishable(
    reader: &mut Reader,
    root: &Section<'_>,
    plant: &PlantDescription,
    instruments: [&[Instrument]; 2],
    rate: Rate,
) {
    let Some((table, index, [first, second])) = indistinguishable(plant, instruments, rate) else {
        return;
    };
    let sections = reader.list(root, table);
    let Some(section) = sections.get(index) else {
        return;
    };
    let message = format!(
        "`{first}` and `{second}`, inputs of stages, cannot be distinguished in a recording"
    );
    reader
        .report_at(section, "signal", ProblemKind::Duplicate, message)
        .help("leave out one of the two stages, or give one of the signals another name");
}

fn all(
    reader: &mut Reader,
    root: &Section<'_>,
    table: &'static str,
    plants: Option<Plants<'_>>,
    grid: Option<Grid>,
) -> Option<Vec<Instrument>> {
    let fields = plants.map(|plants| plants.fields(table));
    let mut names = BTreeSet::new();
    let sections = reader.list(root, table);
    let instruments: Vec<Option<Instrument>> = (sections.iter())
        .map(|section| {
            reader.refuse_unknown(section, &[]);
            let field = signal(reader, section, table, plants);
            if let Some(field) = field
                && !names.insert(&field.name)
            {
                let message = format!("`{table}` has two entries for `{}`", field.name);
                reader
                    .report_at(section, "signal", ProblemKind::Duplicate, message)
                    .help("put all keys of a signal into one entry");
            }
            instrument(reader, section, table, (field?, fields?), grid)
        })
        .collect();
    instruments.into_iter().collect()
}

/// Returns the signal that an entry names.
fn signal<'a>(
    reader: &mut Reader,
    section: &Section<'_>,
    table: &str,
    plants: Option<Plants<'a>>,
) -> Option<&'a Field> {
    let name = reader.text(section, "signal")?;
    let plants = plants?;
    let fields = plants.fields(table);
    let field = fields.iter().find(|field| field.is_called(name));
    if field.is_none() {
        let path = section.path_of("signal");
        let message = match plants.advice(table, name) {
            Some(advice) => format!("`{path}`: {advice}"),
            None => format!("`{path}` is `{name}`, which is not a signal of the plant"),
        };
        let names = fields.iter().map(|field| field.name.as_str());
        reader
            .report_at(section, "signal", ProblemKind::UnknownName, message)
            .one_of(name, names);
    }
    field
}

fn instrument(
    reader: &mut Reader,
    section: &Section<'_>,
    table: &str,
    (field, fields): (&Field, &[Field]),
    grid: Option<Grid>,
) -> Option<Instrument> {
    let before = reader.problems.len();
    let mut instrument = Instrument {
        signal: field.name.clone(),
        ..Instrument::default()
    };
    refuse_combinations(reader, section);
    let has = |key: &str| section.table.get(key).is_some();
    let mut scales = Scales::new(&field.unit);
    if has("range") {
        scales.range = range(reader, section, &scales);
        let (min, max) = scales.range?;
        instrument.values.set("range_min", min);
        instrument.values.set("range_max", max);
    }
    if has("bits") {
        let bits = reader.integer(section, "bits")?;
        instrument.values.set("bits", bits as f64);
    }
    if has("resolution") {
        let step = scales.quantity(reader, section, "resolution")?;
        instrument.values.set("resolution", step);
    }
    scales.lsb = instrument.resolution();
    let own = ["range", "resolution"];
    for key in section.keys.iter().filter(|key| has(key.name)) {
        let value = match key.kind {
            KeyKind::Quantity { .. } if !own.contains(&key.name) => {
                scales.quantity(reader, section, key.name)
            }
            _ => None,
        };
        if let Some(value) = value {
            instrument.values.set(key.name, value);
        }
    }
    timing(reader, section, &mut instrument, grid);
    if has("cross") {
        cross(reader, section, &mut instrument, fields);
    }
    refuse_others_on_items(reader, section, table, field);
    if section.table.entries().len() < 2 {
        let keys = section.keys.iter().map(|key| key.name);
        let message = format!("`{}` has no effect", section.path);
        reader
            .report(
                ProblemKind::MissingKey,
                &section.path,
                section.place,
                message,
            )
            .expected(format!(
                "at least one of {}",
                listed(keys.filter(|key| *key != "signal"))
            ));
    }
    (reader.problems.len() == before && grid.is_some()).then_some(instrument)
}

/// Reports keys whose companion is missing, and keys that define the same quantity twice.
fn refuse_combinations(reader: &mut Reader, section: &Section<'_>) {
    let has = |key: &str| section.table.get(key).is_some();
    for (key, owner) in OWNERS {
        if has(key) && !has(owner) {
            let path = section.path_of(key);
            let message = format!("`{path}` needs `{owner}`");
            reader.report_at(section, key, ProblemKind::Mismatch, message);
        }
    }
    if has("bits") && has("resolution") {
        let path = section.path_of("resolution");
        let message = format!("`{path}` repeats what `bits` and `range` already define");
        reader
            .report_at(section, "resolution", ProblemKind::Mismatch, message)
            .expected("either `bits` or `resolution`");
    }
}

/// Reads both ends of the range, which must differ.
fn range(reader: &mut Reader, section: &Section<'_>, scales: &Scales<'_>) -> Option<(f64, f64)> {
    let path = section.path_of("range");
    let node = &section.table.get("range")?.node;
    let unit = scales.unit;
    let expected = format!("[lower, upper], two different bounds in {unit}");
    let Value::List(ends) = &node.value else {
        reader.wrong_type(&path, node, expected);
        return None;
    };
    let [min, max] = ends.as_slice() else {
        let message = format!("`{path}` has {} entries", ends.len());
        reader
            .report(ProblemKind::WrongType, &path, &node.place, message)
            .expected(expected);
        return None;
    };
    let min = scales.end(reader, &format!("{path}[0]"), min);
    let max = scales.end(reader, &format!("{path}[1]"), max);
    let (min, max) = (min?, max?);
    if min < max && (max - min).is_finite() {
        return Some((min, max));
    }
    let message = if min == max {
        format!("`{path}` has the width 0")
    } else {
        format!("`{path}` is [{}, {}]", number(min), number(max))
    };
    reader
        .report(ProblemKind::OutOfRange, &path, &node.place, message)
        .expected(expected);
    None
}

/// Checks that times are whole steps, and that the sampling rate is a whole fraction of the run's rate.
fn timing(
    reader: &mut Reader,
    section: &Section<'_>,
    instrument: &mut Instrument,
    grid: Option<Grid>,
) {
    let Some(grid) = grid else {
        return;
    };
    if let Some(rate_hz) = instrument.get("rate_hz") {
        let divisor = rate_divisor(reader, section, rate_hz, Some(grid));
        if section.table.get("phase_steps").is_some()
            && let Some(phase) = reader.integer(section, "phase_steps")
        {
            instrument.values.set("phase_steps", phase as f64);
            if let Some(divisor) = divisor.filter(|divisor| phase >= i64::from(*divisor)) {
                let path = section.path_of("phase_steps");
                let message = format!("`{path}` is {phase}, but samples are {divisor} steps apart");
                reader
                    .report_at(section, "phase_steps", ProblemKind::OutOfRange, message)
                    .expected(format!("a whole number from 0 to {}", divisor - 1));
            }
        }
    }
    let rate = grid.rate;
    for key in ["delay_s", "dead_time_s"] {
        let Some(delay_s) = instrument.get(key) else {
            continue;
        };
        let steps = delay_s * rate.hz();
        let is_whole = (steps - steps.round()).abs() <= 1e-9 * (1.0 + steps);
        if is_whole && steps <= MOST_STEPS {
            continue;
        }
        let path = section.path_of(key);
        let period_s = number(rate.period_s());
        let problem = reader.report_at(
            section,
            key,
            ProblemKind::OutOfRange,
            format!(
                "`{path}` is {} s, {} steps of {period_s} s",
                number(delay_s),
                number(steps)
            ),
        );
        problem.expected(format!("a whole number of steps, at most {MOST_STEPS}"));
        if !is_whole && steps <= MOST_STEPS {
            let (below, above) = (steps.floor() / rate.hz(), steps.ceil() / rate.hz());
            problem.help(format!(
                "the nearest are {} and {} s",
                number(below),
                number(above)
            ));
        }
    }
}

/// Returns the other signals that leak into this one.
fn cross(
    reader: &mut Reader,
    section: &Section<'_>,
    instrument: &mut Instrument,
    fields: &[Field],
) {
    let Some(table) = reader.table(section, "cross") else {
        return;
    };
    let others = || {
        let names = fields.iter().map(|field| field.name.as_str());
        names.filter(|name| *name != instrument.signal)
    };
    let mut leaves = Vec::new();
    collect(table.table, "", fields, &mut leaves);
    let mut shares: BTreeMap<String, (Written, f64)> = BTreeMap::new();
    for (name, entry) in leaves {
        let path = table.path_of(&name);
        match fields.iter().find(|field| field.is_called(&name)) {
            Some(field) if field.name != instrument.signal => {
                let share = reader.quantity(&path, &entry.node, &Quantity::finite("1"));
                let Some(share) = share else { continue };
                let written = Written::new(&name, true, share, &entry.node.place);
                match written.beats(shares.get(&field.name).map(|(earlier, _)| earlier)) {
                    Ok(true) => {
                        shares.insert(field.name.clone(), (written, share));
                    }
                    Ok(false) => {}
                    Err(message) => {
                        let place = &entry.node.place;
                        reader.report(ProblemKind::Duplicate, path, place, message);
                    }
                }
            }
            Some(_) => {
                let message = format!("`{path}` is the signal itself");
                reader
                    .report(ProblemKind::Mismatch, path, &entry.key_place, message)
                    .expected("another measured signal")
                    .help("`scale` is its own factor");
            }
            None => {
                let message = format!("`{path}`: the plant does not measure `{name}`");
                reader
                    .report(ProblemKind::UnknownName, path, &entry.key_place, message)
                    .one_of(&name, others());
            }
        }
    }
    let shares = shares.into_iter();
    instrument.cross = shares.map(|(name, (_, share))| (name, share)).collect();
}

/// Reports keys that would change the values of an enumeration or a Boolean.
fn refuse_others_on_items(reader: &mut Reader, section: &Section<'_>, table: &str, field: &Field) {
    if !field.is_discrete {
        return;
    }
    let delay = match table {
        "sensors" => "delay_s",
        _ => "dead_time_s",
    };
    let keys = section.keys.iter().map(|key| key.name);
    for key in keys.filter(|key| !KEEP_ITEMS.contains(key)) {
        if section.table.get(key).is_none() {
            continue;
        }
        let path = section.path_of(key);
        let reason = match NOISE.contains(&key) {
            true => "cannot have noise",
            false => "has no other values",
        };
        let message = format!(
            "`{path}`: `{}` is an enumeration or a Boolean, which {reason}",
            field.name
        );
        reader
            .report_at(section, key, ProblemKind::Mismatch, message)
            .expected(format!(
                "`rate_hz`, `phase_steps` or `{delay}` of such a signal"
            ));
    }
}

//! `[[changes]]`: values that change during the run.
//!
//! The same code checks the changes of a scenario and those requested during a run. Combinations of parameters are
//! validated by the side that owns them, as at the start of a run.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use shared_types::describe::{PlantDescription, Settings};
use shared_types::live::ChangeRequest;
use shared_types::record::{ChangedValue, MOST_CHANGES};
use shared_types::table::Field;
use shared_types::time::Step;

use super::RequestContext;
use super::inputs::Advice;
use super::parameters::{LISTED, Written, collect, is_named};
use super::run::Grid;
use crate::document::Entry;
use crate::keys::LIVE_CHANGE;
use crate::plan::{Change, INPUT_KEYS, PLANT_KEYS, REFERENCE_KEYS, Stimulus, law_keys};
use crate::problem::{ProblemKind, Problems, listed};
use crate::quantity::{Quantity, toml_float};
use crate::reader::{Reader, Section};
use crate::scenario::{Scenario, root};

/// Context against which changes are checked. A part that is `None` is itself faulty; anything that depends on it is
/// not checked.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChangeContext<'a> {
    /// Plant.
    pub plant: Option<&'a PlantDescription>,
    /// Name and parameters of the law.
    pub law: Option<(&'a str, &'a [Field])>,
    /// Reference signals.
    pub stimuli: Option<&'a [Stimulus]>,
    /// Constant inputs of the plant.
    pub constants: &'a Settings,
    /// Steps of the run.
    pub grid: Option<Grid>,
}

/// Known key, with a flag for keys that can be changed.
struct Known {
    key: String,
    /// Further keys, by the aliases of the variable.
    aliases: Vec<String>,
    field: Field,
    is_tunable: bool,
}

impl Known {
    fn new(group: &str, field: &Field, is_tunable: bool) -> Self {
        let key = |name: &String| format!("{group}{name}");
        Self {
            key: key(&field.name),
            aliases: field.aliases.iter().map(key).collect(),
            field: field.clone(),
            is_tunable,
        }
    }

    fn keys(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.key)
            .chain(&self.aliases)
            .map(String::as_str)
    }

    fn is_called(&self, key: &str) -> bool {
        self.keys().any(|one| one == key)
    }
}

/// Returns the valid changes and reports the others.
pub(crate) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    context: &ChangeContext<'_>,
) -> Vec<Change> {
    let sections = reader.list(root, "changes");
    if sections.len() > MOST_CHANGES {
        let message = format!("there are {} changes", sections.len());
        reader
            .report_at(root, "changes", ProblemKind::OutOfRange, message)
            .expected(format!("{MOST_CHANGES} at most"));
        return Vec::new();
    }
    let keys = known(context);
    let changes = (1..)
        .zip(&sections)
        .map(|(id, section)| change(reader, section, context, keys.as_deref(), id));
    changes.collect::<Vec<_>>().into_iter().flatten().collect()
}

/// Returns a live change, if it is valid.
fn live(
    reader: &mut Reader,
    root: &Section<'_>,
    context: &ChangeContext<'_>,
    id: u32,
) -> Option<Change> {
    let keys = known(context);
    let change = change(reader, root, context, keys.as_deref(), id)?;
    Some(Change {
        live: true,
        ..change
    })
}

/// Lists every key that can be changed, with its aliases; `None` if some keys are unknown.
pub(super) fn tunable(context: &ChangeContext<'_>) -> Option<Vec<(String, Vec<String>)>> {
    let tunable = known(context)?.into_iter().filter(|one| one.is_tunable);
    Some(tunable.map(|one| (one.key, one.aliases)).collect())
}

/// Lists all keys; `None` if some keys are unknown.
fn known(context: &ChangeContext<'_>) -> Option<Vec<Known>> {
    let (law, parameters) = context.law?;
    let group = law_keys(law);
    let of_law = (parameters.iter()).map(|field| Known::new(&group, field, field.tunable));
    let of_plant = (context.plant?.parameters.iter())
        .map(|field| Known::new(PLANT_KEYS, field, field.tunable || field.faultable));
    let signals = context.stimuli?.iter().map(|stimulus| {
        let group = match stimulus.input() {
            Some(_) => INPUT_KEYS,
            None => REFERENCE_KEYS,
        };
        let field = Field {
            aliases: stimulus.aliases.clone(),
            min: stimulus.range[0],
            max: stimulus.range[1],
            is_whole: stimulus.is_whole,
            ..Field::signal(&stimulus.target, &stimulus.unit, "")
        };
        Known {
            key: stimulus.key(),
            ..Known::new(group, &field, true)
        }
    });
    Some(of_law.chain(of_plant).chain(signals).collect())
}

fn change(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &ChangeContext<'_>,
    keys: Option<&[Known]>,
    id: u32,
) -> Option<Change> {
    reader.refuse_unknown(section, &[]);
    let problems = reader.problems.len();
    let at_s = reader.number(section, "at_s");
    let ramp_s = reader.number(section, "ramp_s");
    let set = section
        .table
        .get("set")
        .and_then(|_| reader.table(section, "set"));
    let advice = Advice {
        stimuli: context.stimuli.unwrap_or_default(),
        constants: context.constants,
    };
    let set = set.map(|set| values(reader, section, &set, keys, advice));
    let clear = section
        .table
        .get("clear")
        .and_then(|_| cleared(reader, section, keys));
    if reader.problems.len() > problems {
        return None;
    }
    let (set, clear) = (set.unwrap_or_default(), clear.unwrap_or_default());
    if set.is_empty() && clear.is_empty() {
        let message = match section.path.as_str() {
            "" => "the change is empty".into(),
            path => format!("`{path}` has no effect"),
        };
        reader
            .report(
                ProblemKind::MissingKey,
                &section.path,
                section.place,
                message,
            )
            .expected("values under `set`, or reference signals under `clear`");
        return None;
    }
    if let Some(both) = set.iter().find(|one| clear.contains(&one.key)) {
        let message = format!("`{}` is both set and cleared", both.key);
        reader.report_at(section, "clear", ProblemKind::Duplicate, message);
        return None;
    }
    let is_whole = |one: &ChangedValue| {
        let mut keys = keys.into_iter().flatten();
        keys.any(|known| known.key == one.key && known.field.is_whole)
    };
    let has_no_ramp =
        |one: &&ChangedValue| ramp_s.is_some() && (!one.value.is_finite() || is_whole(one));
    let no_way = match set.iter().find(has_no_ramp) {
        Some(one) if one.value.is_finite() => Some(format!(
            "`{}` takes whole numbers only, so it cannot change along a ramp",
            one.key
        )),
        Some(one) => Some(format!(
            "`{}` cannot change to {} along a ramp",
            one.key, one.value
        )),
        None if ramp_s.is_some() && set.is_empty() => Some(
            "a reference signal returns to its stimulus at once, because a ramp needs an end value"
                .into(),
        ),
        None => None,
    };
    if let Some(message) = no_way {
        reader
            .report_at(section, "ramp_s", ProblemKind::Mismatch, message)
            .help("leave out the ramp");
        return None;
    }
    let Grid { rate, steps } = context.grid?;
    let step = at_s.map(|at_s| rate.step_at_or_after(at_s));
    if let (Some(at_s), Some(step)) = (at_s, step)
        && step.0 >= steps
    {
        let end_s = rate.seconds(Step(steps));
        let message = format!(
            "`{}` is {at_s}, and the run ends at {end_s} s",
            section.path_of("at_s")
        );
        reader
            .report_at(section, "at_s", ProblemKind::OutOfRange, message)
            .expected(format!("a time before {end_s} s"));
        return None;
    }
    Some(Change {
        id,
        step,
        ramp_steps: ramp_s.map_or(0, |ramp_s| rate.step_at_or_after(ramp_s).0),
        live: false,
        set,
        clear,
    })
}

/// Returns the values of a table by full name; if two keys mean the same name, the longer key counts.
fn values(
    reader: &mut Reader,
    section: &Section<'_>,
    set: &Section<'_>,
    keys: Option<&[Known]>,
    advice: Advice<'_>,
) -> Vec<ChangedValue> {
    let mut leaves = Vec::new();
    collect(set.table, "", &[], &mut leaves);
    let mut by_name: BTreeMap<String, (Written, ChangedValue)> = BTreeMap::new();
    for (name, entry) in leaves {
        // As typed, at its place.
        let path = match section.path.as_str() {
            "" => name.clone(),
            _ => set.path_of(&name),
        };
        let Some(keys) = keys else {
            continue;
        };
        // A full key is never also the short form of another.
        let matches: Vec<&Known> = match keys.iter().find(|one| one.is_called(&name)) {
            Some(exact) => vec![exact],
            None => (keys.iter())
                .filter(|one| one.keys().any(|key| is_short_form(key, &name)))
                .collect(),
        };
        let tunable: Vec<&Known> = matches
            .iter()
            .copied()
            .filter(|one| one.is_tunable)
            .collect();
        if tunable.is_empty() {
            let is_there = !matches.is_empty();
            unknown(reader, &path, &name, entry, keys, is_there, advice);
        }
        for one in tunable {
            let Some(value) = reader.quantity(&path, &entry.node, &Quantity::from(&one.field))
            else {
                break; // one message for one value
            };
            let typed_value = Written::new(&name, one.is_called(&name), value, &entry.node.place);
            let value = ChangedValue {
                key: one.key.clone(),
                unit: one.field.unit.clone(),
                value,
            };
            match typed_value.beats(by_name.get(&one.key).map(|(earlier, _)| earlier)) {
                Ok(true) => {
                    by_name.insert(one.key.clone(), (typed_value, value));
                }
                Ok(false) => {}
                Err(message) => {
                    reader.report(ProblemKind::Duplicate, &path, &entry.node.place, message);
                    break;
                }
            }
        }
    }
    by_name.into_values().map(|(_, value)| value).collect()
}

/// Returns `true` if a key in the scenario consists of the group and the last parts of a full key.
fn is_short_form(key: &str, typed: &str) -> bool {
    let groups = [PLANT_KEYS.len(), key_group(key)];
    groups.into_iter().any(|length| {
        let (Some(own), Some(other)) = (key.get(..length), typed.get(..length)) else {
            return false;
        };
        own == other && own.ends_with('.') && is_named(&key[length..], &typed[length..])
    })
}

/// Returns the length of the group before a law parameter.
fn key_group(key: &str) -> usize {
    let mut dots = key.match_indices('.').map(|(place, _)| place + 1);
    dots.nth(1).unwrap_or(0)
}

fn unknown(
    reader: &mut Reader,
    path: &str,
    name: &str,
    entry: &Entry,
    keys: &[Known],
    is_there: bool,
    advice: Advice<'_>,
) {
    let tunable = keys.iter().filter(|one| one.is_tunable);
    let names: Vec<&str> = tunable.map(|one| one.key.as_str()).collect();
    let expected = match names.len() {
        0 => "none: neither the law nor the plant has anything that can be changed".into(),
        count if count <= LISTED => format!("one of {}", listed(names.iter().copied())),
        count => format!("one of {count} keys, which `hil get --tunable` lists"),
    };
    let message = match is_there || advice.is_fixed(name) {
        true => format!("`{name}` cannot be changed during the run"),
        false => format!("there is no `{name}` to change"),
    };
    let problem = reader
        .report(ProblemKind::UnknownKey, path, &entry.key_place, message)
        .expected(expected)
        .nearest(name, names.iter().copied());
    if let Some(help) = advice.on(name) {
        problem.help(help);
    }
}

/// Lists the reference signals that return to their stimulus.
fn cleared(
    reader: &mut Reader,
    section: &Section<'_>,
    keys: Option<&[Known]>,
) -> Option<Vec<String>> {
    let texts = reader.texts(section, "clear")?;
    let keys = keys?;
    let is_signal = |one: &&Known| {
        let mut groups = [REFERENCE_KEYS, INPUT_KEYS].into_iter();
        groups.any(|group| one.key.starts_with(group))
    };
    let signals: Vec<&Known> = keys.iter().filter(is_signal).collect();
    let mut clear = Vec::new();
    for (path, place, text) in texts {
        if let Some(signal) = signals.iter().find(|one| one.is_called(text)) {
            clear.push(signal.key.clone());
        } else {
            let message = format!("`{text}` has no stimulus to return to");
            reader
                .report(ProblemKind::UnknownName, path, place, message)
                .one_of(text, signals.iter().map(|one| one.key.as_str()));
        }
    }
    clear.sort_unstable();
    clear.dedup();
    Some(clear)
}

impl RequestContext {
    /// Checks a change that receives this number, against the run and its current law, given by name and tunable
    /// parameters.
    ///
    /// # Errors
    /// All problems found.
    pub fn check_change(
        &self,
        request: &ChangeRequest,
        law: (&str, &[Field]),
        id: u32,
    ) -> Result<Change, Problems> {
        let scenario = Scenario::parse(&toml(request), "request")?;
        let mut reader = Reader::new(scenario.sources.clone(), Vec::new());
        let root = root(&scenario).with_keys(LIVE_CHANGE);
        let context = ChangeContext {
            plant: Some(&self.plant),
            law: Some(law),
            stimuli: Some(&self.stimuli),
            constants: &self.constants,
            grid: Some(self.grid()),
        };
        let change = live(&mut reader, &root, &context, id);
        reader.finish(change)
    }
}

/// Formats a request as the table that a scenario has for a change.
fn toml(request: &ChangeRequest) -> String {
    let mut text = String::new();
    let number = toml_float;
    for (key, value) in [("at_s", request.at_s), ("ramp_s", request.ramp_s)] {
        if let Some(value) = value {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{key} = {}", number(value));
        }
    }
    let string = |text: &str| toml::Value::from(text).to_string();
    if !request.clear.is_empty() {
        let keys: Vec<String> = request.clear.iter().map(|key| string(key)).collect();
        let _ = writeln!(text, "clear = [{}]", keys.join(", "));
    }
    if !request.set.is_empty() {
        let _ = writeln!(text, "[set]");
    }
    for one in &request.set {
        let parts: Vec<String> = one.key.split('.').map(string).collect();
        let _ = writeln!(text, "{} = {}", parts.join("."), number(one.value));
    }
    text
}

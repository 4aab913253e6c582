//! Misplaced keys, such as `kp` at the top of a scenario: suggests the full key with that name, or explains the name.
//! Only examines keys that are refused anyway, so that no valid scenario depends on this module.

use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription};
use shared_types::table::nearest;

use crate::document::{Table, Value};
use crate::keys::{CONTROLLER, Key, PLANT, REALTIME, RUN};
use crate::plan::Stimulus;
use crate::problem::ProblemKind;
use crate::reader::Reader;

/// Maximum number of suggestions.
const MOST: usize = 3;

/// Parts of a scenario to which names may belong.
pub(super) struct Owners<'a> {
    pub(super) plant: Option<&'a PlantDescription>,
    pub(super) law: Option<&'a LawDescription>,
    pub(super) stimuli: &'a [Stimulus],
    pub(super) kinds: &'a [FaultKindDescription],
}

/// Meaning of a name.
#[derive(Clone)]
enum Owned {
    /// Value with this full key.
    Key(String),
    /// Any other meaning, with advice.
    Other(String),
}

/// Adds suggestions to the unknown keys of the scenario, its plant and its controller.
pub(super) fn advise(reader: &mut Reader, root: &Table, owners: &Owners<'_>) {
    let names = names(owners);
    for problem in &mut reader.problems {
        let outer = problem.key.rsplit_once('.').map_or("", |(outer, _)| outer);
        if problem.kind != ProblemKind::UnknownKey || !["", "plant", "controller"].contains(&outer)
        {
            continue;
        }
        let typed = leaf(root, &problem.key);
        let own = problem.nearest.iter();
        let own = own.map(|name| (name.clone(), Owned::Key(name.clone())));
        let further = names
            .iter()
            .filter(|(name, _)| !problem.nearest.contains(name));
        let all: Vec<(String, Owned)> = own.chain(further.cloned()).collect();
        let close = nearest(&typed, all.iter().map(|(name, _)| name.as_str()));
        let Some(closest) = close.first() else {
            continue;
        };
        let mut keys: Vec<String> = Vec::new();
        let mut advice = None;
        let of_name = |close: &&str| {
            all.iter()
                .filter(|(name, _)| name == close)
                .collect::<Vec<_>>()
        };
        for (name, owned) in close.iter().flat_map(of_name) {
            match owned {
                Owned::Key(key) if !keys.contains(key) => keys.push(key.clone()),
                Owned::Other(text) if name == closest => advice = advice.or(Some(text.clone())),
                Owned::Key(_) | Owned::Other(_) => {}
            }
        }
        keys.truncate(MOST);
        if advice.is_some() {
            keys.clear(); // no key is meant
        }
        problem.nearest = keys;
        problem.help = problem.help.take().or(advice);
    }
}

/// Returns the last name of a key, or of the only value below it, such as `kp` of `controller.parameters.kp`.
fn leaf(root: &Table, key: &str) -> String {
    let mut parts = key.split('.');
    let mut name = parts.next().unwrap_or_default();
    let mut entry = root.get(name);
    for part in parts {
        name = part;
        entry = match entry.map(|entry| &entry.node.value) {
            Some(Value::Table(table)) => table.get(part),
            _ => None,
        };
    }
    while let Some(Value::Table(table)) = entry.map(|entry| &entry.node.value)
        && let [only] = table.entries()
    {
        name = &only.key;
        entry = Some(only);
    }
    name.to_owned()
}

/// Lists the last names of all named things.
fn names(owners: &Owners<'_>) -> Vec<(String, Owned)> {
    let tables: [(&str, &[Key]); 4] = [
        ("run", RUN),
        ("plant", PLANT),
        ("controller", CONTROLLER),
        ("realtime", REALTIME),
    ];
    let keys = tables.into_iter().flat_map(|(table, keys)| {
        let full = move |key: &Key| {
            (
                key.name.to_owned(),
                Owned::Key(format!("{table}.{}", key.name)),
            )
        };
        keys.iter().map(full)
    });
    let mut all: Vec<(String, Owned)> = keys.collect();
    let mut parameter = |table: &str, name: &str| {
        let last = name.rsplit('.').next().unwrap_or(name);
        all.push((last.into(), Owned::Key(format!("{table}.{name}"))));
    };
    for field in owners
        .law
        .iter()
        .flat_map(|law| law.parameters.iter().map(move |field| (law, field)))
    {
        let (law, field) = field;
        parameter(&format!("controller.{}", law.name), &field.name);
    }
    for field in owners.plant.iter().flat_map(|plant| &plant.parameters) {
        parameter("plant.parameters", &field.name);
    }
    for (number, stimulus) in owners.stimuli.iter().enumerate() {
        for field in stimulus.fields() {
            let advice = format!(
                "`{}` is a reference signal: its values follow from the keys of `stimuli[{number}]`",
                field.name
            );
            all.push((field.name, Owned::Other(advice)));
        }
    }
    let own = owners.plant.iter().flat_map(|plant| &plant.faults);
    let own = own.map(|fault| fault.kind.as_str());
    let shared = owners.kinds.iter().map(|kind| kind.kind.as_str());
    for kind in own.chain(shared) {
        let advice = format!(
            "`{kind}` is a kind of fault: a [[faults]] with kind = \"{kind}\" causes it, and hil inject does so during the run"
        );
        all.push((kind.into(), Owned::Other(advice)));
    }
    all
}

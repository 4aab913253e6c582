//! `[[faults]]`: the schema of an effect depends on the event's kind.

use serde_json::{Map, Value, json};
use shared_types::describe::{
    ActsOn, FaultDescription, FaultKindDescription, ListDescription, PlantDescription,
    ProfileDescription,
};
use shared_types::table::Field;

use super::{choices, field, merge, of_kinds, offer, section};
use crate::check::{groups, unit_of};
use crate::keys;

/// Completes the table of an event with the available kinds.
pub(super) fn complete(
    event: &mut Value,
    plants: &[PlantDescription],
    kinds: &[FaultKindDescription],
) {
    if plants.is_empty() {
        // The faults of a plant and their keys have names of the plant's choice.
        event["properties"]["effects"]["items"]["additionalProperties"] = json!(true);
        return;
    }
    let own: Vec<(&PlantDescription, &FaultDescription)> = plants
        .iter()
        .flat_map(|plant| plant.faults.iter().map(move |fault| (plant, fault)))
        .collect();
    let names: Vec<&str> = (own.iter().map(|(_, fault)| fault.kind.as_str()))
        .chain(kinds.iter().map(|kind| kind.kind.as_str()))
        .collect();
    merge(
        &mut event["properties"]["kind"],
        choices(names.iter().copied()),
    );
    event["properties"]["effects"]["items"] = json!({"type": "object"});
    let mut rules = Map::new();
    for (plant, fault) in own {
        let effect = rules
            .entry(&fault.kind)
            .or_insert_with(|| effect(&fault.summary));
        of_plant(effect, plant, fault);
    }
    for kind in kinds {
        // A plant's own fault of that name wins.
        let name = kind.kind.clone();
        rules.entry(name).or_insert_with(|| of_kind(plants, kind));
    }
    event["allOf"] = rules
        .into_iter()
        .map(|(kind, effect)| {
            json!({
                "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                "then": {"properties": {"effects": {"items": effect}}},
            })
        })
        .collect();
}

/// Returns the schema of an effect with the keys common to all effects.
fn effect(text: &str) -> Value {
    let mut effect = section(keys::EFFECT);
    effect["description"] = json!(text);
    let profiles = keys::PROFILES.iter();
    merge(
        &mut effect["properties"]["profile"],
        of_kinds(
            keys::PROFILE,
            profiles.map(|kind| (kind.name, kind.text, kind.keys)),
        ),
    );
    for key in ["type", "properties", "required", "additionalProperties"] {
        let profile = effect["properties"]["profile"].as_object_mut();
        profile.map(|profile| profile.remove(key)); // each kind has its own
    }
    effect
}

/// Adds the keys of a plant fault.
fn of_plant(effect: &mut Value, plant: &PlantDescription, fault: &FaultDescription) {
    let properties = &mut effect["properties"];
    if let Some(selector) = &fault.selector {
        let numbers = groups(plant, fault).into_iter();
        let numbers: Vec<u64> = numbers.filter_map(|number| number.parse().ok()).collect();
        let slot = &mut properties[selector];
        let mut all: Vec<Value> = slot["enum"].as_array().cloned().unwrap_or_default();
        all.extend(numbers.into_iter().map(|number| json!(number)));
        *slot = json!({"type": "integer", "enum": all, "description": "Which target."});
    }
    for size in &fault.sizes {
        offer(&mut properties[&size.name], size);
    }
    if let ProfileDescription::Exponential { speed } = &fault.profile {
        offer(&mut properties[&speed.name], speed);
    }
}

fn of_kind(plants: &[PlantDescription], kind: &FaultKindDescription) -> Value {
    let mut effect = effect(&format!("{} {}", kind.summary, kind.equation));
    let mut required = vec![json!("target")];
    let properties = &mut effect["properties"];
    properties["target"] = target(plants, kind.acts_on);
    for parameter in &kind.parameters {
        properties[&parameter.name] = field(&Field {
            unit: unit_of(parameter, None),
            ..parameter.clone()
        });
        if parameter.default.is_none() {
            required.push(json!(parameter.name));
        }
    }
    if let Some(described) = &kind.list {
        properties[&described.key] = list(described);
    }
    effect["required"] = json!(required);
    effect
}

/// Returns the schema of a kind's targets. Reference signals depend on the scenario.
fn target(plants: &[PlantDescription], acts_on: ActsOn) -> Value {
    let fields = |prefix: &'static str, all: fn(&PlantDescription) -> Vec<&str>| {
        let names = plants.iter().flat_map(all);
        names
            .map(move |name| format!("{prefix}.{name}"))
            .collect::<Vec<String>>()
    };
    let mut names: Vec<String> = match acts_on {
        ActsOn::Links => {
            let links = ["link.sample", "link.command"].into_iter();
            let all =
                links.flat_map(|link| [link.to_owned(), format!("{link}.a"), format!("{link}.b")]);
            all.collect()
        }
        ActsOn::Sides => vec!["controller".into(), "plant".into()],
        ActsOn::Controller => vec!["controller".into()],
        ActsOn::Signals | ActsOn::Numbers => {
            let mut names = fields("measured", |plant| {
                plant.measured.iter().map(|f| f.name.as_str()).collect()
            });
            names.extend(fields("command", |plant| {
                plant.commands.iter().map(|f| f.name.as_str()).collect()
            }));
            names
        }
    };
    if acts_on == ActsOn::Numbers {
        names.extend(fields("parameter", |plant| {
            let faultable = plant.parameters.iter().filter(|f| f.faultable);
            faultable.map(|f| f.name.as_str()).collect()
        }));
    }
    let choices_known = choices(names.iter().map(String::as_str));
    let mut target = match acts_on {
        ActsOn::Signals | ActsOn::Numbers => {
            json!({"anyOf": [choices_known, {"pattern": "^(reference|input)\\."}]})
        }
        _ => choices_known,
    };
    target["description"] = json!("Target of the effect.");
    target["type"] = json!("string");
    target
}

fn list(described: &ListDescription) -> Value {
    let number = json!({"type": "number"});
    let columns = described.columns;
    let row = match columns {
        1 => number,
        _ => json!({"type": "array", "items": number, "minItems": columns, "maxItems": columns}),
    };
    json!({
        "description": described.description,
        "anyOf": [{"type": "array", "items": row, "minItems": 1}, section(keys::FILE)],
    })
}

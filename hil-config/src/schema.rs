//! JSON schema of the scenario format, for editors that complete and check TOML.
//!
//! Implements `hil config schema`. Generated from the same tables as the check; the keys of plants and laws come from
//! their descriptions.

mod faults;

use serde_json::{Map, Value, json};
use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription};
use shared_types::number::unit_shown;
use shared_types::table::Field;

use crate::keys::{self, Key, KeyKind, METRICS, PLOTS, SectionKind, WAVEFORMS};
use crate::quantity::Quantity;
use crate::reader::describe;

/// Returns the JSON schema (draft 2020-12) of a scenario with these plants, laws and fault kinds. Without plants or
/// laws, the tables that depend on them accept any key.
#[must_use]
pub fn schema(
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Value {
    let mut root = section(keys::SCENARIO);
    root["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    root["title"] = json!("hil scenario");
    let properties = &mut root["properties"];

    if !plants.is_empty() {
        let plant = &mut properties["plant"]["properties"];
        merge(
            &mut plant["model"],
            choices(plants.iter().map(|plant| plant.name.as_str())),
        );
        let all: Vec<&Field> = plants.iter().flat_map(|plant| &plant.parameters).collect();
        merge(&mut plant["parameters"], described(&all));
        let truth: Vec<&Field> = plants.iter().flat_map(|plant| &plant.truth).collect();
        merge(&mut plant["limits"], limits(&truth));
        let commands: Vec<&Field> = plants.iter().flat_map(|plant| &plant.commands).collect();
        merge(&mut plant["safe_command"], described(&commands));
        merge(&mut plant["inputs"], inputs(&commands));
    }
    if !laws.is_empty() {
        let controller = &mut properties["controller"]["properties"];
        merge(
            &mut controller["law"],
            choices(laws.iter().map(|law| law.name.as_str())),
        );
        let all: Vec<&Field> = laws.iter().flat_map(|law| &law.model).collect();
        merge(&mut controller["model"], described(&all));
        for law in laws {
            let same_name = laws.iter().filter(|other| other.name == law.name);
            let all: Vec<&Field> = same_name.flat_map(|law| &law.parameters).collect();
            let mut table = described(&all);
            table["description"] = json!(law.summary);
            controller[&law.name] = table;
        }
    }
    properties["stimuli"]["items"] = stimulus();
    properties["metrics"]["items"] = of_optional_kinds(keys::METRIC, METRICS);
    properties["plots"]["items"] = of_optional_kinds(keys::PLOT, PLOTS);
    faults::complete(&mut properties["faults"]["items"], plants, kinds);
    root
}

/// Returns the JSON schema (draft 2020-12) of a study.
#[must_use]
pub fn study() -> Value {
    let mut root = section(keys::STUDY);
    root["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    root["title"] = json!("hil study");
    let kinds = keys::SPREADS.iter();
    root["properties"]["vary"]["items"] = of_kinds(
        keys::VARY,
        kinds.map(|kind| (kind.name, kind.text, kind.keys)),
    );
    root
}

/// Returns the JSON schema (draft 2020-12) of a port file.
#[must_use]
pub fn port() -> Value {
    let of = |common, kinds: &[keys::SectionKind]| {
        let kinds = kinds.iter();
        of_kinds(common, kinds.map(|kind| (kind.name, kind.text, kind.keys)))
    };
    let mut root = section(keys::PORT);
    root["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    root["title"] = json!("hil port");
    let properties = &mut root["properties"];
    properties["media"]["items"] = of(keys::MEDIUM, keys::MEDIA);
    properties["frames"]["items"]["properties"]["fields"]["items"] = of(keys::FIELD, keys::FIELDS);
    root
}

/// Returns the schema of a table with known keys and no others.
fn section(keys: &[Key]) -> Value {
    let properties: Map<String, Value> = keys
        .iter()
        .map(|key| (key.name.to_owned(), property(key)))
        .collect();
    let required: Vec<&str> = keys
        .iter()
        .filter(|key| key.required)
        .map(|key| key.name)
        .collect();
    json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

fn property(key: &Key) -> Value {
    let mut value = match key.kind {
        KeyKind::Number {
            unit,
            min,
            max,
            default,
        } => {
            let any = Quantity::finite(unit);
            let mut value = quantity(&Quantity { min, max, ..any });
            if let Some(default) = default {
                value["default"] = json!(default);
            }
            value
        }
        KeyKind::Integer { min, max, default } => {
            let mut value = json!({"type": "integer", "minimum": min, "maximum": max});
            if let Some(default) = default {
                value["default"] = json!(default);
            }
            value
        }
        KeyKind::Text { choices, default } => {
            let mut value = json!({"type": "string"});
            if !choices.is_empty() {
                value["enum"] = json!(choices);
            }
            if let Some(default) = default {
                value["default"] = json!(default);
            }
            value
        }
        KeyKind::Boolean { default } => json!({"type": "boolean", "default": default}),
        KeyKind::Numbers => json!({"type": "array", "items": {"type": "number"}, "minItems": 1}),
        KeyKind::Texts => json!({"type": "array", "items": {"type": "string"}, "minItems": 1}),
        KeyKind::Values => {
            let values = json!({"type": ["number", "string", "boolean"]});
            json!({"type": "array", "items": values, "minItems": 1})
        }
        KeyKind::Pair => pair(),
        KeyKind::Pairs => json!({"type": "array", "items": pair(), "minItems": 1}),
        KeyKind::Quantity { unit, min, max } => {
            let any = Quantity::finite(unit);
            json!({"anyOf": [quantity(&Quantity { min, max, ..any }), {"type": "string"}]})
        }
        KeyKind::Range => {
            let end = json!({"type": ["number", "string"]});
            json!({"type": "array", "items": end, "minItems": 2, "maxItems": 2})
        }
        KeyKind::Event => json!({"type": ["string", "integer"]}),
        KeyKind::Section(keys) => section(keys),
        KeyKind::List(keys) => json!({"type": "array", "items": section(keys)}),
        KeyKind::Described => json!({"type": "object"}),
        KeyKind::Program => json!({"anyOf": [
            {"type": "string"},
            {"type": "object", "additionalProperties": {"type": "string"}, "minProperties": 1},
        ]}),
    };
    let text = match key.kind {
        KeyKind::Number { .. } | KeyKind::Integer { .. } | KeyKind::Quantity { .. } => {
            format!("{} Expected: {}.", key.text, describe(&key.kind))
        }
        _ => key.text.into(),
    };
    value["description"] = json!(text);
    value
}

fn pair() -> Value {
    json!({"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2})
}

fn quantity(quantity: &Quantity<'_>) -> Value {
    let mut value = json!({"type": if quantity.whole { "integer" } else { "number" }});
    if quantity.min > f64::MIN {
        value["minimum"] = json!(quantity.min);
    }
    if quantity.max < f64::MAX {
        value["maximum"] = json!(quantity.max);
    }
    value
}

fn field(field: &Field) -> Value {
    let described = Quantity::from(field);
    let mut value = quantity(&described);
    let text = &field.description;
    value["description"] = json!(format!("{text} Expected: {}.", described.expected()));
    if let Some(default) = field
        .default
        .filter(|default| default.is_finite() && !field.is_optional)
    {
        value["default"] = json!(default);
    }
    value
}

/// Returns the schema of a table of parameters: groups as tables, and every last part of a name alone.
fn described(fields: &[&Field]) -> Value {
    let mut root = json!({"type": "object", "properties": {}, "additionalProperties": false});
    let names = (fields.iter()).flat_map(|one| one.names().map(move |name| (*one, name)));
    for (one, name) in names {
        let mut table = &mut root;
        let mut parts = name.split('.').peekable();
        while let Some(part) = parts.next() {
            let properties = &mut table["properties"];
            if parts.peek().is_some() && properties[part].is_null() {
                properties[part] =
                    json!({"type": "object", "properties": {}, "additionalProperties": false});
            } else if parts.peek().is_none() {
                offer(&mut properties[part], one);
            }
            table = &mut table["properties"][part];
        }
        if let Some((_, last)) = name.rsplit_once('.') {
            offer(&mut root["properties"][last], one);
        }
    }
    root
}

/// Adds a field; if two fields share a key, the range becomes the union of both.
fn offer(slot: &mut Value, one: &Field) {
    let new = field(one);
    if slot.is_null() {
        *slot = new;
        return;
    }
    for (bound, wider) in [
        ("minimum", f64::lt as fn(&f64, &f64) -> bool),
        ("maximum", f64::gt),
    ] {
        match (slot[bound].as_f64(), new[bound].as_f64()) {
            (Some(old), Some(new)) if wider(&new, &old) => slot[bound] = json!(new),
            (Some(_), Some(_)) => {}
            _ => {
                slot.as_object_mut().map(|slot| slot.remove(bound));
            }
        }
    }
    if slot["default"] != new["default"] {
        slot.as_object_mut().map(|slot| slot.remove("default"));
    }
}

/// Returns the schema of `[plant.inputs]`: numbers, or the start value of the plant's table.
fn inputs(fields: &[&Field]) -> Value {
    let mut value = described(fields);
    let properties = value["properties"].as_object_mut();
    for (_, one) in properties.into_iter().flatten() {
        if one["type"] != json!("object") {
            *one = json!({"anyOf": [one.take(), {"const": "start"}]});
        }
    }
    value
}

fn limits(fields: &[&Field]) -> Value {
    let properties: Map<String, Value> = fields
        .iter()
        .flat_map(|field| field.names().map(move |name| (*field, name)))
        .map(|(field, name)| {
            let mut value = pair();
            value["description"] = json!(match unit_shown(&field.unit) {
                "" => field.description.clone(),
                unit => format!("{} In {unit}.", field.description),
            });
            (name.to_owned(), value)
        })
        .collect();
    json!({"properties": properties, "additionalProperties": false})
}

/// Returns the schema of a stimulus: the common keys, and those of each kind.
fn stimulus() -> Value {
    let kinds = || {
        WAVEFORMS
            .iter()
            .map(|kind| (kind.name, kind.text, kind.keys))
    };
    let mut stimulus = of_kinds(keys::STIMULUS, kinds());
    let part = of_kinds(
        keys::PART,
        kinds().filter(|(name, ..)| *name != keys::SEQUENCE_KIND),
    );
    for kind in stimulus["oneOf"].as_array_mut().into_iter().flatten() {
        if kind["properties"]["kind"]["const"] == json!(keys::SEQUENCE_KIND) {
            kind["properties"]["parts"]["items"] = part.clone();
        }
    }
    stimulus
}

/// Returns the schema of a table whose first kind is the default: the common keys, and those of each kind.
fn of_optional_kinds(common: &[Key], kinds: &[SectionKind]) -> Value {
    let all = kinds.iter();
    let mut schema = of_kinds(common, all.map(|kind| (kind.name, kind.text, kind.keys)));
    let others = schema["oneOf"].as_array_mut().into_iter().flatten().skip(1);
    for other in others {
        if let Some(required) = other["required"].as_array_mut() {
            required.push(json!("kind"));
        }
    }
    schema
}

/// Returns the schema of a table whose keys depend on its `kind`: name, text and keys of each kind.
fn of_kinds<'a>(
    common: &[Key],
    kinds: impl Iterator<Item = (&'a str, &'a str, &'a [Key])>,
) -> Value {
    let kinds: Vec<Value> = kinds
        .map(|(name, text, keys)| {
            let mut one = section(common);
            let own = section(keys);
            merge(&mut one["properties"], own["properties"].clone());
            one["properties"]["kind"] = json!({"const": name, "description": text});
            if let (Some(all), Some(own)) =
                (one["required"].as_array_mut(), own["required"].as_array())
            {
                all.extend(own.iter().cloned());
            }
            one["description"] = json!(text);
            one
        })
        .collect();
    json!({"oneOf": kinds})
}

fn choices<'a>(names_given: impl Iterator<Item = &'a str>) -> Value {
    let mut names: Vec<&str> = Vec::new();
    for name in names_given {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    json!({"enum": names})
}

/// Merges the entries of one object into another, overriding existing entries.
fn merge(into: &mut Value, from: Value) {
    if let (Value::Object(into), Value::Object(from)) = (into, from) {
        into.extend(from);
    }
}

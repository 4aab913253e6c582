//! The JSON schema, compared with the check.

use hil_config::schema::schema;
use serde_json::{Value, json};

use crate::{BASE, descriptions};

/// Collects every key of a TOML value that the schema does not offer, by path. All alternatives are tried.
fn unknown_keys(schema: &Value, value: &toml::Value, path: &str, unknown: &mut Vec<String>) {
    match value {
        toml::Value::Table(table) => {
            if let Some(kinds) = schema["oneOf"].as_array() {
                // An alternative whose kind is optional applies to tables without one.
                let kind = table.get("kind").and_then(toml::Value::as_str);
                let needs_kind = |one: &Value| {
                    let needed = one["required"].as_array().into_iter().flatten();
                    needed.into_iter().any(|key| key == "kind")
                };
                let fitting = kinds
                    .iter()
                    .find(|one| match kind {
                        Some(kind) => one["properties"]["kind"]["const"] == kind,
                        None => !needs_kind(one),
                    })
                    .expect("a kind");
                return unknown_keys(fitting, value, path, unknown);
            }
            let schema = &with_rules(schema, table);
            for (key, value) in table {
                let path = format!("{path}.{key}");
                match schema["properties"].get(key) {
                    Some(schema) => unknown_keys(schema, value, &path, unknown),
                    None => unknown.push(path),
                }
            }
        }
        toml::Value::Array(items) => {
            for item in items {
                unknown_keys(&schema["items"], item, path, unknown);
            }
        }
        _ => {}
    }
}

/// Returns a schema with its rules for a table of this kind applied.
fn with_rules(schema: &Value, table: &toml::Table) -> Value {
    let mut schema = schema.clone();
    let rules = schema["allOf"].take();
    for rule in rules.as_array().into_iter().flatten() {
        let kind = rule["if"]["properties"]["kind"]["const"].as_str();
        if kind == table["kind"].as_str() {
            let then = rule["then"]["properties"].as_object().expect("properties");
            for (key, value) in then {
                schema["properties"][key] = value.clone();
            }
        }
    }
    schema
}

/// Returns the schema of the scenarios of all described plants and laws.
fn described() -> Value {
    let (plants, laws) = (descriptions::plants(), descriptions::laws());
    schema(&plants, &laws, &descriptions::kinds())
}

/// Returns the schema of the effects of a kind of fault.
fn effects(schema: &Value, kind: &str) -> Value {
    let rules = &schema["properties"]["faults"]["items"]["allOf"];
    let rule = rules
        .as_array()
        .into_iter()
        .flatten()
        .find(|rule| rule["if"]["properties"]["kind"]["const"] == kind);
    rule.unwrap_or_else(|| panic!("no `{kind}`"))["then"]["properties"]["effects"]["items"].clone()
}

#[test]
fn the_schema_offers_exactly_the_keys_of_valid_scenarios() {
    let schema = described();
    let mut unknown = Vec::new();
    let value: toml::Value = toml::from_str(BASE).expect("TOML");
    unknown_keys(&schema, &value, "", &mut unknown);
    assert!(unknown.is_empty(), "{unknown:?}");

    let text = format!("{BASE}\ncolour = 1\n[controller.lqr]\n").replace("seed =", "sed =");
    let value: toml::Value = toml::from_str(&text).expect("TOML");
    unknown_keys(&schema, &value, "", &mut unknown);
    unknown.sort();
    assert_eq!(unknown, [".controller.lqr", ".panel.colour", ".run.sed"]);
}

#[test]
fn the_schema_has_ranges_defaults_and_names() {
    let schema = described();
    let at = |pointer: &str| schema.pointer(pointer).unwrap_or(&Value::Null).clone();
    let rate = "/properties/run/properties/rate_hz";
    assert_eq!(at(&format!("{rate}/minimum")), 0.001);
    assert_eq!(at(&format!("{rate}/maximum")), 1e6);
    assert_eq!(at("/properties/run/additionalProperties"), false);
    assert_eq!(at("/properties/plant/properties/substeps/default"), 4);
    assert_eq!(
        at("/properties/plant/properties/model/enum/1"),
        "spring-mass"
    );
    let parameters = "/properties/plant/properties/parameters/properties";
    assert_eq!(
        at(&format!(
            "{parameters}/actuator1/properties/piston_mass_kg/default"
        )),
        55.0
    );
    assert_eq!(at(&format!("{parameters}/piston_mass_kg/minimum")), 0.001);
    let realtime = "/properties/realtime/properties";
    assert_eq!(at(&format!("{realtime}/priority/maximum")), 98);
    assert_eq!(at(&format!("{realtime}/prefault/type")), "boolean");
    assert_eq!(at(&format!("{realtime}/prefault/default")), false);
    assert_eq!(
        at(&format!("{realtime}/wait/enum")),
        json!(["hybrid", "spin", "yield", "sleep"])
    );
    // Two laws are called pid.
    let pid = "/properties/controller/properties/pid/properties";
    assert_eq!(at(&format!("{pid}/gain_a_per_m/default")), 90.0);
    assert_eq!(at(&format!("{pid}/gain_n_per_m/default")), 300.0);
}

#[test]
fn the_schema_has_the_keys_of_each_kinds_effects() {
    let schema = described();
    let kinds = &schema["properties"]["faults"]["items"]["properties"]["kind"]["enum"];
    let names = [
        "leakage",
        "burst",
        "softening",
        "bias",
        "drift",
        "delay",
        "dropout",
        "message-loss",
        "late",
        "skip",
    ];
    assert_eq!(*kinds, json!(names));
    let leakage = effects(&schema, "leakage");
    assert_eq!(leakage["properties"]["actuator"]["enum"], json!([1, 2]));
    assert_eq!(leakage["properties"]["speed_per_s"]["maximum"], 1e6);
    assert_eq!(leakage["additionalProperties"], false);

    let delay = effects(&schema, "delay");
    assert_eq!(delay["properties"]["steps"]["type"], "integer");
    assert_eq!(delay["required"], json!(["target", "steps"]));
    let targets = &delay["properties"]["target"]["anyOf"];
    let names: Vec<&str> = (targets[0]["enum"].as_array().into_iter().flatten())
        .filter_map(Value::as_str)
        .collect();
    assert!(names.contains(&"measured.surface_angle_rad"));
    assert!(names.contains(&"parameter.actuator1.bulk_modulus_pa"));
    assert!(
        !names.contains(&"parameter.actuator1.piston_mass_kg"),
        "not faultable"
    );
    assert_eq!(targets[1]["pattern"], "^(reference|input)\\.");

    let late = effects(&schema, "late");
    let target = &late["properties"]["target"];
    assert_eq!(target["enum"], json!(["controller", "plant"]));
    assert_eq!(
        late["properties"]["histogram"]["anyOf"][0]["items"]["minItems"],
        2
    );
    let profiles = late["properties"]["profile"]["oneOf"]
        .as_array()
        .map(Vec::len);
    assert_eq!(profiles, Some(7));
}

#[test]
fn without_descriptions_their_tables_accept_any_key() {
    let schema = schema(&[], &[], &[]);
    let parameters = &schema["properties"]["plant"]["properties"]["parameters"];
    assert_eq!(parameters["type"], "object");
    assert!(parameters.get("additionalProperties").is_none());
}

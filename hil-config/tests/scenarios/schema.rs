//! The JSON schema, against what the check accepts.

use hil_config::schema::schema;
use serde_json::Value;

use crate::{BASE, descriptions};

/// Every key of a TOML value that the schema does not offer, by path. Alternatives are all tried.
fn unknown_keys(schema: &Value, value: &toml::Value, path: &str, unknown: &mut Vec<String>) {
    match value {
        toml::Value::Table(table) => {
            if let Some(kinds) = schema["oneOf"].as_array() {
                let kind = table["kind"].as_str();
                let fitting = kinds
                    .iter()
                    .find(|one| one["properties"]["kind"]["const"].as_str() == kind)
                    .expect("a kind");
                return unknown_keys(fitting, value, path, unknown);
            }
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

#[test]
fn the_schema_offers_every_key_of_a_right_scenario_and_no_other() {
    let schema = schema(&descriptions::plants(), &descriptions::laws());
    let mut unknown = Vec::new();
    let value: toml::Value = toml::from_str(BASE).expect("TOML");
    unknown_keys(&schema, &value, "", &mut unknown);
    assert!(unknown.is_empty(), "{unknown:?}");

    let text = format!("{BASE}\ncolour = 1\n[controller.lqr]\n").replace("seed =", "sed =");
    let value: toml::Value = toml::from_str(&text).expect("TOML");
    unknown_keys(&schema, &value, "", &mut unknown);
    unknown.sort();
    assert_eq!(unknown, [".controller.lqr", ".metrics.colour", ".run.sed"]);
}

#[test]
fn the_schema_knows_ranges_defaults_and_names() {
    let schema = schema(&descriptions::plants(), &descriptions::laws());
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
    // Both laws named pid.
    let pid = "/properties/controller/properties/pid/properties";
    assert_eq!(at(&format!("{pid}/gain_a_per_m/default")), 90.0);
    assert_eq!(at(&format!("{pid}/gain_n_per_m/default")), 300.0);
    let effects = "/properties/faults/items/properties/effects/items/properties";
    assert_eq!(
        at(&format!("{effects}/actuator/enum")),
        serde_json::json!([1, 2])
    );
}

#[test]
fn without_descriptions_their_tables_stay_open() {
    let schema = schema(&[], &[]);
    let parameters = &schema["properties"]["plant"]["properties"]["parameters"];
    assert_eq!(parameters["type"], "object");
    assert!(parameters.get("additionalProperties").is_none());
}

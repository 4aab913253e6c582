//! An FMU: any bytes as the archive, or as the model description in it.
//!
//! No name leads out of the folder that an archive is unpacked into. A model whose tables can be made describes itself
//! as a plant and as a law so that `hil` reads the same, or is refused.

use std::io::Cursor;
use std::path::{Component, Path};

use controller_process::controller::LawKind;
use hil_foreign::fmi::archive::{Archive, LIMITS, MARK};
use hil_foreign::fmi::description::ModelDescription;
use hil_foreign::fmi::{Model, sides};
use plant_process::plant::PlantKind;
use shared_types::describe::{Description, Invalid, ModelSettings};

use super::assert_told;

/// Maximum size of an unpacked entry in bytes.
const MOST: u64 = 1 << 20;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    if bytes.starts_with(&MARK) {
        archive(bytes);
    } else {
        model(bytes);
    }
}

fn archive(bytes: &[u8]) {
    let mut archive = match Archive::read(Cursor::new(bytes), &LIMITS) {
        Ok(archive) => archive,
        Err(error) => return assert_told(&error.to_string()),
    };
    let names: Vec<String> = archive.names().map(str::to_owned).collect();
    for name in &names {
        let mut parts = Path::new(name).components();
        let stays = parts.all(|part| matches!(part, Component::Normal(_)));
        assert!(stays, "{name:?} leads out of the folder");
        match archive.content(name, MOST) {
            Ok(content) if name == "modelDescription.xml" => model(&content),
            Ok(content) => assert!(content.len() as u64 <= MOST),
            Err(error) => assert_told(&error.to_string()),
        }
    }
}

fn model(bytes: &[u8]) {
    let description = match ModelDescription::decode(bytes) {
        Ok(description) => description,
        Err(error) => return assert_told(&error.to_string()),
    };
    let model = match Model::of(description, &[], &ModelSettings::default()) {
        Ok(model) => model,
        Err(error) => return assert_told(&error.to_string()),
    };
    let nothing = || Invalid("it is not run here".into());
    let plant = PlantKind::from_tables(sides::plant_description(&model), move |_| Err(nothing()));
    match plant {
        Ok(kind) => described(&model, |all| all.plants.push(kind.description)),
        Err(error) => assert_told(&error.to_string()),
    }
    let law = LawKind::from_tables(sides::law_description(&model), move |_| Err(nothing()));
    match law {
        Ok(kind) => described(&model, |all| all.laws.push(kind.description)),
        Err(error) => assert_told(&error.to_string()),
    }
}

/// Checks that `hil` reads the description printed by the program of the FMU.
fn described(model: &Model, add: impl FnOnce(&mut Description)) {
    let mut all = Description::new("hil-fmu", "1");
    all.imported = Some(Box::new(model.tables.imported.clone()));
    add(&mut all);
    all.check().expect("what can be run can be described");
    let text = serde_json::to_string(&all).expect("it can be told");
    let read: Description = serde_json::from_str(&text).expect("it can be read");
    assert_eq!(read, all);
    assert!(!text.contains(char::is_control));
}

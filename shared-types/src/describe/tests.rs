//! Descriptions that must be refused.

use super::*;

fn table(names: &[&str]) -> Vec<Field> {
    let signal = |name: &&str| Field::signal(name, "m", "x");
    names.iter().map(signal).collect()
}

fn law(name: &str, plants: &[&str]) -> LawDescription {
    LawDescription {
        name: name.into(),
        summary: "Does nothing.".into(),
        plants: plants.iter().map(|plant| (*plant).to_owned()).collect(),
        parameters: vec![],
        model: vec![],
        measured: table(&["x_m"]),
        reference: vec![],
        commands: Some(table(&["u_m"])),
        internals: table(&["e_m"]),
        saves: false,
        state: None,
        tuning: String::new(),
    }
}

fn plant(name: &str) -> PlantDescription {
    PlantDescription {
        name: name.into(),
        summary: "Stands still.".into(),
        parameters: table(&["a.m_kg"]),
        truth: table(&["x_m"]),
        measured: table(&["x_m"]),
        commands: table(&["u_m"]),
        faults: vec![],
        saves: false,
        port: None,
        state: None,
    }
}

fn sound() -> Description {
    let mut description = Description::new("both", "1");
    description.plants = vec![plant("still"), plant("stiller")];
    description.laws = vec![
        law("pid", &["still"]),
        law("pid", &["stiller"]),
        law("off", &[]),
    ];
    description
}

#[track_caller]
fn refused(change: impl FnOnce(&mut Description), expected: &str) {
    let mut description = sound();
    change(&mut description);
    assert_eq!(description.check(), Err(expected.to_owned()));
}

#[test]
fn a_description_with_duplicate_or_unprintable_names_is_refused() {
    assert_eq!(sound().check(), Ok(()));
    let no_name = "is not a name of letters, digits and _, with a dot after a group";
    refused(
        |all| all.plants[1].name = "still".into(),
        "plant `still` is defined twice",
    );
    refused(
        |all| all.plants[0].name = "a\nb".into(),
        &format!("the name of a plant: \"a\\nb\" {no_name}"),
    );
    refused(
        |all| all.laws[1].plants.push("still".into()),
        "law `pid` is defined twice for one plant",
    );
    refused(
        |all| all.laws[2].name = "pid".into(),
        "law `pid` is defined twice for one plant",
    );
    refused(
        |all| all.laws[2].internals = table(&["e m"]),
        &format!("internals of law `off`: \"e m\" {no_name}"),
    );
    refused(
        |all| all.laws[2].internals = table(&["e_m", "e_m"]),
        "internals of law `off`: `e_m` is defined twice",
    );
    refused(
        |all| all.plants[0].truth[0].unit = "m]".into(),
        "truth of plant `still`: `x_m` has the invalid unit \"m]\"",
    );
    refused(
        |all| all.plants[0].parameters = table(&["a.m_kg", "a_m_kg"]),
        "parameters of plant `still`: `a_m_kg` is defined twice",
    );
    let many: Vec<String> = (0..513).map(|number| format!("x{number}_m")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    refused(
        |all| all.plants[0].measured = table(&many),
        "measured of plant `still`: there are 513 entries, but at most 512 are allowed",
    );
    // Together with the command.
    refused(
        |all| all.laws[2].internals = table(&many[..512]),
        "law `off` has 1 commands and 512 internals; a frame carries at most 512 of both together",
    );
}

//! Plant and law for tests of several packages: a rig with one fault kind of each sort, and a law that does
//! nothing.

use std::path::Path;

use hil_config::plan::Plan;
use hil_recording::writer::Attachment;
use shared_types::describe::{
    ActsOn, Description, FaultDescription, FaultKindDescription, LawDescription, ListDescription,
    MoveBy, Operation, ParameterMove, PlantDescription, ProfileDescription,
};
use shared_types::table::Field;

use hil_facts::programs::checked::checked;

pub(crate) const SCENARIO: &str = r#"
schema = 1
name = "demo"
[run]
duration_s = 1.0
rate_hz = 1000
[plant]
model = "rig"
[plant.parameters]
actuator1.leak = 0.0
actuator2.leak = 0.0
[controller]
law = "quiet"
[[stimuli]]
target = "surface_angle_rad"
kind = "step"
at_s = 0.0
after = 1.0
"#;

/// Returns the descriptions of plant and controller of the scenario.
pub(crate) fn described() -> [Description; 2] {
    let mut plant = Description::new("some-plant", "1");
    (plant.plants, plant.faults) = (vec![self::plant()], kinds());
    let mut controller = Description::new("some-controller", "1");
    controller.laws = vec![LawDescription {
        name: "quiet".into(),
        summary: "Does nothing.".into(),
        plants: vec![],
        parameters: vec![],
        model: vec![],
        measured: vec![],
        reference: vec![],
        commands: None,
        internals: vec![],
        saves: false,
        state: None,
        tuning: String::new(),
    }];
    [plant, controller]
}

/// Returns the attachments in the recording of a run of the rig.
pub(crate) fn attachments(scenario: String) -> Vec<Attachment> {
    let [plant, controller] = described();
    let json = |description| serde_json::to_string(description).expect("JSON");
    let attachments = [
        ("scenario.toml", scenario),
        ("plant-description.json", json(&plant)),
        ("controller-description.json", json(&controller)),
    ];
    let attachment = |(name, text)| Attachment {
        name,
        media_type: "text/plain",
        text,
    };
    attachments.map(attachment).into()
}

pub(crate) fn plan() -> Plan {
    let [plant, controller] = described();
    let checked = checked(SCENARIO, Path::new("demo"), &plant, &controller);
    checked.expect("a right scenario")
}

/// Returns a rig with a plant-specific fault kind of each sort.
pub(crate) fn plant() -> PlantDescription {
    let angle = Field::signal("surface_angle_rad", "rad", "The angle.");
    let size = |name: &str, unit: &str, text: &str, max: f64| Field {
        min: 0.0,
        max,
        ..Field::signal(name, unit, text)
    };
    let leak = |group: &str| Field {
        faultable: true,
        ..Field::signal(&format!("{group}.leak"), "m3/s", "The leak.")
    };
    let own = |kind: &str, selector: Option<&str>, sizes, profile| FaultDescription {
        kind: kind.into(),
        summary: "A leak.".into(),
        equation: "q = C g".into(),
        selector: selector.map(Into::into),
        sizes,
        moves: vec![ParameterMove {
            parameter: "leak".into(),
            operation: Operation::Add,
            by: MoveBy::Constant(1.0),
        }],
        profile,
    };
    let speed = Field {
        default: Some(3.0),
        ..size("speed_per_s", "1/s", "mu.", f64::INFINITY)
    };
    let coefficient = size(
        "coefficient_m3ps_per_sqrt_pa",
        "m3/s/sqrt(Pa)",
        "C at the end.",
        1e-4,
    );
    PlantDescription {
        name: "rig".into(),
        summary: "A rig.".into(),
        parameters: vec![leak("actuator1"), leak("actuator2")],
        truth: vec![],
        measured: vec![angle],
        commands: vec![Field::signal("valve1_current_a", "A", "The current.")],
        saves: false,
        port: None,
        state: None,
        faults: vec![
            own(
                "leakage",
                Some("actuator"),
                vec![coefficient],
                ProfileDescription::Exponential { speed },
            ),
            own(
                "supply-loss",
                None,
                vec![
                    size("factor_first", "1", "x", 1.0),
                    size("factor_second", "1", "x", 1.0),
                ],
                ProfileDescription::Step,
            ),
        ],
    }
}

/// Returns fault kinds common to all plants, one of each sort.
pub(crate) fn kinds() -> Vec<FaultKindDescription> {
    let kind = |kind: &str, acts_on, keys: &[(&str, &str)], list: Option<(&str, usize)>| {
        FaultKindDescription {
            kind: kind.into(),
            summary: "x".into(),
            equation: "x".into(),
            acts_on,
            parameters: keys
                .iter()
                .map(|(name, unit)| Field::signal(name, unit, "x"))
                .collect(),
            saves: false,
            list: list.map(|(key, columns)| ListDescription {
                key: key.into(),
                description: "Rows.".into(),
                columns,
            }),
        }
    };
    vec![
        kind("bias", ActsOn::Numbers, &[("bias", "target")], None),
        kind(
            "saturation",
            ActsOn::Numbers,
            &[("min", "target"), ("max", "target")],
            None,
        ),
        kind("dropout", ActsOn::Signals, &[], None),
        kind(
            "message-loss",
            ActsOn::Links,
            &[("probability", "1")],
            Some(("pattern", 1)),
        ),
        kind(
            "late",
            ActsOn::Sides,
            &[("busy_us", "us"), ("spread_us", "us")],
            Some(("histogram", 2)),
        ),
        kind(
            "skip",
            ActsOn::Controller,
            &[("steps", "steps"), ("period_s", "s")],
            None,
        ),
    ]
}

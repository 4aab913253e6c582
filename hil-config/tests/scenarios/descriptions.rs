//! Descriptions as binaries would give them, written by hand: a part of the hydraulic plant, the
//! teaching plant and laws for both.

use shared_types::describe::{
    FaultDescription, LawDescription, PlantDescription, ProfileDescription,
};
use shared_types::table::Field;

pub(crate) fn parameter(name: &str, unit: &str, default: f64, min: f64, max: f64) -> Field {
    Field {
        default: Some(default),
        min,
        max,
        ..Field::signal(name, unit, "A parameter.")
    }
}

fn faultable(field: Field) -> Field {
    Field {
        faultable: true,
        ..field
    }
}

fn ranged(name: &str, unit: &str, max: f64) -> Field {
    Field {
        min: 0.0,
        max,
        ..Field::signal(name, unit, "Of a fault.")
    }
}

fn signals(named: &[(&str, &str)]) -> Vec<Field> {
    named
        .iter()
        .map(|(name, unit)| Field::signal(name, unit, "A signal."))
        .collect()
}

pub(crate) fn plants() -> Vec<PlantDescription> {
    let mut parameters = Vec::new();
    for n in [1, 2] {
        let named = |last: &str| format!("actuator{n}.{last}");
        parameters.push(parameter(&named("piston_mass_kg"), "kg", 55.0, 1e-3, 1e6));
        let leak = named("leakage_coefficient_m3ps_per_sqrt_pa");
        let leak = parameter(&leak, "m3/s/sqrt(Pa)", 0.0, 0.0, 1e-3);
        parameters.push(faultable(leak));
    }
    parameters.push(parameter("surface.inertia_kg_m2", "kg m2", 13.5, 1e-9, 1e9));
    let drhas = PlantDescription {
        name: "drhas".into(),
        summary: "Two hydraulic actuators.".into(),
        parameters,
        truth: signals(&[
            ("surface_angle_rad", "rad"),
            ("actuator1_pressure1_pa", "Pa"),
            ("force_fight_n", "N"),
        ]),
        measured: signals(&[
            ("surface_angle_rad", "rad"),
            ("actuator1_position_m", "m"),
            ("actuator1_pressure1_pa", "Pa"),
        ]),
        commands: signals(&[
            ("actuator1_valve_current_a", "A"),
            ("actuator2_valve_current_a", "A"),
        ]),
        faults: vec![FaultDescription {
            kind: "leakage".into(),
            summary: "A leak.\nIt grows.".into(),
            selector: "actuator".into(),
            parameter: "leakage_coefficient_m3ps_per_sqrt_pa".into(),
            size: ranged("coefficient_m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)", 1.0),
            profile: ProfileDescription::Exponential {
                speed: ranged("speed_per_s", "1/s", 1e6),
            },
        }],
    };
    let spring_mass = PlantDescription {
        name: "spring-mass".into(),
        summary: "A mass on a spring.".into(),
        parameters: vec![
            parameter("mass_kg", "kg", 1.0, 1e-3, 1e3),
            parameter("damping_n_s_per_m", "N s/m", 2.0, 0.0, 1e6),
            faultable(parameter("stiffness_n_per_m", "N/m", 100.0, 0.0, 1e9)),
        ],
        truth: signals(&[("position_m", "m"), ("velocity_mps", "m/s")]),
        measured: signals(&[("position_m", "m"), ("velocity_mps", "m/s")]),
        commands: signals(&[("force_n", "N")]),
        faults: Vec::new(),
    };
    vec![drhas, spring_mass]
}

fn law(name: &str, plants: &[&str]) -> LawDescription {
    LawDescription {
        name: name.into(),
        summary: "A law.".into(),
        plants: plants.iter().map(|&plant| plant.into()).collect(),
        parameters: Vec::new(),
        model: Vec::new(),
        measured: Vec::new(),
        reference: Vec::new(),
        commands: None,
        internals: Vec::new(),
    }
}

pub(crate) fn laws() -> Vec<LawDescription> {
    let hydraulic = plants().remove(0);
    let backstepping = |name| LawDescription {
        parameters: vec![parameter("gain_per_s", "1/s", 300.0, 0.0, 1e9)],
        model: vec![
            parameter("actuator1.piston_mass_kg", "kg", 1.0, 1e-3, 1e6),
            parameter("actuator2.piston_mass_kg", "kg", 1.0, 1e-3, 1e6),
            parameter("surface.inertia_kg_m2", "kg m2", 1.0, 1e-9, 1e9),
            parameter("friction_n", "N", 0.5, 0.0, 1e9),
        ],
        measured: hydraulic.measured.clone(),
        reference: signals(&[
            ("surface_angle_rad", "rad"),
            ("surface_angle_d1_radps", "rad/s"),
            ("surface_angle_d2_radps2", "rad/s2"),
        ]),
        commands: Some(hydraulic.commands.clone()),
        internals: signals(&[("fault_detected", "1")]),
        ..law(name, &["drhas"])
    };
    let pid_drhas = LawDescription {
        parameters: vec![parameter("gain_a_per_m", "A/m", 90.0, 0.0, 1e9)],
        measured: signals(&[("actuator1_position_m", "m")]),
        reference: signals(&[("surface_angle_rad", "rad")]),
        commands: Some(hydraulic.commands.clone()),
        ..law("pid", &["drhas"])
    };
    let pid_spring_mass = LawDescription {
        parameters: vec![parameter("gain_n_per_m", "N/m", 300.0, 0.0, 1e9)],
        measured: signals(&[("position_m", "m")]),
        reference: signals(&[("position_m", "m")]),
        commands: Some(signals(&[("force_n", "N")])),
        ..law("pid", &["spring-mass"])
    };
    // A law that fits no plant by its signals.
    let strange = LawDescription {
        parameters: vec![Field {
            default: None,
            ..parameter("gain", "1", 0.0, 0.0, 1.0)
        }],
        model: vec![parameter("surface.inertia_kg_m2", "kg m2", 1.0, 0.0, 2.0)],
        measured: signals(&[
            ("actuator1_pressure3_pa", "Pa"),
            ("surface_angle_rad", "deg"),
        ]),
        reference: signals(&[("surface_angle_rad", "rad"), ("wind_mps", "m/s")]),
        commands: Some(signals(&[("actuator1_valve_current_a", "A")])),
        ..law("strange", &[])
    };
    vec![
        pid_drhas,
        pid_spring_mass,
        backstepping("nrsc"),
        backstepping("ftsc"),
        law("hold", &[]),
        strange,
    ]
}

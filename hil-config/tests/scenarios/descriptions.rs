//! Descriptions as binaries would give them, written by hand: a part of the hydraulic plant, the teaching plant and
//! laws for both.

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;
use hil_config::show::show;
use shared_types::describe::{
    ActsOn, FaultDescription, FaultKindDescription, LawDescription, ListDescription, MoveBy,
    Operation, ParameterMove, PlantDescription, ProfileDescription,
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
        let bulk = parameter(&named("bulk_modulus_pa"), "Pa", 1e9, 1e6, 2e9);
        parameters.push(faultable(bulk));
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
            ("actuator1_position_m", "m"),
            ("actuator1_leakage_flow_m3ps", "m3/s"),
            (
                "actuator1_leakage_coefficient_m3ps_per_sqrt_pa",
                "m3/s/sqrt(Pa)",
            ),
            ("actuator2_position_m", "m"),
            ("actuator2_leakage_flow_m3ps", "m3/s"),
            (
                "actuator2_leakage_coefficient_m3ps_per_sqrt_pa",
                "m3/s/sqrt(Pa)",
            ),
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
        saves: false,
        port: None,
        state: None,
        faults: vec![
            FaultDescription {
                kind: "leakage".into(),
                summary: "A leak.\nIt grows.".into(),
                equation: "c".into(),
                selector: Some("actuator".into()),
                sizes: vec![ranged("coefficient_m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)", 1.0)],
                moves: vec![moves(
                    "leakage_coefficient_m3ps_per_sqrt_pa",
                    Operation::Add,
                    "coefficient_m3ps_per_sqrt_pa",
                )],
                profile: ProfileDescription::Exponential {
                    speed: ranged("speed_per_s", "1/s", 1e6),
                },
            },
            FaultDescription {
                kind: "burst".into(),
                summary: "A hose bursts.".into(),
                equation: "leakage = 1e-3, bulk modulus = f E".into(),
                selector: Some("actuator".into()),
                sizes: vec![parameter("factor", "1", 0.5, 0.0, 10.0)],
                moves: vec![
                    ParameterMove {
                        by: MoveBy::Constant(1e-3),
                        ..moves("leakage_coefficient_m3ps_per_sqrt_pa", Operation::Set, "")
                    },
                    moves("bulk_modulus_pa", Operation::Scale, "factor"),
                ],
                profile: ProfileDescription::Step,
            },
        ],
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
        saves: false,
        port: None,
        state: None,
        faults: vec![FaultDescription {
            kind: "softening".into(),
            summary: "The spring softens.".into(),
            equation: "k + d".into(),
            selector: None,
            sizes: vec![Field::signal("change_n_per_m", "N/m", "Of a fault.")],
            moves: vec![moves("stiffness_n_per_m", Operation::Add, "change_n_per_m")],
            profile: ProfileDescription::Step,
        }],
    };
    vec![drhas, spring_mass]
}

fn moves(parameter: &str, operation: Operation, size: &str) -> ParameterMove {
    ParameterMove {
        parameter: parameter.into(),
        operation,
        by: MoveBy::Size(size.into()),
    }
}

fn kind(name: &str, acts_on: ActsOn, parameters: Vec<Field>) -> FaultKindDescription {
    FaultKindDescription {
        kind: name.into(),
        summary: "A fault.".into(),
        equation: "y = x".into(),
        acts_on,
        parameters,
        list: None,
        saves: false,
    }
}

fn list(key: &str, columns: usize) -> Option<ListDescription> {
    Some(ListDescription {
        key: key.into(),
        description: "Numbers.".into(),
        columns,
    })
}

/// Fault kinds of every class, with every form of parameter.
pub(crate) fn kinds() -> Vec<FaultKindDescription> {
    vec![
        kind(
            "bias",
            ActsOn::Numbers,
            vec![Field::signal("bias", "target", "Of a fault.")],
        ),
        kind(
            "drift",
            ActsOn::Numbers,
            vec![Field {
                max: 10.0,
                ..Field::signal("rate_per_s", "target/s", "Of a fault.")
            }],
        ),
        kind("delay", ActsOn::Numbers, vec![ranged("steps", "1", 1000.0)]),
        kind("dropout", ActsOn::Signals, Vec::new()),
        FaultKindDescription {
            list: list("pattern", 1),
            ..kind(
                "message-loss",
                ActsOn::Links,
                vec![parameter("probability", "1", 1.0, 0.0, 1.0)],
            )
        },
        FaultKindDescription {
            list: list("histogram", 2),
            ..kind(
                "late",
                ActsOn::Sides,
                vec![
                    ranged("busy_us", "us", 1e6),
                    parameter("spread_us", "us", 0.0, 0.0, 1e6),
                ],
            )
        },
        kind(
            "skip",
            ActsOn::Controller,
            vec![
                ranged("steps", "1", 1000.0),
                parameter("period_steps", "1", 0.0, 0.0, 1e6),
            ],
        ),
    ]
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
        saves: false,
        state: None,
        tuning: String::new(),
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
        internals: signals(&[
            ("fault_detected", "1"),
            ("lyapunov_v3", "1"),
            ("lyapunov_bound", "1"),
            ("leakage_estimate1_m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)"),
            ("leakage_estimate2_m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)"),
        ]),
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
    // A law whose signals match no plant.
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

/// Check of a scenario against these descriptions.
pub(crate) trait Checked {
    fn checked(&self) -> Result<Plan, Problems>;
}

impl Checked for Scenario {
    fn checked(&self) -> Result<Plan, Problems> {
        self.check(&plants(), &laws(), &kinds())
    }
}

/// Shows a plan of these plants and laws as a scenario.
pub(crate) fn shown(plan: &Plan) -> String {
    show(plan, &plants(), &laws(), &kinds()).expect("described")
}

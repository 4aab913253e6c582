//! Faults of the hydraulic system: names for the faults of its parts, each with the parameters that it moves and the
//! amounts by which it moves them.
//!
//! Part of the plant's description for the launcher; the fault layer around the plant moves the parameters. The
//! consequences of a moved parameter are in the equations of its physical part. Every range keeps the integration
//! stable with substeps of 25 us.

use shared_types::describe::{
    FaultDescription, MoveBy, Operation, ParameterMove, ProfileDescription,
};
use shared_types::table::Field;

use Operation::{Add, Scale, Set};

/// Lists every named fault.
#[must_use]
pub fn all() -> Vec<FaultDescription> {
    let mut faults = vec![leakage()];
    faults.extend(oil());
    faults.extend(valve());
    faults.extend(mechanics());
    faults
}

/// Leak past a piston's seal: the paper's fault.
fn leakage() -> FaultDescription {
    FaultDescription {
        profile: ProfileDescription::Exponential {
            speed: size(
                "speed_per_s",
                "1/s",
                "Speed mu at which the leak sets in.",
                [0.0, 1e6],
            ),
        },
        ..of_actuator(
            "leakage",
            "Leak past the piston's seal that sets in exponentially (eqs. 5 and 6).",
            "q_t = C_t g sqrt(|P_h1 - P_h2|) sign(P_h1 - P_h2), g = 1 - exp(-mu t)",
            vec![size(
                "coefficient_m3ps_per_sqrt_pa",
                "m3/s/sqrt(Pa)",
                "Leakage coefficient C_t at the end.",
                [0.0, 1e-4],
            )],
            vec![by_size(
                "leakage_coefficient_m3ps_per_sqrt_pa",
                Add,
                "coefficient_m3ps_per_sqrt_pa",
            )],
        )
    }
}

/// Faults of the oil and its supply.
fn oil() -> Vec<FaultDescription> {
    let chamber = |key, text| {
        let leak = size(key, "m3/s/sqrt(Pa)", text, [0.0, 1e-6]);
        or_else(leak, 0.0)
    };
    vec![
        of_actuator(
            "external-leakage",
            "Leak from the chambers to the outside (turbulent as in eq. 5).",
            "q_e = c g sqrt(P - P_r) for P > P_r, else 0",
            vec![
                chamber(
                    "chamber1_m3ps_per_sqrt_pa",
                    "Coefficient c of the active chamber.",
                ),
                chamber(
                    "chamber2_m3ps_per_sqrt_pa",
                    "Coefficient c of the passive chamber.",
                ),
            ],
            vec![
                by_size(
                    "external_leakage1_m3ps_per_sqrt_pa",
                    Add,
                    "chamber1_m3ps_per_sqrt_pa",
                ),
                by_size(
                    "external_leakage2_m3ps_per_sqrt_pa",
                    Add,
                    "chamber2_m3ps_per_sqrt_pa",
                ),
            ],
        ),
        of_actuator(
            "supply-loss",
            "The supply pressure sinks to a share of itself (eqs. 10 and 11).",
            "P_s -> P_s (1 + (factor - 1) g)",
            vec![size(
                "factor",
                "1",
                "Share of the pressure left.",
                [0.0, 1.0],
            )],
            vec![by_size("supply_pressure_pa", Scale, "factor")],
        ),
        of_actuator(
            "supply-droop",
            "The supply gives way to the flow it gives: a clogged filter, a weak pump (before eq. 10).",
            "q = k_q |x_v| sqrt(P_s - R g q - P)",
            vec![size(
                "droop_pa_s_per_m3",
                "Pa s/m3",
                "Loss R of supply pressure per flow.",
                [0.0, 1e12],
            )],
            vec![by_size(
                "supply_droop_pa_s_per_m3",
                Add,
                "droop_pa_s_per_m3",
            )],
        ),
        of_actuator(
            "return-rise",
            "The return pressure rises: a blocked return line (eqs. 10 and 11).",
            "P_r -> P_r + pressure g",
            vec![size(
                "pressure_pa",
                "Pa",
                "Rise of the pressure.",
                [0.0, 2e7],
            )],
            vec![by_size("return_pressure_pa", Add, "pressure_pa")],
        ),
        of_actuator(
            "air",
            "Air in the oil lowers its bulk modulus (eqs. 3 and 4).",
            "beta_e -> beta_e (1 + (factor - 1) g)",
            vec![size(
                "factor",
                "1",
                "Share of the bulk modulus left.",
                [0.01, 1.0],
            )],
            vec![by_size("bulk_modulus_pa", Scale, "factor")],
        ),
    ]
}

/// Faults of the servo valve.
fn valve() -> Vec<FaultDescription> {
    let spool = |key, text| size(key, "m", text, [-0.02, 0.02]);
    vec![
        of_actuator(
            "valve-jam",
            "The spool sticks where it is when the fault sets in (eq. 1).",
            "x_v -> (1 - g) k_i u + g x_v(begin)",
            vec![],
            vec![by_constant("valve_stuck", Set, 1.0)],
        ),
        of_actuator(
            "valve-bias",
            "Null bias: the spool is off its middle without current (eq. 1).",
            "x_v = k_i u + bias g",
            vec![spool("bias_m", "Displacement without current.")],
            vec![by_size("valve_null_bias_m", Add, "bias_m")],
        ),
        of_actuator(
            "valve-gain-loss",
            "The spool moves less for a current (eq. 1).",
            "k_i -> k_i (1 + (factor - 1) g)",
            vec![size("factor", "1", "Share of the gain left.", [0.0, 1.0])],
            vec![by_size("valve_gain_m_per_a", Scale, "factor")],
        ),
        of_actuator(
            "valve-bandwidth-loss",
            "The spool follows its current late, as a system of first order.",
            "T x_v' = k_i u - x_v, T = T_0 + (lag - T_0) g",
            vec![size(
                "lag_s",
                "s",
                "Time constant, 1 / (2 pi bandwidth).",
                [0.0, 10.0],
            )],
            vec![by_size("valve_lag_s", Set, "lag_s")],
        ),
        of_actuator(
            "hard-over",
            "The spool goes to a place of its own and no current moves it (eq. 1).",
            "x_v = k_i (1 - g) u + b + (spool - b) g",
            vec![spool("spool_m", "Where the spool goes.")],
            vec![
                by_constant("valve_gain_m_per_a", Scale, 0.0),
                by_size("valve_null_bias_m", Set, "spool_m"),
            ],
        ),
    ]
}

/// Faults of piston, connection and load.
fn mechanics() -> Vec<FaultDescription> {
    let added = |key, unit, text, range| or_else(size(key, unit, text, range), 0.0);
    vec![
        of_actuator(
            "actuator-jam",
            "The piston seizes in its cylinder; the structure takes the force.",
            "x_h'' -> (1 - j) x_h'' - j x_h' / tau, j = blocked g, tau = 50 us",
            vec![or_else(
                size("blocked", "1", "How far the piston is seized.", [0.0, 1.0]),
                1.0,
            )],
            vec![by_size("motion_blocked", Set, "blocked")],
        ),
        of_actuator(
            "friction",
            "Dry and viscous friction of the piston (eq. 2 with both added to d).",
            "F = coulomb g tanh(x_h' / v_s) + viscous g x_h'",
            vec![
                size("coulomb_n", "N", "Coulomb friction.", [0.0, 4e4]),
                added(
                    "viscous_n_s_per_m",
                    "N s/m",
                    "Viscous friction.",
                    [0.0, 1e6],
                ),
            ],
            vec![
                by_size("coulomb_friction_n", Add, "coulomb_n"),
                by_size("damping_n_s_per_m", Add, "viscous_n_s_per_m"),
            ],
        ),
        of_actuator(
            "connection-loss",
            "The connection between rod and surface softens or breaks (eqs. 14 and 15).",
            "K_h -> K_h (1 + (factor - 1) g)",
            vec![size(
                "factor",
                "1",
                "Share of the stiffness left.",
                [0.0, 1.0],
            )],
            vec![by_size("connection_stiffness_n_per_m", Scale, "factor")],
        ),
        FaultDescription {
            selector: None,
            ..of_actuator(
                "load-change",
                "The load of the surface becomes stiffer or softer, or a torque adds to it (eq. 17).",
                "T_L = K_d (1 + (factor - 1) g) r_d^2 theta_d + torque g",
                vec![
                    or_else(
                        size("factor", "1", "Factor of the stiffness.", [0.0, 10.0]),
                        1.0,
                    ),
                    added(
                        "torque_nm",
                        "N m",
                        "Torque against a positive angle.",
                        [-1e5, 1e5],
                    ),
                ],
                vec![
                    by_size("surface.load_stiffness_n_per_m", Scale, "factor"),
                    by_size("surface.load_torque_nm", Add, "torque_nm"),
                ],
            )
        },
    ]
}

/// Creates a fault of one actuator with a step profile.
fn of_actuator(
    kind: &str,
    summary: &str,
    equation: &str,
    sizes: Vec<Field>,
    moves: Vec<ParameterMove>,
) -> FaultDescription {
    FaultDescription {
        kind: kind.into(),
        summary: summary.into(),
        equation: equation.into(),
        selector: Some("actuator".into()),
        sizes,
        moves,
        profile: ProfileDescription::Step,
    }
}

/// Creates a required magnitude of an effect.
fn size(key: &str, unit: &str, text: &str, [min, max]: [f64; 2]) -> Field {
    Field {
        min,
        max,
        ..Field::signal(key, unit, text)
    }
}

/// Creates an optional magnitude of an effect.
fn or_else(size: Field, default: f64) -> Field {
    Field {
        default: Some(default),
        ..size
    }
}

fn by_size(parameter: &str, operation: Operation, key: &str) -> ParameterMove {
    ParameterMove {
        parameter: parameter.into(),
        operation,
        by: MoveBy::Size(key.into()),
    }
}

fn by_constant(parameter: &str, operation: Operation, constant: f64) -> ParameterMove {
    ParameterMove {
        parameter: parameter.into(),
        operation,
        by: MoveBy::Constant(constant),
    }
}

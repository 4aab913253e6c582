//! The backstepping laws' model of the plant (Table 1), under the plant's own names.
//!
//! Contains neither the disturbances nor the leakage fault, which are unknown to any law.

shared_types::table! {
    /// Actuator: servo valve, cylinder, power supply and connection to the surface.
    pub struct ActuatorModel {
        /// Servo valve gain k_i.
        valve_gain_m_per_a: "m/A" = 3.04e-3 in 1e-9..=1.0,
        /// Flow rate gain k_q.
        flow_gain_m2ps_per_sqrt_pa: "m2/s/sqrt(Pa)" = 7.5e-5 in 1e-9..=1.0,
        /// Supply pressure P_s.
        supply_pressure_pa: "Pa" = 28e6 in 0.0..=6e7,
        /// Return pressure P_r.
        return_pressure_pa: "Pa" = 0.0 in 0.0..=6e7,
        /// Piston mass m_h.
        piston_mass_kg: "kg" = 55.0 in 1e-3..=1e6,
        /// Damping coefficient B_h.
        damping_n_s_per_m: "N s/m" = 1e4 in 0.0..=1e9,
        /// Piston area of the active chamber, A_1.
        area1_m2: "m2" = 1.47e-3 in 1e-6..=1.0,
        /// Piston area of the passive chamber, A_2.
        area2_m2: "m2" = 1.47e-3 in 1e-6..=1.0,
        /// Effective bulk modulus of the oil, beta_e.
        bulk_modulus_pa: "Pa" = 800e6 in 1e6..=1e10,
        /// Volume of the active chamber at position 0, V_10.
        volume1_m3: "m3" = 0.735e-4 in 1e-9..=1.0,
        /// Volume of the passive chamber at position 0, V_20.
        volume2_m3: "m3" = 0.735e-4 in 1e-9..=1.0,
        /// Normal internal leakage coefficient C_i.
        internal_leakage_m3ps_per_pa: "m3/s/Pa" = 1e-12 in 0.0..=1e-6,
        /// Stiffness of the connection to the surface, K_h.
        connection_stiffness_n_per_m: "N/m" = 1e8 in 1.0..=1e12,
    }
}

shared_types::table! {
    /// The control surface and its air load.
    pub struct SurfaceModel {
        /// Radial distance r_d between hinge and piston rods.
        radial_distance_m: "m" = 0.15 in 1e-3..=1e2,
        /// Moment of inertia J_d.
        inertia_kg_m2: "kg m2" = 13.5 in 1e-6..=1e6,
        /// Damping coefficient beta_d.
        damping_n_m_s_per_rad: "N m s/rad" = 51.75 in 0.0..=1e9,
        /// Elastic load coefficient K_d.
        load_stiffness_n_per_m: "N/m" = 9.14e5 in 0.0..=1e12,
    }
}

shared_types::table! {
    /// The plant as the law believes it to be.
    pub struct Model {
        /// Actuator 1.
        actuator1: ActuatorModel,
        /// Actuator 2.
        actuator2: ActuatorModel,
        /// Control surface.
        surface: SurfaceModel,
    }
}

impl Model {
    /// Returns both actuators.
    #[must_use]
    pub fn actuators(&self) -> [ActuatorModel; 2] {
        [self.actuator1, self.actuator2]
    }
}

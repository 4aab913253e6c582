//! Tables of the hydraulic system: its parameters and signals.
//!
//! The defaults are Table 1 of the paper and eq. 74; parameters beyond the paper are neutral by default. The symbols in
//! the descriptions are the paper's.

use shared_types::table;

table! {
    /// Actuator: valve, cylinder, seal, its connection to the surface and its disturbance.
    pub struct ActuatorParameters {
        /// Valve gain k_i: spool displacement per current.
        valve_gain_m_per_a: "m/A" = 3.04e-3 in 0.0..=1.0 [faultable],
        /// Null bias of the valve: position of the spool at zero current.
        valve_null_bias_m: "m" = 0.0 in (-0.02)..=0.02 [faultable],
        /// Travel of the spool to either side, where its stops are; the paper's runs use 7.1 mm.
        valve_travel_m: "m" = 0.02 in 1e-6..=1.0,
        /// Time constant of the spool, 1 / (2 pi bandwidth); 0: it follows at once.
        valve_lag_s: "s" = 0.0 in 0.0..=10.0 [faultable],
        /// Degree to which the spool is stuck where it was: 0 moves freely, 1 not at all.
        valve_stuck: "1" = 0.0 in 0.0..=1.0 [faultable],
        /// Flow gain k_q of the valve.
        flow_gain_m2ps_per_sqrt_pa: "m2/s/sqrt(Pa)" = 7.5e-5 in 0.0..=1.0,
        /// Supply pressure P_s.
        supply_pressure_pa: "Pa" = 28e6 in 0.0..=6e7 [faultable],
        /// Drop of the supply pressure at the valve per flow that it gives.
        supply_droop_pa_s_per_m3: "Pa s/m3" = 0.0 in 0.0..=1e12 [faultable],
        /// Return pressure P_r.
        return_pressure_pa: "Pa" = 0.0 in 0.0..=6e7 [faultable],
        /// Piston mass m_h.
        piston_mass_kg: "kg" = 55.0 in 1e-3..=1e6,
        /// Damping coefficient B_h of the piston.
        damping_n_s_per_m: "N s/m" = 1e4 in 0.0..=1e9 [faultable],
        /// Coulomb friction F_c of the piston.
        coulomb_friction_n: "N" = 0.0 in 0.0..=4e4 [faultable],
        /// Velocity v_s at which Coulomb friction has reached 76 % (tanh 1) of its size.
        friction_velocity_mps: "m/s" = 1e-2 in 1e-2..=1e2,
        /// Degree to which the piston is seized: 0 moves freely, 1 not at all.
        motion_blocked: "1" = 0.0 in 0.0..=1.0 [faultable],
        /// Piston area A_1 of the active chamber.
        area1_m2: "m2" = 1.47e-3 in 1e-6..=1.0,
        /// Piston area A_2 of the passive chamber.
        area2_m2: "m2" = 1.47e-3 in 1e-6..=1.0,
        /// Effective bulk modulus beta_e of the oil; lower when there is air in it.
        bulk_modulus_pa: "Pa" = 800e6 in 1e6..=1e10 [faultable],
        /// Volume V_10 of the active chamber at position 0.
        volume1_m3: "m3" = 0.735e-4 in 1e-9..=1.0,
        /// Volume V_20 of the passive chamber at position 0.
        volume2_m3: "m3" = 0.735e-4 in 1e-9..=1.0,
        /// Pressure above the surroundings at which the oil boils and which no chamber goes below.
        vapour_pressure_pa: "Pa" = (-1e5) in (-1e5)..=0.0,
        /// Normal internal leakage coefficient C_i.
        internal_leakage_m3ps_per_pa: "m3/s/Pa" = 1e-12 in 0.0..=1e-6,
        /// Leakage coefficient of the fault, beta C_t of eqs. 5 and 6; moved by the fault `leakage`.
        leakage_coefficient_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)" = 0.0 in 0.0..=1e-4 [faultable],
        /// Coefficient of the leak from the active chamber to the outside.
        external_leakage1_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)" = 0.0 in 0.0..=1e-6 [faultable],
        /// Coefficient of the leak from the passive chamber to the outside.
        external_leakage2_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)" = 0.0 in 0.0..=1e-6 [faultable],
        /// Stiffness K_h of the connection between rod and surface.
        connection_stiffness_n_per_m: "N/m" = 1e8 in 0.0..=1e12 [faultable],
        /// Constant part of the disturbance force d, against the rod's extension.
        disturbance_constant_n: "N" = 0.0 in (-1e6)..=1e6,
        /// Amplitude of the oscillating part of d.
        disturbance_amplitude_n: "N" = 0.0 in (-1e6)..=1e6,
        /// Frequency of the oscillating part of d.
        disturbance_frequency_hz: "Hz" = 1.0 in 0.0..=1e4,
        /// Time from which the oscillating part of d acts.
        disturbance_start_s: "s" = 2.0 in 0.0..=1e9,
        /// Position of the piston at step 0.
        initial_position_m: "m" = 0.0 in (-0.045)..=0.045,
        /// Velocity of the piston at step 0.
        initial_velocity_mps: "m/s" = 0.0 in (-10.0)..=10.0,
        /// Pressure of the active chamber at step 0 as a share of the supply pressure.
        initial_pressure1_ratio: "1" = 0.5 in 0.0..=1.0,
        /// Pressure of the passive chamber at step 0 as a share of the supply pressure.
        initial_pressure2_ratio: "1" = 0.5 in 0.0..=1.0,
    }
}

table! {
    /// The control surface and its load.
    pub struct SurfaceParameters {
        /// Radial distance r_d between the hinge and the rods.
        radial_distance_m: "m" = 0.15 in 1e-3..=1e2,
        /// Moment of inertia J_d.
        inertia_kg_m2: "kg m2" = 13.5 in 1e-6..=1e6,
        /// Damping coefficient beta_d.
        damping_n_m_s_per_rad: "N m s/rad" = 51.75 in 0.0..=1e9,
        /// Stiffness K_d of the elastic load.
        load_stiffness_n_per_m: "N/m" = 9.14e5 in 0.0..=1e12 [faultable],
        /// Torque of the load besides the elastic one, against a positive angle.
        load_torque_nm: "N m" = 0.0 in (-1e5)..=1e5 [faultable],
        /// Angle at step 0.
        initial_angle_rad: "rad" = 0.0 in (-0.5)..=0.5,
        /// Rate at step 0.
        initial_rate_radps: "rad/s" = 0.0 in (-1e2)..=1e2,
    }
}

table! {
    /// The whole system.
    pub struct Parameters {
        /// The first actuator, with the disturbance d_1 of eq. 74.
        actuator1: ActuatorParameters = ActuatorParameters {
            disturbance_constant_n: 100.0,
            disturbance_amplitude_n: 400.0,
            ..ActuatorParameters::default()
        },
        /// The second actuator, with the disturbance d_2 of eq. 74.
        actuator2: ActuatorParameters = ActuatorParameters {
            disturbance_constant_n: 400.0,
            ..ActuatorParameters::default()
        },
        /// The surface.
        surface: SurfaceParameters,
    }
}

impl Parameters {
    /// Returns the actuators in order.
    #[inline]
    #[must_use]
    pub fn actuators(&self) -> [&ActuatorParameters; 2] {
        [&self.actuator1, &self.actuator2]
    }
}

table! {
    /// True state and outputs. The ranges limit the validity of the equations.
    pub struct Truth {
        /// Angle theta_d of the surface.
        surface_angle_rad: "rad" in (-0.5)..=0.5,
        /// Rate of theta_d.
        surface_rate_radps: "rad/s",
        /// Position x_h of piston 1, 0 in the middle of its travel.
        actuator1_position_m: "m" in (-0.045)..=0.045,
        /// Velocity of piston 1.
        actuator1_velocity_mps: "m/s",
        /// Pressure P_h11 of the active chamber of actuator 1.
        actuator1_pressure1_pa: "Pa" in (-1e5)..=6e7,
        /// Pressure P_h12 of the passive chamber of actuator 1.
        actuator1_pressure2_pa: "Pa" in (-1e5)..=6e7,
        /// Force F_h1 of rod 1 on the surface.
        actuator1_rod_force_n: "N",
        /// Flow of the leakage fault in actuator 1 from the active to the passive chamber.
        actuator1_leakage_flow_m3ps: "m3/s",
        /// Leakage coefficient beta C_t of actuator 1 now in force.
        actuator1_leakage_coefficient_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
        /// Disturbance d_1.
        actuator1_disturbance_n: "N",
        /// Position x_h of piston 2, 0 in the middle of its travel.
        actuator2_position_m: "m" in (-0.045)..=0.045,
        /// Velocity of piston 2.
        actuator2_velocity_mps: "m/s",
        /// Pressure P_h21 of the active chamber of actuator 2.
        actuator2_pressure1_pa: "Pa" in (-1e5)..=6e7,
        /// Pressure P_h22 of the passive chamber of actuator 2.
        actuator2_pressure2_pa: "Pa" in (-1e5)..=6e7,
        /// Force F_h2 of rod 2 on the surface.
        actuator2_rod_force_n: "N",
        /// Flow of the leakage fault in actuator 2 from the active to the passive chamber.
        actuator2_leakage_flow_m3ps: "m3/s",
        /// Leakage coefficient beta C_t of actuator 2 now in force.
        actuator2_leakage_coefficient_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
        /// Disturbance d_2.
        actuator2_disturbance_n: "N",
        /// Force fight Delta F = F_h1 - F_h2 between the rods.
        force_fight_n: "N",
    }
}

table! {
    /// Readings of the sensors, without noise: the state, in its order.
    pub struct Measured {
        /// Angle theta_d of the surface.
        surface_angle_rad: "rad",
        /// Rate of theta_d.
        surface_rate_radps: "rad/s",
        /// Position x_h of piston 1.
        actuator1_position_m: "m",
        /// Velocity of piston 1.
        actuator1_velocity_mps: "m/s",
        /// Pressure P_h11 of the active chamber of actuator 1.
        actuator1_pressure1_pa: "Pa",
        /// Pressure P_h12 of the passive chamber of actuator 1.
        actuator1_pressure2_pa: "Pa",
        /// Position x_h of piston 2.
        actuator2_position_m: "m",
        /// Velocity of piston 2.
        actuator2_velocity_mps: "m/s",
        /// Pressure P_h21 of the active chamber of actuator 2.
        actuator2_pressure1_pa: "Pa",
        /// Pressure P_h22 of the passive chamber of actuator 2.
        actuator2_pressure2_pa: "Pa",
    }
}

table! {
    /// Commands of the controller.
    pub struct Command {
        /// Current u_1 of valve 1; positive extends the rod.
        actuator1_valve_current_a: "A",
        /// Current u_2 of valve 2; positive extends the rod.
        actuator2_valve_current_a: "A",
    }
}

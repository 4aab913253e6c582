//! Signals of the backstepping laws: measured, reference and internal.

use super::Jet;

shared_types::table! {
    /// Signals that the laws need to measure.
    pub struct Measured {
        /// Angle of the control surface, y_1 = theta_d.
        surface_angle_rad: "rad",
        /// Angular rate of the control surface, y_2.
        surface_rate_radps: "rad/s",
        /// Piston position x_h1.
        actuator1_position_m: "m",
        /// Piston velocity.
        actuator1_velocity_mps: "m/s",
        /// Pressure of the active chamber, P_h11.
        actuator1_pressure1_pa: "Pa",
        /// Pressure of the passive chamber, P_h12.
        actuator1_pressure2_pa: "Pa",
        /// Piston position x_h2.
        actuator2_position_m: "m",
        /// Piston velocity.
        actuator2_velocity_mps: "m/s",
        /// Pressure of the active chamber, P_h21.
        actuator2_pressure1_pa: "Pa",
        /// Pressure of the passive chamber, P_h22.
        actuator2_pressure2_pa: "Pa",
    }
}

/// Measurements of one actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PistonState {
    /// Position x_h.
    pub position_m: f64,
    /// Velocity.
    pub velocity_mps: f64,
    /// Pressure of the active chamber, P_h1.
    pub pressure1_pa: f64,
    /// Pressure of the passive chamber, P_h2.
    pub pressure2_pa: f64,
}

impl Measured {
    /// Returns the measurements of both actuators.
    #[must_use]
    pub fn pistons(&self) -> [PistonState; 2] {
        [
            PistonState {
                position_m: self.actuator1_position_m,
                velocity_mps: self.actuator1_velocity_mps,
                pressure1_pa: self.actuator1_pressure1_pa,
                pressure2_pa: self.actuator1_pressure2_pa,
            },
            PistonState {
                position_m: self.actuator2_position_m,
                velocity_mps: self.actuator2_velocity_mps,
                pressure1_pa: self.actuator2_pressure1_pa,
                pressure2_pa: self.actuator2_pressure2_pa,
            },
        ]
    }
}

shared_types::table! {
    /// Signals that the laws follow: the deflection command and its first five derivatives (Assumption 4).
    pub struct Reference {
        /// Deflection command theta_r.
        surface_angle_rad: "rad",
        /// First derivative of theta_r.
        surface_angle_d1_radps: "rad/s",
        /// Second derivative of theta_r.
        surface_angle_d2_radps2: "rad/s2",
        /// Third derivative of theta_r.
        surface_angle_d3_radps3: "rad/s3",
        /// Fourth derivative of theta_r.
        surface_angle_d4_radps4: "rad/s4",
        /// Fifth derivative of theta_r.
        surface_angle_d5_radps5: "rad/s5",
    }
}

impl Reference {
    /// Returns theta_r and its five derivatives.
    #[must_use]
    pub fn jet(&self) -> Jet<f64, 6> {
        [
            self.surface_angle_rad,
            self.surface_angle_d1_radps,
            self.surface_angle_d2_radps2,
            self.surface_angle_d3_radps3,
            self.surface_angle_d4_radps4,
            self.surface_angle_d5_radps5,
        ]
    }
}

shared_types::table! {
    /// Signals that the laws show. Component 1 of an error belongs to the sum, component 2 to the difference
    /// of the stiffness-weighted piston positions (eqs. 34, 39).
    pub struct Internals {
        /// Performance indicator V_3, half the sum of the squares of all z; it adds N2, N2/s2 and
        /// N2/s4 as plain numbers, as the paper does.
        lyapunov_v3: "1",
        /// Bound V_r (eq. 60).
        lyapunov_bound: "1",
        /// 1 while V_3 has been above V_r without a break for `performance.detection_hold_s`,
        /// else 0.
        fault_detected: "1",
        /// Estimate of C_t1 that the command was computed with; 0 in NRSC.
        leakage_estimate1_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
        /// Estimate of C_t2 that the command was computed with; 0 in NRSC.
        leakage_estimate2_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
        /// Error z_11 of the position sum (eq. 39).
        z11: "N",
        /// Error z_12 of the position difference (eq. 39).
        z12: "N",
        /// Error z_21 of the velocity sum (eq. 40).
        z21: "N/s",
        /// Error z_22 of the velocity difference (eq. 40).
        z22: "N/s",
        /// Error z_31 of the force sum (eq. 43).
        z31: "N/s2",
        /// Error z_32 of the force difference (eq. 43).
        z32: "N/s2",
    }
}

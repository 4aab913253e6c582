//! The paper's backstepping laws for the hydraulic plant: `nrsc` and `ftsc`.
//!
//! Source: "Adaptive Robust Fault-Tolerant Synchronization Control for a Dual Redundant Hydraulic Actuation System with
//! Common-Mode Fault", Mathematical Problems in Engineering, 2018, article 6570104; equation and table numbers in these
//! files are its own.
//!
//! [`nrsc`] is the nonlinear robust synchronization control, [`ftsc`] adds the online estimate of the leakage. Both are
//! [`law::Backstepping`] with their own parameters. One step of the law:
//!
//! 1. [`trajectory`]: from the surface's motion and the deflection command to the desired sum and difference of the
//!    stiffness-weighted piston positions, with derivatives (eqs. 24-33).
//! 2. [`transformation`]: the piston motion as that sum and difference (eqs. 34, 35).
//! 3. [`steps`]: the three errors z_1, z_2, z_3 and the rate of force that they demand (eqs. 39-55).
//! 4. [`hydraulics`]: the valve currents for that rate (eqs. 10, 11, 20-22, 52).
//! 5. [`performance`]: V_3 against its bound V_r, and detection (eqs. 59, 60).
//! 6. [`adaptation`]: the leakage estimate, for the next sample (eqs. 67, 68).
//!
//! Choices where the text is ambiguous or misprinted: x_3 is `[x_13, x_23]`; lambda is `+2 min(k)`;
//! `mu = epsilon_1 + epsilon_2 + xi_1 + xi_2`; eq. (22) is read without beta and without C_t, which eq. (23) multiplies
//! again. The piston acceleration, which x_r1 and its derivatives need, is the backward difference of the measured
//! velocity; an acceleration computed from the model, without the disturbance that no law knows, would make the force
//! fight ten times higher.

pub mod adaptation;
pub mod ftsc;
pub mod gains;
pub mod hydraulics;
pub mod law;
pub mod model;
pub mod nrsc;
pub mod performance;
pub mod signals;
pub mod steps;
pub mod trajectory;
pub mod transformation;

#[cfg(test)]
mod tests;

/// A quantity and its time derivatives: element `j` is the derivative of order `j`.
pub type Jet<T, const N: usize> = [T; N];

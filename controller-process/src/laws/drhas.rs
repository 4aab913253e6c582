//! Common parts of all laws for the hydraulic plant `drhas`: the plant's name and the commands.
//!
//! Used by the `pid` for that plant and by the backstepping laws.

/// The plant's name in scenarios.
pub const PLANT: &str = "drhas";

shared_types::table! {
    /// Currents of the two servo valves.
    pub struct Command {
        /// Current of the servo valve of actuator 1, u_1.
        actuator1_valve_current_a: "A",
        /// Current of the servo valve of actuator 2, u_2.
        actuator2_valve_current_a: "A",
    }
}

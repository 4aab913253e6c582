//! Flags in brackets after a row of [`table!`](crate::table!); the compiler names the flag nearest to an unknown one.

use super::Field;

/// Opens a parameter to faults.
#[must_use]
pub fn faultable(field: Field) -> Field {
    Field {
        faultable: true,
        ..field
    }
}

/// Opens a parameter to changes during a run.
#[must_use]
pub fn tunable(field: Field) -> Field {
    Field {
        tunable: true,
        ..field
    }
}

/// Tells a parameter that is left out from one with its default value.
#[must_use]
pub fn optional(field: Field) -> Field {
    Field {
        is_optional: true,
        ..field
    }
}

#[cfg(test)]
mod tests {
    use crate::table::Table;

    #[test]
    fn a_parameter_can_be_open_to_faults_and_to_changes_in_either_order() {
        crate::table! {
            /// Parameters.
            struct Open {
                /// Both.
                a_kg: "kg" = 1.0 in 0.0..=2.0 [faultable, tunable],
                /// Both, in reverse order.
                b_kg: "kg" = 1.0 in 0.0..=2.0 [tunable, faultable,],
                /// Tunable only.
                c_kg: "kg" = 1.0 in 0.0..=2.0 [tunable],
                /// Neither.
                d_kg: "kg" = 1.0 in 0.0..=2.0,
            }
        }
        let flags: Vec<_> = (Open::fields().iter())
            .map(|field| (field.faultable, field.tunable))
            .collect();
        assert_eq!(
            flags,
            [(true, true), (true, true), (false, true), (false, false)]
        );
        assert_eq!(Open::default().row(), [1.0; 4]);
    }

    #[test]
    fn a_command_can_have_a_start_value_beside_one_without() {
        crate::table! {
            /// Commands.
            struct Command {
                /// Voltage.
                voltage_v: "V",
                /// Ambient temperature.
                ambient_k: "K" start 293.15 in 200.0..=400.0,
                /// Wind.
                wind_mps: "m/s" start (-2.5) in (-50.0)..=50.0,
            }
        }
        let starts: Vec<_> = (Command::fields().iter())
            .map(|field| field.default)
            .collect();
        assert_eq!(starts, [None, Some(293.15), Some(-2.5)]);
        assert_eq!(Command::default().row(), [0.0, 293.15, -2.5]);
    }
}

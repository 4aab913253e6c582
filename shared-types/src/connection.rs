//! Connections: signals of a law bound to signals of a plant with other names and units.
//!
//! The wire, the recording and the faults use the plant's names and units; the law uses its own. A controller's runner
//! renames the law's tables before hello and converts each incoming and outgoing row; neither law nor plant is aware of
//! the connections. The check of a scenario's `[[connect]]` makes them, and the controller's job carries them.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::describe::{Invalid, LawDescription};
use crate::layout::SignalKind;
use crate::number::exact;
use crate::table::Field;
use crate::units::Conversion;

/// Binding between a signal of a law and a signal of a plant or its rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Connection {
    /// Kind of both signals: measured, reference or command.
    pub kind: SignalKind,
    /// Name in the law's table.
    pub law: String,
    /// Unit in the law's table.
    pub law_unit: String,
    /// Name in the plant's table, or of the reference signal.
    pub plant: String,
    /// Unit in the plant's table, or of the reference signal.
    pub plant_unit: String,
    /// Conversion from the sent to the received value: the law sends commands and receives all other signals.
    #[serde(flatten)]
    pub conversion: Conversion,
    /// `true` if the scenario states the conversion, `false` if it follows from the units.
    pub is_given: bool,
}

impl Connection {
    fn is_of(&self, kind: SignalKind, field: &Field) -> bool {
        self.kind == kind && self.law == field.name
    }
}

/// Formats as `law measured.position_m [m] = 0.001 * plant measured.x [mm]`, the receiver first.
impl fmt::Display for Connection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = self.kind.prefix();
        let law = format!("law {kind}.{} [{}]", self.law, self.law_unit);
        let plant = format!("plant {kind}.{} [{}]", self.plant, self.plant_unit);
        let (received, sender) = match self.kind {
            SignalKind::Command => (plant, law),
            _ => (law, plant),
        };
        let Conversion { factor, offset } = self.conversion;
        write!(f, "{received} = ")?;
        if factor != 1.0 {
            write!(f, "{} * ", exact(factor))?;
        }
        f.write_str(&sender)?;
        match offset {
            0.0 => Ok(()),
            _ if offset < 0.0 => write!(f, " - {}", exact(-offset)),
            _ => write!(f, " + {}", exact(offset)),
        }
    }
}

/// Returns the fields of one kind, in order, with the names and units to which the connections bind them.
#[must_use]
pub fn renamed(kind: SignalKind, fields: &[Field], connections: &[Connection]) -> Vec<Field> {
    let renamed = |field: &Field| {
        let connection = connections.iter().find(|one| one.is_of(kind, field));
        connection.map_or_else(
            || field.clone(),
            |one| Field::signal(&one.plant, &one.plant_unit, &field.description),
        )
    };
    fields.iter().map(renamed).collect()
}

/// Lists the conversions of one kind that change a value, each with the index of its field.
#[must_use]
pub fn conversions(
    kind: SignalKind,
    fields: &[Field],
    connections: &[Connection],
) -> Vec<(usize, Conversion)> {
    let conversion = |(place, field): (usize, &Field)| {
        let connection = connections.iter().find(|one| one.is_of(kind, field))?;
        (!connection.conversion.is_identity()).then_some((place, connection.conversion))
    };
    fields.iter().enumerate().filter_map(conversion).collect()
}

impl LawDescription {
    /// Returns the law as seen on the wire: each signal has the name and unit to which it is bound.
    ///
    /// # Errors
    /// If the law lacks a signal to be bound, or would send one command twice.
    pub fn connected(&self, connections: &[Connection]) -> Result<Self, Invalid> {
        let none = &[][..];
        for one in connections {
            let fields = match one.kind {
                SignalKind::Measured => &self.measured,
                SignalKind::Reference => &self.reference,
                SignalKind::Command => self.commands.as_deref().unwrap_or(none),
                SignalKind::Truth | SignalKind::Internal => none,
            };
            if !fields.iter().any(|field| one.is_of(one.kind, field)) {
                let (kind, law, name) = (one.kind.prefix(), &self.name, &one.law);
                return Err(Invalid(format!(
                    "law `{law}` has no signal `{kind}.{name}` to connect"
                )));
            }
        }
        // A sensor may be bound under two names, but is requested once.
        let sensed = |kind, fields: &[Field]| {
            let mut once: Vec<Field> = Vec::with_capacity(fields.len());
            for field in renamed(kind, fields, connections) {
                if once.iter().all(|other| other.name != field.name) {
                    once.push(field);
                }
            }
            once
        };
        let commands = (self.commands.as_ref())
            .map(|commands| renamed(SignalKind::Command, commands, connections));
        for (place, field) in commands.iter().flatten().enumerate() {
            let before = commands.iter().flatten().take(place);
            if before.into_iter().any(|other| other.name == field.name) {
                let (law, name) = (&self.name, &field.name);
                return Err(Invalid(format!(
                    "law `{law}` would send the command `{name}` twice; remove one of the connections"
                )));
            }
        }
        Ok(Self {
            measured: sensed(SignalKind::Measured, &self.measured),
            reference: sensed(SignalKind::Reference, &self.reference),
            commands,
            ..self.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connection(
        kind: SignalKind,
        [law, law_unit, plant, plant_unit]: [&str; 4],
        factor: f64,
        offset: f64,
    ) -> Connection {
        Connection {
            kind,
            law: law.into(),
            law_unit: law_unit.into(),
            plant: plant.into(),
            plant_unit: plant_unit.into(),
            conversion: Conversion { factor, offset },
            is_given: false,
        }
    }

    fn law() -> LawDescription {
        let fields = |names: &[&str]| {
            names
                .iter()
                .map(|name| Field::signal(name, "m", "It."))
                .collect::<Vec<_>>()
        };
        LawDescription {
            name: "two".into(),
            summary: String::new(),
            plants: vec!["one".into()],
            parameters: Vec::new(),
            model: Vec::new(),
            measured: fields(&["a_m", "b_m"]),
            reference: fields(&["a_m"]),
            commands: Some(fields(&["c_m", "d_m"])),
            internals: fields(&["e_m"]),
            saves: false,
            state: None,
            tuning: String::new(),
        }
    }

    fn names(fields: &[Field]) -> Vec<&str> {
        fields.iter().map(|field| field.name.as_str()).collect()
    }

    #[test]
    fn a_connected_law_has_the_names_of_the_plant() {
        let connections = [
            connection(SignalKind::Measured, ["b_m", "m", "x", "mm"], 1e-3, 0.0),
            connection(SignalKind::Command, ["c_m", "m", "d_m", "m"], 1.0, 0.0),
            connection(SignalKind::Command, ["d_m", "m", "c_m", "m"], 1.0, 0.0),
        ];
        let connected = law().connected(&connections).expect("it fits");
        assert_eq!(names(&connected.measured), ["a_m", "x"]);
        assert_eq!(connected.measured[1].unit, "mm");
        assert_eq!(names(&connected.reference), ["a_m"]);
        assert_eq!(
            names(connected.commands.as_deref().unwrap_or_default()),
            ["d_m", "c_m"]
        );
        assert_eq!(connected.internals, law().internals);
        assert_eq!(law().connected(&[]), Ok(law()));
    }

    #[test]
    fn a_sensor_under_two_names_is_requested_once() {
        let connections = [
            connection(SignalKind::Measured, ["a_m", "m", "x", "m"], 1.0, 0.0),
            connection(SignalKind::Measured, ["b_m", "m", "x", "m"], -1.0, 0.0),
        ];
        let connected = law().connected(&connections).expect("it fits");
        assert_eq!(names(&connected.measured), ["x"]);
        let renamed = renamed(SignalKind::Measured, &law().measured, &connections);
        assert_eq!(names(&renamed), ["x", "x"]);
        let conversions = conversions(SignalKind::Measured, &law().measured, &connections);
        assert_eq!(conversions, [(1, connections[1].conversion)]);
    }

    #[test]
    fn impossible_connections_of_a_law_are_refused() {
        for (kind, names, reason) in [
            (
                SignalKind::Measured,
                ["z", "m", "x", "m"],
                "law `two` has no signal `measured.z` to connect",
            ),
            (
                SignalKind::Internal,
                ["e_m", "m", "x", "m"],
                "law `two` has no signal `internal.e_m` to connect",
            ),
            (
                SignalKind::Command,
                ["c_m", "m", "d_m", "m"],
                "law `two` would send the command `d_m` twice; remove one of the connections",
            ),
        ] {
            let error = law().connected(&[connection(kind, names, 1.0, 0.0)]);
            assert_eq!(error, Err(Invalid(reason.into())));
        }
    }

    #[test]
    fn a_connection_prints_the_received_value_as_a_function_of_the_sent_one() {
        for (kind, names, factor, offset, text) in [
            (
                SignalKind::Measured,
                ["x_m", "m", "s", "mm"],
                1e-3,
                0.0,
                "law measured.x_m [m] = 0.001 * plant measured.s [mm]",
            ),
            (
                SignalKind::Reference,
                ["t_k", "K", "t", "degC"],
                1.0,
                273.15,
                "law reference.t_k [K] = plant reference.t [degC] + 273.15",
            ),
            (
                SignalKind::Command,
                ["f_n", "N", "F", "kN"],
                -1e-3,
                -2.0,
                "plant command.F [kN] = -0.001 * law command.f_n [N] - 2",
            ),
        ] {
            assert_eq!(connection(kind, names, factor, offset).to_string(), text);
        }
    }
}

//! Checks of tables known only at run time: the rules that [`table!`](crate::table!) enforces at compile time.
//!
//! Applied when a plant or law is built from such tables, before anything is started. A faulty row is refused, never
//! repaired.

use super::{Invalid, LawDescription, PlantDescription};
use crate::table::{Field, rule};

impl PlantDescription {
    /// Checks a plant with run-time tables: names, units and texts as for any plant, and each row.
    ///
    /// # Errors
    /// The first violation.
    pub fn check_rows(&self) -> Result<(), Invalid> {
        self.check(&[]).map_err(Invalid)?;
        let whose = format!("plant `{}`", self.name);
        check_parameters("parameters", &whose, &self.parameters)?;
        for (table, fields) in [
            ("truth", &self.truth),
            ("measured", &self.measured),
            ("commands", &without_starts(&self.commands)),
            ("state", &self.state.clone().unwrap_or_default()),
        ] {
            check_signals(table, &whose, fields)?;
        }
        check_starts(&whose, &self.commands)?;
        Ok(())
    }
}

impl LawDescription {
    /// Checks a law with run-time tables: names, units and texts as for any law, and each row.
    ///
    /// # Errors
    /// The first violation.
    pub fn check_rows(&self) -> Result<(), Invalid> {
        self.check().map_err(Invalid)?;
        let whose = format!("law `{}`", self.name);
        check_parameters("parameters", &whose, &self.parameters)?;
        check_parameters("model", &whose, &self.model)?;
        for (table, fields) in [
            ("measured", &self.measured[..]),
            ("reference", &self.reference),
            ("commands", self.commands.as_deref().unwrap_or_default()),
            ("internals", &self.internals),
            ("state", self.state.as_deref().unwrap_or_default()),
        ] {
            check_signals(table, &whose, fields)?;
        }
        Ok(())
    }
}

fn check_parameters(table: &str, whose: &str, fields: &[Field]) -> Result<(), Invalid> {
    check_each(table, whose, fields, |field| match field.default {
        // A value without a default must come from the scenario.
        Some(default) if !rule::is_inside(field.min, field.max, default) => Some(format!(
            "has the default {default}, outside {} to {}",
            field.min, field.max
        )),
        _ => None,
    })
}

/// Checks the start values of a plant's commands.
fn check_starts(whose: &str, commands: &[Field]) -> Result<(), Invalid> {
    check_each("commands", whose, commands, |field| match field.default {
        Some(start) if !(start.is_finite() && field.admits(start)) => Some(format!(
            "has the start value {start}, outside {} to {}",
            field.min, field.max
        )),
        _ => None,
    })
}

fn without_starts(commands: &[Field]) -> Vec<Field> {
    let without = |field: &Field| Field {
        default: None,
        ..field.clone()
    };
    commands.iter().map(without).collect()
}

fn check_signals(table: &str, whose: &str, fields: &[Field]) -> Result<(), Invalid> {
    check_each(table, whose, fields, |field| {
        let has_default = field.default.is_some();
        (has_default || field.faultable || field.tunable).then(|| {
            "is a signal; signals have no default and are neither faultable nor tunable".into()
        })
    })
}

/// Finds the first row that violates the common rules or an additional one.
fn check_each(
    table: &str,
    whose: &str,
    fields: &[Field],
    other: impl Fn(&Field) -> Option<String>,
) -> Result<(), Invalid> {
    for field in fields {
        let wrong = if field.unit.is_empty() {
            Some("has no unit; a dimensionless number has the unit `1`".into())
        } else if field.description.is_empty() {
            Some("has no description".into())
        } else if !rule::is_range(field.min, field.max) {
            let (min, max) = (field.min, field.max);
            Some(format!(
                "has a range that begins above its end: {min} to {max}"
            ))
        } else {
            other(field)
        };
        if let Some(wrong) = wrong {
            let name = &field.name;
            return Err(Invalid(format!("{table} of {whose}: `{name}` {wrong}")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(name: &str) -> Field {
        Field::signal(name, "m", "x")
    }

    fn parameter() -> Field {
        Field {
            default: Some(1.0),
            min: 0.0,
            max: 2.0,
            faultable: true,
            ..signal("mass_kg")
        }
    }

    fn plant() -> PlantDescription {
        PlantDescription {
            name: "still".into(),
            summary: "Stands still.".into(),
            parameters: vec![parameter()],
            truth: vec![signal("x_m")],
            measured: vec![signal("x_m")],
            commands: vec![signal("u_m")],
            faults: Vec::new(),
            saves: false,
            port: None,
            state: None,
        }
    }

    fn law() -> LawDescription {
        LawDescription {
            name: "still".into(),
            summary: "Does nothing.".into(),
            plants: Vec::new(),
            parameters: vec![parameter()],
            model: vec![parameter()],
            measured: vec![signal("x_m")],
            reference: Vec::new(),
            commands: None,
            internals: Vec::new(),
            saves: false,
            state: None,
            tuning: String::new(),
        }
    }

    #[test]
    fn rows_that_would_not_compile_are_refused_by_name() {
        assert_eq!(plant().check_rows(), Ok(()));
        let mut required = plant();
        required.parameters[0].default = None;
        assert_eq!(required.check_rows(), Ok(()), "a scenario must give it");
        type Change = fn(&mut Field);
        #[rustfmt::skip] // a table
        let changes: [(Change, &str); 6] = [
            (|row| row.default = Some(3.0), "has the default 3, outside 0 to 2"),
            (|row| row.default = Some(f64::NAN), "has the default NaN, outside 0 to 2"),
            (|row| row.min = 5.0, "has a range that begins above its end: 5 to 2"),
            (|row| row.max = f64::NAN, "has a range that begins above its end: 0 to NaN"),
            (|row| row.unit.clear(), "has no unit; a dimensionless number has the unit `1`"),
            (|row| row.description.clear(), "has no description"),
        ];
        for (change, wrong) in changes {
            let mut plant = plant();
            change(&mut plant.parameters[0]);
            let message = format!("parameters of plant `still`: `mass_kg` {wrong}");
            assert_eq!(plant.check_rows(), Err(Invalid(message)));
            let mut law = law();
            change(&mut law.model[0]);
            let message = format!("model of law `still`: `mass_kg` {wrong}");
            assert_eq!(law.check_rows(), Err(Invalid(message)));
        }
    }

    #[test]
    fn a_signal_with_parameter_attributes_is_refused() {
        assert_eq!(law().check_rows(), Ok(()));
        let mut plant = plant();
        plant.measured[0].default = Some(0.0);
        let message = "measured of plant `still`: `x_m` is a signal; signals have no default and are neither faultable nor tunable";
        assert_eq!(plant.check_rows(), Err(Invalid(message.into())));
        let mut law = law();
        law.internals = vec![Field {
            faultable: true,
            ..signal("i_m")
        }];
        let message = "internals of law `still`: `i_m` is a signal; signals have no default and are neither faultable nor tunable";
        assert_eq!(law.check_rows(), Err(Invalid(message.into())));
    }

    #[test]
    fn names_are_checked_as_in_any_description() {
        let mut plant = plant();
        plant.truth.push(signal("x_m"));
        let message = "truth of plant `still`: `x_m` is defined twice";
        assert_eq!(plant.check_rows(), Err(Invalid(message.into())));
        let mut law = law();
        law.name.clear();
        assert!(law.check_rows().is_err());
    }
}

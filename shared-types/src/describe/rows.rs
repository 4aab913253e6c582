//! Checks of tables that are known at run time: the rules that [`table!`](crate::table!) has the compiler keep.
//!
//! Used where a plant or a law is made from them, before anything is started. It never mends a row.

use super::{Invalid, LawDescription, PlantDescription};
use crate::table::{Field, rule};

impl PlantDescription {
    /// Checks a plant whose tables are known at run time: names, units and texts as of any plant, and each row.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check_rows(&self) -> Result<(), Invalid> {
        self.check(&[]).map_err(Invalid)?;
        let whose = format!("plant `{}`", self.name);
        check_parameters("parameters", &whose, &self.parameters)?;
        for (table, fields) in [
            ("truth", &self.truth),
            ("measured", &self.measured),
            ("commands", &self.commands),
        ] {
            check_signals(table, &whose, fields)?;
        }
        Ok(())
    }
}

impl LawDescription {
    /// Checks a law whose tables are known at run time: names, units and texts as of any law, and each row.
    ///
    /// # Errors
    /// The first thing that is wrong.
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
        ] {
            check_signals(table, &whose, fields)?;
        }
        Ok(())
    }
}

fn check_parameters(table: &str, whose: &str, fields: &[Field]) -> Result<(), Invalid> {
    check_each(table, whose, fields, |field| match field.default {
        // A scenario must give the value of one without a default.
        Some(default) if !rule::is_inside(field.min, field.max, default) => Some(format!(
            "has the default {default}, which is not in {} to {}",
            field.min, field.max
        )),
        _ => None,
    })
}

fn check_signals(table: &str, whose: &str, fields: &[Field]) -> Result<(), Invalid> {
    check_each(table, whose, fields, |field| {
        let has_default = field.default.is_some();
        (has_default || field.faultable || field.tunable).then(|| {
            "is a signal, which has no default and is neither faultable nor tunable".into()
        })
    })
}

/// Finds the first row that breaks the rules of every row or another one.
fn check_each(
    table: &str,
    whose: &str,
    fields: &[Field],
    other: impl Fn(&Field) -> Option<String>,
) -> Result<(), Invalid> {
    for field in fields {
        let wrong = if field.unit.is_empty() {
            Some("has no unit; that of a number without one is `1`".into())
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
            tuning: String::new(),
        }
    }

    #[test]
    fn rows_that_the_compiler_would_refuse_are_refused_by_name() {
        assert_eq!(plant().check_rows(), Ok(()));
        let mut required = plant();
        required.parameters[0].default = None;
        assert_eq!(required.check_rows(), Ok(()), "a scenario must give it");
        type Change = fn(&mut Field);
        let changes: [(Change, &str); 6] = [
            (
                |row| row.default = Some(3.0),
                "has the default 3, which is not in 0 to 2",
            ),
            (
                |row| row.default = Some(f64::NAN),
                "has the default NaN, which is not in 0 to 2",
            ),
            (
                |row| row.min = 5.0,
                "has a range that begins above its end: 5 to 2",
            ),
            (
                |row| row.max = f64::NAN,
                "has a range that begins above its end: 0 to NaN",
            ),
            (
                |row| row.unit.clear(),
                "has no unit; that of a number without one is `1`",
            ),
            (|row| row.description.clear(), "has no description"),
        ];
        for (change, wrong) in changes {
            let mut plant = plant();
            change(&mut plant.parameters[0]);
            let told = format!("parameters of plant `still`: `mass_kg` {wrong}");
            assert_eq!(plant.check_rows(), Err(Invalid(told)));
            let mut law = law();
            change(&mut law.model[0]);
            let told = format!("model of law `still`: `mass_kg` {wrong}");
            assert_eq!(law.check_rows(), Err(Invalid(told)));
        }
    }

    #[test]
    fn a_signal_is_no_parameter() {
        assert_eq!(law().check_rows(), Ok(()));
        let mut plant = plant();
        plant.measured[0].default = Some(0.0);
        let told = "measured of plant `still`: `x_m` is a signal, which has no default and is neither faultable nor tunable";
        assert_eq!(plant.check_rows(), Err(Invalid(told.into())));
        let mut law = law();
        law.internals = vec![Field {
            faultable: true,
            ..signal("i_m")
        }];
        let told = "internals of law `still`: `i_m` is a signal, which has no default and is neither faultable nor tunable";
        assert_eq!(law.check_rows(), Err(Invalid(told.into())));
    }

    #[test]
    fn names_are_checked_as_in_any_description() {
        let mut plant = plant();
        plant.truth.push(signal("x_m"));
        let told = "truth of plant `still`: `x_m` is there twice";
        assert_eq!(plant.check_rows(), Err(Invalid(told.into())));
        let mut law = law();
        law.name.clear();
        assert!(law.check_rows().is_err());
    }
}

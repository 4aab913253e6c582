//! Variables of an FMU that can be set before it runs.

use super::description::{Causality, Initial, ModelDescription, Variable};

/// Iterates over the variables other than inputs whose initial values can be set.
pub(super) fn with_initial_value(model: &ModelDescription) -> impl Iterator<Item = &Variable> {
    let all = model.variables.iter();
    all.filter(|one| one.kind.range().is_some() && may_be_set(one).is_ok() && !is_input(one))
}

/// Returns `true` if the variable is an input.
pub(super) fn is_input(variable: &Variable) -> bool {
    variable.causality == Causality::Input
}

/// Checks that a variable has an initial value that can be set.
///
/// # Errors
/// If the variable has no settable initial value; the text is the reason.
pub(super) fn may_be_set(variable: &Variable) -> Result<(), &'static str> {
    if variable.unusable.is_some() {
        return Err("cannot be read from the model description, so its value cannot be set");
    }
    if variable.is_clocked {
        return Err("has a clock");
    }
    match (variable.causality, variable.initial) {
        (Causality::Parameter, _) if variable.lacks_start() && !variable.is_constant => Ok(()),
        (Causality::Parameter, _) => Err("is a parameter; set it in `parameters`"),
        (Causality::StructuralParameter, _) => {
            Err("is a structural parameter; set it in `structural`")
        }
        (Causality::Independent, _) => Err("is the time; set its start with `start_time_s`"),
        _ if variable.is_constant => Err("is constant"),
        (Causality::Input, _) | (_, Initial::Exact | Initial::Approx) => Ok(()),
        (_, Initial::Calculated) => Err(
            "is calculated by the FMU and cannot be set (its `initial` is neither exact nor approx)",
        ),
    }
}

/// Returns `true` if the variable is a text that can be set.
pub(super) fn is_settable_text(variable: &Variable) -> bool {
    variable.causality == Causality::Parameter && !variable.is_constant
        || may_be_set(variable).is_ok()
}

//! The linear model of an FMU at its state: the directional derivatives that it provides, by the continuous states that
//! its model structure lists. Differences nothing, and knows no discrete map.

use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::local_map::{Accuracy, LocalMap, variables};
use shared_types::table::Field;

use super::description::{ModelDescription, VariableType};
use super::instance::Instance;
use super::tables::Column;

/// Differentiates the equations of an instance at its state and these inputs.
///
/// Numbers of 64 bits without dimensions count: the model has no row or column for others.
///
/// # Errors
/// If the FMU provides no derivatives by its states, or refuses.
pub(super) fn map(
    instance: &mut Instance,
    inputs: &[f64],
    length_s: f64,
) -> Result<LocalMap, Invalid> {
    let parts = Parts::of(instance)?;
    let map = parts.map(instance, inputs, length_s);
    let map = map.map_err(|failure| Invalid(failure.to_string()))?;
    let all = map.columns.iter().flatten();
    let all = all.chain(map.states.iter().map(|state| &state.value));
    match all.copied().all(f64::is_finite) {
        true => Ok(map),
        false => Err(Invalid(
            "a derivative by which the FMU answers is not a finite number".into(),
        )),
    }
}

/// Numbers of the model, with their value references.
struct Parts {
    states: Vec<Number>,
    /// Value references of the derivatives of the states.
    rates: Vec<u32>,
    inputs: Vec<Number>,
    outputs: Vec<Number>,
}

/// Number of an FMU.
struct Number {
    field: Field,
    reference: u32,
    /// Place in its table.
    place: usize,
}

impl Parts {
    fn of(instance: &Instance) -> Result<Self, Invalid> {
        let (description, tables) = (&instance.model().description, &instance.model().tables);
        if tables.states.is_empty() {
            return Err(Invalid(match description.differentiates {
                true => "the FMU provides directional derivatives, but its model structure lists no continuous states by which they could be taken".into(),
                false => "the FMU provides no directional derivatives, and its state is bytes without names".into(),
            }));
        }
        Ok(Self {
            states: numbers(description, &tables.states),
            rates: { description.states.iter() }
                .map(|state| state.derivative)
                .collect(),
            inputs: numbers(description, &tables.inputs),
            outputs: numbers(description, &tables.outputs),
        })
    }

    fn map(
        &self,
        instance: &mut Instance,
        inputs: &[f64],
        length_s: f64,
    ) -> Result<LocalMap, Failure> {
        let references: Vec<u32> = self.states.iter().map(|state| state.reference).collect();
        // Read before the inputs are set, as the standard requires.
        let states = instance.numbers(&references)?;
        let signals = instance.signals().to_vec();
        instance.set_inputs(inputs)?;
        // An output that is a state needs no question, and some FMUs answer it with 0.
        let state_of = |output: &Number| references.iter().position(|one| *one == output.reference);
        let computed = self.outputs.iter().filter(|one| state_of(one).is_none());
        let computed = computed.map(|output| output.reference);
        let unknowns: Vec<u32> = self.rates.iter().copied().chain(computed).collect();
        let known = self.states.iter().chain(&self.inputs);
        let columns = known.enumerate().map(|(column, known)| {
            let mut answers = instance
                .derivatives(&unknowns, known.reference)?
                .into_iter();
            let mut values: Vec<f64> = answers.by_ref().take(self.rates.len()).collect();
            values.extend(self.outputs.iter().map(|output| match state_of(output) {
                Some(state) => f64::from(u8::from(state == column)),
                None => answers.next().unwrap_or_default(),
            }));
            Ok(values)
        });
        let columns = columns.collect::<Result<Vec<_>, Failure>>()?;
        let own = |numbers: &[Number], row: &[f64]| {
            let (fields, values): (Vec<Field>, Vec<f64>) = { numbers.iter() }
                .map(|number| (number.field.clone(), row[number.place]))
                .unzip();
            variables(&fields, &values)
        };
        Ok(LocalMap {
            period_s: length_s,
            states: own(&self.states, &states),
            inputs: own(&self.inputs, inputs),
            outputs: own(&self.outputs, &signals),
            truth: Vec::new(),
            next: Vec::new(),
            accuracy: vec![EXACT; columns.len()],
            columns,
            is_continuous: true,
        })
    }
}

/// Accuracy of derivatives that no difference approximates.
const EXACT: Accuracy = Accuracy {
    step: 0.0,
    error: 0.0,
};

fn numbers(description: &ModelDescription, columns: &[Column]) -> Vec<Number> {
    let all = columns.iter().enumerate();
    let number = |(place, column): (usize, &Column)| {
        let variable = &description.variables[column.variable];
        let is_number = variable.kind == VariableType::Float64 && variable.dimensions.is_empty();
        is_number.then(|| Number {
            field: column.field.clone(),
            reference: variable.reference,
            place,
        })
    };
    all.filter_map(number).collect()
}

//! Directional derivatives of an instance's equations, and the numbers that they are of. No steps are executed here.

use std::sync::Arc;

use shared_types::failure::Failure;

use super::Instance;
use crate::crash::calling;
use crate::fmi::description::VariableType;
use crate::fmi::library::{Access, DerivativeFunction};

impl Instance {
    /// Returns numbers by their value references.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub(in crate::fmi) fn numbers(&self, references: &[u32]) -> Result<Vec<f64>, Failure> {
        let mut values = vec![0.0; references.len()];
        let (first, count) = (references.as_ptr(), references.len());
        let to = values.as_mut_ptr().cast();
        let call = calling(&"GetReal");
        // SAFETY: the instance is initialised and between two steps, nothing was set since the last, and both lists
        // have this length and live until the call returns.
        let answer = unsafe {
            match self.functions.access[&VariableType::Float64] {
                Access::Two(get, _) => get(self.handle, first, count, to),
                Access::Three(get, _) => get(self.handle, first, count, to, count),
            }
        };
        drop(call);
        self.judge("GetReal", answer)?;
        Ok(values)
    }

    /// Sets the inputs, between two steps.
    ///
    /// # Errors
    /// If the FMU refuses.
    pub(in crate::fmi) fn set_inputs(&mut self, inputs: &[f64]) -> Result<(), Failure> {
        // SAFETY: the instance is between two steps, so inputs may be set.
        let set = unsafe { (self.inputs).set(&self.functions, self.handle, inputs) };
        self.accept(set)
    }

    /// Returns the derivatives of unknowns by one known number, all by their value references.
    ///
    /// # Errors
    /// If the library has no such function, or the FMU refuses.
    pub(in crate::fmi) fn derivatives(
        &self,
        unknowns: &[u32],
        known: u32,
    ) -> Result<Vec<f64>, Failure> {
        let functions = Arc::clone(&self.functions);
        let Some(function) = functions.derivative else {
            return Err(self.failure(
                "promises directional derivatives, but its library has no function GetDirectionalDerivative",
            ));
        };
        let mut values = vec![0.0; unknowns.len()];
        let (first, count, to) = (unknowns.as_ptr(), unknowns.len(), values.as_mut_ptr());
        let seed = 1.0;
        let call = calling(&"GetDirectionalDerivative");
        // SAFETY: the instance is between two steps, when derivatives may be computed; both lists have this length, and
        // `known` and `seed` are one number each; all live until the call returns.
        let answer = unsafe {
            match function {
                DerivativeFunction::Two(function) => function(
                    self.handle,
                    first,
                    count,
                    &raw const known,
                    1,
                    &raw const seed,
                    to,
                ),
                DerivativeFunction::Three(function) => function(
                    self.handle,
                    first,
                    count,
                    &raw const known,
                    1,
                    &raw const seed,
                    1,
                    to,
                    count,
                ),
            }
        };
        drop(call);
        self.judge("GetDirectionalDerivative", answer)?;
        Ok(values)
    }
}

//! Values other than parameters that are set before initialisation: array sizes, initial values and texts.

use std::ffi::{c_char, c_int};
use std::sync::Arc;

use shared_types::failure::Failure;

use super::{Instance, Values};
use crate::crash::calling;
use crate::fmi::description::VariableType;
use crate::fmi::library::Access;
use crate::fmi::start::{Preset, Start};

impl Instance {
    /// Sets structural parameters, in the mode reserved for them.
    pub(super) fn configure(&self, structural: &Preset) -> Result<(), Failure> {
        let functions = Arc::clone(&self.functions);
        let Some([enter, exit]) = functions.configuration else {
            return Ok(());
        };
        let call = calling(&"EnterConfigurationMode");
        // SAFETY: the instance exists and is not initialised.
        self.judge("EnterConfigurationMode", unsafe { enter(self.handle) })?;
        drop(call);
        self.set_preset(structural)?;
        let _call = calling(&"ExitConfigurationMode");
        // SAFETY: the instance is in configuration mode.
        self.judge("ExitConfigurationMode", unsafe { exit(self.handle) })
    }

    /// Sets initial values and texts.
    pub(super) fn preset(&self, start: &Start) -> Result<(), Failure> {
        self.set_preset(&start.initial)?;
        for (reference, text) in &start.texts {
            let values: [*const c_char; 1] = [text.as_ptr()];
            let values = values.as_ptr().cast();
            let call = calling(&"SetString");
            // SAFETY: the instance exists and is not initialised; one reference and one text are passed, which live
            // until the call returns.
            let answer: c_int = unsafe {
                match self.functions.access[&VariableType::String] {
                    Access::Two(_, set) => set(self.handle, reference, 1, values),
                    Access::Three(_, set) => set(self.handle, reference, 1, values, 1),
                }
            };
            drop(call);
            self.judge("SetString", answer)?;
        }
        Ok(())
    }

    fn set_preset(&self, preset: &Preset) -> Result<(), Failure> {
        let mut values = Values::new(&self.model.description, &preset.columns);
        // SAFETY: the instance exists and is not initialised, and its mode allows setting these.
        let set = unsafe { values.set(&self.functions, self.handle, &preset.row) };
        self.accept(set)
    }
}

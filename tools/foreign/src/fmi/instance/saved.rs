//! State of an instance as bytes, for checkpoints. Nothing here does a step.

use std::ffi::c_int;
use std::ptr::null_mut;
use std::sync::Arc;

use shared_types::describe::Invalid;
use shared_types::state::State;

use super::Instance;
use crate::crash::calling;
use crate::fmi::library::{Functions, StateFunctions};
use crate::fmi::status::Status;

impl Instance {
    /// The state of the instance as bytes, with the parameters that it has.
    ///
    /// # Errors
    /// If the FMU cannot save its state, or fails at it.
    pub(in crate::fmi) fn save(&self) -> Result<State, Invalid> {
        let functions = Arc::clone(&self.functions);
        let state = saving(&functions)?;
        let mut taken = null_mut();
        let mut size = 0;
        let call = calling(&"GetFMUState");
        // SAFETY: the instance is between two steps, when its state may be taken, and `taken` is null.
        let got = unsafe { (state.get)(self.handle, &raw mut taken) };
        self.saved("GetFMUState", got)?;
        drop(call);
        let call = calling(&"SerializedFMUStateSize");
        // SAFETY: the state was taken from this instance.
        let sized = unsafe { (state.size)(self.handle, taken, &raw mut size) };
        drop(call);
        let mut bytes = Vec::new();
        let (mut function, mut written) = ("SerializedFMUStateSize", sized);
        if Status::of(sized).is_done() {
            bytes = vec![0; size];
            let _call = calling(&"SerializeFMUState");
            function = "SerializeFMUState";
            // SAFETY: the state is of this instance and `bytes` has the size that it asked for.
            written =
                unsafe { (state.serialize)(self.handle, taken, bytes.as_mut_ptr(), bytes.len()) };
        }
        let call = calling(&"FreeFMUState");
        // SAFETY: the state is of this instance and is not used again.
        let freed = unsafe { (state.free)(self.handle, &raw mut taken) };
        drop(call);
        self.saved(function, written)?;
        self.saved("FreeFMUState", freed)?;
        State::of(&(bytes, &self.tuned))
    }

    /// Puts a state back and reads all signals.
    ///
    /// # Errors
    /// If it is no state of this FMU.
    pub(in crate::fmi) fn restore(&mut self, saved: &State) -> Result<(), Invalid> {
        let functions = Arc::clone(&self.functions);
        let state = saving(&functions)?;
        let (bytes, tuned): (Vec<u8>, Vec<f64>) = saved.read()?;
        if tuned.len() != self.tuned.len() {
            return Err(Invalid(
                "the state has other tunable parameters than the FMU".into(),
            ));
        }
        let mut made = null_mut();
        let call = calling(&"DeserializeFMUState");
        // SAFETY: the instance is between two steps, and `bytes` has so many.
        let read =
            unsafe { (state.deserialize)(self.handle, bytes.as_ptr(), bytes.len(), &raw mut made) };
        self.saved("DeserializeFMUState", read)?;
        drop(call);
        let call = calling(&"SetFMUState");
        // SAFETY: the state was made by this instance.
        let set = unsafe { (state.set)(self.handle, made) };
        drop(call);
        let call = calling(&"FreeFMUState");
        // SAFETY: the state is of this instance and is not used again.
        let freed = unsafe { (state.free)(self.handle, &raw mut made) };
        drop(call);
        self.saved("SetFMUState", set)?;
        self.saved("FreeFMUState", freed)?;
        self.tuned = tuned;
        self.read().map_err(|failure| Invalid(failure.to_string()))
    }

    fn saved(&self, function: &'static str, answer: c_int) -> Result<(), Invalid> {
        let judged = self.judge(function, answer);
        judged.map_err(|failure| Invalid(failure.to_string()))
    }
}

fn saving(functions: &Functions) -> Result<&StateFunctions, Invalid> {
    let refused = || Invalid("the FMU cannot save its state (canSerializeFMUState)".into());
    functions.state.as_ref().ok_or_else(refused)
}

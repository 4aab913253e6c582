//! Saving and restoring the state of an instance for checkpoints. No steps are executed here.

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
    /// Serialises the state of the instance, together with its tunable parameters.
    ///
    /// # Errors
    /// If the FMU does not support saving its state, or fails to do so.
    pub(in crate::fmi) fn save(&self) -> Result<State, Invalid> {
        let functions = Arc::clone(&self.functions);
        let state = saving(&functions)?;
        let mut snapshot = null_mut();
        let mut size = 0;
        let call = calling(&"GetFMUState");
        // SAFETY: the instance is between two steps, when its state may be saved, and `snapshot` is null.
        let got = unsafe { (state.get)(self.handle, &raw mut snapshot) };
        self.saved("GetFMUState", got)?;
        drop(call);
        let call = calling(&"SerializedFMUStateSize");
        // SAFETY: the state belongs to this instance.
        let sized = unsafe { (state.size)(self.handle, snapshot, &raw mut size) };
        drop(call);
        let mut bytes = Vec::new();
        let (mut function, mut status) = ("SerializedFMUStateSize", sized);
        if Status::of(sized).is_done() {
            bytes = vec![0; size];
            let _call = calling(&"SerializeFMUState");
            function = "SerializeFMUState";
            // SAFETY: the state belongs to the instance, and `bytes` has the size that it requested.
            status = unsafe {
                (state.serialize)(self.handle, snapshot, bytes.as_mut_ptr(), bytes.len())
            };
        }
        let call = calling(&"FreeFMUState");
        // SAFETY: the state belongs to the instance and is not used again.
        let freed = unsafe { (state.free)(self.handle, &raw mut snapshot) };
        drop(call);
        self.saved(function, status)?;
        self.saved("FreeFMUState", freed)?;
        State::of(&(bytes, &self.tuned))
    }

    /// Restores a state and reads all signals.
    ///
    /// # Errors
    /// If the state does not belong to this FMU.
    pub(in crate::fmi) fn restore(&mut self, saved: &State) -> Result<(), Invalid> {
        let functions = Arc::clone(&self.functions);
        let state = saving(&functions)?;
        let (bytes, tuned): (Vec<u8>, Vec<f64>) = saved.read()?;
        if tuned.len() != self.tuned.len() {
            return Err(Invalid(
                "the state and the FMU have different tunable parameters".into(),
            ));
        }
        let mut snapshot = null_mut();
        let call = calling(&"DeserializeFMUState");
        // SAFETY: the instance is between two steps, and `bytes` has this length.
        let read = unsafe {
            (state.deserialize)(self.handle, bytes.as_ptr(), bytes.len(), &raw mut snapshot)
        };
        self.saved("DeserializeFMUState", read)?;
        drop(call);
        let call = calling(&"SetFMUState");
        // SAFETY: the state was created by this instance.
        let set = unsafe { (state.set)(self.handle, snapshot) };
        drop(call);
        let call = calling(&"FreeFMUState");
        // SAFETY: the state belongs to the instance and is not used again.
        let freed = unsafe { (state.free)(self.handle, &raw mut snapshot) };
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

//! Memory of one plant or controller in C: its `self`, and what a checkpoint keeps of it.

use std::ffi::c_void;

use shared_types::describe::Invalid;
use shared_types::state::State;

use crate::crash::calling;

use super::interface::{End, Restore, Save};
use super::reason::outcome;
use crate::float_modes;

/// Largest `self`, far beyond what a model needs.
pub(super) const MOST_BYTES: usize = 1 << 32;

/// Functions for checkpoints, if there are any.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saving {
    pub(super) size: usize,
    pub(super) save: Save,
    pub(super) restore: Restore,
}

/// A `self` with the function that ends it. All zero at first, aligned for any type of C.
#[derive(Debug)]
pub(super) struct Memory {
    // As large as asked for, rounded up to whole words.
    words: Box<[u128]>,
    /// Set when it has started.
    pub(super) end: Option<End>,
}

impl Memory {
    /// Memory of N bytes, at most [`MOST_BYTES`].
    pub(super) fn new(size: usize) -> Self {
        Self {
            words: vec![0; size.div_ceil(size_of::<u128>())].into(),
            end: None,
        }
    }

    /// The pointer that callbacks read.
    #[inline]
    pub(super) fn read(&self) -> *const c_void {
        self.words.as_ptr().cast()
    }

    /// The pointer that callbacks change.
    #[inline]
    pub(super) fn change(&mut self) -> *mut c_void {
        self.words.as_mut_ptr().cast()
    }

    /// Saves the state.
    ///
    /// # Errors
    /// If there is no saving, or the callback failed.
    pub(super) fn save(&self, saving: Option<Saving>) -> Result<State, Invalid> {
        let saving = saving.ok_or_else(cannot_save)?;
        let mut bytes = vec![0_u8; saving.size];
        let _call = calling(&"save");
        // SAFETY: the callback is that of this memory, which has started, and writes `size` bytes.
        let status = unsafe { (saving.save)(self.read(), bytes.as_mut_ptr().cast()) };
        outcome("save", status).map_err(|failure| Invalid(failure.to_string()))?;
        Ok(State::from(bytes))
    }

    /// Puts a state back.
    ///
    /// # Errors
    /// If it has another size, there is no saving, or the callback failed.
    pub(super) fn restore(&mut self, saving: Option<Saving>, state: &State) -> Result<(), Invalid> {
        let saving = saving.ok_or_else(cannot_save)?;
        let (bytes, size) = (state.as_bytes(), saving.size);
        if bytes.len() != size {
            let found = bytes.len();
            return Err(Invalid(format!(
                "the state has {found} bytes, and this program saves {size}"
            )));
        }
        let _call = calling(&"restore");
        // SAFETY: the callback is that of this memory, which has started, and reads `size` bytes.
        let status = unsafe { (saving.restore)(self.change(), bytes.as_ptr().cast()) };
        outcome("restore", status).map_err(|failure| Invalid(failure.to_string()))
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        if let Some(end) = self.end {
            let _call = calling(&"end");
            // SAFETY: the callback is that of this memory, which has started, and nothing is called after it.
            unsafe { end(self.change()) };
            float_modes::settle("end");
        }
    }
}

fn cannot_save() -> Invalid {
    Invalid("the program cannot save its state; it needs `saved_size`, `save` and `restore`".into())
}

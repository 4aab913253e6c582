//! State memory of a plant or controller in C (`self`), with saving for checkpoints.

use std::ffi::c_void;

use shared_types::describe::Invalid;
use shared_types::state::{State, check_count, unnamed};

use crate::crash::calling;

use super::interface::{End, Restore, Save, TakeRow, WriteRow};
use super::reason::outcome;
use crate::float_modes;

/// Maximum size of `self`, far beyond the needs of a model, in bytes.
pub(super) const MOST_BYTES: usize = 1 << 32;

/// Callbacks for checkpoints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saving {
    pub(super) size: usize,
    pub(super) save: Save,
    pub(super) restore: Restore,
}

/// Callbacks for the named numbers of a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Naming {
    /// Number of rows.
    pub(super) count: usize,
    pub(super) tell: WriteRow,
    pub(super) take: TakeRow,
}

/// State memory with the callback that ends its use. Initially zero, and aligned for any C type.
#[derive(Debug)]
pub(super) struct Memory {
    // Requested size, rounded up to whole words.
    words: Box<[u128]>,
    /// Set once the plant or controller has started.
    pub(super) end: Option<End>,
}

impl Memory {
    /// Allocates memory of `size` bytes, at most [`MOST_BYTES`].
    pub(super) fn new(size: usize) -> Self {
        Self {
            words: vec![0; size.div_ceil(size_of::<u128>())].into(),
            end: None,
        }
    }

    /// Returns the pointer for callbacks that only read.
    #[inline]
    pub(super) fn read(&self) -> *const c_void {
        self.words.as_ptr().cast()
    }

    /// Returns the pointer for callbacks that modify the state.
    #[inline]
    pub(super) fn change(&mut self) -> *mut c_void {
        self.words.as_mut_ptr().cast()
    }

    /// Saves the state.
    ///
    /// # Errors
    /// If saving is not supported, or the callback fails.
    pub(super) fn save(&self, saving: Option<Saving>) -> Result<State, Invalid> {
        let saving = saving.ok_or_else(cannot_save)?;
        let mut bytes = vec![0_u8; saving.size];
        let _call = calling(&"save");
        // SAFETY: the callback belongs to this started memory, and writes `size` bytes.
        let status = unsafe { (saving.save)(self.read(), bytes.as_mut_ptr().cast()) };
        outcome("save", status).map_err(|failure| Invalid(failure.to_string()))?;
        Ok(State::from(bytes))
    }

    /// Restores a state.
    ///
    /// # Errors
    /// If the size differs, saving is not supported, or the callback fails.
    pub(super) fn restore(&mut self, saving: Option<Saving>, state: &State) -> Result<(), Invalid> {
        let saving = saving.ok_or_else(cannot_save)?;
        let (bytes, size) = (state.as_bytes(), saving.size);
        if bytes.len() != size {
            let actual = bytes.len();
            return Err(Invalid(format!(
                "the state has {actual} bytes, but this program saves {size}"
            )));
        }
        let _call = calling(&"restore");
        // SAFETY: the callback belongs to this started memory, and reads `size` bytes.
        let status = unsafe { (saving.restore)(self.change(), bytes.as_ptr().cast()) };
        outcome("restore", status).map_err(|failure| Invalid(failure.to_string()))
    }

    /// Returns the named numbers of the state.
    ///
    /// # Errors
    /// If the state does not name its numbers, or the callback fails.
    pub(super) fn numbers(&self, naming: Option<Naming>) -> Result<Vec<f64>, Invalid> {
        let naming = naming.ok_or_else(unnamed)?;
        let mut numbers = vec![f64::NAN; naming.count];
        let _call = calling(&"tell_state");
        // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
        let status = unsafe { (naming.tell)(self.read(), numbers.as_mut_ptr()) };
        outcome("tell_state", status).map_err(|failure| Invalid(failure.to_string()))?;
        Ok(numbers)
    }

    /// Sets the named numbers of the state.
    ///
    /// # Errors
    /// If the state does not name its numbers, names another count of them, or the callback fails.
    pub(super) fn set_numbers(
        &mut self,
        naming: Option<Naming>,
        numbers: &[f64],
    ) -> Result<(), Invalid> {
        let naming = naming.ok_or_else(unnamed)?;
        check_count(naming.count, numbers.len())?;
        let _call = calling(&"take_state");
        // SAFETY: the callback belongs to this started memory, and the row is as long as its table.
        let status = unsafe { (naming.take)(self.change(), numbers.as_ptr()) };
        outcome("take_state", status).map_err(|failure| Invalid(failure.to_string()))
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        if let Some(end) = self.end {
            let _call = calling(&"end");
            // SAFETY: the callback belongs to this started memory, and nothing is called after it.
            unsafe { end(self.change()) };
            float_modes::settle("end");
        }
    }
}

fn cannot_save() -> Invalid {
    Invalid("the program cannot save its state; it needs `saved_size`, `save` and `restore`".into())
}

//! Plants and laws that are lent by address and dropped with their last owner.

use std::ptr::NonNull;
use std::sync::Arc;

/// Kind that is dropped with its last owner.
pub(crate) struct Owned<T>(NonNull<T>);

// SAFETY: an owner of its value, which is all that it has.
unsafe impl<T: Send> Send for Owned<T> {}
// SAFETY: as above.
unsafe impl<T: Sync> Sync for Owned<T> {}

impl<T> Owned<T> {
    /// Takes a kind.
    pub(crate) fn new(kind: T) -> Arc<Self> {
        Arc::new(Self(NonNull::from(Box::leak(Box::new(kind)))))
    }

    /// Returns the kind.
    ///
    /// # Safety
    /// No use of the reference may outlive the owner.
    pub(crate) const unsafe fn get(&self) -> &'static T {
        // SAFETY: the kind lives until this owner is dropped, as the caller promises to observe, and nothing changes it.
        unsafe { self.0.as_ref() }
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: made from a box in `new`, and dropped here alone.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

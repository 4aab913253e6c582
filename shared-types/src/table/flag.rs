//! What may stand in brackets behind a row of [`table!`](crate::table!); the compiler names the nearest
//! of these when it is something else.

/// Opens a parameter to faults.
#[must_use]
pub const fn faultable() -> bool {
    true
}

//! Flags in brackets behind a row of [`table!`](crate::table!); the compiler names the nearest
//! of these when it is something else.

use super::Field;

/// Opens a parameter to faults.
#[must_use]
pub fn faultable(field: Field) -> Field {
    Field {
        faultable: true,
        ..field
    }
}

/// Opens a parameter to changes while a run goes on.
#[must_use]
pub fn tunable(field: Field) -> Field {
    Field {
        tunable: true,
        ..field
    }
}

//! The package as a static library that exports only the functions called from C.

pub use hil_foreign::c;

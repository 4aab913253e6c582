//! The package as a static library: everything of it that C calls, and nothing else.

pub use hil_foreign::c;

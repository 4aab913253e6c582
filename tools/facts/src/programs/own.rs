//! Source revision of this program.

use std::sync::OnceLock;

static COMMIT: OnceLock<&str> = OnceLock::new();

/// Sets the commit from which this program is built; only the first call counts.
pub fn note_commit(commit: &'static str) {
    let _ = COMMIT.set(commit);
}

/// Returns the commit from which this program is built; `unknown` if its `main` has not set one.
#[must_use]
pub fn commit() -> &'static str {
    COMMIT.get().copied().unwrap_or("unknown")
}

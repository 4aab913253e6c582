//! The program that this is: the source that it is built from.

use std::sync::OnceLock;

static COMMIT: OnceLock<&str> = OnceLock::new();

/// Notes the commit that this program is built from; only the first note counts.
pub fn note_commit(commit: &'static str) {
    let _ = COMMIT.set(commit);
}

/// Returns the commit that this program is built from: `unknown` if its `main` noted none.
#[must_use]
pub fn commit() -> &'static str {
    COMMIT.get().copied().unwrap_or("unknown")
}

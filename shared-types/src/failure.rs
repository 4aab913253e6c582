//! Failure of a plant or law during a run.
//!
//! Returned by plants and laws whose equations are implemented elsewhere, in C or in a file, through the rows of
//! `plant_process::plant::Model` and `controller_process::controller::Law`. A `Plant` or `Controller` written in Rust
//! never fails: its ranges of validity limit it.

/// Failure that ends a run, with its reason. Pointer-sized, so that returning `None` costs nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.reason)]
pub struct Failure(Box<Cause>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct Cause {
    is_divergence: bool,
    reason: String,
}

impl Failure {
    /// Creates the failure of a plant that left its range of validity: the run ends as diverged.
    #[must_use]
    pub fn diverged(reason: impl Into<String>) -> Self {
        Self::of(true, reason.into())
    }

    /// Creates the failure of a plant or law that cannot compute another step: its side of the run fails.
    #[must_use]
    pub fn lost(reason: impl Into<String>) -> Self {
        Self::of(false, reason.into())
    }

    fn of(is_divergence: bool, reason: String) -> Self {
        Self(Box::new(Cause {
            is_divergence,
            reason,
        }))
    }

    /// Returns `true` if the equations diverged; `false` if the program that runs them failed.
    #[must_use]
    pub fn is_divergence(&self) -> bool {
        self.0.is_divergence
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_has_the_size_of_a_pointer() {
        assert_eq!(size_of::<Result<(), Failure>>(), size_of::<usize>());
        let message = Failure::lost("the library is gone").to_string();
        assert_eq!(message, "the library is gone");
    }
}

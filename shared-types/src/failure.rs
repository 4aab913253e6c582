//! Failure of a plant or a law while it runs.
//!
//! Returned by plants and laws whose equations are elsewhere, in C or in a file, through the rows of
//! `plant_process::plant::Model` and `controller_process::controller::Law`. One that is written in Rust as
//! `Plant` or `Controller` never fails: its ranges of validity say where it ends.

/// Failure that ends a run, with its reason. It is as large as a pointer, so that passing none costs nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.reason)]
pub struct Failure(Box<Cause>);

#[derive(Clone, Debug, PartialEq, Eq)]
struct Cause {
    is_divergence: bool,
    reason: String,
}

impl Failure {
    /// Failure of a plant that left the range where its equations mean something: its run ends as diverged.
    #[must_use]
    pub fn diverged(reason: impl Into<String>) -> Self {
        Self::of(true, reason.into())
    }

    /// Failure of a plant or law that is lost and can do no further step: its side of the run fails.
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

    /// Tells whether the equations ended, rather than the program that has them.
    #[must_use]
    pub fn is_divergence(&self) -> bool {
        self.0.is_divergence
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_failure_is_as_large_as_a_pointer() {
        assert_eq!(size_of::<Result<(), Failure>>(), size_of::<usize>());
        let told = Failure::lost("the library is gone").to_string();
        assert_eq!(told, "the library is gone");
    }
}

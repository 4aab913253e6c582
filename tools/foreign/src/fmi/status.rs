//! Status codes of an FMU's functions, with the same numbers in FMI 2 and 3.

use std::ffi::c_int;
use std::fmt;

/// Status returned by a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Status {
    Ok,
    Warning,
    /// The step was not executed, or only partially.
    Discard,
    /// The instance cannot continue.
    Error,
    /// No instance of the library can continue, and no function may be called.
    Fatal,
    /// FMI 2: the step is still in progress.
    Pending,
    /// Number that the standard does not define.
    Unknown(c_int),
}

impl Status {
    pub(super) const fn of(number: c_int) -> Self {
        match number {
            0 => Self::Ok,
            1 => Self::Warning,
            2 => Self::Discard,
            3 => Self::Error,
            4 => Self::Fatal,
            5 => Self::Pending,
            other => Self::Unknown(other),
        }
    }

    /// Returns `true` if the function succeeded.
    pub(super) const fn is_done(self) -> bool {
        matches!(self, Self::Ok | Self::Warning)
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ok => f.write_str("OK"),
            Self::Warning => f.write_str("Warning"),
            Self::Discard => f.write_str("Discard"),
            Self::Error => f.write_str("Error"),
            Self::Fatal => f.write_str("Fatal"),
            Self::Pending => f.write_str("Pending"),
            Self::Unknown(number) => write!(f, "status {number}"),
        }
    }
}

//! The limit of a command, used by every law with a limited command.

/// Limit of an unlimited command.
pub(super) const UNLIMITED: f64 = f64::INFINITY;

/// Clamps a value to `[-limit, limit]`; NaN remains NaN, for the plant's guard.
pub(super) fn limited(value: f64, limit: f64) -> f64 {
    if value > limit {
        limit
    } else if value < -limit {
        -limit
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_clamps_both_signs_and_nothing_else() {
        assert_eq!(
            [-3.0, -1.0, 1.5, 2.5].map(|v| limited(v, 2.0)),
            [-2.0, -1.0, 1.5, 2.0]
        );
        assert_eq!(limited(-1e300, f64::INFINITY), -1e300);
        assert!(limited(f64::NAN, 2.0).is_nan());
    }
}

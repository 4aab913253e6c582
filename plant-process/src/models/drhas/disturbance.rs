//! Disturbance forces on the pistons: the model uncertainty of eq. 74.
//!
//! Called by the right-hand side and by the truth of the hydraulic system. Unknown to controllers.

use std::f64::consts::TAU;

use super::tables::ActuatorParameters;

/// Disturbance force on a piston, opposing the extension of the rod.
///
/// `d = d_c` before `t_0`, then `d = d_c + d_a sin(2 pi f t)` (eq. 74, where `d_c`, `d_a`, `f` and
/// `t_0` are 100 N, 400 N, 1 Hz and 2 s for the first actuator, and `d = 400 N` for the second).
/// The sine counts from time 0: with `f t_0` not a multiple of 1/2, `d` jumps at `t_0`.
#[inline]
#[must_use]
pub fn disturbance_n(p: &ActuatorParameters, time_s: f64) -> f64 {
    let (d_c, d_a, f) = (
        p.disturbance_constant_n,
        p.disturbance_amplitude_n,
        p.disturbance_frequency_hz,
    );
    if d_a == 0.0 || time_s < p.disturbance_start_s {
        return d_c;
    }
    // Whole turns are irrelevant, and without them the angle keeps its digits in a long run.
    let turns = f * time_s;
    let whole = turns as u64 as f64; // time is never negative
    d_c + d_a * libm::sin(TAU * (turns - whole))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_piston_is_shaken_from_two_seconds_on() {
        let d_1 = crate::models::drhas::Parameters::default().actuator1;
        for (time_s, expected_n) in [
            (0.0, 100.0),
            (1.25, 100.0),
            (2.0, 100.0),
            (2.25, 500.0),
            (2.5, 100.0),
            (2.75, -300.0),
            (19.0 + 1.0 / 12.0, 300.0),
        ] {
            let d_n = disturbance_n(&d_1, time_s);
            assert!((d_n - expected_n).abs() < 1e-10, "{time_s} s: {d_n} N");
        }
    }

    #[test]
    fn the_second_piston_feels_a_constant_force() {
        let d_2 = crate::models::drhas::Parameters::default().actuator2;
        for time_s in [0.0, 2.0, 2.25, 17.3] {
            assert_eq!(disturbance_n(&d_2, time_s), 400.0);
        }
    }

    #[test]
    fn frequency_and_start_can_be_set() {
        let p = ActuatorParameters {
            disturbance_constant_n: -50.0,
            disturbance_amplitude_n: 10.0,
            disturbance_frequency_hz: 0.25,
            disturbance_start_s: 1.0,
            ..ActuatorParameters::default()
        };
        assert_eq!(disturbance_n(&p, 0.999), -50.0);
        assert_eq!(disturbance_n(&p, 1.0), -40.0);
        assert_eq!(disturbance_n(&p, 3.0), -60.0);
    }
}

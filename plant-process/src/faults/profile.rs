//! Profiles: the course of a fault's size over time.
//!
//! Called by the layer at each step for each active fault. A profile is a factor g, a pure function of the time since
//! the fault began.

use hil_config::plan::Profile;

/// Returns g at `since_s` >= 0 after the fault began.
#[must_use]
pub fn gain(profile: &Profile, since_s: f64) -> f64 {
    match profile {
        Profile::Step => 1.0,
        Profile::Ramp { duration_s } => {
            if since_s < *duration_s {
                since_s / duration_s
            } else {
                1.0
            }
        }
        // beta = 1 - exp(-mu t), eq. 6
        Profile::Exponential { speed_per_s } => -libm::expm1(-speed_per_s * since_s),
        Profile::Pulse { duration_s } => {
            if since_s < *duration_s {
                1.0
            } else {
                0.0
            }
        }
        Profile::Intermittent { period_s, duty } => intermittent(since_s / period_s, *duty),
        Profile::Sine {
            frequency_hz,
            phase_rad,
        } => libm::sin(std::f64::consts::TAU * frequency_hz * since_s + phase_rad),
        Profile::Table { time_s, values } => between(time_s, values, since_s),
    }
}

/// Returns 1 in the first part of each period, 0 in the rest.
///
/// A time on an edge belongs to the part that begins there. The quotient of time and period has a rounding error, so a
/// time very close to an edge counts as on the edge; otherwise a part could be a step short.
fn intermittent(periods: f64, duty: f64) -> f64 {
    let rounding = 2.0 * f64::EPSILON * periods;
    let part = periods - libm::floor(periods + rounding);
    if part + rounding < duty { 1.0 } else { 0.0 }
}

/// Interpolates linearly between points, constant before the first and after the last.
fn between(time_s: &[f64], values: &[f64], at_s: f64) -> f64 {
    let next = time_s.partition_point(|&time| time <= at_s);
    match (next.checked_sub(1), values.get(next)) {
        (None, first) => first.copied().unwrap_or(0.0),
        (Some(last), None) => values[last],
        (Some(last), Some(value)) => {
            let part = (at_s - time_s[last]) / (time_s[next] - time_s[last]);
            values[last] + (value - values[last]) * part
        }
    }
}

/// Formats a profile in canonical form, its numbers as exact bits.
#[must_use]
pub fn canonical(profile: &Profile) -> String {
    let bits = |values: &[f64]| {
        let bits = values
            .iter()
            .map(|value| format!("{:016x}", value.to_bits()));
        bits.collect::<Vec<_>>().join(",")
    };
    match profile {
        Profile::Step => "step".into(),
        Profile::Ramp { duration_s } => format!("ramp={}", bits(&[*duration_s])),
        Profile::Exponential { speed_per_s } => format!("exponential={}", bits(&[*speed_per_s])),
        Profile::Pulse { duration_s } => format!("pulse={}", bits(&[*duration_s])),
        Profile::Intermittent { period_s, duty } => {
            format!("intermittent={}", bits(&[*period_s, *duty]))
        }
        Profile::Sine {
            frequency_hz,
            phase_rad,
        } => format!("sine={}", bits(&[*frequency_hz, *phase_rad])),
        Profile::Table { time_s, values } => format!("table={};{}", bits(time_s), bits(values)),
    }
}

#[cfg(test)]
mod tests {
    use shared_types::time::{Rate, Step};

    use super::*;

    #[test]
    fn each_profile_matches_its_closed_form() {
        let table = Profile::Table {
            time_s: vec![1.0, 2.0, 4.0],
            values: vec![0.5, 1.0, -1.0],
        };
        let intermittent = Profile::Intermittent {
            period_s: 2.0,
            duty: 0.25,
        };
        let sine = Profile::Sine {
            frequency_hz: 0.25,
            phase_rad: 0.0,
        };
        #[rustfmt::skip] // a table
        let cases: [(&Profile, &[(f64, f64)]); 7] = [
            (&Profile::Step, &[(0.0, 1.0), (9.0, 1.0)]),
            (&Profile::Ramp { duration_s: 4.0 }, &[(0.0, 0.0), (1.0, 0.25), (4.0, 1.0), (9.0, 1.0)]),
            // 1 - exp(-1) and 1 - exp(-2), to 16 digits by an independent calculator.
            (&Profile::Exponential { speed_per_s: 2.0 }, &[(0.0, 0.0), (0.5, 0.632_120_558_828_557_7), (1.0, 0.864_664_716_763_387_3)]),
            (&Profile::Pulse { duration_s: 2.0 }, &[(0.0, 1.0), (1.99, 1.0), (2.0, 0.0)]),
            (&intermittent, &[(0.0, 1.0), (0.49, 1.0), (0.5, 0.0), (1.99, 0.0), (2.0, 1.0), (4.4, 1.0)]),
            (&sine, &[(0.0, 0.0), (1.0, 1.0), (3.0, -1.0)]),
            (&table, &[(0.0, 0.5), (1.0, 0.5), (1.5, 0.75), (2.0, 1.0), (3.0, 0.0), (4.0, -1.0), (9.0, -1.0)]),
        ];
        for (profile, points) in cases {
            for &(at_s, expected) in points {
                let actual = gain(profile, at_s);
                assert!(
                    (actual - expected).abs() < 1e-15,
                    "{profile:?} at {at_s}: {actual}"
                );
            }
        }
    }

    #[test]
    fn every_part_of_an_intermittent_profile_has_as_many_steps_as_the_others() {
        let rate = Rate::new(10_000.0).expect("legal");
        for (period_s, duty, on, period) in [(0.1, 0.5, 500, 1000), (0.03, 0.1, 30, 300)] {
            let profile = Profile::Intermittent { period_s, duty };
            for step in 0..1_000_000 {
                let expected = f64::from(u8::from(step % period < on));
                let actual = gain(&profile, rate.seconds(Step(step)));
                assert_eq!(actual, expected, "step {step}, {profile:?}");
            }
        }
    }

    #[test]
    fn the_canonical_form_of_the_papers_profile_is_that_of_its_digests() {
        let profile = Profile::Exponential { speed_per_s: 10.0 };
        assert_eq!(canonical(&profile), "exponential=4024000000000000");
    }
}

//! Kinds that act on signals and parameters.

use super::*;

#[test]
fn numbers_follow_their_equations() {
    // Kind, parameters; for each step the profile, the healthy value and the result.
    type Case<'a> = (&'a str, Parameters<'a>, &'a [(f64, f64, f64)]);
    #[rustfmt::skip] // a table
    let cases: &[Case<'_>] = &[
        ("bias", &[("bias", 0.5)], &[(0.0, 1.0, 1.0), (0.5, 2.0, 2.25), (1.0, -3.0, -2.5)]),
        ("scale", &[("factor", 3.0)], &[(0.0, 1.0, 1.0), (0.5, 2.0, 4.0), (1.0, -3.0, -9.0)]),
        // 4 per second are 0.5 per step.
        ("drift", &[("rate_per_s", 4.0)], &[(1.0, 1.0, 1.0), (1.0, 1.0, 1.5), (1.0, 1.0, 2.0), (0.5, 1.0, 1.75)]),
        ("spike", &[("amplitude", 2.0)], &[(0.5, 1.0, 2.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)]),
        // 0.45 s are 3.6 steps, so 4; 0.13 s are 1.04 steps, so 2.
        (
            "spike",
            &[("amplitude", 2.0), ("period_s", 0.45), ("width_s", 0.13)],
            &[
                (1.0, 1.0, 3.0),
                (1.0, 1.0, 3.0),
                (1.0, 1.0, 1.0),
                (1.0, 1.0, 1.0),
                (1.0, 1.0, 3.0),
                (0.0, 1.0, 1.0),
                (1.0, 1.0, 1.0),
            ],
        ),
        ("stuck", &[], &[(0.0, 1.0, 1.0), (0.1, 2.0, 2.0), (-1.0, 3.0, 2.0), (0.0, 4.0, 4.0), (1.0, 5.0, 5.0), (1.0, 6.0, 5.0)]),
        ("stuck-at", &[("value", 10.0)], &[(0.0, 2.0, 2.0), (0.5, 2.0, 6.0), (1.0, 3.0, 10.0)]),
        // With rounding, 0.3 - 1e7 + 1e7 is not 0.3.
        ("stuck-at", &[("value", 0.3)], &[(1.0, 1e7, 0.3), (1.0, -1e9, 0.3)]),
        (
            "delay",
            &[("steps", 2.0)],
            &[
                (1.0, 1.0, 1.0),
                (1.0, 2.0, 1.0),
                (1.0, 3.0, 1.0),
                (1.0, 4.0, 2.0),
                (0.0, 5.0, 5.0),
                (0.1, 6.0, 4.0),
            ],
        ),
        ("delay", &[("steps", 0.0)], &[(1.0, 1.0, 1.0), (1.0, 2.0, 2.0)]),
        (
            "quantisation",
            &[("step", 0.5)],
            &[
                (1.0, 0.2, 0.0),
                (1.0, 0.25, 0.5),
                (0.1, 0.74, 0.5),
                (1.0, -0.25, -0.5),
                (1.0, -0.76, -1.0),
                (0.0, 0.2, 0.2),
            ],
        ),
        ("saturation", &[("min", -1.0), ("max", 2.0)], &[(1.0, -3.0, -1.0), (0.1, 3.0, 2.0), (1.0, 0.5, 0.5), (0.0, 3.0, 3.0)]),
        ("saturation", &[("min", f64::NEG_INFINITY), ("max", 2.0)], &[(1.0, -1e12, -1e12), (1.0, 3.0, 2.0)]),
        ("dropout", &[], &[(0.0, 1.0, 1.0), (1.0, 2.0, 2.0)]),
        // The fault takes effect at step 100: samples with the phase 1 of 4 are those of 101 and 105.
        (
            "sample-hold",
            &[("every_steps", 4.0), ("phase_steps", 1.0)],
            &[
                (1.0, 1.0, 1.0),
                (1.0, 2.0, 2.0),
                (1.0, 3.0, 2.0),
                (0.0, 4.0, 4.0),
                (0.5, 5.0, 2.0),
                (1.0, 6.0, 6.0),
                (1.0, 7.0, 6.0),
            ],
        ),
        (
            "sample-hold",
            &[("every_steps", 3.0), ("phase_steps", 0.0)],
            &[
                (1.0, 1.0, 1.0),
                (1.0, 2.0, 1.0),
                (1.0, 3.0, 3.0),
                (1.0, 4.0, 3.0),
            ],
        ),
        // 4 per second are 0.5 per step.
        (
            "rate-limit",
            &[("rate_limit_per_s", 4.0)],
            &[
                (1.0, 1.0, 1.0),
                (1.0, 3.0, 1.5),
                (0.5, 3.0, 2.5),
                (1.0, 2.25, 2.25),
                (1.0, -1.0, 1.75),
            ],
        ),
        (
            "dead-band",
            &[("dead_band", 0.5)],
            &[
                (1.0, 0.25, 0.0),
                (1.0, -0.5, 0.0),
                (1.0, 2.0, 1.5),
                (1.0, -2.0, -1.5),
                (0.5, 2.0, 1.75),
                (0.0, 0.25, 0.25),
            ],
        ),
        (
            "backlash",
            &[("backlash", 1.0)],
            &[
                (1.0, 0.0, 0.0),
                (1.0, 0.5, 0.0),
                (1.0, 2.0, 1.5),
                (1.0, 1.25, 1.5),
                (1.0, 0.5, 1.0),
                (0.5, 1.0, 1.0),
                (0.0, 7.0, 7.0),
            ],
        ),
    ];
    for (kind, parameters, steps) in cases {
        let mut fault = start(kind, parameters, &[]);
        for (since, &(gain, x, expected)) in (0..).zip(*steps) {
            let actual = fault.number(&moment(since, gain), valid(x)).value;
            assert_eq!(actual, expected, "{kind} {parameters:?} at step {since}");
        }
    }
}

// mpmath 1.3, mp.dps = 50, for k in (0, 1, 333, 987654):
//   sin(2 * pi * mpf(3.7) * mpf(k / 1000) + mpf(0.4))
const SINES: [(u64, f64); 4] = [
    (0, 0.389_418_342_308_650_5),
    (1, 0.410_723_814_441_910_77),
    (333, 0.958_946_974_952_541_5),
    (987_654, 0.668_529_708_719_180_4),
];

#[test]
fn oscillations_match_an_independent_calculation() {
    let parameters = [
        ("amplitude", 2.5),
        ("frequency_hz", 3.7),
        ("phase_rad", 0.4),
    ];
    let mut additive = start("oscillation-additive", &parameters, &[]);
    let with_offset = [&parameters[..], &[("offset", -1.0)]].concat();
    let mut replacing = start("oscillation-replacing", &with_offset, &[]);
    for (since, sine) in SINES {
        // The angle 2 pi f t is accurate to a few units in the last place.
        let turns = 3.7 * since as f64 / 1000.0;
        let tolerance = 2.5 * f64::EPSILON * (2.0 + 7.0 * turns);
        for gain in [1.0, 0.5, 0.0] {
            let at = moment_at(since, gain, 1000.0);
            let added = additive.number(&at, valid(7.0)).value;
            let expected = 7.0 + 2.5 * gain * sine;
            assert!((added - expected).abs() <= tolerance, "{since}: {added}");
            let replaced = replacing.number(&at, valid(7.0)).value;
            let expected = 7.0 + (-1.0 + 2.5 * sine - 7.0) * gain;
            assert!(
                (replaced - expected).abs() <= tolerance,
                "{since}: {replaced}"
            );
        }
    }
}

#[test]
fn noise_has_the_moments_of_its_distribution() {
    let (s, count) = (0.25, 100_000);
    let mut noise = start("noise", &[("standard_deviation", s)], &[]);
    let (mut sum, mut squares) = (0.0, 0.0);
    for since in 0..count {
        let n = noise.number(&moment(since, 1.0), valid(3.0)).value - 3.0;
        (sum, squares) = (sum + n, squares + n * n);
    }
    let n = count as f64;
    // Five standard deviations of the mean, s / sqrt(n), and of the variance, s^2 sqrt(2 / n).
    assert!((sum / n).abs() < 5.0 * s / n.sqrt(), "{}", sum / n);
    let error = squares / n - s * s;
    assert!(error.abs() < 5.0 * s * s * (2.0 / n).sqrt(), "{error}");
}

#[test]
fn a_profile_scales_noise_and_does_not_shift_its_numbers() {
    let draw = |gains: [f64; 3]| {
        let mut noise = start("noise", &[("standard_deviation", 1.0)], &[]);
        [0, 1, 2].map(|k| noise.number(&moment(k as u64, gains[k]), valid(0.0)).value)
    };
    let [whole, scaled] = [draw([1.0; 3]), draw([0.0, 1.0, -0.5])];
    assert_eq!(scaled, [0.0, whole[1], -0.5 * whole[2]]);
}

#[test]
fn a_dropout_removes_validity_and_a_delay_carries_it_along() {
    let mut dropout = start("dropout", &[], &[]);
    for (since, gain, before, after) in [
        (0, 0.0, true, true),
        (1, 0.1, true, false),
        (2, -1.0, true, false),
        (3, 0.0, false, false),
    ] {
        let reading = Reading {
            value: 1.0,
            valid: before,
        };
        let actual = dropout.number(&moment(since, gain), reading);
        assert_eq!(actual.valid, after, "step {since}");
    }
    let mut delay = start("delay", &[("steps", 1.0)], &[]);
    let actual: Vec<bool> = (0..)
        .zip([true, false, true, true])
        .map(|(since, valid)| {
            let reading = Reading { value: 1.0, valid };
            delay.number(&moment(since, 1.0), reading).valid
        })
        .collect();
    assert_eq!(actual, [true, true, false, true]);
}

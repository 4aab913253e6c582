//! Kinds that act on the computing time of a side.

use super::*;

#[test]
fn a_late_side_is_busy_for_the_requested_time() {
    let busy = |parameters: Parameters<'_>, list: &[f64], gains: &[f64]| {
        let mut late = start("late", parameters, list);
        let actual = directives(late.as_mut(), gains);
        actual.iter().map(|one| one.busy_ns).collect::<Vec<u32>>()
    };
    // 12.5 us times 0.5, 1, 0, -1; then more than a directive can express.
    let fixed = busy(&[("busy_us", 12.5)], &[], &[0.5, 1.0, 0.0, -1.0, 1e9]);
    assert_eq!(fixed, [6_250, 12_500, 0, 0, u32::MAX]);
    let (count, gains) = (20_000, vec![1.0; 20_000]);
    let spread = busy(&[("busy_us", 10.0), ("spread_us", 20.0)], &[], &gains);
    assert!(spread.iter().all(|ns| (10_000..=30_000).contains(ns)));
    let late_half = spread.iter().filter(|ns| **ns >= 20_000).count();
    assert_frequency("in the later half", late_half, count, 0.5);
    let times = busy(&[], &[5.0, 3.0, 700.0, 0.0, 40.0, 1.0], &gains);
    for (ns, probability) in [(5_000, 0.75), (40_000, 0.25)] {
        let happened = times.iter().filter(|actual| **actual == ns).count();
        assert_frequency(&format!("{ns} ns"), happened, count, probability);
    }
    assert!(!times.contains(&700_000), "a weight of 0");
}

#[test]
fn skips_act_on_the_samples_that_the_controller_processes() {
    // Parameters, profile, and the steps since its beginning at which it acts.
    type Case<'a> = (Parameters<'a>, &'a [f64], &'a [usize]);
    #[rustfmt::skip] // a table
    let cases: &[Case<'_>] = &[
        (&[("steps", 3.0)], &[1.0; 20], &[0]),
        (&[("steps", 3.0), ("burst", 3.0)], &[1.0; 20], &[0, 4, 8]),
        (&[("steps", 1.0), ("period_steps", 5.0)], &[0.1; 12], &[0, 5, 10]),
        (&[("steps", 2.0), ("burst", 2.0), ("period_steps", 6.0)], &[1.0; 12], &[0, 3, 6, 9]),
        (&[("steps", 1.0), ("period_steps", 2.0)], &[1.0, 1.0, 0.0, 1.0, 1.0], &[0, 4]),
    ];
    for (parameters, gains, expected) in cases {
        let mut skip = start("skip", parameters, &[]);
        let actual = directives(skip.as_mut(), gains);
        let steps = parameters[0].1 as u32;
        for (since, directive) in actual.iter().enumerate() {
            let late_steps = if expected.contains(&since) { steps } else { 0 };
            assert_eq!(directive.late_steps, late_steps, "{parameters:?}, {since}");
        }
    }
    // Two at one step add up.
    let mut directive = Directive::default();
    for steps in [2.0, 3.0] {
        start("skip", &[("steps", steps)], &[]).timing(&moment(0, 1.0), &mut directive);
    }
    assert_eq!(directive.late_steps, 5);
}

//! Text histogram with ten classes per decade and bars on a logarithmic scale.

use std::fmt::Write as _;

use hil_console::terminal::duration::shown_ns;

use super::times::Times;

/// Lower limits of the classes of a decade, in hundredths: the preferred numbers R10 of ISO 3.
const CLASSES: [u64; 10] = [100, 125, 160, 200, 250, 315, 400, 500, 630, 800];
/// Maximum length of a bar, in characters.
const LONGEST: usize = 44;

/// Returns the lower and upper limits of the class of a time, in ns.
fn class_of(ns: u64) -> (u64, u64) {
    let mut edges = (0..).flat_map(|decade: u32| {
        CLASSES.map(|class| (class * 10_u64.saturating_pow(decade) / 100).max(1))
    });
    let mut from_ns = 0;
    loop {
        let to_ns = edges.next().unwrap_or(u64::MAX);
        if ns < to_ns {
            return (from_ns, to_ns);
        }
        from_ns = to_ns;
    }
}

/// Returns the non-empty classes in order, as limits in ns with a count.
pub fn classes(times_ns: &Times) -> Vec<((u64, u64), u64)> {
    let mut classes: Vec<((u64, u64), u64)> = Vec::new();
    for (_, to_ns, count) in times_ns.buckets() {
        let class = class_of(to_ns - 1);
        match classes.last_mut() {
            Some((last, sum)) if *last == class => *sum += count,
            _ => classes.push((class, count)),
        }
    }
    classes
}

/// Formats the histogram with a line for each class, and `...` in place of empty classes in between.
#[must_use]
pub fn bars(times_ns: &Times) -> String {
    let classes = classes(times_ns);
    let most = classes.iter().map(|(_, count)| *count).max().unwrap_or(1);
    let mut text = String::new();
    let mut last_ns = None;
    for ((from_ns, to_ns), count) in classes {
        if last_ns.is_some_and(|last_ns| last_ns != from_ns) {
            text += "       ...\n";
        }
        last_ns = Some(to_ns);
        let bar = "#".repeat(length(count, most));
        let (from, to) = (shown_ns(from_ns), shown_ns(to_ns));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {from:>8} to {to:>8} {count:>10} {bar}");
    }
    text
}

/// Returns the length of a bar: proportional to the logarithm of the count, at least one.
fn length(count: u64, most: u64) -> usize {
    if most <= 1 {
        return 1;
    }
    let share = libm::log(count as f64) / libm::log(most as f64);
    1 + (share * (LONGEST - 1) as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_those_of_iso_3() {
        for (ns, class) in [
            (0, (0, 1)),
            (1, (1, 2)),
            (999, (800, 1000)),
            (1000, (1000, 1250)),
            (1249, (1000, 1250)),
            (1250, (1250, 1600)),
            (314_999, (250_000, 315_000)),
            (315_000, (315_000, 400_000)),
            (59_999_999_999, (50_000_000_000, 63_000_000_000)),
        ] {
            assert_eq!(class_of(ns), class, "{ns} ns");
        }
    }

    #[test]
    fn every_step_is_in_one_class_and_gaps_are_marked() {
        let mut times_ns = Times::default();
        for (ns, count) in [(1100, 10_000), (1300, 100), (9_000, 1)] {
            (0..count).for_each(|_| times_ns.record(ns));
        }
        // 1 + 43 log(100) / log(10 000), where the ratio is one half
        let expected = format!(
            "   1.00 us to  1.25 us      10000 {}\n   1.25 us to  1.60 us        100 {}\n       \
             ...\n   8.00 us to  10.0 us          1 #\n",
            "#".repeat(44),
            "#".repeat(22)
        );
        assert_eq!(bars(&times_ns), expected);
        assert!(expected.lines().all(|line| line.len() <= 80));
        assert_eq!(bars(&Times::default()), "");
    }
}

//! Signal history: minimum and maximum per time interval, at several resolutions.
//!
//! Fed with every value by the [model](super::model), read column by column by the [view](super::view). A column
//! contains the extremes of all its values, so no spike is hidden. Memory is fixed; old values are overwritten.

/// Number of bins per level.
const BINS: u64 = 4096;
/// Ratio of bin lengths of adjacent levels, as a power of two.
const SHIFT: u32 = 3;
/// Number of levels: the coarsest reaches `BINS` times 8^6 steps back, a day at 10 kHz.
const LEVELS: usize = 7;

/// Minimum and maximum of some values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
}

impl Range {
    /// Creates the range of one value.
    pub(crate) const fn of(value: f64) -> Self {
        Self {
            min: value,
            max: value,
        }
    }

    /// Returns the union of two ranges.
    #[must_use]
    pub(crate) const fn and(self, other: Self) -> Self {
        Self {
            min: if other.min < self.min {
                other.min
            } else {
                self.min
            },
            max: if other.max > self.max {
                other.max
            } else {
                self.max
            },
        }
    }
}

/// Time interval of a level.
#[derive(Clone, Copy)]
struct Bin {
    /// Index of the bin in its level, counted from step 0.
    number: u64,
    range: Range,
}

/// Index that no bin has.
const NONE: u64 = u64::MAX;

/// History of a signal.
pub(crate) struct History {
    /// Bins per level, finest first, stored at their index modulo [`BINS`].
    levels: [Vec<Bin>; LEVELS],
    /// Newest bin of each level, still being filled.
    open: [Option<Bin>; LEVELS],
}

impl Default for History {
    fn default() -> Self {
        let empty = Bin {
            number: NONE,
            range: Range::of(0.0),
        };
        Self {
            levels: std::array::from_fn(|_| vec![empty; BINS as usize]),
            open: [None; LEVELS],
        }
    }
}

impl History {
    /// Adds the value of a step. Steps must increase; NaN leaves a gap.
    pub(crate) fn take(&mut self, step: u64, value: f64) {
        if !value.is_finite() {
            return;
        }
        let mut bin = Bin {
            number: step,
            range: Range::of(value),
        };
        for level in 0..LEVELS {
            let closed = match &mut self.open[level] {
                Some(open) if open.number == bin.number => {
                    open.range = open.range.and(bin.range);
                    return;
                }
                open => open.replace(bin),
            };
            let Some(closed) = closed else { return };
            self.levels[level][(closed.number % BINS) as usize] = closed;
            bin = Bin {
                number: closed.number >> SHIFT,
                range: closed.range,
            };
        }
    }

    /// Returns the extremes in each of `columns` columns of equal width, the last of which ends with step `last`;
    /// `None` for columns without a value. `steps` is the total width.
    pub(crate) fn columns(&self, last: u64, steps: u64, columns: usize) -> Vec<Option<Range>> {
        let mut ranges = vec![None; columns];
        let count = columns as u64;
        if count == 0 || steps == 0 {
            return ranges;
        }
        // Keeps a margin of one bin, as a bin may begin before the first column.
        let level = (0..LEVELS)
            .find(|level| (steps >> (SHIFT * *level as u32)) + 2 < BINS)
            .unwrap_or(LEVELS - 1);
        let mut put = |bin: &Bin, level: usize| {
            let shift = SHIFT * level as u32;
            let (begin, end) = (bin.number << shift, (bin.number + 1) << shift);
            // Steps before the window have negative offsets from its first column.
            let first = (last + 1).saturating_sub(steps);
            if end <= first || begin > last {
                return;
            }
            // Covers the `steps` steps up to `last`, possibly beginning before step 0.
            let place = |step: u64| {
                let from_end = last - step;
                let place = steps.saturating_sub(1).saturating_sub(from_end);
                (u128::from(place) * u128::from(count) / u128::from(steps)) as usize
            };
            let (begin, end) = (begin.max(first), (end - 1).min(last));
            for column in &mut ranges[place(begin)..=place(end)] {
                *column = Some(match *column {
                    Some(range) => bin.range.and(range),
                    None => bin.range,
                });
            }
        };
        for bin in &self.levels[level] {
            if bin.number != NONE {
                put(bin, level);
            }
        }
        // Open bins are in no coarser level yet.
        for (level, open) in self.open.iter().enumerate().take(level + 1) {
            if let Some(open) = open {
                put(open, level);
            }
        }
        ranges
    }

    /// Returns the length of the shortest intervals, as a power of two, that are kept of steps of this age.
    pub(crate) fn kept_shift(age: u64) -> u32 {
        // The newest bin of a level may have replaced the oldest one already.
        let is_kept = |level: &u32| (age >> (SHIFT * level)) + 2 < BINS;
        let level = (0..LEVELS as u32).find(is_kept);
        SHIFT * level.unwrap_or(LEVELS as u32 - 1)
    }

    /// Returns the extremes of `count` intervals of `2^shift` steps each, beginning with index `first`; `None` where no
    /// value was recorded or the value was overwritten. Exact, because intervals are aligned to bins.
    pub(crate) fn stretches(
        &self,
        first: u64,
        count: u64,
        shift: u32,
    ) -> impl Iterator<Item = Option<Range>> + '_ {
        let level = (shift / SHIFT).min(LEVELS as u32 - 1);
        let rest = shift - SHIFT * level;
        let bins = &self.levels[level as usize];
        (first..first.saturating_add(count)).map(move |stretch| {
            let closed = (stretch << rest..(stretch + 1) << rest)
                .map(|number| &bins[(number % BINS) as usize])
                .zip(stretch << rest..)
                .filter(|(bin, number)| bin.number == *number)
                .map(|(bin, _)| bin.range);
            // Open bins are in no coarser level yet.
            let open = (0..=level).zip(&self.open).filter_map(|(level, open)| {
                let open = open.as_ref()?;
                ((open.number << (SHIFT * level)) >> shift == stretch).then_some(open.range)
            });
            closed.chain(open).reduce(Range::and)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_one_step_spike_appears_in_its_column_at_every_zoom_level() {
        for (steps, columns) in [(100, 10), (4000, 160), (40_000, 158), (1_000_000, 40)] {
            let mut history = History::default();
            let spike = 1_000_000 - steps / 3;
            for step in 0..=1_000_000 {
                history.take(step, if step == spike { 9.0 } else { -1.0 });
            }
            let ranges = history.columns(1_000_000, steps, columns);
            let peaks: Vec<usize> = (0..columns)
                .filter(|&column| ranges[column].is_some_and(|range| range.max == 9.0))
                .collect();
            // A third of the window before its end.
            let expected = (steps - 1 - steps / 3) as usize * columns / steps as usize;
            assert!(peaks.contains(&expected), "{steps} {peaks:?} {expected}");
            assert!(peaks.len() <= 2, "{steps}: {peaks:?}");
            let lowest = ranges.iter().map(|range| range.expect("values").min);
            assert!(lowest.into_iter().all(|min| min == -1.0));
        }
    }

    #[test]
    fn a_column_has_exactly_the_extremes_of_its_steps() {
        let value = |step: u64| ((step * 7919) % 1009) as f64;
        let mut history = History::default();
        for step in 0..3000 {
            history.take(step, value(step));
        }
        let ranges = history.columns(2999, 1000, 50);
        for (column, range) in ranges.iter().enumerate() {
            let steps = 2000 + 20 * column as u64..2020 + 20 * column as u64;
            let expected = steps.map(|step| Range::of(value(step)));
            assert_eq!(*range, expected.reduce(Range::and), "column {column}");
        }
    }

    #[test]
    fn an_interval_has_exactly_the_extremes_of_its_steps() {
        let value = |step: u64| ((step * 7919) % 1009) as f64;
        let mut history = History::default();
        for last in 0..40_000 {
            history.take(last, value(last));
            // All kinds of alignment at the end.
            if last % 997 != 0 && last != 39_999 {
                continue;
            }
            for shift in [0, 1, 3, 4, 6, 8] {
                let newest = last >> shift;
                let first = newest.saturating_sub(700);
                let ranges: Vec<_> = history
                    .stretches(first, newest - first + 2, shift)
                    .collect();
                for (stretch, range) in (first..).zip(&ranges) {
                    let steps = stretch << shift..(stretch + 1) << shift;
                    let there = steps.filter(|step| *step <= last);
                    let expected = there.map(|step| Range::of(value(step)));
                    assert_eq!(
                        *range,
                        expected.reduce(Range::and),
                        "{last} {shift} {stretch}"
                    );
                }
            }
        }
    }

    #[test]
    fn lost_steps_and_nan_values_leave_a_gap() {
        let mut history = History::default();
        for step in (0..50).chain(150..200) {
            history.take(step, 1.0);
        }
        history.take(200, f64::NAN);
        let ranges = history.columns(199, 200, 4);
        assert_eq!(
            ranges.iter().map(Option::is_some).collect::<Vec<_>>(),
            [true, false, false, true]
        );
        assert_eq!(history.columns(200, 1, 1), [None]);
    }

    #[test]
    fn a_window_longer_than_the_run_begins_with_empty_columns() {
        let mut history = History::default();
        for step in 0..10 {
            history.take(step, step as f64);
        }
        let ranges = history.columns(9, 40, 4);
        assert_eq!(ranges[..3], [None; 3]);
        assert_eq!(ranges[3], Some(Range { min: 0.0, max: 9.0 }));
    }
}

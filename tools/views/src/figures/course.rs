//! Course of a signal over time, reduced while it is read to what a figure can show.
//!
//! Time is divided into columns. A column keeps its first, least, greatest and last value, each at its time, so that the
//! line through them covers the same places as the line through all values. Memory does not grow with the run: where
//! there are too many columns, pairs of them become one.

/// Number of columns at the end: between this and twice this.
const COLUMNS: usize = 1500;

/// Course of a signal.
#[derive(Clone, Debug, Default)]
pub(super) struct Course {
    columns: Vec<Column>,
    /// Records in a column, a power of two.
    per_column: u64,
    records: u64,
}

/// Some consecutive records.
#[derive(Clone, Copy, Debug)]
struct Column {
    first: [f64; 2],
    least: [f64; 2],
    greatest: [f64; 2],
    last: [f64; 2],
    /// `true` if a value is missing after the last.
    is_cut: bool,
    /// `true` if there is no value at all.
    is_empty: bool,
}

impl Column {
    fn of(point: [f64; 2]) -> Self {
        let is_empty = point[1].is_nan();
        Self {
            first: point,
            least: point,
            greatest: point,
            last: point,
            is_cut: is_empty,
            is_empty,
        }
    }

    fn join(&mut self, next: Self) {
        if next.is_empty {
            self.is_cut = true;
            return;
        }
        if self.is_empty {
            *self = next;
            return;
        }
        if next.least[1] < self.least[1] {
            self.least = next.least;
        }
        if next.greatest[1] > self.greatest[1] {
            self.greatest = next.greatest;
        }
        self.last = next.last;
        self.is_cut = next.is_cut;
    }

    /// Returns the points in the order of their times.
    fn points(&self) -> Vec<[f64; 2]> {
        let mut points = vec![self.first, self.least, self.greatest, self.last];
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points.dedup();
        points
    }
}

impl Course {
    /// Adds a value; times ascend, and NaN leaves a gap.
    pub(super) fn push(&mut self, time_s: f64, value: f64) {
        let column = Column::of([time_s, value]);
        if self.per_column == 0 {
            self.per_column = 1;
        }
        match self.columns.last_mut() {
            Some(last) if !self.records.is_multiple_of(self.per_column) => last.join(column),
            _ => self.columns.push(column),
        }
        self.records += 1;
        let is_full = self.records.is_multiple_of(self.per_column);
        if is_full && self.columns.len() == 2 * COLUMNS {
            let pairs = self.columns.chunks_exact(2);
            let joined = pairs.map(|pair| {
                let mut one = pair[0];
                one.join(pair[1]);
                one
            });
            self.columns = joined.collect();
            self.per_column *= 2;
        }
    }

    /// Returns the parts of the line, which gaps separate.
    pub(super) fn parts(&self) -> Vec<Vec<[f64; 2]>> {
        let (mut parts, mut part) = (Vec::new(), Vec::new());
        for column in &self.columns {
            if !column.is_empty {
                part.extend(column.points());
            }
            if column.is_cut && !part.is_empty() {
                parts.push(std::mem::take(&mut part));
            }
        }
        if !part.is_empty() {
            parts.push(part);
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_run_keeps_every_value() {
        let mut course = Course::default();
        for step in 0..2999_u32 {
            course.push(f64::from(step), f64::from(step % 7));
        }
        let parts = course.parts();
        assert_eq!(parts.len(), 1);
        assert_eq!(parts[0].len(), 2999);
        assert_eq!(parts[0][2000], [2000.0, f64::from(2000_u32 % 7)]);
    }

    #[test]
    fn a_long_run_keeps_every_extreme_in_few_points() {
        let mut course = Course::default();
        for step in 0..1_000_000_u32 {
            let value = if step == 123_457 {
                9.0
            } else {
                f64::from(step % 2)
            };
            course.push(f64::from(step), value);
        }
        let parts = course.parts();
        assert!(parts[0].len() <= 8 * COLUMNS, "{}", parts[0].len());
        assert!(parts[0].contains(&[123_457.0, 9.0]));
        assert!(parts[0].is_sorted_by(|a, b| a[0] < b[0]));
        assert_eq!(parts[0].first(), Some(&[0.0, 0.0]));
        assert_eq!(parts[0].last(), Some(&[999_999.0, 1.0]));
    }

    #[test]
    fn a_missing_value_parts_the_line() {
        let mut course = Course::default();
        for (time_s, value) in [(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0), (3.0, 4.0)] {
            course.push(time_s, value);
        }
        assert_eq!(
            course.parts(),
            [vec![[0.0, 1.0]], vec![[2.0, 3.0], [3.0, 4.0]]]
        );
    }
}

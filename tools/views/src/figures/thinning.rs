//! Reduction of a spectrum to what a logarithmic axis of frequency can show. Keeps every greatest line.

/// Number of columns over the whole axis.
const COLUMNS: f64 = 1500.0;

/// Returns the function that maps a frequency to its column, of `count` over a logarithmic axis; the highest begins one more.
pub(super) fn columns([low, high]: [f64; 2], count: f64) -> impl Fn(f64) -> i64 {
    let octaves = libm::log2(high / low);
    move |frequency| match octaves > 0.0 {
        true => libm::floor(count * libm::log2(frequency / low) / octaves) as i64,
        false => 0,
    }
}

/// Returns the least and the greatest line of each column of a logarithmic axis; frequencies ascend from above 0.
pub(super) fn over_logarithm(lines: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (Some([low, _]), Some([high, _])) = (lines.first(), lines.last()) else {
        return Vec::new();
    };
    let column = columns([*low, *high], COLUMNS);
    let mut result = Vec::new();
    let mut start = 0;
    while start < lines.len() {
        let own = column(lines[start][0]);
        let beyond = lines[start..].iter().position(|[f, _]| column(*f) != own);
        let end = beyond.map_or(lines.len(), |length| start + length);
        let of_column = &lines[start..end];
        let by_height = |a: &&[f64; 2], b: &&[f64; 2]| a[1].total_cmp(&b[1]);
        let least = of_column.iter().min_by(by_height);
        let greatest = of_column.iter().max_by(by_height);
        let mut ends: Vec<[f64; 2]> = least.into_iter().chain(greatest).copied().collect();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        ends.dedup();
        result.extend(ends);
        start = end;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_spectrum_keeps_its_peak_and_its_low_frequencies() {
        let line = |k: u32| {
            let height = if k == 70_001 { 8.0 } else { f64::from(k % 3) };
            [f64::from(k), height]
        };
        let lines: Vec<_> = (1..=100_000).map(line).collect();
        let thin = over_logarithm(&lines);
        assert!(thin.len() <= 3004, "{}", thin.len());
        assert!(thin.contains(&[70_001.0, 8.0]));
        assert_eq!(thin[..4], lines[..4]);
        assert!(thin.is_sorted_by(|a, b| a[0] < b[0]));
    }
}

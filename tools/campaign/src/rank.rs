//! Ranks, and the rank correlation between a parameter and a result.
//!
//! The report calls [`spearman`] for every pair of a varied parameter and a result. A rank correlation
//! sees any monotonic relation, and no other.

/// Ranks of values, counted from 1; equal values share the mean of their ranks.
///
/// `r = (first + last) / 2` over the places of equal values in ascending order (M. G. Kendall, Rank
/// Correlation Methods, 4th ed. 1970, chapter 3; valid for any values). Both zeros are equal; NaN
/// of either sign is equal to itself and greater than infinity.
#[must_use]
pub fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<(f64, usize)> = values.iter().map(|&value| key(value)).zip(0..).collect();
    order.sort_unstable_by(|(one, i), (other, j)| one.total_cmp(other).then(i.cmp(j)));
    let mut ranks = vec![0.0; values.len()];
    let mut before = 0;
    for equal in order.chunk_by(|(one, _), (other, _)| one.total_cmp(other).is_eq()) {
        let rank = before as f64 + 0.5 * (equal.len() + 1) as f64;
        for &(_, place) in equal {
            ranks[place] = rank;
        }
        before += equal.len();
    }
    ranks
}

/// Spearman's rank correlation of two series, from -1 to 1.
///
/// `rho = sum(x y) / sqrt(sum(x^2) sum(y^2))` over the ranks less their mean `(n + 1) / 2` (Kendall, 1970,
/// chapter 3, with ties; valid from 3 pairs on). `None` for fewer pairs, for series of different
/// lengths, and if all values of a series are equal.
#[must_use]
pub fn spearman(x: &[f64], y: &[f64]) -> Option<f64> {
    of_ranks(&ranks(x), &ranks(y))
}

/// [`spearman`]'s correlation of two series by their [`ranks`], for series that are in several pairs.
#[must_use]
pub fn of_ranks(x: &[f64], y: &[f64]) -> Option<f64> {
    if x.len() != y.len() || x.len() < 3 {
        return None;
    }
    let mean = 0.5 * (x.len() + 1) as f64;
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (x, y) = (x - mean, y - mean);
        xx += x * x;
        yy += y * y;
        xy += x * y;
    }
    let size = xx.sqrt() * yy.sqrt();
    if size == 0.0 {
        return None;
    }
    match xy / size {
        rho if rho > 1.0 => Some(1.0),
        rho if rho < -1.0 => Some(-1.0),
        rho => Some(rho),
    }
}

/// The value in the total order: one zero, and one NaN, since its sign differs between machines.
fn key(value: f64) -> f64 {
    if value == 0.0 {
        0.0
    } else if value.is_nan() {
        f64::NAN
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: [f64; 10] = [1.0, 2.0, 2.0, 3.0, 5.0, 5.0, 5.0, 8.0, -1.0, 0.0];
    const Y: [f64; 10] = [2.0, 1.0, 4.0, 4.0, 3.0, 9.0, 9.0, 7.0, 0.5, 0.5];

    #[test]
    fn equal_values_share_their_ranks() {
        // scipy.stats.rankdata(X)
        assert_eq!(
            ranks(&X),
            [3.0, 4.5, 4.5, 6.0, 8.0, 8.0, 8.0, 10.0, 1.0, 2.0]
        );
        assert!(ranks(&[]).is_empty());
    }

    #[test]
    fn every_value_has_a_rank() {
        let values = [
            f64::NAN,
            0.0,
            f64::INFINITY,
            -0.0,
            -f64::INFINITY,
            -f64::NAN,
        ];
        assert_eq!(ranks(&values), [5.5, 2.5, 4.0, 2.5, 1.0, 5.5]);
    }

    #[test]
    fn correlation_with_ties_is_that_of_scipy() {
        // scipy.stats.spearmanr(X, Y), and with -Y^2
        let found = spearman(&X, &Y).expect("a correlation");
        assert!((found - 0.8416311415311708).abs() < 1e-15, "{found}");
        let found = spearman(&X, &Y.map(|y| -y * y)).expect("a correlation");
        assert!((found + 0.8416311415311708).abs() < 1e-15, "{found}");
    }

    #[test]
    fn any_rising_relation_is_complete() {
        let x: Vec<f64> = (0..1000).map(f64::from).collect();
        let rising: Vec<f64> = x.iter().map(|x| x * x * x).collect();
        let falling: Vec<f64> = x.iter().map(|x| 1.0 / (1.0 + x)).collect();
        assert_eq!(spearman(&x, &rising), Some(1.0));
        assert_eq!(spearman(&x, &falling), Some(-1.0));
    }

    #[test]
    fn too_little_to_compare_has_no_correlation() {
        assert_eq!(spearman(&[1.0, 2.0], &[1.0, 2.0]), None);
        assert_eq!(spearman(&[1.0, 2.0, 3.0], &[1.0, 2.0]), None);
        assert_eq!(spearman(&[1.0, 2.0, 3.0], &[4.0; 3]), None);
        assert_eq!(spearman(&[f64::NAN; 3], &[1.0, 2.0, 3.0]), None);
    }
}

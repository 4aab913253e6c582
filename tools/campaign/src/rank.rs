//! Ranks, and the rank correlation between a parameter and a result.
//!
//! The report calls [`spearman`] for every pair of a varied parameter and a result. Rank correlation detects
//! monotonic relations only.

/// Values in ascending order. Both zeros are equal; NaN of either sign equals itself and is greater than infinity.
#[derive(Debug)]
pub(crate) struct Order(Vec<u128>);

impl Order {
    /// Sorts values.
    pub(crate) fn of(values: &[f64]) -> Self {
        let places = values.iter().map(|value| u128::from(key(*value))).zip(0..);
        let mut order: Vec<u128> = places.map(|(key, place)| key << PLACE | place).collect();
        order.sort_unstable();
        Self(order)
    }

    /// Returns the indices of the values in this order; equal values keep their original order.
    pub(crate) fn places(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|one| place(*one))
    }

    /// Ranks of the values, counted from 1; equal values share the mean of their ranks.
    ///
    /// `r = (first + last) / 2` over the positions of equal values in ascending order (M. G. Kendall, Rank
    /// Correlation Methods, 4th ed. 1970, chapter 3; valid for any values).
    pub(crate) fn ranks(&self) -> Vec<f64> {
        let mut ranks = vec![0.0; self.0.len()];
        let mut before = 0;
        for equal in self.0.chunk_by(|one, other| one >> PLACE == other >> PLACE) {
            let rank = before as f64 + 0.5 * (equal.len() + 1) as f64;
            for one in equal {
                ranks[place(*one)] = rank;
            }
            before += equal.len();
        }
        ranks
    }
}

/// Low bits of a sorted entry that hold the value's index; the high bits hold its key.
const PLACE: u32 = u64::BITS;

const fn place(one: u128) -> usize {
    one as usize
}

/// Ranks of values, as [`Order::ranks`] computes them.
pub(crate) fn ranks(values: &[f64]) -> Vec<f64> {
    Order::of(values).ranks()
}

/// Spearman's rank correlation of two series, from -1 to 1.
///
/// `rho = sum(x y) / sqrt(sum(x^2) sum(y^2))` over the ranks minus their mean `(n + 1) / 2` (Kendall, 1970, chapter
/// 3, with ties; valid from 3 pairs on). `None` for fewer pairs, for series of different lengths, and if all values
/// of a series are equal.
#[must_use]
pub fn spearman(x: &[f64], y: &[f64]) -> Option<f64> {
    of_ranks(&ranks(x), &ranks(y))
}

/// [`spearman`]'s correlation of two series given as [`ranks`], for series that occur in several pairs.
pub(crate) fn of_ranks(x: &[f64], y: &[f64]) -> Option<f64> {
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

/// Spread of values, relative to the largest magnitude among them, up to which their differences count as rounding.
///
/// A simulation of many steps reproduces a result to some ten digits; a difference in the seventh digit is
/// meaningless and not shown.
const ROUNDING: f64 = 1e-6;

/// Returns `true` if finite values differ by no more than rounding: by at most a millionth of the largest magnitude.
pub(crate) fn is_rounding(values: &[f64]) -> bool {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.iter().copied().filter(|value| value.is_finite()) {
        least = if value < least { value } else { least };
        most = if value > most { value } else { most };
    }
    let size = if -least > most { -least } else { most };
    // The spread of an empty slice is minus infinity.
    let spread = most - least;
    spread > 0.0 && spread <= ROUNDING * size.abs()
}

/// Maps a value to an integer with the same order: both zeros map to one integer, and so do all NaN, whose sign
/// differs between machines.
fn key(value: f64) -> u64 {
    let bits = if value == 0.0 {
        0
    } else if value.is_nan() {
        f64::NAN.to_bits() & !SIGN
    } else {
        value.to_bits()
    };
    // For negative values the order of the bits is reversed.
    if bits & SIGN == 0 { bits | SIGN } else { !bits }
}

const SIGN: u64 = 1 << 63;

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
        let order = Order::of(&values);
        assert_eq!(order.ranks(), [5.5, 2.5, 4.0, 2.5, 1.0, 5.5]);
        assert!(order.places().eq([4, 1, 3, 2, 0, 5]));
    }

    #[test]
    fn correlation_with_ties_agrees_with_scipy() {
        // scipy.stats.spearmanr(X, Y), and with -Y^2
        let correlation = spearman(&X, &Y).expect("a correlation");
        assert!(
            (correlation - 0.8416311415311708).abs() < 1e-15,
            "{correlation}"
        );
        let correlation = spearman(&X, &Y.map(|y| -y * y)).expect("a correlation");
        assert!(
            (correlation + 0.8416311415311708).abs() < 1e-15,
            "{correlation}"
        );
    }

    #[test]
    fn any_strictly_rising_relation_has_correlation_one() {
        let x: Vec<f64> = (0..1000).map(f64::from).collect();
        let rising: Vec<f64> = x.iter().map(|x| x * x * x).collect();
        let falling: Vec<f64> = x.iter().map(|x| 1.0 / (1.0 + x)).collect();
        assert_eq!(spearman(&x, &rising), Some(1.0));
        assert_eq!(spearman(&x, &falling), Some(-1.0));
    }

    #[test]
    fn values_that_differ_in_their_seventh_digit_differ_by_rounding() {
        const INF: f64 = f64::INFINITY;
        for values in [
            &[0.1, 0.1 + 1e-9, 0.1 - 1e-9][..],
            &[-5e-9, -5e-9 * (1.0 + 9e-7)],
            &[-INF, 1.0, 1.0 + 1e-9, INF, f64::NAN],
        ] {
            assert!(is_rounding(values), "{values:?}");
        }
        for values in [
            &[1e-300, 2e-300][..],
            &[0.0, 1e-12],
            &[-1e-12, 1e-12],
            &[-1.0, -1.0 - 2e-6],
            &[1.0, 1.0 + 2e-6, INF],
            &[],
            &[2.0],
            &[0.0, -0.0],
            &[3.0, 3.0, 3.0],
            &[-INF, INF],
        ] {
            assert!(!is_rounding(values), "{values:?}");
        }
    }

    #[test]
    fn too_few_pairs_have_no_correlation() {
        assert_eq!(spearman(&[1.0, 2.0], &[1.0, 2.0]), None);
        assert_eq!(spearman(&[1.0, 2.0, 3.0], &[1.0, 2.0]), None);
        assert_eq!(spearman(&[1.0, 2.0, 3.0], &[4.0; 3]), None);
        assert_eq!(spearman(&[f64::NAN; 3], &[1.0, 2.0, 3.0]), None);
    }
}

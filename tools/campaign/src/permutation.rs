//! Pseudo-random permutations of any number of items, computed without storing them.
//!
//! The sampler calls [`permuted`] to pair the strata of one parameter with those of another. Each index is computed
//! independently, in any order and on any machine. The permutation is not cryptographically secure.

/// Number of rounds; four suffice for random round functions (Luby and Rackoff), halves of a few bits need more.
const ROUNDS: usize = 8;
/// Golden ratio as a fraction of 2^64, the increment of splitmix64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the position of `index` in the permutation of `count` items that is selected by `key`.
///
/// A Feistel network over the smallest power of 4 that is at least `count`, `(left, right) -> (right, left xor
/// f_round(right))`, is iterated until the position lies below `count` (J. Black and P. Rogaway, Ciphers with
/// Arbitrary Finite Domains, CT-RSA 2002, methods 2 and 3; a bijection for `index < count`). It needs fewer than four
/// iterations on average. An index of `count` or more is returned unchanged.
pub(crate) fn permuted(index: u64, count: u64, key: u64) -> u64 {
    if count < 2 || index >= count {
        return index;
    }
    let bits = u64::BITS - (count - 1).leading_zeros();
    let half = bits.div_ceil(2);
    let mut keys = [0; ROUNDS];
    let mut state = key;
    for round in &mut keys {
        state = state.wrapping_add(GOLDEN);
        *round = mixed(state);
    }
    // The network is a bijection, so the walk returns to the index at the latest.
    let mut place = crossed(index, half, &keys);
    while place >= count {
        place = crossed(place, half, &keys);
    }
    place
}

/// Applies the Feistel network over `2 half` bits.
fn crossed(place: u64, half: u32, keys: &[u64; ROUNDS]) -> u64 {
    let mask = (1 << half) - 1;
    let (mut left, mut right) = (place >> half, place & mask);
    for key in keys {
        // The highest bits of the mixed number have the best quality.
        let mask = mixed(right ^ key) >> (u64::BITS - half);
        (left, right) = (right, left ^ mask);
    }
    left << half | right
}

/// Mixes the bits of a number: a bijection of 64 bits in which each input bit flips half of the output bits.
///
/// Finaliser of splitmix64 (G. L. Steele, D. Lea and C. H. Flood, Fast Splittable Pseudorandom Number Generators,
/// OOPSLA 2014, with the constants of D. Stafford's variant 13; valid for any number).
fn mixed(number: u64) -> u64 {
    let z = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(count: u64, key: u64) -> Vec<u64> {
        (0..count).map(|i| permuted(i, count, key)).collect()
    }

    #[test]
    fn every_position_is_used_exactly_once() {
        for count in 1..=300 {
            for key in [0, 1, 42, u64::MAX, 0xdead_beef_0bad_cafe] {
                let mut places = order(count, key);
                places.sort_unstable();
                assert!(places.into_iter().eq(0..count), "{count} with key {key}");
            }
        }
    }

    #[test]
    fn positions_are_distinct_for_large_counts() {
        for count in [u64::from(u32::MAX), 1 << 62, (1 << 63) + 1, u64::MAX] {
            let mut places: Vec<u64> = (0..1000).map(|i| permuted(i, count, 7)).collect();
            places.sort_unstable();
            places.dedup();
            assert_eq!(places.len(), 1000);
            assert!(places.iter().all(|&place| place < count));
        }
    }

    #[test]
    fn different_keys_give_different_orders() {
        let mut orders: Vec<_> = (0..1000).map(|key| order(50, key)).collect();
        orders.sort_unstable();
        orders.dedup();
        assert_eq!(orders.len(), 1000);
    }

    /// Chi-square statistic: sum of `(observed - expected)^2 / expected`.
    fn chi_square(counts: &[u32], expected: f64) -> f64 {
        let square = |&n| (f64::from(n) - expected) * (f64::from(n) - expected);
        counts.iter().map(square).sum::<f64>() / expected
    }

    #[test]
    fn every_index_reaches_every_position_equally_often() {
        for index in 0..7 {
            let mut counts = [0; 7];
            for key in 0..10_000 {
                counts[permuted(index, 7, key) as usize] += 1;
            }
            // scipy.stats.chi2.ppf(0.999, 6)
            let chi = chi_square(&counts, 10_000.0 / 7.0);
            assert!(chi < 22.457744484825323, "{chi} for {index}");
        }
    }

    #[test]
    fn all_orders_of_four_are_equally_frequent() {
        let mut counts = std::collections::BTreeMap::new();
        for key in 0..10_000 {
            *counts.entry(order(4, key)).or_insert(0) += 1;
        }
        let counts: Vec<u32> = counts.into_values().collect();
        assert_eq!(counts.len(), 24);
        // scipy.stats.chi2.ppf(0.999, 23)
        let chi = chi_square(&counts, 10_000.0 / 24.0);
        assert!(chi < 49.7282324664315, "{chi}");
    }

    #[test]
    fn neighbouring_indices_have_unrelated_positions() {
        let count = 10_000;
        let middle = 0.5 * (count - 1) as f64;
        // Variance of 0..count in closed form.
        let variance = (count * count - 1) as f64 / 12.0;
        for key in 0..20 {
            let places = order(count, key);
            let pairs = places.windows(2);
            let sum: f64 = pairs
                .map(|p| (p[0] as f64 - middle) * (p[1] as f64 - middle))
                .sum();
            let correlation = sum / (variance * count as f64);
            // Four deviations of 1 / sqrt(count).
            assert!(correlation.abs() < 0.04, "{correlation} with key {key}");
        }
    }

    #[test]
    fn neighbouring_keys_give_unrelated_positions() {
        let middle = 499.5;
        let place = |key| permuted(3, 1000, key) as f64 - middle;
        let sum: f64 = (0..10_000).map(|key| place(key) * place(key + 1)).sum();
        let correlation = sum / (999_999.0 / 12.0 * 10_000.0);
        assert!(correlation.abs() < 0.04, "{correlation}");
    }

    #[test]
    fn indices_outside_the_range_are_unchanged() {
        assert_eq!(permuted(0, 0, 5), 0);
        assert_eq!(permuted(9, 9, 5), 9);
        assert_eq!(permuted(0, 1, 5), 0);
    }
}

//! Points of the Sobol' sequence, each computed directly from its index.
//!
//! The sampler calls [`point`] once for each run and parameter. Points are independent of each other, so any run can be
//! repeated alone. The points are neither scrambled nor shifted.

/// Number of dimensions that have direction numbers.
pub(crate) const MOST_DIMENSIONS: usize = 64;

/// Number of bits of a fraction.
const BITS: usize = 32;

/// Primitive polynomials, including their first and last bits, and first direction integers `m` of the dimensions
/// from the second on; the first dimension is van der Corput's sequence.
///
/// File `new-joe-kuo-6.21201` (S. Joe and F. Y. Kuo, Constructing Sobol' sequences with better
/// two-dimensional projections, SIAM J. Sci. Comput. 30 (2008) 2635-2654).
const JOE_KUO: [(u32, &[u32]); MOST_DIMENSIONS - 1] = [
    (3, &[1]),
    (7, &[1, 3]),
    (11, &[1, 3, 1]),
    (13, &[1, 1, 1]),
    (19, &[1, 1, 3, 3]),
    (25, &[1, 3, 5, 13]),
    (37, &[1, 1, 5, 5, 17]),
    (41, &[1, 1, 5, 5, 5]),
    (47, &[1, 1, 7, 11, 19]),
    (55, &[1, 1, 5, 1, 1]),
    (59, &[1, 1, 1, 3, 11]),
    (61, &[1, 3, 5, 5, 31]),
    (67, &[1, 3, 3, 9, 7, 49]),
    (91, &[1, 1, 1, 15, 21, 21]),
    (97, &[1, 3, 1, 13, 27, 49]),
    (103, &[1, 1, 1, 15, 7, 5]),
    (109, &[1, 3, 1, 15, 13, 25]),
    (115, &[1, 1, 5, 5, 19, 61]),
    (131, &[1, 3, 7, 11, 23, 15, 103]),
    (137, &[1, 3, 7, 13, 13, 15, 69]),
    (143, &[1, 1, 3, 13, 7, 35, 63]),
    (145, &[1, 3, 5, 9, 1, 25, 53]),
    (157, &[1, 3, 1, 13, 9, 35, 107]),
    (167, &[1, 3, 1, 5, 27, 61, 31]),
    (171, &[1, 1, 5, 11, 19, 41, 61]),
    (185, &[1, 3, 5, 3, 3, 13, 69]),
    (191, &[1, 1, 7, 13, 1, 19, 1]),
    (193, &[1, 3, 7, 5, 13, 19, 59]),
    (203, &[1, 1, 3, 9, 25, 29, 41]),
    (211, &[1, 3, 5, 13, 23, 1, 55]),
    (213, &[1, 3, 7, 3, 13, 59, 17]),
    (229, &[1, 3, 1, 3, 5, 53, 69]),
    (239, &[1, 1, 5, 5, 23, 33, 13]),
    (241, &[1, 1, 7, 7, 1, 61, 123]),
    (247, &[1, 1, 7, 9, 13, 61, 49]),
    (253, &[1, 3, 3, 5, 3, 55, 33]),
    (285, &[1, 3, 1, 15, 31, 13, 49, 245]),
    (299, &[1, 3, 5, 15, 31, 59, 63, 97]),
    (301, &[1, 3, 1, 11, 11, 11, 77, 249]),
    (333, &[1, 3, 1, 11, 27, 43, 71, 9]),
    (351, &[1, 1, 7, 15, 21, 11, 81, 45]),
    (355, &[1, 3, 7, 3, 25, 31, 65, 79]),
    (357, &[1, 3, 1, 1, 19, 11, 3, 205]),
    (361, &[1, 1, 5, 9, 19, 21, 29, 157]),
    (369, &[1, 3, 7, 11, 1, 33, 89, 185]),
    (391, &[1, 3, 3, 3, 15, 9, 79, 71]),
    (397, &[1, 3, 7, 11, 15, 39, 119, 27]),
    (425, &[1, 1, 3, 1, 11, 31, 97, 225]),
    (451, &[1, 1, 1, 3, 23, 43, 57, 177]),
    (463, &[1, 3, 7, 7, 17, 17, 37, 71]),
    (487, &[1, 3, 1, 5, 27, 63, 123, 213]),
    (501, &[1, 1, 3, 5, 11, 43, 53, 133]),
    (529, &[1, 3, 5, 5, 29, 17, 47, 173, 479]),
    (539, &[1, 3, 3, 11, 3, 1, 109, 9, 69]),
    (545, &[1, 1, 1, 5, 17, 39, 23, 5, 343]),
    (557, &[1, 3, 1, 5, 25, 15, 31, 103, 499]),
    (563, &[1, 1, 1, 11, 11, 17, 63, 105, 183]),
    (601, &[1, 1, 5, 11, 9, 29, 97, 231, 363]),
    (607, &[1, 1, 5, 15, 19, 45, 41, 7, 383]),
    (617, &[1, 3, 7, 7, 31, 19, 83, 137, 221]),
    (623, &[1, 1, 1, 3, 23, 15, 111, 223, 83]),
    (631, &[1, 1, 5, 13, 31, 15, 55, 25, 161]),
    (637, &[1, 1, 3, 13, 25, 47, 39, 87, 257]),
];

/// Direction numbers, as fractions of 2^32.
static DIRECTIONS: [[u32; BITS]; MOST_DIMENSIONS] = directions();

/// Returns a coordinate of a Sobol' point as a fraction of 2^32.
///
/// `x = g_1 v_1 xor g_2 v_2 xor ..` with the bits `g` of the Gray code `index xor (index >> 1)` (P. Bratley and B. L.
/// Fox, Algorithm 659, ACM Trans. Math. Softw. 14 (1988) 88-100; direction numbers of Joe and Kuo, 2008; valid for
/// any index, and for dimensions, counted from 0, below [`MOST_DIMENSIONS`]). Larger dimensions give the coordinate
/// of the last one, so callers have to check the number of dimensions.
pub(crate) fn point(index: u32, dimension: usize) -> u32 {
    let directions = &DIRECTIONS[dimension.min(MOST_DIMENSIONS - 1)];
    let mut gray = index ^ (index >> 1);
    let mut x = 0;
    while gray != 0 {
        x ^= directions[gray.trailing_zeros() as usize];
        gray &= gray - 1;
    }
    x
}

/// Computes the direction numbers of all dimensions from their polynomials.
///
/// `v_j = a_1 v_(j-1) xor .. xor a_(s-1) v_(j-s+1) xor v_(j-s) xor (v_(j-s) >> s)` for a polynomial
/// `x^s + a_1 x^(s-1) + .. + 1`, and `v_j = m_j 2^(32-j)` for the first `s`,
/// as fractions of 2^32 (Bratley and Fox, 1988; Joe and Kuo, 2008; valid for all entries of the table).
const fn directions() -> [[u32; BITS]; MOST_DIMENSIONS] {
    let mut all = [[0; BITS]; MOST_DIMENSIONS];
    let mut j = 0;
    while j < BITS {
        all[0][j] = 1 << (BITS - 1 - j);
        j += 1;
    }
    let mut dimension = 1;
    while dimension < MOST_DIMENSIONS {
        let (polynomial, first) = JOE_KUO[dimension - 1];
        let v = &mut all[dimension];
        let s = first.len();
        let mut j = 0;
        while j < BITS {
            if j < s {
                v[j] = first[j] << (BITS - 1 - j);
            } else {
                v[j] = v[j - s] ^ (v[j - s] >> s);
                let mut k = 1;
                while k < s {
                    if polynomial >> (s - k) & 1 == 1 {
                        v[j] ^= v[j - k];
                    }
                    k += 1;
                }
            }
            j += 1;
        }
        dimension += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FNV-1a hash over 32-bit words.
    fn digest(words: impl Iterator<Item = u32>) -> u64 {
        words.fold(0xcbf2_9ce4_8422_2325, |digest: u64, word| {
            (digest ^ u64::from(word)).wrapping_mul(0x100_0000_01b3)
        })
    }

    #[test]
    fn first_points_of_all_dimensions_agree_with_scipy() {
        // scipy.stats.qmc.Sobol(64, scramble=False, bits=32).random(1024), times 2^32.
        for (index, dimension, expected) in [
            (0, 0, 0),
            (1, 0, 2147483648),
            (2, 1, 1073741824),
            (3, 2, 3221225472),
            (1023, 5, 1883242496),
            (777, 63, 1832910848),
            (1000, 36, 3644850176),
        ] {
            assert_eq!(point(index, dimension), expected);
        }
        let all = (0..1024).flat_map(|i| (0..MOST_DIMENSIONS).map(move |d| point(i, d)));
        assert_eq!(digest(all), 0x8659_9089_dcb6_2325);
    }

    #[test]
    fn late_points_agree_with_scipy() {
        // scipy.stats.qmc.Sobol(64, scramble=False, bits=32).fast_forward(index).random(1), times 2^32.
        for (index, expected) in [
            (
                1_000_003,
                [1187450880, 2413424640, 1145868288, 1251569664, 1323372544],
            ),
            (
                123_456_789,
                [4191448864, 3403469216, 2973295136, 2082040352, 1087637792],
            ),
        ] {
            assert_eq!([0, 1, 7, 31, 63].map(|d| point(index, d)), expected);
        }
    }

    #[test]
    fn direction_numbers_agree_with_scipy() {
        // scipy.stats.qmc.Sobol(64, scramble=False, bits=32)._sv
        let all = DIRECTIONS.iter().flatten().copied();
        assert_eq!(digest(all), 0x96e7_b294_33e2_f043);
    }

    #[test]
    fn every_dyadic_interval_contains_one_point() {
        for dimension in 0..MOST_DIMENSIONS {
            let mut cells: Vec<u32> = (0..4096).map(|i| point(i, dimension) >> 20).collect();
            cells.sort_unstable();
            assert!(cells.into_iter().eq(0..4096), "dimension {dimension}");
        }
    }

    #[test]
    fn dimensions_beyond_the_last_repeat_the_last() {
        assert_eq!(point(5, MOST_DIMENSIONS), point(5, MOST_DIMENSIONS - 1));
        assert_eq!(point(u32::MAX, usize::MAX), point(u32::MAX, 63));
    }
}

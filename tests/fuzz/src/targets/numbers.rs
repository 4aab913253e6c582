//! Numbers that often break arithmetic, in an order determined by the input.

/// A stream of such numbers.
pub(super) struct OddNumbers(u64);

const ODD: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    1e300,
    9_007_199_254_740_993.0,
];

impl OddNumbers {
    /// Returns the stream that belongs to an input (FNV-1a of its bytes).
    pub(super) fn of(bytes: &[u8]) -> Self {
        let mix = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        Self(bytes.iter().fold(0xcbf2_9ce4_8422_2325, mix))
    }

    /// Returns the next 64 bits (splitmix64).
    pub(super) const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Returns the next number: an unusual one, any bits, or an ordinary one.
    pub(super) const fn next(&mut self) -> f64 {
        let bits = self.bits();
        match bits % 4 {
            0 => ODD[(bits >> 8) as usize % ODD.len()],
            1 => f64::from_bits(bits.rotate_left(17)),
            _ => (bits >> 40) as f64 / 4096.0 - 2048.0,
        }
    }

    /// Returns a row of such numbers.
    pub(super) fn row(&mut self, length: usize) -> Vec<f64> {
        (0..length).map(|_| self.next()).collect()
    }
}

//! Pseudo-random binary sequence of maximal length, for the identification of a plant.
//!
//! Bit k obeys `s[k + n] = s[k] xor s[k + a] xor ..` with the exponents n, a, .. of a primitive polynomial
//! `x^n + x^a + .. + 1`, so that the sequence repeats after `2^n - 1` bits and not earlier. The first n bits are those
//! of the seed, the lowest first. The polynomials are those of `scipy.signal.max_len_seq`, which gives the same
//! sequence for the same first bits.

use serde::{Deserialize, Serialize};

use super::pulse::EDGE_S;

/// Smallest and largest order.
pub(crate) const ORDERS: [u32; 2] = [2, 31];

/// Exponents of each order's polynomial between n and 0.
#[rustfmt::skip]
const EXPONENTS: [&[u32]; 30] = [
    &[1], &[2], &[3], &[3], &[5], &[6], &[7, 6, 1], &[5], &[7], &[9], &[11, 10, 4], &[12, 11, 8], &[13, 12, 2],
    &[14], &[15, 13, 4], &[14], &[11], &[18, 17, 14], &[17], &[19], &[21], &[18], &[23, 22, 17], &[22],
    &[25, 24, 20], &[26, 25, 22], &[25], &[27], &[29, 28, 7], &[28],
];

/// Sequence that changes between `offset + amplitude` (bit 1) and `offset - amplitude` (bit 0) every `bit_s` at most.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prbs {
    /// Amplitude.
    pub amplitude: f64,
    /// Length of a bit in s.
    pub bit_s: f64,
    /// Order n, from 2 to 31.
    pub order: u32,
    /// First n bits, the lowest first; not all 0.
    pub seed: u32,
    /// Mean of both levels.
    pub offset: f64,
}

impl Prbs {
    pub(super) fn at(&self, time_s: f64) -> f64 {
        let bit = ((time_s + EDGE_S) / self.bit_s).floor() as u64;
        match is_one(self.order, self.seed, bit) {
            true => self.offset + self.amplitude,
            false => self.offset - self.amplitude,
        }
    }
}

/// Returns `true` if a bit of the sequence is 1: with `x^k = c_0 + c_1 x + ..` modulo the polynomial it is the sum of
/// `c_i s_i`.
fn is_one(order: u32, seed: u32, bit: u64) -> bool {
    let period = (1_u64 << order) - 1;
    let coefficients = power_of_x(order, bit % period);
    (coefficients & u64::from(seed)).count_ones() % 2 == 1
}

/// Returns the polynomial of an order without its highest term, as a number whose bit i is the coefficient of x^i.
fn polynomial(order: u32) -> u64 {
    let exponents = EXPONENTS[(order - ORDERS[0]) as usize];
    exponents
        .iter()
        .fold(1, |sum, exponent| sum | 1 << exponent)
}

/// Computes x^k modulo the polynomial, over the field of two elements.
fn power_of_x(order: u32, k: u64) -> u64 {
    let polynomial = polynomial(order);
    let times_x = |value: u64| {
        let shifted = value << 1;
        match shifted >> order & 1 {
            0 => shifted,
            _ => shifted ^ (1 << order | polynomial),
        }
    };
    let times = |a: u64, b: u64| {
        (0..order).rev().fold(0, |sum, place| {
            let sum = times_x(sum);
            if b >> place & 1 == 1 { sum ^ a } else { sum }
        })
    };
    let digits = u64::BITS - k.leading_zeros();
    (0..digits).rev().fold(1, |power, digit| {
        let square = times(power, power);
        if k >> digit & 1 == 1 {
            times_x(square)
        } else {
            square
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the distinct prime factors of a number.
    fn prime_factors(mut number: u64) -> Vec<u64> {
        let (mut factors, mut factor) = (Vec::new(), 2);
        while factor * factor <= number {
            if number.is_multiple_of(factor) {
                factors.push(factor);
                while number.is_multiple_of(factor) {
                    number /= factor;
                }
            }
            factor += 1;
        }
        factors.extend((number > 1).then_some(number));
        factors
    }

    #[test]
    fn every_polynomial_is_primitive() {
        for order in ORDERS[0]..=ORDERS[1] {
            // x has the order 2^n - 1, which it has modulo a primitive polynomial and no other.
            let period = (1_u64 << order) - 1;
            assert_eq!(power_of_x(order, period), 1, "order {order}");
            for factor in prime_factors(period) {
                assert_ne!(power_of_x(order, period / factor), 1, "order {order}");
            }
        }
    }

    #[test]
    fn the_bits_obey_the_recurrence_and_are_balanced() {
        for (order, seed) in [(2, 1), (5, 0b10011), (7, 0x7f), (8, 0xff), (12, 1)] {
            let period = (1_u64 << order) - 1;
            let bits: Vec<bool> = (0..2 * period)
                .map(|bit| is_one(order, seed, bit))
                .collect();
            for (place, bit) in bits.iter().enumerate().take(order as usize) {
                assert_eq!(*bit, seed >> place & 1 == 1);
            }
            let exponents = EXPONENTS[(order - ORDERS[0]) as usize];
            for k in 0..period as usize {
                let sum = { exponents.iter() }
                    .fold(bits[k], |sum, exponent| sum ^ bits[k + *exponent as usize]);
                assert_eq!(bits[k + order as usize], sum, "order {order}, bit {k}");
            }
            // A maximal sequence has one more 1 than 0, and its autocorrelation is -1 at each shift but 0.
            let whole = &bits[..period as usize];
            assert_eq!(
                whole.iter().filter(|bit| **bit).count() as u64,
                1 << (order - 1)
            );
            for shift in [1, 2, period as usize / 2 + 1] {
                let agreements = { whole.iter().zip(&bits[shift..]) }.filter(|(a, b)| a == b);
                assert_eq!(2 * agreements.count() as i64 - period as i64, -1);
            }
        }
    }

    #[test]
    fn the_bits_are_those_of_scipy() {
        // The example of the documentation of scipy.signal.max_len_seq: max_len_seq(4)[0].
        let expected = [1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 0, 1, 0, 0, 0];
        for (bit, expected) in (0..).zip(expected) {
            assert_eq!(is_one(4, 0xf, bit), expected == 1, "bit {bit}");
        }
    }

    #[test]
    fn a_bit_lasts_its_time_to_the_step() {
        let prbs = Prbs {
            amplitude: 0.5,
            bit_s: 0.07,
            order: 9,
            seed: 0x1ff,
            offset: 1.0,
        };
        for k in 0..100_000_u32 {
            let expected = match is_one(9, 0x1ff, u64::from(k / 7)) {
                true => 1.5,
                false => 0.5,
            };
            assert_eq!(prbs.at(f64::from(k) / 100.0), expected, "step {k}");
        }
    }
}

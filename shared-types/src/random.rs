//! Random streams: one for each consumer, derived from the run's seed and the consumer's path.
//!
//! Adding a consumer does not change the numbers of another consumer, and the numbers are the same on every machine.

mod ziggurat;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Stream of random numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RandomStream(Pcg64);

impl RandomStream {
    /// Creates the stream of a consumer, for example `noise/measured.surface_angle_rad`.
    #[must_use]
    pub fn new(seed: u64, path: &str) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&seed.to_le_bytes());
        hasher.update(path.as_bytes());
        let mut key = <Pcg64 as SeedableRng>::Seed::default();
        hasher.finalize_xof().fill(&mut key);
        ziggurat::prepare();
        Self(Pcg64::from_seed(key))
    }

    /// Draws a uniform number in [0, 1), with 53 random bits.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Draws a normal number with mean 0 and standard deviation 1 (Box and Muller 1958, cosine branch).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }

    /// Draws a normal number with mean 0 and standard deviation 1 in a fraction of the time of
    /// [`normal`](Self::normal), as another sequence (ziggurat of Marsaglia and Tsang 2000).
    #[inline]
    pub fn normal_by_layers(&mut self) -> f64 {
        ziggurat::normal(self)
    }

    fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_repeats_and_streams_differ() {
        let numbers = |seed, path| {
            let mut stream = RandomStream::new(seed, path);
            [stream.uniform(), stream.uniform(), stream.normal()]
        };
        assert_eq!(numbers(1, "a"), numbers(1, "a"));
        assert_ne!(numbers(1, "a"), numbers(1, "b"));
        assert_ne!(numbers(1, "a"), numbers(2, "a"));
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut stream = RandomStream::new(1, "moments");
        let count = 200_000;
        let moments = |mut draw: Box<dyn FnMut() -> f64>| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..count {
                let x = draw();
                (sum, squares) = (sum + x, squares + x * x);
            }
            let mean = sum / f64::from(count);
            (mean, squares / f64::from(count) - mean * mean)
        };
        let mut copy = stream.clone();
        let (mean, variance) = moments(Box::new(move || copy.uniform()));
        assert!((mean - 0.5).abs() < 4e-3 && (variance - 1.0 / 12.0).abs() < 1e-3);
        let mut copy = stream.clone();
        let (mean, variance) = moments(Box::new(move || copy.normal_by_layers()));
        assert!(mean.abs() < 1e-2 && (variance - 1.0).abs() < 2e-2);
        let (mean, variance) = moments(Box::new(move || stream.normal()));
        assert!(mean.abs() < 1e-2 && (variance - 1.0).abs() < 2e-2);
    }
}

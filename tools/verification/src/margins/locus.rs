//! Locus of an open loop: its measured response between and at the measured frequencies, and its margins.

use std::f64::consts::{PI, TAU};

use super::extremes::{larger, smaller};

/// Response of the open loop at a frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Response {
    pub(super) frequency_hz: f64,
    /// Real and imaginary part of L.
    pub(super) l: (f64, f64),
}

/// Margins of a loop; `None` where the locus has no such crossing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Margins {
    /// Frequencies with `|L| = 1`, each with the phase margin in degrees.
    pub(super) crossovers: Vec<[f64; 2]>,
    /// Frequencies with a phase of -180 degrees, each with the gain margin in dB.
    pub(super) phase_crossovers: Vec<[f64; 2]>,
    /// Frequency of the least `|1 + L|`, and that value.
    pub(super) disc: [f64; 2],
}

/// Parts into which each interval is divided in the search for crossings.
const PARTS: u32 = 32;
/// Responses through which an interpolation goes.
const NODES: usize = 4;
/// Halvings in the search for a crossing.
const HALVINGS: u32 = 60;

impl Margins {
    /// Returns the crossover with the phase margin of least size.
    pub(super) fn crossover(&self) -> Option<[f64; 2]> {
        least(&self.crossovers)
    }

    /// Returns the phase crossover with the gain margin of least size.
    pub(super) fn phase_crossover(&self) -> Option<[f64; 2]> {
        least(&self.phase_crossovers)
    }

    /// Returns the least additional delay in s that brings the locus to -1.
    pub(super) fn delay_margin_s(&self) -> Option<f64> {
        let delay = |[frequency_hz, margin_deg]: &[f64; 2]| {
            margin_deg.rem_euclid(360.0) / (360.0 * frequency_hz)
        };
        self.crossovers.iter().map(delay).reduce(smaller)
    }

    /// Lists the frequencies near which the locus must be known well.
    pub(super) fn places_hz(&self) -> Vec<f64> {
        let crossings = self.crossovers.iter().chain(&self.phase_crossovers);
        let mut all: Vec<f64> = crossings.map(|[frequency_hz, _]| *frequency_hz).collect();
        all.push(self.disc[0]);
        all
    }
}

fn least(all: &[[f64; 2]]) -> Option<[f64; 2]> {
    let all = all.iter().copied();
    all.min_by(|a, b| a[1].abs().total_cmp(&b[1].abs()))
}

/// Computes the margins of a locus; its responses ascend in frequency.
pub(super) fn margins(locus: &[Response]) -> Margins {
    margins_through(locus, NODES)
}

/// Computes the margins from an interpolation of one order less, which differ from [`margins`] by more than the error
/// of these.
pub(super) fn margins_of_less_order(locus: &[Response]) -> Margins {
    margins_through(locus, NODES - 1)
}

fn margins_through(locus: &[Response], nodes: usize) -> Margins {
    let at = |locus: &[Response], x: f64| through(nodes, locus, x);
    let mut margins = Margins {
        disc: [f64::NAN, f64::INFINITY],
        ..Margins::default()
    };
    let distance = |x: f64| {
        let (re, im) = at(locus, x);
        libm::hypot(1.0 + re, im)
    };
    for pair in locus.windows(2) {
        let [from, until] = [&pair[0], &pair[1]].map(|one| libm::log(one.frequency_hz));
        let step = (until - from) / f64::from(PARTS);
        for part in 0..PARTS {
            let (a, b) = (
                from + step * f64::from(part),
                from + step * f64::from(part + 1),
            );
            let gain = |x: f64| {
                let (re, im) = at(locus, x);
                libm::log(libm::hypot(re, im))
            };
            if let Some(x) = crossing(gain, a, b) {
                let (re, im) = at(locus, x);
                let margin = wrapped(libm::atan2(im, re) + PI).to_degrees();
                margins.crossovers.push([libm::exp(x), margin]);
            }
            let side = |x: f64| at(locus, x).1;
            if let Some(x) = crossing(side, a, b)
                && at(locus, x).0 < 0.0
            {
                let margin_db = -20.0 * libm::log10(-at(locus, x).0);
                margins.phase_crossovers.push([libm::exp(x), margin_db]);
            }
            for x in [a, b] {
                if distance(x) < margins.disc[1] {
                    margins.disc = [libm::exp(x), distance(x)];
                }
            }
        }
    }
    if margins.disc[0].is_finite() {
        polish(&mut margins.disc, distance, locus);
    }
    margins
}

/// Moves the least value to the minimum beside it, by ternary search.
fn polish(disc: &mut [f64; 2], distance: impl Fn(f64) -> f64, locus: &[Response]) {
    let ends = [&locus[0], &locus[locus.len() - 1]].map(|one| libm::log(one.frequency_hz));
    let x = libm::log(disc[0]);
    let width = locus.windows(2).filter(|pair| {
        pair[0].frequency_hz <= disc[0] * 1.000_001 && disc[0] <= pair[1].frequency_hz * 1.000_001
    });
    let width = width.map(|pair| libm::log(pair[1].frequency_hz / pair[0].frequency_hz));
    let width = width.fold(0.0, larger) / f64::from(PARTS);
    let (mut low, mut high) = (larger(x - width, ends[0]), smaller(x + width, ends[1]));
    for _ in 0..HALVINGS {
        let third = (high - low) / 3.0;
        if distance(low + third) < distance(high - third) {
            high -= third;
        } else {
            low += third;
        }
    }
    let x = 0.5 * (low + high);
    if distance(x) < disc[1] {
        *disc = [libm::exp(x), distance(x)];
    }
}

/// Finds the zero of a function that changes sign once between two places.
fn crossing(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> Option<f64> {
    let is_above = f(low) > 0.0;
    if is_above == (f(high) > 0.0) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if (f(middle) > 0.0) == is_above {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// Interpolates L at the logarithm of a frequency: logarithm of the gain, and phase, by the cubic through the four
/// nearest responses.
pub(super) fn at(locus: &[Response], x: f64) -> (f64, f64) {
    through(NODES, locus, x)
}

/// Interpolates L as [`at`] does, through this number of responses.
fn through(nodes: usize, locus: &[Response], x: f64) -> (f64, f64) {
    let after = locus.partition_point(|one| libm::log(one.frequency_hz) < x);
    let count = locus.len().min(nodes);
    let first = after.saturating_sub(2).min(locus.len() - count);
    let (mut gain, mut phase, mut before) = (0.0, 0.0, None);
    let nodes = &locus[first..first + count];
    let place = |one: &Response| libm::log(one.frequency_hz);
    for (index, node) in nodes.iter().enumerate() {
        let others = nodes
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != index);
        let weight: f64 = others
            .map(|(_, other)| (x - place(other)) / (place(node) - place(other)))
            .product();
        let mut angle = libm::atan2(node.l.1, node.l.0);
        if let Some(before) = before {
            angle = before + wrapped(angle - before);
        }
        before = Some(angle);
        gain += weight * libm::log(libm::hypot(node.l.0, node.l.1));
        phase += weight * angle;
    }
    let (sin, cos) = libm::sincos(phase);
    let size = libm::exp(gain);
    (size * cos, size * sin)
}

/// Returns an angle in -pi to pi.
pub(super) fn wrapped(angle: f64) -> f64 {
    angle - TAU * libm::round(angle / TAU)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `L = exp(-j w tau) k / s`: crossover at `k`, phase margin `90 - k tau`, gain margin at `pi / (2 tau)`.
    #[test]
    fn margins_of_an_integrator_with_delay_are_those_of_its_closed_form() {
        let (k, tau) = (10.0, 0.05);
        let locus: Vec<Response> = (0..=400)
            .map(|n| {
                let frequency_hz = 0.2 * libm::pow(100.0, f64::from(n) / 400.0);
                let w = TAU * frequency_hz;
                let (sin, cos) = libm::sincos(-w * tau - 0.5 * PI);
                Response {
                    frequency_hz,
                    l: (k / w * cos, k / w * sin),
                }
            })
            .collect();
        let margins = margins(&locus);
        let [crossover_hz, phase_deg] = margins.crossover().expect("a crossover");
        assert!((crossover_hz * TAU / k - 1.0).abs() < 1e-8, "{margins:?}");
        assert!((phase_deg - (90.0 - (k * tau).to_degrees())).abs() < 1e-6);
        let [phase_hz, gain_db] = margins.phase_crossover().expect("a phase crossover");
        let w = 0.5 * PI / tau;
        assert!((phase_hz * TAU / w - 1.0).abs() < 1e-8);
        assert!((gain_db - 20.0 * libm::log10(w / k)).abs() < 1e-6);
        let delay_s = margins.delay_margin_s().expect("a delay margin");
        assert!((delay_s - (0.5 * PI - k * tau) / k).abs() < 1e-8);
    }
}

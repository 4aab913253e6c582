//! Normal numbers by layers of equal area under the density (Marsaglia and Tsang 2000, as revised by Doornik 2005).
//!
//! A random layer and a random place in it are one draw of 64 bits; 98.8 % of the places lie wholly under the density,
//! so that a number costs neither a logarithm nor a root.

use std::sync::LazyLock;

use super::RandomStream;

/// Number of layers.
const LAYERS: usize = 128;
/// Right end of the lowest layer that is a rectangle; the tail begins there.
const TAIL: f64 = 3.442_619_855_899;
/// Area of a layer, that of the lowest with the tail.
const AREA: f64 = 9.912_563_035_262_17e-3;

struct Layers {
    /// Right end of each layer, from the lowest to the highest; the first counts the tail as a rectangle.
    ends: [f64; LAYERS + 1],
    /// Share of each layer that lies wholly under the density.
    inside: [f64; LAYERS],
}

static TABLE: LazyLock<Layers> = LazyLock::new(|| {
    let mut ends = [0.0; LAYERS + 1];
    let mut height = density(TAIL);
    (ends[0], ends[1]) = (AREA / height, TAIL);
    for layer in 2..LAYERS {
        ends[layer] = (-2.0 * libm::log(AREA / ends[layer - 1] + height)).sqrt();
        height = density(ends[layer]);
    }
    Layers {
        inside: std::array::from_fn(|layer| ends[layer + 1] / ends[layer]),
        ends,
    }
});

/// Computes the table away from the step.
pub(super) fn prepare() {
    LazyLock::force(&TABLE);
}

/// Density without its factor, `exp(-x^2 / 2)`.
fn density(x: f64) -> f64 {
    libm::exp(-0.5 * x * x)
}

/// Draws a normal number.
#[inline]
pub(super) fn normal(stream: &mut RandomStream) -> f64 {
    let table = &*TABLE;
    loop {
        let bits = stream.bits();
        // Uniform in [-1, 1) from the upper 53 bits; the layer is of the lower ones.
        let place = (bits >> 11) as f64 * (2.0 / (1_u64 << 53) as f64) - 1.0;
        let layer = bits as usize % LAYERS;
        if place.abs() < table.inside[layer] {
            return place * table.ends[layer];
        }
        if let Some(x) = at_the_edge(stream, table, layer, place) {
            return x;
        }
    }
}

/// Decides about a place that may lie above the density; returns `None` if it does.
#[cold]
fn at_the_edge(stream: &mut RandomStream, table: &Layers, layer: usize, place: f64) -> Option<f64> {
    if layer == 0 {
        let x = tail(stream);
        return Some(if place < 0.0 { -x } else { x });
    }
    let x = place * table.ends[layer];
    let relative = |end: f64| libm::exp(-0.5 * (end * end - x * x));
    let (below, above) = (relative(table.ends[layer]), relative(table.ends[layer + 1]));
    (above + stream.uniform() * (below - above) < 1.0).then_some(x)
}

/// Draws from the tail (Marsaglia 1964).
fn tail(stream: &mut RandomStream) -> f64 {
    loop {
        let beyond = -libm::log(1.0 - stream.uniform()) / TAIL;
        let y = -libm::log(1.0 - stream.uniform());
        if 2.0 * y >= beyond * beyond {
            return TAIL + beyond;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_layers_have_one_area() {
        let ends = &TABLE.ends;
        for layer in 1..LAYERS {
            let (low, high) = (density(ends[layer]), density(ends[layer + 1]));
            let area = ends[layer] * (high - low);
            assert!((area / AREA - 1.0).abs() < 1e-8, "layer {layer}: {area}");
        }
        let beyond = (std::f64::consts::PI / 2.0).sqrt() * libm::erfc(TAIL / 2.0_f64.sqrt());
        let lowest = TAIL * density(TAIL) + beyond;
        assert!((lowest / AREA - 1.0).abs() < 1e-12, "{lowest}");
    }

    #[test]
    fn frequencies_are_those_of_the_normal_distribution() {
        // Phi at 0.5, 1, 2, 3, 3.5 and 4 (Abramowitz and Stegun, table 26.1): both sides of the beginning of the tail.
        const BELOW: [(f64, f64); 6] = [
            (0.5, 0.691_462_461_274_013),
            (1.0, 0.841_344_746_068_543),
            (2.0, 0.977_249_868_051_821),
            (3.0, 0.998_650_101_968_370),
            (3.5, 0.999_767_370_920_964),
            (4.0, 0.999_968_328_758_167),
        ];
        const COUNT: usize = 2_000_000;
        let mut stream = RandomStream::new(1, "layers");
        let numbers: Vec<f64> = (0..COUNT).map(|_| normal(&mut stream)).collect();
        for (bound, probability) in BELOW {
            for (side, count) in [
                ("above", numbers.iter().filter(|x| **x > bound).count()),
                ("below", numbers.iter().filter(|x| **x < -bound).count()),
            ] {
                let expected = COUNT as f64 * (1.0 - probability);
                let error = (count as f64 - expected) / (expected * probability).sqrt();
                assert!(
                    error.abs() < 5.0,
                    "{side} {bound}: {count} and not {expected}"
                );
            }
        }
        let fourth = numbers.iter().map(|x| x * x * x * x).sum::<f64>() / COUNT as f64;
        // Five standard deviations of the fourth moment's estimate, sqrt((105 - 9) / n).
        assert!(
            (fourth - 3.0).abs() < 5.0 * (96.0 / COUNT as f64).sqrt(),
            "{fourth}"
        );
    }
}

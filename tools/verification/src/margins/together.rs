//! Margin of all loops together, from the matrix `S = (I + L)^-1` at the plant's input.
//!
//! Tones at command j alone give column j of S: the outputs of all probes over the tone that was added. While the gain
//! or phase of every command changes by a factor k with `|1/k - 1| < a` for each, the loop stays stable if a is at most
//! the least singular value of `D (I + L) D^-1` over frequency, for any diagonal D, since D commutes with the changes
//! (Lehtomaki, Sandell, Athans, IEEE TAC 26, 1981). D is chosen by balancing rows and columns, so the result does not
//! depend on the units of the commands.

use std::collections::BTreeMap;

use nalgebra::{Complex, DMatrix};

use super::extremes::{extended, larger, smaller};
use super::measurement::{Measured, response_to};
use super::probe::{Excitation, Fitted, Loops, Motion, Stop, WINDOWS};
use super::span::Span;

/// Largest number of runs of each command that add frequencies.
const REFINEMENTS: usize = 2;
/// Places between the neighbours of a measured frequency at which S is interpolated.
const PLACES: u32 = 64;
/// Sweeps over rows and columns in balancing.
const SWEEPS: usize = 50;

/// Margin of all loops together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Together {
    /// Least singular value of `I + L` after balancing, and its frequency in Hz.
    pub(super) margin: f64,
    pub(super) frequency_hz: f64,
    /// Least and largest margin among windows.
    pub(super) interval: [f64; 2],
    /// Least singular value of `I + L` in the units of the commands.
    pub(super) least_singular_value: f64,
}

/// S at one frequency: of the mean of all windows, then of each window.
type Sensitivity = [DMatrix<Complex<f64>>; 1 + WINDOWS];

/// Measures the margin of all loops together, given each loop's survey, all at the same tones.
pub(super) fn measure(
    loops: &Loops<'_>,
    own: &Motion,
    measured: &[&Measured],
    span: Span,
) -> Result<Together, Stop> {
    let survey: Vec<&[Fitted]> = measured.iter().map(|one| &one.survey[..]).collect();
    let mut all = BTreeMap::new();
    add(&mut all, &span.dense(), &survey);
    for _ in 0..REFINEMENTS {
        let least = all.iter().min_by(|a, b| {
            let margin = |all: &Sensitivity| balanced_margin(&all[0]);
            margin(a.1).total_cmp(&margin(b.1))
        });
        let Some((turns, _)) = least else { break };
        let mut tones = span.around(span.hz(*turns));
        tones.retain(|turns| !all.contains_key(turns));
        if tones.is_empty() {
            break;
        }
        let own = own.fits(&tones)?;
        let mut columns = Vec::new();
        for (command, one) in measured.iter().enumerate() {
            let motion = loops.run(Some(Excitation {
                command,
                amplitude: one.amplitude,
                turns: &tones,
            }))?;
            columns.push(response_to(motion.fits(&tones)?, &own));
        }
        let columns: Vec<&[Fitted]> = columns.iter().map(Vec::as_slice).collect();
        add(&mut all, &tones, &columns);
    }
    let least = |course: Interpolation, window: usize| least(&all, window, course, balanced_margin);
    let (margin, turns) = least(Interpolation::Parabola, 0)
        .filter(|(margin, _)| margin.is_finite())
        .ok_or_else(|| Stop::Refused("there is no response".into()))?;
    let windows = (1..=WINDOWS).filter_map(|window| least(Interpolation::Parabola, window));
    let others = windows.chain(least(Interpolation::Line, 0));
    let interval = others.map(|(value, _)| value).fold([margin; 2], extended);
    let unscaled = self::least(&all, 0, Interpolation::Parabola, reciprocal);
    Ok(Together {
        margin,
        frequency_hz: span.hz(1) * turns,
        interval,
        least_singular_value: unscaled.map_or(margin, |(value, _)| value),
    })
}

/// Course of S between measured frequencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    /// Parabola through the frequency of the least margin and both its neighbours.
    Parabola,
    /// Line from each of them to the next.
    Line,
}

/// Returns the least margin of a window, and the turns at which it is: that of a measured frequency, or between it and a
/// neighbour.
fn least(
    all: &BTreeMap<u64, Sensitivity>,
    window: usize,
    course: Interpolation,
    margin: fn(&DMatrix<Complex<f64>>) -> f64,
) -> Option<(f64, f64)> {
    let values = all.iter().map(|(turns, s)| (margin(&s[window]), *turns));
    let (value, turns) = values.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let measured = (value, turns as f64);
    let before = all.range(..turns).next_back();
    let after = all.range(turns + 1..).next();
    let (Some((low, s_low)), Some((high, s_high))) = (before, after) else {
        return Some(measured);
    };
    let nodes = [*low, turns, *high].map(|turns| turns as f64);
    let matrices = [s_low, &all[&turns], s_high].map(|s| &s[window]);
    let between = (0..=PLACES).map(|place| {
        let at = nodes[0] + (nodes[2] - nodes[0]) * f64::from(place) / f64::from(PLACES);
        let weights = weights(course, nodes, at);
        let terms = matrices.iter().zip(weights);
        let s = terms.map(|(s, weight)| s.scale(weight)).sum::<DMatrix<_>>();
        (margin(&s), at)
    });
    between.chain([measured]).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Returns the shares of the values at three nodes in the value at a place.
fn weights(course: Interpolation, [a, b, c]: [f64; 3], at: f64) -> [f64; 3] {
    match course {
        Interpolation::Parabola => [
            (at - b) * (at - c) / ((a - b) * (a - c)),
            (at - a) * (at - c) / ((b - a) * (b - c)),
            (at - a) * (at - b) / ((c - a) * (c - b)),
        ],
        Interpolation::Line if at < b => [(b - at) / (b - a), (at - a) / (b - a), 0.0],
        Interpolation::Line => [0.0, (c - at) / (c - b), (at - b) / (c - b)],
    }
}

impl Together {
    /// Returns the gains in dB between which every command may change at once, each for itself.
    pub(super) fn gains_db(&self) -> [Option<f64>; 2] {
        let db = |factor: f64| 20.0 * libm::log10(factor);
        let largest = (self.margin < 1.0).then(|| db(1.0 / (1.0 - self.margin)));
        [Some(db(1.0 / (1.0 + self.margin))), largest]
    }

    /// Returns the phase in degrees by which every command may change at once, each for itself.
    pub(super) fn phase_deg(&self) -> f64 {
        2.0 * libm::asin(smaller(0.5 * self.margin, 1.0)).to_degrees()
    }
}

/// Adds S at these tones; `columns` has the responses to the tones of each command.
fn add(all: &mut BTreeMap<u64, Sensitivity>, tones: &[u64], columns: &[&[Fitted]]) {
    for (index, turns) in tones.iter().enumerate() {
        let windows: [_; WINDOWS] = std::array::from_fn(|window| {
            let outputs = |row: usize, column: usize| {
                let probes = &columns[column][index][window];
                let [input, output] = probes[column].map(|(re, im)| Complex::new(re, im));
                let (re, im) = probes[row][1];
                Complex::new(re, im) / (output - input)
            };
            DMatrix::from_fn(columns.len(), columns.len(), outputs)
        });
        let mean = windows.iter().sum::<DMatrix<_>>().unscale(WINDOWS as f64);
        let [a, b, c] = windows;
        all.insert(*turns, [mean, a, b, c]);
    }
}

/// Returns the reciprocal of the largest singular value of S, which is the least singular value of `I + L`.
fn reciprocal(s: &DMatrix<Complex<f64>>) -> f64 {
    match s.iter().all(|value| value.is_finite()) {
        true => 1.0 / s.singular_values().max(),
        false => f64::NAN,
    }
}

/// Returns the least singular value of `D (I + L) D^-1`, with D that balances S.
fn balanced_margin(s: &DMatrix<Complex<f64>>) -> f64 {
    let mut s = s.clone();
    // A row or column of zeros cannot be balanced; this bounds the factor.
    let least = 1e-9 * s.norm();
    for _ in 0..SWEEPS {
        for i in 0..s.nrows() {
            let others = (0..s.nrows()).filter(|k| *k != i);
            let (mut row, mut column) = (0.0, 0.0);
            for k in others {
                row += s[(i, k)].norm_sqr();
                column += s[(k, i)].norm_sqr();
            }
            let (row, column) = (larger(row.sqrt(), least), larger(column.sqrt(), least));
            let factor = (column / row).sqrt();
            if factor.is_finite() && factor > 0.0 {
                s.row_mut(i).scale_mut(factor);
                s.column_mut(i).unscale_mut(factor);
            }
        }
    }
    reciprocal(&s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(rows: [[f64; 2]; 2]) -> DMatrix<Complex<f64>> {
        DMatrix::from_fn(2, 2, |i, k| Complex::new(rows[i][k], 0.0))
    }

    /// `S = diag(2, 4)` however a unit of one command is chosen: `[[2, 0], [0, 4]]`.
    #[test]
    fn the_margin_does_not_depend_on_the_units_of_the_commands() {
        for unit in [1.0, 1e3, 1e-6] {
            let s = matrix([[2.0, 1.0 * unit], [0.5 / unit, 4.0]]);
            let expected = balanced_margin(&matrix([[2.0, 1.0], [0.5, 4.0]]));
            assert!((balanced_margin(&s) / expected - 1.0).abs() < 1e-9);
        }
    }

    /// A one-way coupling changes no loop's stability, however large it is: the largest |S| is 4.
    #[test]
    fn a_coupling_in_one_direction_costs_no_margin() {
        let margin = balanced_margin(&matrix([[2.0, 1e3], [0.0, 4.0]]));
        assert!((margin - 0.25).abs() < 1e-4, "{margin}");
        let unscaled = reciprocal(&matrix([[2.0, 1e3], [0.0, 4.0]]));
        assert!((unscaled - 1e-3).abs() < 1e-7, "{unscaled}");
    }

    /// Eigenvectors of a symmetric S are orthogonal: its largest singular value is 2 + 1.
    #[test]
    fn a_symmetric_coupling_gives_the_largest_eigenvalue() {
        let margin = balanced_margin(&matrix([[2.0, 1.0], [1.0, 2.0]]));
        assert!((margin - 1.0 / 3.0).abs() < 1e-12, "{margin}");
    }
}

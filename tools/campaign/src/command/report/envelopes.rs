//! Envelopes over time for the script of a campaign's page: minimum and maximum values of all cases, bands over the
//! sampled draws, and the worst cases.

use crate::collect;
use crate::curves::Curves;
use crate::folder::Folder;
use crate::order::quantile;
use hil_config::study::Study;
use hil_facts::results::curve::{Curve, Grid};
use hil_views::plots::words::in_words;
use serde::Serialize;

use super::numbers::Singles;

/// Quantiles of the minimum values and of the maximum values: each pair encloses 90 %, 50 % or none of the draws.
const LOWER: [f64; 3] = [0.05, 0.25, 0.5];
const UPPER: [f64; 3] = [0.5, 0.75, 0.95];

/// Envelopes of all signals; the plots of a signal are side by side, one for each variant.
#[derive(Debug, Serialize)]
pub(super) struct Envelopes {
    bins: usize,
    /// Width of a bin, in s.
    bin_s: f64,
    /// Names and units of the signals.
    signals: Vec<(String, String)>,
    /// Each signal in words.
    words: Vec<String>,
    /// For each variant, the curves of each signal from the lowest to the highest.
    variants: Vec<Vec<Singles>>,
    worst: Vec<Worst>,
    /// Number of draws in the bands.
    pub(super) draws: usize,
    /// Number of shards without curves.
    pub(super) without: u64,
}

#[derive(Debug, Serialize)]
struct Worst {
    /// Index of the variant.
    variant: usize,
    requirement: String,
    case: u64,
    /// Minimum and maximum values of each signal.
    signals: Vec<Singles>,
}

impl Envelopes {
    /// Reads the curves of a campaign; `None` if the campaign records none, or has none yet.
    ///
    /// # Errors
    /// If the journals cannot be read.
    pub(super) fn read(folder: &Folder, study: &Study) -> std::io::Result<Option<Self>> {
        let Some(grid) = &folder.manifest().curves else {
            return Ok(None);
        };
        let (mut curves, without) = collect::curves(folder)?;
        let count = study.variants.len() as u64;
        if curves.envelopes.is_empty() {
            return Ok(None);
        }
        // A campaign that grew had a smaller stride before.
        curves
            .sampled
            .retain(|case, _| (case / count).is_multiple_of(grid.every));
        let names = study.variants.iter().map(|one| &one.name);
        let variants = (0..).zip(names.clone()).map(|(place, name)| {
            let sampled = curves.sampled.iter();
            let of = sampled.filter(|(case, _)| *case % count == place);
            let sampled: Vec<&Curve> = of.map(|(_, curve)| curve).collect();
            let signals = 0..grid.signals.len();
            let bands = signals.map(|signal| bands(&curves, name, &sampled, grid, signal));
            bands.collect()
        });
        let worst = curves.worst.iter().filter_map(|one| {
            let signals = (0..grid.signals.len()).map(|signal| {
                let bins = one.curve.signal(grid, signal).iter();
                let [least, greatest] = [0, 1].map(|end| bins.clone().map(move |bin| bin[end]));
                Singles(least.chain(greatest).collect())
            });
            Some(Worst {
                variant: names.clone().position(|name| *name == one.variant)?,
                requirement: one.requirement.clone(),
                case: one.case,
                signals: signals.collect(),
            })
        });
        let draws = curves.sampled.keys().map(|case| case / count);
        let mut draws: Vec<u64> = draws.collect();
        draws.dedup();
        Ok(Some(Self {
            bins: grid.bins,
            bin_s: grid.bin_s,
            signals: grid.signals.clone(),
            words: words(grid),
            variants: variants.collect(),
            worst: worst.collect(),
            draws: draws.len(),
            without,
        }))
    }
}

/// Returns each signal in words, by its name in a campaign of an earlier version.
fn words(grid: &Grid) -> Vec<String> {
    let mut words = grid.words.iter();
    let signals = grid.signals.iter();
    signals
        .map(|(name, unit)| {
            words
                .next()
                .cloned()
                .unwrap_or_else(|| in_words(name, unit, None))
        })
        .collect()
}

/// Computes the concatenated curves of a signal in a variant.
fn bands(curves: &Curves, name: &str, sampled: &[&Curve], grid: &Grid, signal: usize) -> Singles {
    let envelope = curves.envelopes.get(name);
    let envelope = envelope.map(|curve| curve.signal(grid, signal));
    let ends = |end: usize| {
        let bins = 0..grid.bins;
        bins.map(move |bin| envelope.map_or(f32::NAN, |bins| bins[bin][end]))
    };
    let sorted = |end: usize| {
        let bins = (0..grid.bins).map(|bin| {
            let values = sampled
                .iter()
                .map(|curve| curve.signal(grid, signal)[bin][end]);
            let finite = values.filter(|value| !value.is_nan()).map(f64::from);
            let mut sorted: Vec<f64> = finite.collect();
            sorted.sort_by(f64::total_cmp);
            sorted
        });
        bins.collect::<Vec<_>>()
    };
    let mut all: Vec<f32> = ends(0).collect();
    for (end, quantiles) in [(0, LOWER), (1, UPPER)] {
        let sorted = sorted(end);
        for p in quantiles {
            all.extend(sorted.iter().map(|values| match values.as_slice() {
                [] => f32::NAN,
                values => quantile(values, p) as f32,
            }));
        }
    }
    all.extend(ends(1));
    Singles(all)
}

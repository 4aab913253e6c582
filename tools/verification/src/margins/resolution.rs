//! Resolution of a locus: a survey of many frequencies shows where the measured ones miss a mode.

use std::collections::BTreeMap;

use super::locus::{Response, at, wrapped};
use super::point::{change, size};
use super::probe::Complex;
use super::span::Span;

/// Gain below which a mode decides about no margin.
const LEAST: f64 = 0.003;
/// Gain from which an unresolved mode is refused.
const DECISIVE: f64 = 0.1;
/// Relative difference of the survey from the interpolated locus above which frequencies are added.
const MISSED: f64 = 0.02;
/// Relative difference above which a locus is not resolved.
const UNRESOLVED: f64 = 0.1;
/// Difference of phase in degrees between neighbouring frequencies above which others are added between them.
const TURN_DEG: f64 = 60.0;
/// Difference of phase in degrees above which neighbours in the common period do not resolve a mode.
const UNRESOLVED_DEG: f64 = 120.0;
/// Largest ratio of gains at neighbouring frequencies.
const RATIO: f64 = 4.0;

/// Response at one frequency of the survey.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surveyed {
    pub(super) l: Complex,
    /// Largest relative change from one period to another.
    pub(super) unsteadiness: f64,
}

/// Measured locus and the survey of the same loop, by turns in the common period.
pub(super) struct Resolution<'a> {
    pub(super) points: &'a BTreeMap<u64, Complex>,
    pub(super) survey: &'a BTreeMap<u64, Surveyed>,
    pub(super) span: Span,
}

impl Resolution<'_> {
    /// Lists the turns of frequencies to be added: where the survey is beside the interpolated locus, and between
    /// neighbours of very different phase or gain.
    pub(super) fn further(&self) -> Vec<u64> {
        let locus = self.locus();
        let mut further = Vec::new();
        for (low, high) in self.gaps() {
            let between: Vec<(u64, f64)> = { self.survey.range(low + 1..high) }
                .map(|(turns, one)| (*turns, self.miss(&locus, *turns, one)))
                .collect();
            let worst = { between.iter().enumerate() }.max_by(|a, b| a.1.1.total_cmp(&b.1.1));
            match worst {
                Some((place, (_, miss))) if *miss > MISSED => {
                    let places = [place / 2, place, (place + between.len()) / 2];
                    further.extend(places.map(|place| between[place].0));
                }
                _ if self.is_wide(low, high, LEAST, TURN_DEG) && high - low > 1 => {
                    further.push(u64::midpoint(low, high));
                }
                _ => {}
            }
        }
        further
    }

    /// Returns the reason to refuse a locus whose frequencies miss a mode.
    pub(super) fn refusal(&self) -> Option<String> {
        let locus = self.locus();
        let (low, high) = self.gaps().find(|(low, high)| {
            let missed = self.survey.range(low + 1..*high).any(|(turns, one)| {
                size(one.l) >= DECISIVE && self.miss(&locus, *turns, one) > UNRESOLVED
            });
            missed || self.is_wide(*low, *high, DECISIVE, UNRESOLVED_DEG)
        })?;
        let [low_hz, high_hz] = [low, high].map(|turns| self.span.hz(turns));
        Some(format!(
            "the response has a mode between {low_hz:.4} and {high_hz:.4} Hz that the frequencies do not resolve; give --frequencies {:.4}..{:.4}/60",
            0.9 * low_hz,
            1.1 * high_hz
        ))
    }

    fn locus(&self) -> Vec<Response> {
        let all = self.points.iter().map(|(turns, l)| Response {
            frequency_hz: self.span.hz(*turns),
            l: *l,
        });
        all.collect()
    }

    fn gaps(&self) -> impl Iterator<Item = (u64, u64)> {
        let next = self.points.keys().skip(1);
        self.points.keys().copied().zip(next.copied())
    }

    /// Returns the relative difference of a surveyed response from the locus, as far as the survey is certain.
    fn miss(&self, locus: &[Response], turns: u64, one: &Surveyed) -> f64 {
        let interpolated = at(locus, libm::log(self.span.hz(turns)));
        if size(one.l) < LEAST && size(interpolated) < LEAST {
            return 0.0;
        }
        let difference = change(interpolated, one.l);
        if difference > 3.0 * one.unsteadiness {
            difference
        } else {
            0.0
        }
    }

    /// Returns `true` if a gap between neighbours is too wide for an interpolation.
    fn is_wide(&self, low: u64, high: u64, least: f64, turn_deg: f64) -> bool {
        let (a, b) = (self.points[&low], self.points[&high]);
        let turn = wrapped(libm::atan2(b.1, b.0) - libm::atan2(a.1, a.0));
        let (a, b) = (size(a), size(b));
        let is_steep = a > RATIO * b || b > RATIO * a;
        (a >= least || b >= least) && (turn.to_degrees().abs() > turn_deg || is_steep)
    }
}

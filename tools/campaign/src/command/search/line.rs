//! The edge between passing and failing on the line between two points, by bisection.
//!
//! Bisection is right only where everything fails beyond the first failure, so some points in between are tried first.

use super::spread::distance;
use super::trials::{Stop, Trial, Trials};

/// Neighbours on both sides of the edge.
pub(super) struct Edge {
    pub(super) passes: Trial,
    pub(super) fails: Trial,
    /// Set if no point beyond the first failure passed.
    pub(super) is_monotone: bool,
    /// Distance of the neighbours in units of the ranges, if the runs ended before it was small enough.
    pub(super) too_far: Option<f64>,
}

/// Result on a line.
pub(super) enum Found {
    Edge(Box<Edge>),
    /// The first point already fails.
    StartFails(Trial),
    NothingFails,
}

/// Finds the edge nearest to `from`, up to a distance in units of the ranges.
///
/// # Errors
/// If a point has no result.
pub(super) fn edge(trials: &mut Trials, from: &[f64], to: &[f64]) -> Result<Found, Stop> {
    let search = &trials.evaluator().study().search;
    let (tolerance, most) = (search.tolerance, search.runs - 2);
    let probes = if search.probes < most {
        search.probes
    } else {
        most
    };
    let at = |share: f64| -> Vec<f64> {
        let pairs = from.iter().zip(to);
        pairs.map(|(from, to)| from + (to - from) * share).collect()
    };
    let length = distance(from, to);
    let last = probes + 1;
    let shares: Vec<f64> = (0..=last).map(|one| one as f64 / last as f64).collect();
    let points: Vec<Vec<f64>> = shares.iter().map(|share| at(*share)).collect();
    let mut tried = trials.attempt(&points)?;
    let Some(first) = tried.iter().position(|one| one.is_failed) else {
        return Ok(Found::NothingFails);
    };
    if first == 0 {
        return Ok(Found::StartFails(tried.swap_remove(0)));
    }
    let is_monotone = tried[first..].iter().all(|one| one.is_failed);
    let [mut low, mut high] = [shares[first - 1], shares[first]];
    let [mut passes, mut fails] = [tried[first - 1].clone(), tried[first].clone()];
    let mut too_far = None;
    while (high - low) * length > tolerance {
        if trials.left() == 0 {
            too_far = Some((high - low) * length);
            break;
        }
        let middle = low + (high - low) / 2.0;
        let values = trials.values(&at(middle));
        if values == passes.evaluation.point || values == fails.evaluation.point {
            break; // whole numbers have nothing in between
        }
        for trial in trials.attempt(&[at(middle)])? {
            if trial.is_failed {
                (high, fails) = (middle, trial);
            } else {
                (low, passes) = (middle, trial);
            }
        }
    }
    Ok(Found::Edge(Box::new(Edge {
        passes,
        fails,
        is_monotone,
        too_far,
    })))
}

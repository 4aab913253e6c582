//! Search over several values: corners first, because failures lie at edges, then points spread over the box, then an
//! evolution strategy from each of them that has no better one nearby (multi level single linkage, Rinnooy Kan and
//! Timmer, Mathematical Programming 39, 1987).

use shared_types::random::RandomStream;

use super::trials::{Stop, Trial, Trials};
use crate::cmaes::CmaEs;

/// Largest number of values whose corners are all tried.
const MOST_CORNERED: usize = 4;
/// One of so many runs is spread over the box.
const SPREAD: u64 = 4;
/// Standard deviation of the first generation, in units of the ranges: from the best point and from others.
const STEP: f64 = 0.3;
const NEXT_STEP: f64 = 0.1;

/// Tries the nominal point, then the corners of the box and its centre, then points drawn from all of it; of many values
/// only the ends of each and the far corner.
///
/// # Errors
/// If a point has no result.
pub(super) fn spread(trials: &mut Trials) -> Result<Vec<Trial>, Stop> {
    let nominal = trials.nominal();
    let n = nominal.len();
    let mut points = vec![nominal.clone()];
    if n <= MOST_CORNERED {
        let corner = |number: usize| (0..n).map(|axis| (number >> axis & 1) as f64).collect();
        points.extend((0..1 << n).map(corner));
    } else {
        for axis in 0..n {
            for end in [0.0, 1.0] {
                let mut point = nominal.clone();
                point[axis] = end;
                points.push(point);
            }
        }
        let far = nominal.iter().map(|one| if *one < 0.5 { 1.0 } else { 0.0 });
        points.push(far.collect());
    }
    points.push(vec![0.5; n]);
    let study = trials.evaluator().study();
    let mut random = RandomStream::new(study.seed, "campaign/search");
    for _ in 0..study.search.runs / SPREAD {
        points.push((0..n).map(|_| random.uniform()).collect());
    }
    let most = usize::try_from(trials.left()).unwrap_or(usize::MAX);
    points.truncate(most);
    trials.attempt(&points)
}

/// Moves on from the best of some trials, and from all that have no better one nearby, until few runs are left; returns
/// the best trial. Smaller ranks are better.
///
/// # Errors
/// If a point has no result.
pub(super) fn descend(
    trials: &mut Trials,
    first: &[Trial],
    reserve: u64,
    rank: impl Fn(&Trials, &Trial) -> f64,
) -> Result<Option<Trial>, Stop> {
    let ranked = first.iter().map(|one| (rank(trials, one), one));
    let mut ranked: Vec<(f64, &Trial)> = ranked.collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let dimensions = trials.nominal().len() as f64;
    let near = 2.0 * libm::pow(first.len() as f64, -1.0 / dimensions);
    let mut best: Option<(f64, Trial)> = None;
    for (place, start) in ranked.iter().enumerate() {
        let is_near = |(_, one): &(f64, &Trial)| distance(&one.unit, &start.1.unit) < near;
        // Without a finite rank nothing says which way is down.
        if place > 0 && (!start.0.is_finite() || ranked[..place].iter().any(is_near)) {
            continue;
        }
        let step = if place == 0 { STEP } else { NEXT_STEP };
        let end = converge(trials, *start, step, reserve, &rank)?;
        let is_better = best.as_ref().is_none_or(|best| end.0 < best.0);
        if is_better {
            best = Some(end);
        }
    }
    Ok(best.map(|(_, trial)| trial))
}

/// Returns the distance of two points.
pub(super) fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

/// Moves on from a trial by an evolution strategy until it has converged or few runs are left; returns the best trial
/// with its rank.
fn converge(
    trials: &mut Trials,
    (mut least, start): (f64, &Trial),
    step: f64,
    reserve: u64,
    rank: &impl Fn(&Trials, &Trial) -> f64,
) -> Result<(f64, Trial), Stop> {
    let mut best = start.clone();
    let study = trials.evaluator().study();
    let (tolerance, seed) = (study.search.tolerance, study.seed);
    let mut search = CmaEs::new(&best.unit, step, seed);
    let patience = 10 + 10 * best.unit.len();
    let mut idle = 0;
    while search.deviation() > tolerance / 4.0 && idle < patience {
        let candidates = search.candidates();
        if trials.left() < candidates.len() as u64 + reserve {
            break;
        }
        let inside: Vec<Vec<f64>> = candidates.iter().map(|one| reflected(one)).collect();
        let tried = trials.attempt(&inside)?;
        let ranks = tried.iter().map(|one| rank(trials, one));
        let mut generation: Vec<_> = ranks.zip(tried.iter().zip(candidates)).collect();
        generation.sort_by(|a, b| a.0.total_cmp(&b.0));
        idle += 1;
        if let Some((rank, (trial, _))) = generation.first()
            && *rank < least
        {
            (least, best, idle) = (*rank, (*trial).clone(), 0);
        }
        let ranked: Vec<Vec<f64>> = generation.into_iter().map(|(_, (_, one))| one).collect();
        search.adapt(&ranked);
    }
    Ok((least, best))
}

/// Reflects a point into the box at the faces that it passed.
fn reflected(point: &[f64]) -> Vec<f64> {
    let inside = point.iter().map(|one| {
        let phase = one.rem_euclid(2.0);
        if phase > 1.0 { 2.0 - phase } else { phase }
    });
    inside.collect()
}

#[cfg(test)]
mod tests {
    use super::reflected;

    #[test]
    fn a_point_outside_of_the_box_is_reflected_into_it() {
        assert_eq!(
            reflected(&[-0.25, 0.5, 1.25, 2.0, -1.5]),
            [0.25, 0.5, 0.75, 0.0, 0.5]
        );
    }
}

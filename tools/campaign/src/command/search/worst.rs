//! `hil search worst`: the case with the least margin in the box of all ranges.

use super::answer::Answer;
use super::spread::{descend, spread};
use super::trials::{Stop, Trials};

/// Searches the case with the least margin.
///
/// # Errors
/// If no case has a margin, or a point has no result.
pub(super) fn worst(trials: &mut Trials) -> Result<Answer, Stop> {
    let first = spread(trials)?;
    if first
        .iter()
        .all(|one| one.share.is_infinite() && !one.is_failed)
    {
        let (name, _) = trials.requirement(&first[0]);
        return Err(Stop::Refused(format!(
            "`{name}` has no finite margin (NaN or infinite) in any of {} points of the box, so nothing says which way failures lie; write it as a comparison of numbers that is always judged, or use hil search smallest with one value",
            first.len()
        )));
    }
    let best = descend(trials, &first, 0, |_, trial| trial.share)?;
    best.map(Answer::worst)
        .ok_or_else(|| Stop::Refused("no run is allowed; raise `runs` in [search]".into()))
}

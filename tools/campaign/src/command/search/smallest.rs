//! `hil search smallest`: the smallest departure from the nominal values that breaks a requirement.

use shared_types::number::{counted, short, short_in};

use super::answer::Answer;
use super::line::{Edge, Found, edge};
use super::spread::{descend, spread};
use super::trials::{Stop, Trial, Trials};

/// Searches one value by bisection towards each end of its range, several by an evolution strategy.
///
/// # Errors
/// If nothing fails, the nominal point already fails, or a point has no result.
pub(super) fn smallest(trials: &mut Trials) -> Result<Answer, Stop> {
    let nominal = trials.nominal();
    let ends = match nominal[..] {
        [one] => {
            let ends = [1.0, 0.0].into_iter().filter(|end| *end != one);
            ends.map(|end| vec![end]).collect()
        }
        _ => nearest(trials)?,
    };
    let mut best: Option<Box<Edge>> = None;
    for end in ends {
        match edge(trials, &nominal, &end)? {
            Found::StartFails(trial) => return Err(already_fails(trials, &trial)),
            Found::NothingFails => {}
            Found::Edge(found) => {
                let distance = |edge: &Edge| trials.distance(&edge.fails);
                if { best.as_ref() }.is_none_or(|best| distance(&found) < distance(best)) {
                    best = Some(found);
                }
            }
        }
    }
    match best {
        Some(edge) => Ok(Answer::edge(trials, *edge)),
        None => Err(nothing_fails(trials)),
    }
}

/// Finds a failing point near the nominal one; returns it as the end of a line.
fn nearest(trials: &mut Trials) -> Result<Vec<Vec<f64>>, Stop> {
    let first = spread(trials)?;
    if let Some(nominal) = first.first().filter(|one| one.is_failed) {
        return Err(already_fails(trials, nominal));
    }
    let search = &trials.evaluator().study().search;
    // Kept for the bisection of the last line.
    let halvings = -libm::log2(search.tolerance) + 2.0;
    let reserve = search.probes + halvings as u64;
    // Failing points are ranked by their distances, all others after them by their margins.
    let beyond = (trials.nominal().len() as f64).sqrt() + 1.0;
    let best = descend(trials, &first, reserve, |trials, trial| {
        if trial.is_failed {
            trials.distance(trial)
        } else {
            beyond + trial.share
        }
    })?;
    let failing = best.filter(|one| one.is_failed);
    Ok(failing.into_iter().map(|one| one.unit).collect())
}

fn already_fails(trials: &Trials, trial: &Trial) -> Stop {
    let point = trials.evaluator().describe(&trial.evaluation.point);
    Stop::Refused(format!(
        "the nominal case already fails: {} at {point}; move `nominal` or `min` of the study to values that pass, or mend the case first",
        failure(trials, trial)
    ))
}

/// Describes the failure of a case.
fn failure(trials: &Trials, trial: &Trial) -> String {
    let (name, unit) = trials.requirement(trial);
    match &*trial.evaluation.class {
        "diverged" => format!("it diverges ({})", trial.evaluation.reason),
        _ if Trials::margin(trial) == f64::NEG_INFINITY => format!(
            "`{name}` fails without a margin, because a value in its formula is missing or no number"
        ),
        _ => format!(
            "`{name}` has margin {}",
            short_in(Trials::margin(trial), unit)
        ),
    }
}

fn nothing_fails(trials: &Trials) -> Stop {
    let all = trials.all();
    let names: Vec<&str> = { trials.evaluator().dimensions().iter() }
        .map(|one| &*one.name)
        .collect();
    let names = names.join(", ");
    let is_same = |of: fn(&Trial) -> u64| all.iter().all(|one| of(one) == of(&all[0]));
    if all
        .iter()
        .all(|one| one.evaluation.digest == all[0].evaluation.digest)
    {
        return Stop::Refused(format!(
            "{names} changes no signal: all {} runs have one digest; look for a value that this plant, law or fault does not use, or a fault that begins after the end of the run",
            all.len()
        ));
    }
    if is_same(|one| one.share.to_bits()) {
        let least = |one: &Trial| format!("`{}`", trials.requirement(one).0);
        let mut least: Vec<String> = all.iter().map(least).collect();
        least.sort();
        least.dedup();
        let margin = match &least[..] {
            [one] => format!("{one} has the same margin"),
            several => format!(
                "the least margin, of {}, is the same share of the nominal one",
                several.join(" or ")
            ),
        };
        return Stop::Refused(format!(
            "{margin} in all {} runs, whatever {names} is: either no signal of its formula is reached, or another part of the formula decides; search another requirement, or vary a value or fault that acts on its signals",
            all.len()
        ));
    }
    let least = all.iter().min_by(|a, b| a.share.total_cmp(&b.share));
    let nearest = least.map_or_else(String::new, |one| {
        let (name, unit) = trials.requirement(one);
        let point = trials.evaluator().describe(&one.evaluation.point);
        match Trials::margin(one) {
            margin if margin.is_finite() => format!(
                "; nearest to failing is {point}, where `{name}` has margin {}",
                short_in(margin, unit)
            ),
            _ => "; no case has a finite margin, so nothing says which way failures lie".into(),
        }
    });
    let ranges = trials.evaluator().dimensions().iter();
    let ranges = ranges.map(|one| format!("{} {} to {}", one.name, short(one.min), short(one.max)));
    Stop::Refused(format!(
        "none of {} in {} fails{nearest}; widen the range, or raise `{}` in [search] to try more of it",
        counted(trials.runs(), "run"),
        ranges.collect::<Vec<String>>().join(", "),
        if trials.nominal().len() == 1 {
            "probes"
        } else {
            "runs"
        }
    ))
}

//! Answers of a complete campaign: classes, probabilities with bounds, margins with quantiles, worst cases, rank
//! correlations and the study's goals.
//!
//! Bounds are given only for independent draws. A diverged case has not passed and ranks below any other case; an
//! undecided or vacuous case has not passed either and has a class of its own. A case that was set aside could have any outcome,
//! so no bounds are given in that case.

mod gathered;
pub(super) mod outcomes;

use crate::binomial;
use crate::collect::Collected;
use crate::manifest::Manifest;
use crate::rank::Order;
use crate::sensitivity::Indices;
use crate::table::{CLASS, Column, LOST, NOT_POSSIBLE, Row};
use crate::{order, rank, sensitivity};
use hil_config::study::{Goal, Sampling, Spread, Study, Varied};
use hil_facts::results::requirements::{self, VACUOUS};
use serde::Serialize;
use shared_types::table::number;

use gathered::Cases;
pub(super) use gathered::Gathered;
use outcomes::{OutcomeRow, Outcomes};

/// Classes of cases.
pub(super) const CLASSES: [&str; 7] = [
    "pass",
    "fail",
    "diverged",
    "undecided",
    LOST,
    VACUOUS,
    NOT_POSSIBLE,
];
/// Index of [`LOST`], which unknown classes count as.
const LOST_PLACE: usize = 4;
/// Number of classes that every table shows; the others appear where they have cases.
const SHOWN_ALWAYS: usize = 5;

/// Returns the indices of the classes to display.
pub(super) fn shown_classes(variants: &[VariantAnswer]) -> Vec<usize> {
    let has_cases = |place: &usize| variants.iter().any(|one| one.classes[*place] > 0);
    (0..CLASSES.len())
        .filter(|place| *place < SHOWN_ALWAYS || has_cases(place))
        .collect()
}

/// Returns the class names to display: cases without a requirement are not called a pass.
pub(super) fn classes_in_words(requirements: usize) -> [&'static str; CLASSES.len()] {
    CLASSES.map(|class| requirements::in_words(class, requirements))
}

/// Quantiles of margins that are reported.
const QUANTILES: [f64; 3] = [0.01, 0.05, 0.5];
/// Maximum number of worst cases and correlations that are reported.
const MOST: usize = 5;

/// Results of a campaign.
#[derive(Debug, Serialize)]
pub(super) struct Answers {
    pub(super) name: String,
    pub(super) cases: u64,
    pub(super) draws: u64,
    pub(super) sampling: &'static str,
    pub(super) confidence: f64,
    pub(super) digest: Option<String>,
    /// Cases that were set aside.
    pub(super) lost: Vec<u64>,
    pub(super) variants: Vec<VariantAnswer>,
    pub(super) goals: Vec<GoalAnswer>,
    /// Faults by outcomes, of a campaign that tries some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) faults: Vec<OutcomeRow>,
}

impl Answers {
    /// Returns the number of requirements.
    pub(super) fn requirements(&self) -> usize {
        self.variants
            .first()
            .map_or(0, |one| one.requirements.len())
    }
}

/// Share of cases, with bounds of the underlying probability.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Share {
    pub(super) count: u64,
    pub(super) of: u64,
    pub(super) bounds: Option<BoundsAnswer>,
}

/// Clopper-Pearson bounds.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct BoundsAnswer {
    pub(super) lower: f64,
    pub(super) upper: f64,
    /// Always `both`: each bound has half of the risk.
    pub(super) sided: &'static str,
}

/// Results of a variant.
#[derive(Debug, Serialize)]
pub(super) struct VariantAnswer {
    pub(super) name: String,
    /// Number of cases of each class, in the order of [`CLASSES`].
    pub(super) classes: [u64; CLASSES.len()],
    pub(super) passes: Share,
    pub(super) requirements: Vec<RequirementAnswer>,
    /// First few cases that diverged.
    pub(super) diverged: Vec<u64>,
}

/// Results of a requirement in a variant.
#[derive(Debug, Serialize)]
pub(super) struct RequirementAnswer {
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) holds: Share,
    pub(super) quantiles: Vec<QuantileAnswer>,
    /// Number of possible cases with a NaN margin, which is neither good nor bad.
    pub(super) without: u64,
    pub(super) worst: Vec<WorstAnswer>,
    /// Rank correlations of the margin with varied values, strongest first.
    pub(super) correlations: Vec<(String, f64)>,
    /// Set if the margins differ only by rounding, so that they correlate with nothing.
    pub(super) is_rounding: bool,
    /// Sobol' indices of the margin for each drawn value; empty unless the sampling gives them and every margin is
    /// finite.
    pub(super) indices: Vec<IndicesAnswer>,
}

/// Sobol' indices of a varied value.
#[derive(Debug, Serialize)]
pub(super) struct IndicesAnswer {
    pub(super) name: String,
    #[serde(flatten)]
    pub(super) indices: Indices,
}

/// Quantile of a margin.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct QuantileAnswer {
    pub(super) p: f64,
    /// NaN without a margin, and between minus infinity and infinity.
    pub(super) value: Margin,
    /// Bounds, if there are enough independent draws.
    pub(super) bounds: Option<[Margin; 2]>,
}

/// Case with its margin.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct WorstAnswer {
    pub(super) case: u64,
    pub(super) margin: Margin,
}

/// Margin that may be infinite; in JSON infinities become strings and NaN becomes null.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Margin(pub(super) f64);

impl Serialize for Margin {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            value if value.is_nan() => to.serialize_none(),
            value => number::serialize(&value, to),
        }
    }
}

/// Result of a goal.
#[derive(Debug, Serialize)]
pub(super) struct GoalAnswer {
    pub(super) variant: String,
    /// Requirement; `None` for a goal about cases that pass.
    pub(super) requirement: Option<String>,
    pub(super) probability: f64,
    pub(super) confidence: f64,
    pub(super) share: Share,
    /// One-sided lower bound of the probability.
    pub(super) lower: f64,
    pub(super) is_met: bool,
}

/// Returns the class of a row.
pub(super) fn class_of<'a>(manifest: &Manifest, row: &'a Row) -> &'a str {
    manifest
        .place(CLASS)
        .map_or("", |place| row[place].as_text())
}

/// Returns the index of a class in [`CLASSES`]; unknown classes count as lost.
pub(super) fn place_of(class: &str) -> usize {
    let known = CLASSES.iter().position(|known| *known == class);
    known.unwrap_or(LOST_PLACE)
}

/// Computes the results of a campaign from its cases.
pub(super) fn of(gathered: Gathered, collected: &Collected) -> Answers {
    let Gathered {
        manifest,
        study,
        varied,
        requirements,
        variants: cases,
        outcomes,
        ..
    } = gathered;
    let (digest, lost) = (collected.digest.clone(), collected.lost.clone());
    let is_sure = study.sampling == Sampling::Independent && lost.is_empty() && digest.is_some();
    let variants: Vec<VariantAnswer> = (study.variants.iter().zip(cases))
        .map(|(variant, cases)| {
            answer(&variant.name, cases, study, &varied, &requirements, is_sure)
        })
        .collect();
    let goals = study.goals.iter().flat_map(|goal| {
        let of = variants
            .iter()
            .filter(|one| goal.variant.as_ref().is_none_or(|name| *name == one.name));
        of.map(|variant| goal_answer(goal, variant, is_sure))
            .collect::<Vec<_>>()
    });
    Answers {
        name: manifest.name.clone(),
        cases: manifest.cases,
        draws: study.draws,
        sampling: study.sampling.name(),
        confidence: study.confidence,
        digest,
        lost,
        goals: goals.collect(),
        variants,
        faults: outcomes.map(Outcomes::rows).unwrap_or_default(),
    }
}

/// Returns the margin that orders cases: a diverged case ranks below any other case, and a verdict without a margin is
/// infinite.
pub(super) fn margin(verdict: &str, class: &str, robustness: f64) -> f64 {
    match verdict {
        _ if class == "diverged" => f64::NEG_INFINITY,
        "fail" if robustness.is_nan() => f64::NEG_INFINITY,
        "pass" | VACUOUS if robustness.is_nan() => f64::INFINITY,
        _ => robustness,
    }
}

fn answer(
    name: &str,
    cases: Cases,
    study: &Study,
    varied: &[&Column],
    requirements: &[(String, String)],
    is_sure: bool,
) -> VariantAnswer {
    let not_possible = cases.classes[place_of(NOT_POSSIBLE)];
    let of = cases.case.len() as u64 - not_possible;
    let can_fail = !requirements.is_empty();
    let confidence = is_sure.then_some(study.confidence);
    let ranks: Vec<Vec<f64>> = cases
        .varied
        .iter()
        .map(|values| rank::ranks(values))
        .collect();
    let answers = requirements.iter().zip(&cases.holds).zip(&cases.margins);
    let requirements = answers.map(|(((name, unit), holds), margins)| {
        let order = Order::of(margins);
        // NaN margins sort last.
        let is_there = |place: &usize| !margins[*place].is_nan();
        let places: Vec<usize> = order.places().take_while(is_there).collect();
        let sorted: Vec<f64> = places.iter().map(|place| margins[*place]).collect();
        // The cases with a margin are not a random sample of all cases.
        let bounded = confidence.filter(|_| sorted.len() == margins.len());
        let worst = places.iter().take(MOST).map(|place| WorstAnswer {
            case: cases.case[*place],
            margin: Margin(margins[*place]),
        });
        // Over the cases with a margin, which are nearly always all of them.
        let is_rounding = rank::is_rounding(&sorted);
        let margin_ranks = match is_rounding {
            true => rank::ranks(&existing(margins, without_rounding(margins))),
            false => existing(margins, order.ranks()),
        };
        let pairs = varied.iter().zip(&ranks).zip(&cases.varied);
        let correlations = pairs.filter_map(|((column, ranks), values)| {
            let rho = match sorted.len() == margins.len() {
                true => rank::of_ranks(ranks, &margin_ranks)?,
                false => {
                    let values = existing(margins, values.clone());
                    rank::of_ranks(&rank::ranks(&values), &margin_ranks)?
                }
            };
            Some((column.name.clone(), rho))
        });
        let mut correlations: Vec<(String, f64)> = correlations.collect();
        correlations.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        correlations.truncate(MOST);
        RequirementAnswer {
            name: name.clone(),
            unit: unit.clone(),
            holds: share(*holds, of, confidence),
            quantiles: QUANTILES.map(|p| quantile(&sorted, p, bounded)).into(),
            without: (margins.len() - sorted.len()) as u64 - not_possible,
            worst: worst.collect(),
            correlations,
            is_rounding,
            indices: indices(study, margins, is_rounding),
        }
    });
    let mut diverged = cases.diverged;
    diverged.truncate(MOST);
    VariantAnswer {
        name: name.into(),
        classes: cases.classes,
        // Without a requirement, passing means nothing.
        passes: share(cases.classes[0], of, confidence.filter(|_| can_fail)),
        requirements: requirements.collect(),
        diverged,
    }
}

/// Computes the Sobol' indices of margins in the order of the draws.
fn indices(study: &Study, margins: &[f64], is_rounding: bool) -> Vec<IndicesAnswer> {
    let is_whole = margins.len() as u64 == study.draws;
    if study.sampling != Sampling::Saltelli || !is_whole || is_rounding {
        return Vec::new();
    }
    let all = sensitivity::indices(margins, study.drawn(), study.confidence, study.seed);
    let drawn = |one: &&Varied| !matches!(one.spread, Spread::Expression(_));
    let names = study.varied.iter().filter(drawn);
    let named = names.zip(all.into_iter().flatten());
    let named = named.map(|(one, indices)| IndicesAnswer {
        name: one.name.clone(),
        indices,
    });
    named.collect()
}

/// Replaces all finite margins by the same value, so that only infinite margins differ.
fn without_rounding(margins: &[f64]) -> Vec<f64> {
    let equal = |margin: &f64| if margin.is_finite() { 0.0 } else { *margin };
    margins.iter().map(equal).collect()
}

/// Removes the values of cases without a margin.
fn existing(margins: &[f64], mut values: Vec<f64>) -> Vec<f64> {
    let mut margins = margins.iter();
    values.retain(|_| margins.next().is_some_and(|margin| !margin.is_nan()));
    values
}

fn share(count: u64, of: u64, confidence: Option<f64>) -> Share {
    let bounds = confidence.and_then(|confidence| binomial::bounds(count, of, confidence));
    let bounds = bounds.map(|bounds| BoundsAnswer {
        lower: bounds.lower,
        upper: bounds.upper,
        sided: "both",
    });
    Share { count, of, bounds }
}

fn quantile(sorted: &[f64], p: f64, confidence: Option<f64>) -> QuantileAnswer {
    let bounds = confidence.and_then(|confidence| {
        let (low, high) = order::quantile_bounds(sorted.len() as u64, p, confidence)?;
        let at = |place: u64| sorted.get(usize::try_from(place).ok()?).copied();
        Some([Margin(at(low)?), Margin(at(high)?)])
    });
    QuantileAnswer {
        p,
        value: Margin(order::quantile(sorted, p)),
        bounds,
    }
}

/// Evaluates a goal for a variant; only independent draws and a result for every case can meet a goal.
fn goal_answer(goal: &Goal, variant: &VariantAnswer, is_sure: bool) -> GoalAnswer {
    let none = Share {
        count: 0,
        of: variant.passes.of,
        bounds: None,
    };
    let share = match &goal.requirement {
        None => variant.passes,
        Some(name) => {
            let requirement = variant.requirements.iter().find(|one| one.name == *name);
            requirement.map_or(none, |one| one.holds)
        }
    };
    let lower = match is_sure {
        true => binomial::lower(share.count, share.of, goal.confidence),
        false => 0.0,
    };
    GoalAnswer {
        variant: variant.name.clone(),
        requirement: goal.requirement.clone(),
        probability: goal.probability,
        confidence: goal.confidence,
        share,
        lower,
        is_met: is_sure && lower >= goal.probability,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const INF: f64 = f64::INFINITY;

    fn quantile_json(sorted: &[f64], p: f64) -> serde_json::Value {
        serde_json::to_value(quantile(sorted, p, Some(0.9))).expect("JSON")
    }

    #[test]
    fn an_infinite_quantile_is_distinguished_from_too_few_cases() {
        // Two of twenty diverged, two hold without a margin.
        let mut sorted = vec![-INF, -INF];
        sorted.extend((1..17).map(f64::from));
        sorted.extend([INF, INF]);
        let low = quantile_json(&sorted, 0.05);
        assert_eq!(low["value"], "-inf");
        // Too few for a bound below the quantile at 5 %.
        assert_eq!(low["bounds"], json!(null));
        let high = quantile_json(&sorted, 0.9);
        assert_eq!(high["value"], json!("inf"));
        let median = quantile_json(&sorted, 0.5);
        assert_eq!(median["value"], json!(8.5));
        assert!(median["bounds"][0].is_number(), "{median}");
        // The bounds of the quantile at 20 % begin with a case that diverged.
        let bounded = quantile_json(&sorted, 0.2);
        assert_eq!(bounded["bounds"][0], json!("-inf"), "{bounded}");
        assert!(bounded["bounds"][1].is_number(), "{bounded}");
        assert_eq!(quantile_json(&[], 0.5)["value"], json!(null));
        assert_eq!(quantile_json(&[-INF, INF], 0.5)["value"], json!(null));
    }

    #[test]
    fn diverged_cases_still_differ_from_margins_equal_up_to_rounding() {
        let margins = [1.0, 1.0 + 1e-12, -INF, 1.0 - 1e-12, f64::NAN];
        assert_eq!(without_rounding(&margins)[..4], [0.0, 0.0, -INF, 0.0]);
        assert!(without_rounding(&margins)[4].is_nan());
    }
}

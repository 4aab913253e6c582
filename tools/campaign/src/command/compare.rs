//! Comparison of two campaigns on the same draws: cases that pass in only one of them, and the significance of the
//! difference.

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;

use crate::folder::Folder;
use crate::manifest::Manifest;
use crate::mcnemar;
use crate::table::{CLASS, LOST, NOT_POSSIBLE};
use serde::Serialize;
use shared_types::number::{counted, short};

use super::collect::{listed, read, tell_conflicts};
use super::work::open;
use crate::arguments::CompareCampaignArguments;

/// Difference of two campaigns in one variant.
#[derive(Debug, Serialize)]
struct Flips {
    variant: String,
    cases: u64,
    /// Number of cases that are left out because a campaign has no result for them.
    lost: u64,
    /// Cases that pass only in the first campaign.
    first_only: Vec<u64>,
    /// Cases that pass only in the second campaign.
    second_only: Vec<u64>,
    /// Exact two-sided p value of McNemar's test.
    p: f64,
}

/// Compares two campaigns.
///
/// # Errors
/// If the campaigns cannot be compared.
pub(super) fn compare(arguments: &CompareCampaignArguments) -> Result<Exit, Failure> {
    let (first, second) = (open(&arguments.first)?, open(&arguments.second)?);
    let flips = flips(&first, &second)?;
    output::result(arguments.json, &flips, || describe(&flips))?;
    // A contradictory result cannot be distinguished from a changed verdict.
    let conflicts = tell_conflicts(&first)? + tell_conflicts(&second)?;
    let has_flipped = |one: &Flips| !(one.first_only.is_empty() && one.second_only.is_empty());
    Ok(match conflicts > 0 || flips.iter().any(has_flipped) {
        true => Exit::Failed,
        false => Exit::Pass,
    })
}

fn describe(flips: &[Flips]) -> String {
    let mut text = String::new();
    for one in flips {
        let Flips {
            variant,
            cases,
            lost,
            first_only,
            second_only,
            p,
        } = one;
        text += &format!(
            "{variant}: {}, {} pass only in the first, {} only in the second; McNemar p = {}\n",
            counted(*cases, "case"),
            first_only.len(),
            second_only.len(),
            short(*p)
        );
        if *lost > 0 {
            text += &format!(
                "  {} left out, because one campaign has no result for them\n",
                counted(*lost, "case")
            );
        }
        for (which, cases) in [("first", first_only), ("second", second_only)] {
            if !cases.is_empty() {
                text += &format!("  only in the {which}: {}\n", listed(cases));
            }
        }
    }
    text
}

/// Data of a case that is compared.
struct Case {
    /// Hash of the case's number, variant, seed and varied values.
    values: blake3::Hash,
    /// Index of the case's variant.
    variant: usize,
    /// Verdict; `None` if the case was set aside or is not possible.
    passes: Option<bool>,
}

/// Counts the columns before the class, which identify a case.
fn head(manifest: &Manifest) -> usize {
    manifest.place(CLASS).unwrap_or(0)
}

/// Reads the cases of a campaign, with the names of its variants.
fn cases(folder: &Folder) -> Result<(Vec<Case>, Vec<String>), Failure> {
    let head = head(folder.manifest());
    let variants = folder.manifest().place("variant").unwrap_or(0);
    let (mut all, mut names): (_, Vec<String>) = (Vec::new(), Vec::new());
    let mut fed = Vec::new();
    read(folder, false, |part| {
        let columns = part.results();
        for row in 0..part.cases().len() {
            fed.clear();
            columns[..head]
                .iter()
                .for_each(|column| column.feed(row, &mut fed));
            let name = columns[variants].text(row);
            let variant = names.iter().position(|known| known == name);
            let variant = variant.unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            });
            let class = columns[head].text(row);
            all.push(Case {
                values: blake3::hash(&fed),
                variant,
                passes: (![LOST, NOT_POSSIBLE].contains(&class)).then_some(class == "pass"),
            });
        }
    })?;
    Ok((all, names))
}

/// Finds the cases whose verdict changed, for variants of the same name.
fn flips(first: &Folder, second: &Folder) -> Result<Vec<Flips>, Failure> {
    let (one, other) = (first.manifest(), second.manifest());
    let column = |place: usize| [&one.columns, &other.columns].map(|columns| columns.get(place));
    let differs = (0..one.columns.len().max(other.columns.len()))
        .take_while(|place| {
            column(*place)
                .iter()
                .flatten()
                .all(|column| column.name != CLASS)
        })
        .find(|place| column(*place)[0] != column(*place)[1]);
    let is_other = one.cases != other.cases || differs.is_some();
    let not_comparable = |what: String| {
        Failure::usage(format!(
            "{what}: only campaigns on the same draws can be compared case by case"
        ))
    };
    if is_other {
        return Err(not_comparable(format!(
            "{} has {} cases and {} has {}, or their varied values differ",
            first.path().display(),
            one.cases,
            second.path().display(),
            other.cases
        )));
    }
    let (first, names) = cases(first)?;
    let (second, _) = cases(second)?;
    let flips = names.into_iter().map(|variant| Flips {
        variant,
        cases: 0,
        lost: 0,
        first_only: Vec::new(),
        second_only: Vec::new(),
        p: 1.0,
    });
    let mut all: Vec<Flips> = flips.collect();
    for (case, (a, b)) in (0..).zip(first.iter().zip(&second)) {
        if a.values != b.values {
            return Err(not_comparable(format!(
                "case {case} has different values in the two campaigns"
            )));
        }
        let flips = &mut all[a.variant];
        let Some(passes) = a.passes.zip(b.passes) else {
            flips.lost += 1;
            continue;
        };
        flips.cases += 1;
        match passes {
            (true, false) => flips.first_only.push(case),
            (false, true) => flips.second_only.push(case),
            _ => {}
        }
    }
    for flips in &mut all {
        flips.p = mcnemar::exact(
            flips.first_only.len() as u64,
            flips.second_only.len() as u64,
        );
    }
    Ok(all)
}

//! Two campaigns on the same draws: which cases pass in one and not in the other, and whether chance explains it.

use hil_campaign::folder::Folder;
use hil_campaign::mcnemar;
use hil_campaign::shard::Shard;
use hil_campaign::table::{CLASS, LOST};
use serde::Serialize;
use shared_types::number::{counted, short};

use super::answers::class_of;
use super::collect::{listed, read, tell_conflicts};
use super::work::{cannot, open};
use crate::arguments::campaign::CompareCampaignArguments;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;

/// Difference of two campaigns in a variant.
#[derive(Debug, Serialize)]
struct Flips {
    variant: String,
    cases: u64,
    /// Cases that are left out, as one campaign has no result of them.
    lost: u64,
    /// Cases that pass in the first campaign alone.
    first_only: Vec<u64>,
    /// Cases that pass in the second campaign alone.
    second_only: Vec<u64>,
    /// Exact two-sided p value of McNemar's test.
    p: f64,
}

/// Compares two campaigns.
///
/// # Errors
/// If they cannot be compared.
pub(super) fn compare(arguments: &CompareCampaignArguments) -> Result<Exit, Failure> {
    let (first, second) = (open(&arguments.first)?, open(&arguments.second)?);
    for folder in [&first, &second] {
        read(folder, false)?;
    }
    let flips = flips(&first, &second)?;
    output::result(arguments.json, &flips, || told(&flips))?;
    // What came out twice and not the same cannot be told from what flipped.
    let conflicts = tell_conflicts(&first)? + tell_conflicts(&second)?;
    let has_flipped = |one: &Flips| !(one.first_only.is_empty() && one.second_only.is_empty());
    Ok(match conflicts > 0 || flips.iter().any(has_flipped) {
        true => Exit::Failed,
        false => Exit::Pass,
    })
}

fn told(flips: &[Flips]) -> String {
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
            "{variant}: {}, {} pass in the first alone, {} in the second alone; McNemar p = {}\n",
            counted(*cases, "case"),
            first_only.len(),
            second_only.len(),
            short(*p)
        );
        if *lost > 0 {
            text += &format!(
                "  {} left out: a campaign has no result of them\n",
                counted(*lost, "case")
            );
        }
        for (which, cases) in [("first", first_only), ("second", second_only)] {
            if !cases.is_empty() {
                text += &format!("  those of the {which} alone {}\n", listed(cases));
            }
        }
    }
    text
}

/// Finds the cases that flipped, by variants of one name.
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
            "{} has {} cases and {} has {}, or other values vary",
            first.path().display(),
            one.cases,
            second.path().display(),
            other.cases
        )));
    }
    let mut all: Vec<Flips> = Vec::new();
    let head = one
        .columns
        .iter()
        .position(|column| column.name == CLASS)
        .unwrap_or_default();
    let mut rows = [Vec::new().into_iter(), Vec::new().into_iter()];
    let mut shards = [0, 0];
    for case in 0..one.cases {
        let mut pair = Vec::new();
        for ((rows, shard), folder) in rows.iter_mut().zip(&mut shards).zip([first, second]) {
            let row = match rows.next() {
                Some(row) => row,
                None => {
                    let part = Shard::of(folder, *shard)
                        .part()
                        .map_err(|error| cannot(folder, &error))?;
                    *shard += 1;
                    *rows = part.rows.into_iter();
                    rows.next().unwrap_or_default()
                }
            };
            pair.push(row);
        }
        let (a, b) = (&pair[0], &pair[1]);
        if a[..head] != b[..head] {
            return Err(not_comparable(format!(
                "case {case} has other values in one than in the other"
            )));
        }
        let variant = super::answers::text(a.get(2)).to_owned();
        let classes = [(one, a), (other, b)].map(|(manifest, row)| class_of(manifest, row));
        let passes = classes.map(|class| class == "pass");
        let place = all.iter().position(|flips| flips.variant == variant);
        let place = place.unwrap_or_else(|| {
            all.push(Flips {
                variant,
                cases: 0,
                lost: 0,
                first_only: Vec::new(),
                second_only: Vec::new(),
                p: 1.0,
            });
            all.len() - 1
        });
        let flips = &mut all[place];
        if classes.contains(&LOST) {
            flips.lost += 1;
            continue;
        }
        flips.cases += 1;
        match passes {
            [true, false] => flips.first_only.push(case),
            [false, true] => flips.second_only.push(case),
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

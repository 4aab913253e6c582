//! Signals and bins of a campaign's curves: the signals that the report of a run would plot first.

use std::collections::BTreeMap;

use hil_config::plan::{Derived, Plan};
use hil_facts::results::curve::Grid;
use hil_recording::reader::Column;
use hil_views::plots::bounds::bounds;
use hil_views::plots::signal::recorded_name;
use hil_views::plots::words::in_words;
use hil_views::plots::{Choice, Subject, choose, columns_of, descriptions_of};
use shared_types::record::RecordLayout;
use shared_types::time::Step;

/// Maximum numbers of signals and bins.
const MOST_SIGNALS: usize = 8;
const MOST_BINS: u64 = 100;
/// Approximate number of draws whose curves are stored.
pub(super) const DRAWS: u64 = 1000;

/// Chooses signals and bins from the first case of each variant and its record layout; `None` if there is nothing to
/// plot.
pub(super) fn chosen(
    variants: &[(Plan, RecordLayout)],
    longest_s: f64,
    draws: u64,
) -> Option<Grid> {
    let mut columns: Vec<Column> = Vec::new();
    for (plan, layout) in variants {
        for column in columns_of(layout, &plan.derived) {
            if columns.iter().all(|known| known.name != column.name) {
                columns.push(column);
            }
        }
    }
    let subjects = variants.iter().map(|(plan, _)| subject(plan));
    let recorded = columns.iter().map(|column| Column {
        name: recorded_name(&column.name),
        unit: column.unit.clone(),
    });
    let recorded: Vec<Column> = recorded.collect();
    let plots = choose(&Choice {
        columns: &recorded,
        subjects: &subjects.collect::<Vec<_>>(),
        patterns: &[],
        values: None,
    });
    // Differences due to sensors and channels are seldom worth a second plot.
    let main_plots = plots.iter().filter(|plot| plot.section != "Interface");
    let mut signals: Vec<(String, String)> = Vec::new();
    for name in main_plots.flat_map(|plot| &plot.signals) {
        let place = recorded.iter().position(|column| column.name == *name);
        let Some(column) = place.map(|place| &columns[place]) else {
            continue;
        };
        let is_known = signals.iter().any(|(known, _)| *known == column.name);
        if !is_known && !name.starts_with("reference.") && signals.len() < MOST_SIGNALS {
            signals.push((column.name.clone(), column.unit.clone()));
        }
    }
    let steps = variants.iter().map(|(plan, _)| plan.run.steps).max()?;
    let bins = if steps < MOST_BINS { steps } else { MOST_BINS };
    // Of several variants the first that describes a signal counts.
    let layouts = variants.iter().rev().map(|(_, layout)| layout);
    let descriptions: BTreeMap<String, String> = layouts.flat_map(descriptions_of).collect();
    (!signals.is_empty() && longest_s > 0.0).then_some(Grid {
        words: (signals.iter())
            .map(|(name, unit)| {
                let description = descriptions.get(&recorded_name(name));
                in_words(name, unit, description.map(String::as_str))
            })
            .collect(),
        signals,
        bins: usize::try_from(bins).ok()?,
        bin_s: longest_s / bins as f64,
        every: draws.div_ceil(DRAWS),
    })
}

fn subject(plan: &Plan) -> Subject<'_> {
    let (bounds, _): (_, Vec<Derived>) = bounds(plan, plan.run.rate.seconds(Step(plan.run.steps)));
    Subject {
        bounds,
        ..Subject::of(plan)
    }
}

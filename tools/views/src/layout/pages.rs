//! Pages of a layout: the plots of a run, grouped by section.
//!
//! [`plots`](crate::plots) selects them from the recorded columns and the scenario. Records are never read.

use hil_config::plan::Plan;
use shared_types::time::Step;

use crate::plots::bounds::bounds;
use crate::plots::{Choice, Plot, Subject, choose};
use hil_recording::reader::Column;

/// Maximum number of plots on a page; further plots go to the next page.
const PLOTS: usize = 8;

/// Plots shown together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Page {
    /// Section of the plots, numbered from its second page on.
    pub title: String,
    /// Plots in order.
    pub plots: Vec<Plot>,
}

/// Groups the plots of these columns into pages, with the plots of the scenario if it is valid.
pub(crate) fn of(columns: &[Column], plan: Option<&Plan>) -> Vec<Page> {
    let subject = plan.map_or_else(Subject::default, |plan| Subject {
        bounds: bounds(plan, plan.run.rate.seconds(Step(plan.run.steps))).0,
        ..Subject::of(plan)
    });
    let plots = choose(&Choice {
        columns,
        subjects: &[subject],
        patterns: &[],
        values: None,
    });
    let mut pages = Vec::new();
    for section in plots.chunk_by(|a, b| a.section == b.section) {
        for (number, plots) in (1..).zip(section.chunks(PLOTS)) {
            let title = match number {
                1 => plots[0].section.to_owned(),
                _ => format!("{} {number}", plots[0].section),
            };
            let plots = plots.to_vec();
            pages.push(Page { title, plots });
        }
    }
    pages
}

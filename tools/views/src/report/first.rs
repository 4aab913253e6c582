//! First screen of a report: a line for the verdict, a bar for each requirement, and the plots that decide.
//!
//! A bar shows how much of its limit a requirement used: 1 - margin / |limit| where the deciding comparison is with a
//! constant other than 0, which makes requirements of different units comparable. Judges nothing: verdicts and margins
//! are those of the run.

use hil_facts::results::requirements::{self, Requirement};
use maud::{Markup, html};
use shared_types::number::short_in;

use super::plots::{Plot, limit};
use super::run::Run;
use super::tables::{badge, seconds, swatch};

/// Maximum number of bars outside of the folded list.
const MOST_BARS: usize = 8;
/// Share of a limit that the full width of a bar stands for.
const FULL: f64 = 1.25;
/// Number of plots that decide.
const DECIDING: usize = 2;

/// Requirement of a run with the share of its limit that was used.
struct Use<'a> {
    run: usize,
    judged: &'a Requirement,
    /// Share of the limit; `None` if the margin has no such share.
    used: Option<f64>,
}

impl Use<'_> {
    /// Returns 0 for a failed requirement, 1 for an undecided and 2 for a passed one.
    fn rank(&self) -> u8 {
        match self.judged.verdict {
            "fail" => 0,
            "pass" => 2,
            _ => 1,
        }
    }

    /// Formats the share, or else the margin with its unit.
    fn describe(&self) -> String {
        match (self.used, self.judged.robustness) {
            (Some(used), _) => format!("{} % used", percent(used, self.rank() == 2)),
            (None, Some(margin)) if margin < 0.0 => {
                format!("missed by {}", short_in(-margin, &self.judged.unit))
            }
            (None, Some(margin)) => format!("margin {}", short_in(margin, &self.judged.unit)),
            (None, None) => "no margin".into(),
        }
    }
}

/// Formats a share in whole per cent: a limit that holds is never rounded to 100 %, nor a broken one to less.
fn percent(used: f64, holds: bool) -> String {
    let rounded = (100.0 * used).round();
    let rounded = match holds {
        true if rounded >= 100.0 && used < 1.0 => 99.0,
        false if rounded <= 100.0 && used > 1.0 => 101.0,
        _ => rounded,
    };
    format!("{}", if rounded > 0.0 { rounded } else { 0.0 })
}

/// Returns the requirements of all runs: failed ones first, then by the share of the limit that they used.
fn uses<'a>(runs: &'a [Run], plots: &[Plot]) -> Vec<Use<'a>> {
    let of_run = |(run, one): (usize, &'a Run)| {
        let uses = one.requirements.iter().map(move |judged| {
            let level = limit(plots, run, &judged.name);
            let used = (judged.robustness.zip(level)).map(|(margin, level)| 1.0 - margin / level);
            Use { run, judged, used }
        });
        uses.collect::<Vec<_>>()
    };
    let mut uses: Vec<Use<'_>> = runs.iter().enumerate().flat_map(of_run).collect();
    uses.sort_by(|a, b| {
        let share = |one: &Use<'_>| one.used.unwrap_or(f64::NEG_INFINITY);
        (a.rank().cmp(&b.rank())).then(share(b).total_cmp(&share(a)))
    });
    uses
}

/// Returns the indices of the plots that decide: those of the requirements that failed or are nearest to their limits;
/// without requirements the first plots.
pub(super) fn deciding(runs: &[Run], plots: &[Plot]) -> Vec<usize> {
    let uses = uses(runs, plots);
    let of_use = |one: &Use<'_>| {
        plots
            .iter()
            .position(|plot| plot.decides(one.run, &one.judged.name))
    };
    let of_uses = uses.iter().filter_map(of_use);
    let others = (0..plots.len()).filter(|place| !plots[*place].is_of_loop());
    let mut places = Vec::new();
    for place in of_uses.chain(others) {
        if places.len() < DECIDING && !places.contains(&place) {
            places.push(place);
        }
    }
    places
}

/// Renders verdicts and bars.
pub(super) fn verdicts(runs: &[Run], plots: &[Plot]) -> Markup {
    let uses = uses(runs, plots);
    let has_several = runs.len() > 1;
    let (bars, folded) = uses.split_at(uses.len().min(MOST_BARS * runs.len().min(2)));
    html! {
        @for (number, run) in runs.iter().enumerate() {
            p.verdict {
                @if has_several { (swatch(number)) (run.label) ": " }
                (line(number, run, &uses))
            }
        }
        @for run in runs { @for note in &run.notes { p.note { (run.label) ": " (note) } } }
        @if !uses.is_empty() {
            ul.uses aria-label="Share of its limit that each requirement used" {
                @for one in bars { (bar(one, runs)) }
            }
            @if !folded.is_empty() { details.more {
                summary { (folded.len()) " more" }
                ul.uses { @for one in folded { (bar(one, runs)) } }
            } }
        }
    }
}

fn line(number: usize, run: &Run, uses: &[Use<'_>]) -> Markup {
    let all = run.requirements.len();
    let verdict = requirements::in_words(&run.verdict, all);
    let of_run = |one: &&Use<'_>| one.run == number;
    let nearest = uses.iter().find(of_run);
    let failed = run
        .requirements
        .iter()
        .filter(|one| one.verdict == "fail")
        .count();
    html! {
        (badge(verdict))
        @if let Some(reason) = &run.reason { ": " (reason) }
        @if let Some(one) = nearest {
            @match one.rank() {
                0 => { "; " (failed) " of " (all) " failed, farthest beyond its limit: " },
                1 => "; undecided: ",
                _ => "; nearest to its limit: ",
            }
            (link(one)) ", " (one.describe())
        }
    }
}

/// Renders the bar of a requirement; of several runs with the colour and the label of its run.
fn bar(one: &Use<'_>, runs: &[Run]) -> Markup {
    let run = (runs.len() > 1).then(|| &runs[one.run].label);
    let verdict = one.judged.verdict;
    let width = one.used.map(|used| 100.0 * used.clamp(0.0, FULL) / FULL);
    html! {
        li data-verdict=(verdict) {
            span.sign aria-hidden="true" { (match one.rank() { 0 => "✗", 1 => "?", _ => "✓" }) }
            span.name {
                @if run.is_some() { (swatch(one.run)) }
                span.visually-hidden { (verdict) ": " }
                (link(one))
                @if let Some(label) = run { " " span.hint { (label) } }
            }
            span.track aria-hidden="true" { @if let Some(width) = width {
                span.fill data-run=(one.run) style={ "width:" (format!("{width:.1}")) "%" } {}
                span.limit {}
            } }
            span.share { (one.describe()) }
        }
    }
}

/// Renders the name of a requirement as a button that zooms to its margin.
fn link(one: &Use<'_>) -> Markup {
    let judged = one.judged;
    html! {
        @match judged.at_s {
            Some(at_s) => button.link type="button" data-requirement=(judged.name) data-run=(one.run) data-at=(at_s) title={ (judged.formula) ", at " (seconds(at_s)) " s" } { (judged.name) },
            None => span title=(judged.formula) { (judged.name) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_never_crosses_its_limit_by_rounding() {
        for (used, holds, expected) in [
            (0.8933, true, "89"),
            (0.999, true, "99"),
            (1.0, true, "100"),
            (1.001, false, "101"),
            (2.345, false, "235"),
            (-3.0, true, "0"),
        ] {
            assert_eq!(percent(used, holds), expected, "{used}");
        }
    }
}

//! The tables of a campaign's page: facts, goals, classes, requirements.

use maud::{Markup, html};
use shared_types::number::{counted, short, unit_shown};

use super::Campaign;
use crate::command::answers::outcomes::FAULT_COLUMNS;
use crate::command::answers::{
    Answers, RequirementAnswer, Share, VariantAnswer, classes_in_words, shown_classes,
};
use crate::command::show::bounds;

/// Maximum number of correlated values that are shown for a margin.
const MOST_FOLLOWED: usize = 3;

/// Renders facts about the campaign.
pub(super) fn facts(campaign: &Campaign) -> Markup {
    let (answers, study) = (campaign.answers, campaign.study);
    let varied: Vec<&str> = study.varied.iter().map(|one| &*one.name).collect();
    html! {
        div.scroll tabindex="0" { table.facts { tbody {
            tr { th scope="row" { "cases" } td {
                (answers.cases)
                @if !campaign.is_complete() { ", " strong { (campaign.rows) " with a result" } }
            } }
            tr { th scope="row" { "draws" } td { (answers.draws) ", " (answers.sampling) ", seed " (study.seed) } }
            tr { th scope="row" { "variants" } td { (variants(answers)) } }
            tr { th scope="row" { "varied" } td { (varied.join(", ")) } }
            tr { th scope="row" { "bounds" } td { (bounds_meant(answers)) } }
            tr { th scope="row" { "digest" } td {
                @match &answers.digest {
                    Some(digest) => code { (digest) },
                    None => "none: cases are missing",
                }
            } }
        } } }
    }
}

fn variants(answers: &Answers) -> String {
    let names: Vec<&str> = answers.variants.iter().map(|one| &*one.name).collect();
    names.join(", ")
}

fn bounds_meant(answers: &Answers) -> String {
    let has_bounds = (answers.variants.iter()).any(|one| one.passes.bounds.is_some());
    match has_bounds {
        true => format!(
            "Clopper-Pearson at {} %, two-sided",
            short(answers.confidence * 100.0)
        ),
        false => "none: they need independent draws of every case".into(),
    }
}

/// Renders the goals and their status.
pub(super) fn goals(campaign: &Campaign) -> Markup {
    let answers = campaign.answers;
    let verdict = |is_met: bool| match is_met {
        true => badge("pass", "met"),
        // Missing cases may still decide the goal.
        false if !campaign.is_complete() => badge("undecided", "open"),
        false => badge("fail", "NOT MET"),
    };
    html! {
        h3 { "Goals" }
        @if answers.goals.is_empty() { p { "The study has no goal." } }
        @else { div.scroll tabindex="0" { table {
            thead { tr { th { "goal" } th { "variant" } th { "" } th.n { "probability" } th.n { "confidence" } th.n { "shown" } } }
            tbody { @for goal in &answers.goals { tr {
                th scope="row" { (goal.requirement.as_deref().unwrap_or("pass")) }
                td { (goal.variant) }
                td { (verdict(goal.is_met)) }
                td.n { (short(goal.probability)) }
                td.n { (short(goal.confidence * 100.0)) " %" }
                td.n { "at least " (short(goal.lower)) }
            } } }
        } } }
    }
}

/// Renders the classes of each variant.
pub(super) fn classes(campaign: &Campaign) -> Markup {
    let answers = campaign.answers;
    let words = classes_in_words(answers.requirements());
    let places = shown_classes(&answers.variants);
    html! {
        div.scroll tabindex="0" { table #classes {
            thead { tr {
                th { "variant" }
                @for place in &places { th.n { (words[*place]) } }
                th.n { "passes" } th.n { "probability" }
            } }
            tbody { @for variant in &answers.variants { tr {
                th scope="row" { (variant.name) }
                @for place in &places { td.n { (variant.classes[*place]) } }
                td.n { (percent(campaign, variant.passes)) }
                td.n { (bounds(variant.passes)) }
            } } }
        } }
        @for variant in &answers.variants {
            @if !variant.diverged.is_empty() { p.hint {
                (variant.name) " diverged in " (counted(variant.classes[2], "case")) ", as "
                (joined(variant.diverged.iter().map(ToString::to_string)))
            } }
        }
    }
}

/// Renders the results of each requirement: a table with a row for each variant.
pub(super) fn requirements(campaign: &Campaign, command: &str) -> Markup {
    let answers = campaign.answers;
    let first = answers.variants.first();
    let names = first.map_or(&[][..], |variant| &variant.requirements);
    html! {
        @if names.is_empty() { p { "The scenario has no requirement." } }
        @for (place, one) in names.iter().enumerate() {
            h3 { (one.name) @if !unit_shown(&one.unit).is_empty() { span.hint { " margins in " (one.unit) } } }
            div.scroll tabindex="0" { table {
                thead { tr {
                    th { "variant" } th.n { "holds" } th.n { "probability" } th.n { "worst" }
                    @for quantile in &one.quantiles { th.n { (quantile_name(quantile.p)) } }
                    th { "margin follows" } th { "worst case" }
                } }
                tbody { @for variant in &answers.variants {
                    @if let Some(one) = variant.requirements.get(place) { (requirement(campaign, variant, one, command)) }
                } }
            } }
        }
        @if !names.is_empty() { p.hint {
            "A margin says by how much a requirement holds, negative where it fails. "
            "Margin follows: rank correlations (Spearman) with varied values, the strongest first."
        } }
    }
}

fn requirement(
    campaign: &Campaign,
    variant: &VariantAnswer,
    one: &RequirementAnswer,
    command: &str,
) -> Markup {
    let has_diverged = variant.classes[2] > 0;
    let strong = one.correlations.iter().filter(|(_, rho)| rho.abs() >= 0.1);
    let strong = strong.take(MOST_FOLLOWED);
    html! { tr {
        th scope="row" { (variant.name) }
        td.n { (percent(campaign, one.holds)) }
        td.n { (bounds(one.holds)) }
        td.n { @match one.worst.first() { Some(worst) => (margin(worst.margin.0, has_diverged)), None => "-" } }
        @for quantile in &one.quantiles { td.n {
            (margin(quantile.value.0, has_diverged))
            @if let Some([low, high]) = quantile.bounds { span.hint { (margin(low.0, has_diverged)) br; "to " (margin(high.0, has_diverged)) } }
        } }
        td { @for (name, rho) in strong { span.follows { (name) " " (format!("{rho:+.2}")) } } @if one.is_rounding { span.hint { "rounding only" } } @if one.without > 0 { span.hint { (counted(one.without, "case")) " without a margin" } } }
        td { @match one.worst.first() {
            Some(worst) => code.command { (command) (worst.case) },
            None => "-",
        } }
    } }
}

/// Renders the table of faults by outcomes.
pub(super) fn faults(campaign: &Campaign) -> Markup {
    let answers = campaign.answers;
    html! {
        div.scroll tabindex="0" { table #faults {
            thead { tr {
                @for head in FAULT_COLUMNS { th { (head) } }
                th { "repeated by" }
            } }
            tbody { @for row in &answers.faults { tr {
                @for (place, cell) in row.shown(answers.requirements()).into_iter().enumerate() {
                    @if place == 5 { td { (badge(&row.outcome, &cell)) @if !row.reason.is_empty() { br; span.hint { (row.reason) } } } }
                    @else { td title=(row.targets.join(", ")) { (cell) } }
                }
                td { @if !row.command.is_empty() { code.command { (row.command) } } }
            } } }
        } }
        p.hint {
            "The worst margin is the least one among the requirements with the worst verdict. "
            "Detected: from the onset to the alarm. Recovered: from the onset to the step from which the study's condition holds until the end. "
            "Faults that the study does not try are rows, too."
        }
    }
}

fn quantile_name(p: f64) -> String {
    match p {
        0.5 => "median".into(),
        p => format!("{} %", short(p * 100.0)),
    }
}

fn badge(verdict: &str, text: &str) -> Markup {
    html! { span.badge data-verdict=(verdict) { (text) } }
}

fn joined(texts: impl Iterator<Item = String>) -> String {
    texts.collect::<Vec<_>>().join(", ")
}

/// Formats a share; for an incomplete campaign as a count, because there is no share yet.
fn percent(campaign: &Campaign, share: Share) -> String {
    match campaign.is_complete() && share.of > 0 {
        true => format!("{} %", short(share.count as f64 / share.of as f64 * 100.0)),
        false => format!("{} of {}", share.count, share.of),
    }
}

/// Formats a margin; infinite margins belong to cases that diverged or have a verdict without a margin.
fn margin(value: f64, has_diverged: bool) -> String {
    match value {
        f64::NEG_INFINITY if has_diverged => "diverged".into(),
        f64::NEG_INFINITY => "fails".into(),
        f64::INFINITY => "holds".into(),
        value if value.is_nan() => "-".into(),
        value => short(value),
    }
}

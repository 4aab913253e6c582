//! The tables of Sobol' indices of a campaign's page: a table for each requirement, a row for each varied value.

use maud::{Markup, html};
use shared_types::number::short;

use super::Campaign;
use crate::command::answers::{Answers, VariantAnswer};

/// Renders the indices of a campaign whose sampling gives some.
pub(super) fn indices(campaign: &Campaign) -> Markup {
    let answers = campaign.answers;
    if answers.sampling != "saltelli" {
        return html! {};
    }
    let first = answers.variants.first();
    let names = first.map_or(&[][..], |variant| &variant.requirements);
    html! {
        h3 { "Sobol' indices" }
        @for (place, one) in names.iter().enumerate() {
            div.scroll tabindex="0" { table.indices {
                thead { tr {
                    th { "margin of " (one.name) } th { "variant" }
                    th.n { "first index" } th.n { "total index" }
                } }
                tbody { @for variant in &answers.variants { (rows(answers, variant, place)) } }
            } }
        }
        @if !names.is_empty() { p.hint {
            "The first index is the share of a margin's variance that a value explains alone, the total index the share with all its interactions. "
            "In parentheses: intervals at " (short(answers.confidence * 100.0)) " %."
        } }
    }
}

fn rows(answers: &Answers, variant: &VariantAnswer, place: usize) -> Markup {
    let Some(one) = variant.requirements.get(place) else {
        return html! {};
    };
    let share = |value: f64, within: f64| {
        let (low, high) = (short(value - within), short(value + within));
        html! { (short(value)) " " span.hint { "(" (low) " to " (high) ")" } }
    };
    let reason = match (one.is_rounding, answers.digest.is_some()) {
        (true, _) => "none: the margin varies by rounding only",
        (false, false) => "none: cases are missing",
        (false, true) => "none: every case needs a finite margin, and margins must differ",
    };
    html! {
        @for value in &one.indices { tr {
            th scope="row" { (value.name) }
            td { (variant.name) }
            td.n { (share(value.indices.first, value.indices.first_within)) }
            td.n { (share(value.indices.total, value.indices.total_within)) }
        } }
        @if one.indices.is_empty() { tr {
            th scope="row" { "-" }
            td { (variant.name) }
            td colspan="2" { (reason) }
        } }
    }
}

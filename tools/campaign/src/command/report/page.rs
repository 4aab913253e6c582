//! The HTML page of a campaign: the parts that need no script, and the data for the script that draws the plots.

use hil_console::terminal::exit::Failure;
use hil_views::offline_page::{OfflinePage, PAGE};

use maud::{Markup, html};
use shared_types::number::counted;

use super::data::Data;
use super::{Campaign, indices, tables};
use crate::command::collect::set_aside;
use crate::command::quoted;

const SCRIPT: &str = include_str!("assets/campaign.js");
const STYLE: &str = include_str!("assets/campaign.css");

/// Renders the whole page.
pub(super) fn page(campaign: &Campaign, data: &Data) -> Result<String, Failure> {
    let name = &campaign.answers.name;
    let body = html! {
        header {
            (warnings(campaign))
            h1 { (name) }
            @if !campaign.study.description.is_empty() { p { (campaign.study.description) } }
        }
        nav.bar aria-label="Sections" {
            a href="#summary" { "Summary" }
            a href="#plots" { "Plots" }
            a href="#requirements" { "Requirements" }
            a href="#about" { "Study" }
            span.gap {}
            button #theme type="button" aria-pressed="false" { "Dark" }
        }
        main {
            section #summary {
                h2 { "Classes of cases" }
                (tables::classes(campaign))
                @if !campaign.answers.goals.is_empty() { (tables::goals(campaign)) }
            }
            (plots(data))
            @if !campaign.answers.faults.is_empty() { section {
                h2 { "Faults and their outcomes" }
                (tables::faults(campaign))
            } }
            section #requirements {
                h2 { "Requirements" }
                (tables::requirements(campaign, data.command()))
                (indices::indices(campaign))
            }
            section #about {
                h2 { "The study" }
                (tables::facts(campaign))
                @if campaign.answers.goals.is_empty() { (tables::goals(campaign)) }
            }
        }
    };
    let page = OfflinePage {
        title: &format!("{name}: campaign"),
        styles: ["", STYLE],
        body,
        credit: None,
        data,
        scripts: &[PAGE, SCRIPT],
    };
    page.write()
}

/// Renders the reasons why the numbers do not cover the whole campaign.
fn warnings(campaign: &Campaign) -> Markup {
    let (answers, rows) = (campaign.answers, campaign.rows);
    let folder_text = quoted(campaign.folder.path());
    html! {
        @if !campaign.is_complete() { p.note {
            "Not complete: " (answers.cases - rows) " of " (counted(answers.cases, "case")) " are in no published shard. "
            "The numbers below are counts, not probabilities, because slow cases come last; "
            code { "hil campaign run " (folder_text) } " computes the rest."
        } }
        @if !answers.lost.is_empty() { p.note {
            (set_aside(&answers.lost)) "; no probability has bounds; " code { "hil campaign run " (folder_text) " --again" } " tries once more."
        } }
        @for conflict in campaign.conflicts { p.note { (conflict.to_string()) } }
    }
}

/// Renders the frame of the curves over time.
fn envelopes(data: &Data) -> Markup {
    let Some(envelopes) = &data.envelopes else {
        return html! {};
    };
    html! {
        section #envelopes {
            h3 { "Over time" }
            p.hint {
                "Over s, from the outside inwards: the range of all cases; the middle 90 % and 50 % of "
                (counted(envelopes.draws as u64, "draw")) "; the median. Each time counts on its own: no case need follow a line. "
                "Diverged cases are left out. A selection changes nothing here."
            }
            @if envelopes.without > 0 { p.note {
                (counted(envelopes.without, "shard")) " of the campaign without curves: their cases are missing below. "
                "The results are all there."
            } }
            div.controls {
                label { "Worst case of " select #worst {} }
                label { input #same type="checkbox" checked; " One scale for all variants" }
            }
            div #timed {}
        }
    }
}

/// Renders the frame into which the script draws.
fn plots(data: &Data) -> Markup {
    html! {
        section #plots {
            h2 { "Plots" }
            noscript { p.note { "Plots need a browser with JavaScript; the tables do not." } }
            @if data.every() > 1 { p.note {
                "So many cases are too many for a page: the plots show every "
                (data.every()) "th draw; the tables above count all of them."
            } }
            div #tools hidden {
                p.hint { "Drag over a plot to select a range in all plots; in a plot of points a rectangle. "
                    "A range that begins or ends at the edge of a plot is open there; a click in a plot of bars removes it. Click a point to see its case." }
                div.controls {
                    label { "Colour " select #colour { option value="class" { "class" } option value="variant" { "variant" } } }
                    label { "Heights " select #heights {
                        option value="root" { "square root" } option value="linear" { "linear" } option value="log" { "logarithm" }
                    } }
                    form #find { label { "Case " input #number type="number" min="0" inputmode="numeric"; } " " button { "Show" } }
                }
                div.selection {
                    p #count {}
                    button #clear type="button" disabled { "Clear selection" }
                    div.legend #legend {}
                    div #chips {}
                }
                div #case hidden {}
                h3 { "Margins and metrics" }
                p.hint { "A margin below zero fails. Diverged cases, and others beyond a plot, are counted at its edge." }
                div.plots #outcomes {}
                h3 { "Varied values" }
                p.hint { "Selected cases in colour, those that pass below, others above; all cases behind them. The two numbers are the selected range." }
                div.plots #varied {}
                (envelopes(data))
                section #map {
                    h3 { "Map of pass and fail" }
                    div.controls {
                        label { "Across " select #across {} }
                        label { "Up " select #up {} }
                    }
                    div.plots #mapped {}
                }
                div #scatters {}
            }
        }
    }
}

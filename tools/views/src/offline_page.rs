//! HTML page that shows results without a server or a network: the frame of every report.
//!
//! Text, scripts and data are embedded in one file. Used by reports; independent of runs and campaigns.

use hil_console::terminal::exit::Failure;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

/// Content security policy: loads nothing and sends nothing.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'";
/// Style of every report.
const STYLE: &str = include_str!("report/assets/report.css");

/// Script before those of every page with plots: numbers, axes and colours.
pub const PAGE: &str = include_str!("pages/assets/page.js");

/// Page of results that is readable without scripts.
pub struct OfflinePage<'a, D> {
    /// Title of the page.
    pub title: &'a str,
    /// Style sheets before and after the common one.
    pub styles: [&'a str; 2],
    /// Content between the skip link and the footer.
    pub body: Markup,
    /// Credit for third-party work on the page.
    pub credit: Option<&'a str>,
    /// Data for the scripts.
    pub data: &'a D,
    /// Scripts behind the common one, in order.
    pub scripts: &'a [&'a str],
}

impl<D: Serialize> OfflinePage<'_, D> {
    /// Renders the whole page.
    pub fn write(&self) -> Result<String, Failure> {
        // No text in it can end the element.
        let json = serde_json::to_string(self.data)
            .map_err(Failure::infrastructure)?
            .replace('<', "\\u003c");
        let [before, after] = self.styles;
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    meta name="generator" content=(concat!("hil ", env!("CARGO_PKG_VERSION")));
                    title { (self.title) }
                    style { (PreEscaped(before)) (PreEscaped(STYLE)) (PreEscaped(after)) }
                }
                body {
                    a.skip href="#plots" { "Skip to the plots" }
                    (self.body)
                    footer { p {
                        "Made by hil " (env!("CARGO_PKG_VERSION")) ", commit " (hil_facts::programs::own::commit()) "."
                        @if let Some(credit) = self.credit { " " (credit) }
                    } }
                    p #status .visually-hidden role="status" aria-live="polite" {}
                    script #data type="application/json" { (PreEscaped(json)) }
                    @for script in self.scripts { script { (PreEscaped(script)) } }
                }
            }
        };
        Ok(page.into_string())
    }
}

//! Foxglove layout, which Lichtblick can also read: a tab for each page below a band that shows the latest event.

use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use serde_json::{Map, Value, json};
use shared_types::number::unit_shown;

use super::Ranges;
use super::pages::Page;
use crate::plots::Plot;
use crate::plots::signal::labels;

const TABS: &str = "Tab!hil";
const EVENTS: &str = "StateTransitions!events";
/// Height of the band, in per cent.
const BAND: u32 = 16;
/// Threshold for an explicit axis range: axes show three decimals, so smaller values would appear as a flat line.
const SMALL: f64 = 1e-3;

pub(super) fn text(pages: &[Page], ranges: &Ranges) -> Result<String, Failure> {
    let mut configs = Map::new();
    let mut tabs = Vec::new();
    for (number, page) in pages.iter().enumerate() {
        let mut ids = Vec::new();
        for (place, plot) in page.plots.iter().enumerate() {
            let id = format!("Plot!page{number}plot{place}");
            configs.insert(id.clone(), config(plot, ranges));
            ids.push(id);
        }
        tabs.push(json!({"title": page.title, "layout": tree(&ids, "column")}));
    }
    configs.insert(TABS.into(), json!({"activeTabIdx": 0, "tabs": tabs}));
    let events =
        json!({"value": "/events.event", "label": "event", "timestampMethod": "receiveTime"});
    let title = "the last event until then";
    configs.insert(
        EVENTS.into(),
        json!({
            "foxglovePanelTitle": title,
            "lichtblickPanelTitle": title,
            "isSynced": true,
            "paths": [events],
        }),
    );
    let layout = json!({
        "configById": configs,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "column",
            "first": EVENTS,
            "second": TABS,
            "splitPercentage": BAND,
        },
    });
    output::pretty(&layout)
}

/// Arranges panels of about equal size by halving, alternating rows and columns.
fn tree(ids: &[String], direction: &str) -> Value {
    if let [id] = ids {
        return json!(id);
    }
    let (first, second) = ids.split_at(ids.len().div_ceil(2));
    let next = if direction == "column" {
        "row"
    } else {
        "column"
    };
    json!({
        "direction": direction,
        "first": tree(first, next),
        "second": tree(second, next),
        "splitPercentage": 100 * first.len() / ids.len(),
    })
}

fn config(plot: &Plot, ranges: &Ranges) -> Value {
    let labels = labels(plot);
    // Columns are addressed like the fields of the messages.
    let path = |(curve, label): (&String, &String)| {
        json!({
            "value": format!("/record.{curve}"),
            "label": label,
            "enabled": true,
            "timestampMethod": "receiveTime",
        })
    };
    let longest = labels.iter().map(String::len).max().unwrap_or(0);
    let mut config = json!({
        "foxglovePanelTitle": plot.title,
        "lichtblickPanelTitle": plot.title,
        "paths": plot.signals.iter().zip(&labels).map(path).collect::<Vec<_>>(),
        "xAxisVal": "timestamp",
        "xAxisLabel": "s",
        "yAxisLabel": unit_shown(&plot.unit),
        "isSynced": true,
        // Beside the curves, which it would cover; a single curve is named in the title.
        "showLegend": labels.len() > 1,
        "legendDisplay": if labels.len() > 1 { "left" } else { "none" },
        "showPlotValuesInLegend": false,
        "showXAxisLabels": true,
        "showYAxisLabels": true,
        "sidebarDimension": (60 + 8 * longest).clamp(100, 300),
    });
    if let Some([least, greatest]) = bounds(plot, ranges) {
        config["minYValue"] = json!(least);
        config["maxYValue"] = json!(greatest);
    }
    config
}

/// Returns explicit ends of a vertical axis for small values, rounded so that similar runs fit; otherwise `None`.
fn bounds(plot: &Plot, ranges: &Ranges) -> Option<[f64; 2]> {
    let (mut least, mut greatest) = (0.0, 0.0);
    for [low, high] in plot.signals.iter().filter_map(|curve| ranges.get(curve)) {
        least = if *low < least { *low } else { least };
        greatest = if *high > greatest { *high } else { greatest };
    }
    let is_small = -least < SMALL && greatest < SMALL;
    (is_small && least < greatest).then(|| [0.0 - above(-least), above(greatest)])
}

/// Rounds a value up to the next 1, 2 or 5 times a power of ten, with a margin of a tenth; 0 for 0.
fn above(value: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let limit = 1.1 * value;
    let decade = libm::floor(libm::log10(limit)) as i32;
    let round = [1, 2, 5, 10]
        .map(|digit| format!("{digit}e{decade}").parse().unwrap_or(limit))
        .into_iter()
        .find(|round| *round >= limit);
    round.unwrap_or(limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_small_values_get_explicit_rounded_axis_limits() {
        let plot = Plot {
            signals: vec!["truth.a".into(), "truth.b".into()],
            ..Plot::default()
        };
        let ends = |a: [f64; 2], b: [f64; 2]| {
            let ranges = [("truth.a".to_owned(), a), ("truth.b".to_owned(), b)];
            bounds(&plot, &Ranges::from(ranges))
        };
        assert_eq!(ends([0.0, 5e-7], [0.0, 1e-7]), Some([0.0, 1e-6]));
        assert_eq!(ends([-3e-5, 1e-6], [0.0, 1.7e-4]), Some([-5e-5, 2e-4]));
        assert_eq!(ends([0.0, 5e-7], [0.0, 2e-3]), None);
        assert_eq!(ends([0.0, 0.0], [0.0, 0.0]), None);
        assert_eq!(bounds(&plot, &Ranges::new()), None);
    }
}

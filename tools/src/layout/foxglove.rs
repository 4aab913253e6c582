//! Pages as a layout of Foxglove, which Lichtblick takes as well: a tab for each page, and above them
//! what happened, as a band of states.

use serde_json::{Map, Value, json};

use super::pages::{Page, Plot};
use crate::exit::Failure;

const TABS: &str = "Tab!hil";
const EVENTS: &str = "StateTransitions!events";
/// Height of the band, in per cent.
const BAND: u32 = 12;

pub(super) fn text(pages: &[Page]) -> Result<String, Failure> {
    let mut configs = Map::new();
    let mut tabs = Vec::new();
    for (number, page) in pages.iter().enumerate() {
        let mut ids = Vec::new();
        for (place, plot) in page.plots.iter().enumerate() {
            let id = format!("Plot!page{number}plot{place}");
            configs.insert(id.clone(), config(plot));
            ids.push(id);
        }
        tabs.push(json!({"title": page.title, "layout": tree(&ids, "column")}));
    }
    configs.insert(TABS.into(), json!({"activeTabIdx": 0, "tabs": tabs}));
    let events =
        json!({"value": "/events.event", "label": "events", "timestampMethod": "receiveTime"});
    configs.insert(EVENTS.into(), json!({"isSynced": true, "paths": [events]}));
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
    let text = serde_json::to_string_pretty(&layout).map_err(Failure::infrastructure)?;
    Ok(text + "\n")
}

/// Panels of about the same size: halves, in turns one above and one beside the other.
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

fn config(plot: &Plot) -> Value {
    // Columns are named as the fields of the messages are reached.
    let path = |curve: &String| {
        json!({
            "value": format!("/record.{curve}"),
            "label": curve,
            "enabled": true,
            "timestampMethod": "receiveTime",
        })
    };
    json!({
        "foxglovePanelTitle": plot.title,
        "lichtblickPanelTitle": plot.title,
        "paths": plot.curves.iter().map(path).collect::<Vec<_>>(),
        "xAxisVal": "timestamp",
        "yAxisLabel": plot.unit,
        "isSynced": true,
        "showLegend": true,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": false,
        "showXAxisLabels": true,
        "showYAxisLabels": true,
        "sidebarDimension": 240,
    })
}

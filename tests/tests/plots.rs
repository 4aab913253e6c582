//! Plots of one run in its report, its monitor and its layouts: the same, in the same order.

use serde_json::Value;

use crate::layouts::panels;
use crate::monitor::json_state;
use crate::report::page::Page;
use crate::support::harness::{Rig, until};
use crate::support::programs::program;
use crate::support::terminal::Terminal;

/// Terminal size with room for every plot, and none beside them for lists.
const TALL: (u16, u16) = (109, 250);

/// Returns the titles of the plots on a monitor's screen, each of which precedes the number of its plot.
fn titles_on_screen(text: &str) -> Vec<String> {
    let numbered = text.lines().filter_map(|line| {
        let (rest, number) = line.trim_end().rsplit_once("  ")?;
        let (number, all) = number.split_once('/')?;
        let is_number = number.parse::<u32>().is_ok() && all.parse::<u32>().is_ok();
        is_number.then(|| rest.split("  ").next().unwrap_or_default().to_owned())
    });
    numbered.collect()
}

/// Returns the titles of the panels of a Foxglove layout, with those of their pages.
fn titles_of_layout(layout: &Value) -> Vec<(String, String)> {
    let configs = &layout["configById"];
    let mut titles = Vec::new();
    for tab in configs["Tab!hil"]["tabs"].as_array().expect("tabs") {
        let mut ids = Vec::new();
        panels(&tab["layout"], &mut ids);
        let page = tab["title"].as_str().expect("text");
        for id in ids {
            let title = configs[&id]["foxglovePanelTitle"].as_str().expect("text");
            titles.push((page.to_owned(), title.to_owned()));
        }
    }
    titles
}

#[test]
fn report_monitor_and_layout_show_the_same_plots_in_the_same_order() {
    let rig = Rig::new();
    let run = rig.start(
        "scenarios/severe-leakage.toml --set run.duration_s=8 --set requirements=[] --set metrics=[] --pause-at 7.5 --wait-limit 60",
    );
    until("the run is held", || json_state(&rig) == "paused");
    let mut hil = rig.command(program("hil"));
    hil.args(["monitor", "--session", rig.session()]);
    let mut terminal = Terminal::start(hil, TALL);
    terminal.until_it_shows("PAUSED");
    let mut watched = Vec::new();
    until("every plot is on the screen", || {
        let text = terminal.text();
        watched = titles_on_screen(&text);
        let last = format!("{0}/{0}", watched.len());
        watched.len() > 1 && text.lines().any(|line| line.trim_end().ends_with(&last))
    });
    terminal.press("q");
    terminal.wait();
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);

    let page = Page::of(&rig, &[&run], &[]);
    let text = |value: &Value| value.as_str().expect("text").to_owned();
    let reported: Vec<String> = page
        .plots()
        .iter()
        .map(|plot| text(&plot["title"]))
        .collect();
    for (watched, reported) in watched.iter().zip(&reported) {
        let view = watched.strip_suffix("..").unwrap_or(watched);
        assert!(reported.starts_with(view), "{watched} and {reported}");
        assert!(watched == reported || watched.ends_with(".."), "{watched}");
    }

    let folder = run.folder.to_str().expect("text");
    let layout = rig.hil(&["layout", folder, "foxglove"]).expect(0).stdout;
    let layout = titles_of_layout(&serde_json::from_str(&layout).expect("JSON"));
    // A layout knows no values, so it includes fault-free sensors, under the name of the sensed signal.
    let is_plain = |(page, _): &&(String, String)| page != "Interface";
    let laid_out: Vec<&String> = (layout.iter().filter(is_plain))
        .map(|(_, title)| title)
        .collect();
    let in_both: Vec<&String> = reported
        .iter()
        .filter(|one| laid_out.contains(one))
        .collect();
    let of_report = |title: &&&String| reported.contains(title);
    let in_layout: Vec<&String> = laid_out.iter().filter(of_report).copied().collect();
    assert_eq!(in_layout, in_both);
    // Derived signals are not recorded.
    let only_reported: Vec<&String> = reported
        .iter()
        .filter(|one| !laid_out.contains(one))
        .collect();
    assert_eq!(only_reported, ["Figure 3: position tracking error"]);
    // In this run no sensor is faulty and no step is late, which only the report knows from the values.
    for (page, title) in &layout {
        assert!(
            ["Interface", "Loop"].contains(&page.as_str()) || reported.contains(title),
            "{page}: {title}"
        );
    }
    let moved = "parameter.actuator*_leakage_coefficient_m3ps_per_sqrt_pa".to_owned();
    assert!(in_both.contains(&&moved), "{in_both:?}");
}

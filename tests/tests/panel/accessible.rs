//! Panels that everybody can read and operate, as axe-core sees them: on a light desk and a dark phone, with cursors and
//! with the list of everything.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::browser::{Play, begun};
use super::{Panel, SCENARIO, heavy};
use crate::support::harness::Rig;

/// Fails unless no rule is broken, no page is wider than its window, and dashes alone tell the curves of each plot apart.
fn assert_accessible(output: &Value) {
    assert_eq!(output["broken"], json!([]));
    let overflow = output["overflow"].as_array().expect("numbers");
    assert_eq!(overflow.len(), 6);
    let is_wide = |one: &&Value| one.as_i64() > Some(0);
    assert_eq!(overflow.iter().find(is_wide), None, "{overflow:?}");
    let pages = output["dashes"].as_array().expect("pages");
    let plots = pages
        .iter()
        .flat_map(|page| page.as_array().expect("plots"));
    let plots: Vec<&Vec<Value>> = plots.map(|plot| plot.as_array().expect("curves")).collect();
    assert!(plots.iter().any(|plot| plot.len() > 1), "{output}");
    for plot in plots {
        let different: BTreeSet<String> = plot.iter().map(ToString::to_string).collect();
        assert_eq!(different.len(), plot.len(), "{plot:?}");
    }
}

#[test]
fn a_live_panel_breaks_no_rule_of_accessibility_on_a_light_desk_and_a_dark_phone() {
    let rig = Rig::new();
    let dropout = "dropout measured.position_m --duration 0.05";
    let (run, panel) = begun(&rig, "", &["--inject", dropout]);
    if let Some(play) = Play::with_axe("accessible", &panel.url) {
        assert_accessible(&play.result());
    }
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn a_panel_of_a_recorded_run_breaks_no_rule_of_accessibility_either() {
    let rig = Rig::new();
    let run = rig.run(SCENARIO).expect(0);
    let heavy = heavy(&rig);
    let over = heavy.folder.to_str().expect("text");
    let panel = Panel::recorded(&rig, &run.folder, &["--over", over]);
    if let Some(play) = Play::with_axe("accessible", &panel.url) {
        assert_accessible(&play.result());
    }
}

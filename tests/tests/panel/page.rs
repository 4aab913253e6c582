//! Details of the page: complete labels, a stable button, choices that survive a reload, final values.

use std::path::Path;

use rustix::process::Signal;
use serde_json::{Value, json};

use super::browser::{Play, Played, begun};
use super::stream::held;
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, Running};
use crate::support::programs::shipped;

/// Starts the teaching run with a signal whose values differ in their fifth digit alone.
fn begun_with_a_narrow_range(rig: &Rig) -> (Running<'_>, Panel) {
    let narrow = "\n[[derived]]\nname = \"narrow\"\nunit = \"m\"\nexpression = \"5e-7 + 1e-8 * truth.position_m\"\n\
                  [[plots]]\ntitle = \"a narrow range\"\nsignals = [\"narrow\"]\n";
    let scenario = rig.write("narrow.toml", &(shipped(SCENARIO) + narrow));
    let run = held(rig, &scenario, "--pause-at 0.001");
    let panel = Panel::start(rig, &[]);
    rig.in_session("step 2499").expect(0);
    rig.until_held_at(2500);
    (run, panel)
}

#[test]
fn axis_labels_are_complete_in_both_themes_and_at_every_zoom() {
    let rig = Rig::new();
    let (run, panel) = begun_with_a_narrow_range(&rig);
    let Some(play) = Play::start("labels", &panel.url) else {
        return;
    };
    let result = play.result();
    let views = result.as_object().expect("views");
    let views: Vec<_> = views.iter().filter(|(view, _)| *view != "wrong").collect();
    assert_eq!(views.len(), 8);
    for (view, plots) in views {
        let plots = plots.as_array().expect("plots");
        let texts = plots.iter().flat_map(|plot| {
            let texts = plot["texts"].as_array().expect("texts");
            texts
                .iter()
                .map(|text| (text[0].as_str(), text[1].as_f64()))
        });
        let texts: Vec<_> = texts.collect();
        // Prefixes and offsets keep labels short; those of both axes are there.
        assert!(texts.len() > 3 * plots.len(), "{view}: {texts:?}");
        for (text, left) in texts {
            assert!(left >= Some(0.0), "{view}: {text:?} begins at {left:?}");
        }
        // Times are listed below each other, and names below the curves.
        let over = &plots[0]["over"];
        for plot in plots {
            assert_eq!(&plot["over"], over, "{view}");
            let [over, legend] =
                ["over", "legend"].map(|part| plot[part].as_f64().expect("a place"));
            assert!((over - legend).abs() < 1.0, "{view}: {plot}");
        }
    }
    drop(panel);
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}

#[test]
fn the_pause_button_becomes_resume_in_place_and_keeps_the_focus() {
    let rig = Rig::new();
    // So slow that it does not end before the browser is done.
    let run = held(&rig, Path::new(SCENARIO), "--pace 0.02 --pause-at 0.001");
    let panel = Panel::start(&rig, &[]);
    let Some(play) = Play::start("places", &panel.url) else {
        return;
    };
    let result = play.result();
    for width in ["1280", "1000", "800", "360"] {
        let seen = result[width].as_array().expect("three looks");
        let [paused, running, paused_again] = &seen[..] else {
            panic!("{result}");
        };
        assert_eq!(paused[4], "pause");
        assert_eq!((running, paused_again), (paused, paused), "{width}");
    }
    drop(panel);
    run.signal(Signal::INT);
    run.finish().expect(130);
}

#[test]
fn window_theme_and_hidden_curves_survive_a_reload_and_corrupt_storage() {
    let rig = Rig::new();
    let Some(played) = Played::of(&rig, "reload", &[]) else {
        return;
    };
    let result = &played.result;
    let (first, chosen) = (&result["first"], &result["chosen"]);
    assert_eq!((&first[0], &first[2][0]), (&json!("light"), &json!("true")));
    assert_eq!(
        (&chosen[0], &chosen[1], &chosen[2][0]),
        (&json!("dark"), &json!("1"), &json!("false"))
    );
    assert_eq!(&result["again"], chosen);
    assert_eq!(result["ink"][0][0], 0, "the hidden curve stays hidden");
    let stored = result["held"].to_string();
    assert!(stored.contains("dark"), "{stored}");
    assert!(!stored.contains(played.panel.secret()), "{stored}");
    for garbage in ["text", "null", "number", "other", "list"] {
        assert_eq!(&result[format!("garbage {garbage}")], first, "{garbage}");
    }
    assert_eq!(&result["refused"], first);
    let chosen = &result["refused-chosen"];
    assert_eq!(
        (&chosen[0], &chosen[2][0]),
        (&json!("dark"), &json!("false"))
    );
    played.end(&rig).expect(0);
}

#[test]
fn the_last_values_stay_when_the_run_has_ended() {
    let rig = Rig::new();
    let (run, panel) = begun(&rig, "", &["--signal", "*"]);
    let Some(play) = Play::start("final", &panel.url) else {
        return;
    };
    let result = play.result();
    assert_eq!(result["before"], "Readings");
    let looks = ["ended", "loaded"].map(|look| &result[look]);
    for look in looks {
        assert_eq!(look[2], "Final readings");
        let rows = [&look[0], &look[1]].map(|rows| rows.as_array().expect("rows"));
        assert!(rows.iter().all(|rows| !rows.is_empty()), "{look}");
        let names: Vec<&Value> = rows[1].iter().map(|row| &row[0]).collect();
        assert!(names.contains(&&json!("command.force_n")), "{names:?}");
        for row in rows.into_iter().flatten() {
            let value = row[1].as_str().expect("text");
            assert!(
                value.starts_with(|first: char| first == '-' || first.is_ascii_digit()),
                "{row}"
            );
        }
    }
    assert_eq!(looks[0], looks[1]);
    drop(panel);
    run.finish().expect(0);
}

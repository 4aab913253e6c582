//! Page of a campaign: its content without a script, and with one in a browser.

use std::path::Path;
use std::process::Command;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use super::{Planned, STUDY, campaign, planned, text};
use crate::report::accessible::broken;
use crate::report::browser::told;
use crate::support::harness::Rig;
use crate::support::programs::{chromium, skip, workspace};
use crate::support::python::{python, succeeds};

#[test]
fn a_campaign_page_agrees_with_show_and_loads_nothing() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let page = rig.path("page.html");
    rig.hil(&["report", text(&demo), "-o", text(&page)])
        .expect(0);
    let page_text = std::fs::read_to_string(&page).expect("a page");
    let digest = demo.digest();
    for expected in [
        &*digest,
        "default-src 'none'",
        "at least 0.8843",
        "hil campaign case",
    ] {
        assert!(
            page_text.contains(expected),
            "{expected} is not in the page"
        );
    }
    let python = python("playwright.sync_api, pyarrow.parquet");
    let Some((python, chromium)) = python.zip(chromium()) else {
        let why = "python3 with playwright and pyarrow, or chromium, is missing";
        return skip(why, "HIL_TEST_CHROMIUM");
    };
    let script = workspace().join("tests/hosts/campaign_page.py");
    let mut judge = Command::new(python);
    judge
        .arg(script)
        .arg(&page)
        .arg(demo.join("results.parquet"))
        .arg(chromium);
    let expected: Value = serde_json::from_str(&succeeds(&mut judge)).expect("JSON");
    assert_eq!(
        (&expected["rows"], &expected["wrong"]),
        (&60.into(), &Value::Array(Vec::new()))
    );
}

/// Data that the page of a campaign gives its script.
pub(super) fn data(rig: &Rig, folder: &Path) -> Value {
    let page = rig.hil(&["report", text(folder), "-o", "-"]).expect(0);
    let after = page
        .stdout
        .split("<script id=\"data\" type=\"application/json\">");
    let json = after.last().and_then(|rest| rest.split("</script>").next());
    serde_json::from_str(json.expect("data")).expect("JSON")
}

/// Returns curves of some numbers each.
fn curves(packed: &Value, bins: usize) -> Vec<Vec<f32>> {
    let bytes = STANDARD.decode(packed.as_str().expect("text"));
    let bytes = bytes.expect("base64");
    let (values, _) = bytes.as_chunks();
    let values: Vec<f32> = values.iter().map(|one| f32::from_le_bytes(*one)).collect();
    values.chunks(bins).map(<[f32]>::to_vec).collect()
}

#[test]
fn envelopes_are_the_extremes_of_the_recordings_of_all_cases() {
    let rig = Rig::new();
    let study = STUDY.replace("cases = 30", "cases = 4");
    let study = study.split("[[variants]]").next().expect("a study");
    let folder = planned(&rig, &super::study(&rig, study), "demo");
    folder.on("run").expect(0);
    let data = data(&rig, &folder);
    let envelopes = &data["envelopes"];
    let signals = envelopes["signals"].as_array().expect("signals");
    let place = signals
        .iter()
        .position(|one| one[0] == "truth.position_m")
        .expect("the position");
    let bins = usize::try_from(envelopes["bins"].as_u64().expect("bins")).expect("some");
    let bin_s = envelopes["bin_s"].as_f64().expect("a time");

    // Expected: minimum and maximum of each case in each bin, from a recording of its own.
    let recorded = (0..4).map(|case| {
        let out = rig.path(&format!("case-{case}"));
        let number = case.to_string();
        campaign(
            &rig,
            &[
                "case",
                text(&folder),
                &number,
                "--out",
                text(&out),
                "--in-process",
            ],
        );
        let csv = rig
            .hil(&["export", text(&out), "--signal", "truth.position_m"])
            .expect(0);
        let mut result = vec![[f64::INFINITY, f64::NEG_INFINITY]; bins];
        for line in csv
            .stdout
            .lines()
            .filter(|line| line.starts_with(|c: char| c.is_ascii_digit()))
        {
            let mut cells = line.split(',').map(|cell| cell.parse::<f64>().ok());
            let (time_s, value) = (cells.nth(1).flatten(), cells.next().flatten());
            let bin = (time_s.expect("a time") / bin_s) as usize;
            let [least, greatest] = &mut result[if bin < bins { bin } else { bins - 1 }];
            let value = value.expect("a position");
            if value < *least {
                *least = value;
            }
            if value > *greatest {
                *greatest = value;
            }
        }
        result
            .iter()
            .map(|bin| bin.map(|value| value as f32))
            .collect::<Vec<_>>()
    });
    let recorded: Vec<Vec<[f32; 2]>> = recorded.collect();

    let bands = curves(&envelopes["variants"][0][place], bins);
    for bin in 0..bins {
        let least = recorded
            .iter()
            .map(|case| case[bin][0])
            .min_by(f32::total_cmp);
        let greatest = recorded
            .iter()
            .map(|case| case[bin][1])
            .max_by(f32::total_cmp);
        assert_eq!(
            (Some(bands[0][bin]), Some(bands[7][bin])),
            (least, greatest),
            "bin {bin}"
        );
        let column: Vec<f32> = bands.iter().map(|curve| curve[bin]).collect();
        assert!(
            column[..4].is_sorted() && column[4..].is_sorted(),
            "{column:?}"
        );
    }
    let worst = &envelopes["worst"][0];
    let case = usize::try_from(worst["case"].as_u64().expect("a case")).expect("one of four");
    let ends = curves(&worst["signals"][place], bins);
    for bin in 0..bins {
        assert_eq!(
            [ends[0][bin], ends[1][bin]],
            recorded[case][bin],
            "bin {bin}"
        );
    }
}

/// Once all plots are drawn, without scrolling, reports how many have ink.
const INK: &str = "<script>addEventListener('load', () => {
  const look = () => {
    if (document.documentElement.dataset.drawn !== 'true') return setTimeout(look, 50);
    const all = [...document.querySelectorAll('figure.plot canvas')];
    const inked = all.filter((canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(Boolean));
    const shapes = [...document.querySelectorAll('#legend > span:not([hidden]) .shape')].map((one) => one.textContent);
    const dashes = [...document.querySelectorAll('#legend line')].map((one) => one.getAttribute('stroke-dasharray'));
    const box = document.createElement('pre');
    box.id = 'told';
    box.textContent = JSON.stringify({ all: all.length, inked: inked.length, shapes, dashes });
    document.body.append(box);
  };
  look();
});</script>";

#[test]
fn a_campaign_page_draws_without_scrolling_and_not_by_colour_alone() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let page = rig.hil(&["report", text(&demo), "-o", "-"]).expect(0);
    let page = page.stdout.replacen("</body>", &format!("{INK}</body>"), 1);
    let Some(result) = told(&rig, &page, 1280, false) else {
        return;
    };
    let result: Value = serde_json::from_str(&result).expect("JSON");
    assert!(result["all"].as_u64() > Some(5), "{result}");
    assert_eq!(result["inked"], result["all"]);
    for key in ["shapes", "dashes"] {
        let mut marks = result[key].as_array().expect("marks").clone();
        assert!(marks.len() > 1, "{result}");
        let count = marks.len();
        marks.sort_by_key(ToString::to_string);
        marks.dedup();
        assert_eq!(marks.len(), count, "{result}");
    }
}

#[test]
fn a_campaign_page_breaks_no_rule_of_accessibility_on_a_light_desk_and_a_dark_phone() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let page = rig
        .hil(&["report", text(&demo), "-o", "-"])
        .expect(0)
        .stdout;
    for (width, dark) in [(1280, false), (500, true)] {
        let Some(broken) = broken(&rig, &page, width, dark) else {
            return;
        };
        assert_eq!(broken, [""; 0], "{width} {dark}");
    }
}

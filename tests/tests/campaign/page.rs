//! The page of a campaign: what it says without a script, and with one in a browser.

use std::process::Command;

use serde_json::Value;

use super::{STUDY, campaign, digest, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{skip, workspace};
use crate::support::python::{python, succeeds};

#[test]
fn a_page_of_a_campaign_says_what_show_says_and_asks_for_nothing() {
    let rig = Rig::new();
    let folder = planned(&rig, &study(&rig, STUDY), "demo");
    campaign(&rig, &["run", text(&folder)]).expect(0);
    let page = rig.path("page.html");
    rig.hil(&["report", text(&folder), "-o", text(&page)])
        .expect(0);
    let page_text = std::fs::read_to_string(&page).expect("a page");
    let digest = digest(&rig, &folder);
    for told in [
        &*digest,
        "default-src 'none'",
        "at least 0.90497",
        "hil campaign case",
    ] {
        assert!(page_text.contains(told), "{told} is not in the page");
    }
    let test = "a_page_of_a_campaign_says_what_show_says_and_asks_for_nothing";
    let chromium = ["/usr/bin/chromium", "/usr/bin/chromium-browser"]
        .into_iter()
        .find(|path| std::path::Path::new(path).exists());
    let Some((python, chromium)) = python("playwright.sync_api, pyarrow.parquet").zip(chromium)
    else {
        let why = "python3 with playwright and pyarrow, or chromium, is missing";
        return skip(test, why, "HIL_TEST_CHROMIUM");
    };
    let script = workspace().join("tests/hosts/campaign_page.py");
    let mut judge = Command::new(python);
    judge
        .arg(script)
        .arg(&page)
        .arg(folder.join("results.parquet"))
        .arg(chromium);
    let told: Value = serde_json::from_str(&succeeds(&mut judge)).expect("JSON");
    assert_eq!(
        (&told["rows"], &told["wrong"]),
        (&60.into(), &Value::Array(Vec::new()))
    );
}

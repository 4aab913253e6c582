//! `hil report` of the paper's scenario, of its 20 s and of ten times as long, and the size of its page.

use std::process::Command;
use std::time::Instant;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::effort::{rounds, shortened};
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

const SCENARIO: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../scenarios/severe-leakage.toml"
);

/// Records the runs, and prints times and sizes.
pub(crate) fn compare(programs: &Programs) {
    let folder = TempDir::new().expect("a folder");
    let page = folder.path().join("page.html");
    let mut lines = Vec::new();
    for duration_s in [20, 20 + shortened(180)] {
        let run = folder.path().join(duration_s.to_string());
        let duration = format!("run.duration_s={duration_s}");
        let arguments = [SCENARIO, "--link", "in-process", "--set", &duration];
        let records = programs.run_in(&run, &arguments)["recording"]["records"].clone();
        let bystanders = Bystanders::watch();
        let mut bytes = Value::Null;
        let times = (0..rounds()).map(|_| {
            let mut hil = Command::new(&programs.hil);
            hil.arg("report")
                .arg(&run)
                .args(["--json", "--force", "-o"]);
            let began = Instant::now();
            let output = hil.arg(&page).output().expect("hil");
            let wall_s = began.elapsed().as_secs_f64();
            let summary: Value = serde_json::from_slice(&output.stdout).expect("JSON");
            bytes = summary["bytes"].clone();
            wall_s
        });
        let wall_s = median(times);
        let others = bystanders.share();
        println!(
            "report of {records} records: {wall_s:.2} s, median of {}, a page of {bytes} bytes, other programs took {:.0} % of the machine",
            rounds(),
            100.0 * others
        );
        lines.push(
            json!({"records": records, "wall_s": wall_s, "bytes": bytes, "others_share": others}),
        );
    }
    let line = json!({
        "bench": "loop/report",
        "machine": machine(),
        "rounds": rounds(),
        "runs": lines,
    });
    println!("{line}\n");
}

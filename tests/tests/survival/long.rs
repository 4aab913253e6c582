//! The table of `docs/survival.md`: which law survives which fault. `.ci/run long`.

use serde_json::Value;

use crate::every_fault::{LAWS, faults, with_fault};
use crate::support::harness::Rig;
use crate::support::programs::shipped;

/// Time at which the other fault begins, in s.
const BEGIN_S: f64 = 10.0;

#[test]
#[ignore = "long: .ci/run long"]
fn the_table_of_laws_and_faults_is_that_of_the_page() {
    let scenario = shipped("scenarios/severe-leakage.toml");
    let mut table = format!("| fault | {} |\n|---|---|---|---|\n", LAWS.join(" | "));
    table += &row("none", &scenario);
    for fault in faults() {
        table += &row(&fault.kind, &with_fault(&scenario, &fault, BEGIN_S));
    }
    let page = shipped("docs/survival.md");
    assert!(page.contains(&table), "docs/survival.md lacks:\n{table}");
}

/// Makes a row: the largest tracking error of each law from then on, or the time at which it left the plant's range.
fn row(name: &str, scenario: &str) -> String {
    let rig = Rig::new();
    let path = rig.write(
        "faulted.toml",
        &format!(
            "{scenario}\n[[metrics]]\nname = \"error_rad\"\nexpression = \"max_abs(tracking_error_rad)\"\nwindows_s = [[{BEGIN_S}, 20]]\n"
        ),
    );
    let cells = LAWS.map(|law| {
        let path = path.display();
        let run = rig.run(&format!("{path} --no-record --set controller.law={law}"));
        cell(&run.summary())
    });
    format!("| {name} | {} |\n", cells.join(" | "))
}

fn cell(summary: &Value) -> String {
    if let Some("pass" | "fail") = summary["verdict"].as_str() {
        let mut metrics = summary["metrics"].as_array().expect("a list").iter();
        let error = metrics.find(|metric| metric["name"] == "error_rad");
        let error_rad = error.and_then(|metric| metric["value"].as_f64());
        return format!("{:.3} mrad", 1e3 * error_rad.expect("a number"));
    }
    let reason = summary["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("diverged"), "{reason}");
    let time_s = summary["sim_time_s"].as_f64().expect("a number");
    format!("diverged after {:.4} s", time_s - BEGIN_S)
}

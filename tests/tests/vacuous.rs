//! Vacuous passes from the run to its evidence: a requirement whose premise never held is not counted as passed.

use serde_json::Value;

use crate::support::harness::{Rig, text};
use crate::support::programs::shipped;

/// Two requirements about the same conclusion: the mass passes 5 mm, and never 5 m.
const RULES: &str = r#"
[[requirements]]
name = "near"
formula = "always(truth.position_m > 0.005 implies truth.position_m < 1)"

[[requirements]]
name = "far"
formula = "always(truth.position_m > 5 implies truth.position_m < 1)"
verifies = ["SYS_7"]
"#;

const WHY: &str = "vacuous: `truth.position_m > 5` never called for its conclusion";

fn scenario(rig: &Rig) -> std::path::PathBuf {
    let shipped = shipped("scenarios/spring-mass.toml");
    rig.write("rules.toml", &(shipped + RULES))
}

fn requirement<'a>(result: &'a Value, name: &str) -> &'a Value {
    let mut all = result["requirements"].as_array().expect("a list").iter();
    all.find(|one| one["name"] == name).expect(name)
}

#[test]
fn a_premise_that_never_held_is_named_and_changes_no_verdict() {
    let rig = Rig::new();
    let scenario = scenario(&rig);
    let run = rig.run(&format!("{} --link in-process", scenario.display()));
    let run = run.expect(0).prints(&["spring-mass: pass", "far", WHY]);
    let summary = run.summary();
    assert_eq!(summary["verdict"], "pass");
    let far = requirement(&summary, "far");
    assert_eq!(far["verdict"], "pass");
    assert_eq!(far["vacuous"], "truth.position_m > 5");
    // No step comes near 5 m, so the margin is the distance of the largest position.
    assert!(far["robustness"].as_f64() > Some(4.9), "{far}");
    assert!(requirement(&summary, "near").get("vacuous").is_none());
    let judged = rig.hil(&["judge", text(&run.folder), "--json"]).expect(0);
    assert_eq!(judged.json()["requirements"], summary["requirements"]);
}

#[test]
fn a_vacuous_pass_is_no_evidence() {
    let rig = Rig::new();
    let scenario = scenario(&rig);
    let run = rig.run(&format!(
        "{} --link in-process --no-record",
        scenario.display()
    ));
    let run = run.expect(0);
    let evidence = rig.path("evidence");
    let arguments = ["export", text(&run.folder), "--evidence", text(&evidence)];
    let written = rig.hil(&[&arguments[..], &["--json"]].concat()).expect(0);
    let all = written.json();
    assert_eq!((&all["tests"], &all["passed"]), (&4.into(), &3.into()));
    let read = |name: &str| std::fs::read_to_string(evidence.join(name)).expect(name);
    let table = read("evidence.csv");
    assert!(table.contains("SYS_7,,vacuous,,far,"), "{table}");
    let junit = read("junit.xml");
    assert!(junit.contains("skipped"), "{junit}");
    assert!(junit.contains("truth.position_m &gt; 5"), "{junit}");
    let needs: Value = serde_json::from_str(&read("needs.json")).expect("JSON");
    let need = &needs["versions"]["1.0"]["needs"]["TEST_SPRING_MASS_FAR"];
    assert_eq!(need["status"], "vacuous", "{needs}");
}

#[test]
fn tables_of_several_runs_do_not_count_a_vacuous_pass() {
    let rig = Rig::new();
    let scenario = scenario(&rig);
    let [junit, markdown] = ["junit.xml", "table.md"].map(|name| rig.path(name));
    let files = format!("--junit {} --markdown {}", text(&junit), text(&markdown));
    let run = rig.run(&format!(
        "{} --link in-process --no-record --repeat 2 {files}",
        scenario.display()
    ));
    run.expect(0).prints(&["3 of 4", WHY]);
    let junit = std::fs::read_to_string(junit).expect("written");
    assert_eq!(junit.matches("<skipped").count(), 2, "{junit}");
    let markdown = std::fs::read_to_string(markdown).expect("written");
    assert!(markdown.contains("3 of 4"), "{markdown}");
    assert!(markdown.contains("| far | **vacuous** |"), "{markdown}");
}

#[test]
fn a_case_of_a_campaign_with_a_vacuous_pass_has_not_passed() {
    let rig = Rig::new();
    scenario(&rig);
    let study = rig.write(
        "study.toml",
        "schema = 1\nscenario = \"rules.toml\"\ncases = 2\n",
    );
    let folder = rig.path("campaign");
    rig.hil(&["campaign", "plan", text(&study), "-o", text(&folder)])
        .expect(0);
    let run = rig.hil(&["campaign", "run", text(&folder), "--json"]);
    let answers = run.expect(0).json();
    for variant in answers["variants"].as_array().expect("a list") {
        // pass, fail, diverged, undecided, lost, vacuous
        assert_eq!(variant["classes"][0], 0, "{variant}");
        assert_eq!(variant["classes"][5], 2, "{variant}");
        assert_eq!(variant["passes"]["count"], 0, "{variant}");
        let far = requirement(variant, "far");
        assert_eq!(far["holds"]["count"], 0, "{far}");
    }
    let tables = rig.hil(&["campaign", "show", text(&folder)]).expect(0);
    tables.prints(&["vacuous"]);
}

#[test]
fn a_vacuous_case_of_a_search_is_no_passing_one() {
    let rig = Rig::new();
    scenario(&rig);
    let search = |kind: &str, further: &str| {
        let range =
            "key = \"plant.parameters.mass_kg\"\nkind = \"uniform\"\nmin = 1.0\nmax = 1.1\n";
        let contents = format!(
            "schema = 1\nscenario = \"rules.toml\"\n[[vary]]\n{range}[search]\nruns = 5\n{further}"
        );
        let study = rig.write("search.toml", &contents);
        let folder = rig.path(&format!("{kind}{}", further.len()));
        rig.hil(&["search", kind, text(&study), "-o", text(&folder)])
    };
    for kind in ["worst", "smallest"] {
        let reason = "`far` is vacuous at mass_kg 1, because the premise";
        search(kind, "").expect(1).prints(&[reason]);
    }
    // Another requirement of the same cases can be searched.
    let near = search("worst", "requirement = \"near\"\n").expect(0);
    near.prints(&["is the worst tried and passes"]);
}

#[test]
fn a_list_of_runs_counts_vacuous_requirements_and_leaves_out_their_margins() {
    let rig = Rig::new();
    let mut scenario = shipped("scenarios/spring-mass.toml");
    scenario.truncate(scenario.find("[[requirements]]").expect("requirements"));
    // The mass stays below 30 mm, with a margin of about 20 mm, and about 1 m below the other limit.
    let far = "always(truth.position_m > 5 implies truth.position_m < 1)";
    let near_miss = "always(truth.position_m > 0.03 implies truth.position_m < 0)";
    scenario += &RULES.replace(far, near_miss);
    let scenario = rig.write("rules.toml", &scenario);
    let run = rig.run(&format!(
        "{} --link in-process --no-record",
        scenario.display()
    ));
    let run = run.expect(0);
    let summary = run.summary();
    let robustness = |name: &str| requirement(&summary, name)["robustness"].as_f64();
    assert!(robustness("far") < robustness("near"), "{summary}");
    let listed = rig.hil(&["runs", text(&run.folder), "--json"]).expect(0);
    let listed = &listed.json()["runs"][0];
    assert_eq!(
        (&listed["verdict"], &listed["vacuous"]),
        (&"pass".into(), &1.into())
    );
    assert_eq!(listed["margin"]["requirement"], "near", "{listed}");
    assert_eq!(listed["margin"]["robustness"].as_f64(), robustness("near"));
    let table = rig.hil(&["runs", text(&run.folder)]).expect(0);
    table.prints(&["pass, 1 vacuous"]);
}

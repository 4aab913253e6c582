//! Marks set at a step during a run: shown by every view of the run, and not part of its digest.

use serde_json::{Value, json};

use crate::support::harness::{Rig, text};
use crate::support::mcap_reader::Recording;

const SHORT: &str = "tests/scenarios/leakage.toml";

#[test]
fn a_mark_is_in_summary_export_and_report_and_changes_no_digest() {
    let rig = Rig::new();
    let expected = rig.run(SHORT).expect(0).digest();
    let run = rig.start(&format!("{SHORT} --pause-at 0.5"));
    let mark = |text: &str| rig.beside(&["mark", text, "--json", "--session", rig.session()]);
    rig.until_held_at(5000);
    let output = mark("  the <b>pilot</b> feels \u{1b}[31mit\n ").expect(0);
    let output = output.json();
    assert_eq!(
        output,
        json!({"response": "marked", "step": 5000, "at_s": 0.5})
    );
    for (text, why) in [
        (" ", "0 characters"),
        (&"µ".repeat(401)[..], "401 characters"),
    ] {
        mark(text).expect(2).says(&[why, "1 to 400"]);
    }
    mark(&"µ".repeat(400)).expect(0);
    rig.in_session("step 7").expect(0);
    let output = rig.in_session("mark later").expect(0).stdout;
    assert_eq!(output, "marked step 5007 (0.5007 s)\n");
    rig.in_session("resume").expect(0);
    let run = run.finish().expect(0);

    assert_eq!(run.digest(), expected);
    let cleaned = "the <b>pilot</b> feels \u{fffd}[31mit";
    let marks = json!([
        {"step": 5000, "text": cleaned, "at_s": 0.5},
        {"step": 5000, "text": "µ".repeat(400), "at_s": 0.5},
        {"step": 5007, "text": "later", "at_s": 0.5007},
    ]);
    assert_eq!(run.summary()["marks"], marks);
    assert!(run.stdout.contains("mark at step 5007 (0.5007 s): later"));

    let recorded = Recording::open(&run.recording()).events;
    let recorded = recorded.iter().filter(|event| event["event"] == "mark");
    let steps: Vec<&Value> = recorded.map(|event| &event["step"]).collect();
    assert_eq!(json!(steps), json!([5000, 5000, 5007]));

    let folder = run.folder.display().to_string();
    let table = rig.path("run.parquet").display().to_string();
    let arguments = ["export", &folder, "-o", &table, "--every", "1000", "--json"];
    let exported = rig.hil(&arguments).expect(0).json();
    assert_eq!(exported["marks"], marks);
    let bytes = std::fs::read(&table).expect("there");
    let holds = |text: &str| {
        bytes
            .windows(text.len())
            .any(|part| part == text.as_bytes())
    };
    assert!(holds("hil.marks") && holds(r#""text":"later""#));

    let page = rig.path("report.html");
    rig.hil(&["report", &folder, "-o", &page.display().to_string()])
        .expect(0);
    let page = std::fs::read_to_string(page).expect("there");
    assert!(page.contains("mark, step 5007, 0.5007 s: later"));
    assert!(page.contains("the &lt;b&gt;pilot&lt;/b&gt; feels"));
    assert!(!page.contains("<b>pilot"));

    // Repeated and compared as if there were no marks.
    let again = rig.rerun(&run.folder, &[]).expect(0).folder;
    rig.hil(&["compare", &folder, text(&again)]).expect(0);
}

#[test]
fn a_mark_without_a_session_or_a_text_is_refused() {
    let rig = Rig::new();
    rig.hil(&["mark", "x"])
        .expect(2)
        .says(&["no session", "hil run"]);
    rig.hil(&["mark"]).expect(2).says(&["<TEXT>"]);
}

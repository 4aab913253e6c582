//! Exit codes of suites, and escaping of texts in each report format.

use super::*;

fn row(label: &str, exit: Exit, failure: &str) -> Row {
    Row {
        label: label.into(),
        law: "pid".into(),
        origin: "a.toml".into(),
        exit,
        skipped: None,
        failure: (!failure.is_empty()).then(|| Failure::Usage(failure.into())),
        disagreement: None,
        begun: None,
        ran: None,
    }
}

#[test]
fn the_worst_run_determines_the_exit_code() {
    let of = |exits: &[Exit]| {
        let rows: Vec<Row> = exits.iter().map(|exit| row("a", *exit, "")).collect();
        worst(&rows)
    };
    use Exit::{Failed, Infrastructure, Interrupted, Pass};
    assert_eq!(of(&[Pass, Pass]), Pass);
    assert_eq!(of(&[Pass, Failed, Pass]), Failed);
    assert_eq!(of(&[Infrastructure, Failed]), Infrastructure);
    assert_eq!(of(&[Failed, Interrupted, Infrastructure]), Interrupted);
}

#[test]
fn a_run_that_never_started_is_an_error_in_every_format() {
    let rows = [row("<a|b>", Exit::Infrastructure, "no \"space\" & no time")];
    let xml = junit::of(&rows).expect("XML");
    assert!(xml.contains("errors=\"1\""), "{xml}");
    assert!(xml.contains("no &quot;space&quot; &amp; no time"), "{xml}");
    assert!(xml.contains("name=\"&lt;a|b&gt;\""), "{xml}");
    let text = markdown::of(&rows);
    assert!(text.contains("0 of 1 runs pass"), "{text}");
    assert!(text.contains("| <a\\|b> | pid | **not run** |"), "{text}");
    let text = table::of(&rows);
    assert!(text.contains("1 runs: 1 not run"), "{text}");
    assert!(text.contains("<a|b>: no \"space\" & no time"), "{text}");
}

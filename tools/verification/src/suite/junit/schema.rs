//! Content model of JUnit XML as the xUnit plugin of Jenkins accepts it (junit-10.xsd, MIT licence), restated: for
//! each element its children, its attributes, and its required attributes.

/// Element, children, attributes, and required attributes.
type Rule = (
    &'static str,
    &'static [&'static str],
    &'static [&'static str],
    &'static [&'static str],
);

const OUTCOME: &[&str] = &["type", "message"];
const RULES: [Rule; 10] = [
    ("", &["testsuites", "testsuite"], &[], &[]),
    (
        "testsuites",
        &["testsuite"],
        &["name", "time", "tests", "failures", "errors"],
        &[],
    ),
    (
        "testsuite",
        &[
            "testsuite",
            "properties",
            "testcase",
            "system-out",
            "system-err",
        ],
        &[
            "name",
            "tests",
            "failures",
            "errors",
            "group",
            "time",
            "skipped",
            "timestamp",
            "hostname",
            "id",
            "package",
            "file",
            "log",
            "url",
            "version",
        ],
        &["name", "tests", "failures", "errors"],
    ),
    ("properties", &["property"], &[], &[]),
    ("property", &[], &["name", "value"], &["name", "value"]),
    (
        "testcase",
        &["skipped", "error", "failure", "system-out", "system-err"],
        &["name", "time", "classname", "group"],
        &["name"],
    ),
    ("skipped", &[], OUTCOME, &[]),
    ("error", &[], OUTCOME, &[]),
    ("failure", &[], OUTCOME, &[]),
    ("system-out", &[], &[], &[]),
];

/// Lists all violations of the schema in a text, which must be well-formed and without comments.
pub(super) fn objections(xml: &str) -> Vec<String> {
    let mut objections = Vec::new();
    let mut open = vec![""];
    for tag in xml.split('<').skip(1) {
        let (tag, _) = tag.split_once('>').expect("an end of the tag");
        if tag.starts_with('?') {
            continue;
        }
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "well-formed");
            continue;
        }
        let is_empty = tag.ends_with('/');
        let tag = tag.trim_end_matches('/');
        let (name, rest) = tag.split_once(' ').unwrap_or((tag, ""));
        let parent = open[open.len() - 1];
        let rule = |name: &str| RULES.iter().find(|rule| rule.0 == name);
        if !rule(parent).is_some_and(|rule| rule.1.contains(&name)) {
            objections.push(format!("{name} in {parent}"));
        }
        let attributes = attributes(rest);
        if let Some((_, _, all, required)) = rule(name) {
            let unknown = attributes.iter().filter(|(name, _)| !all.contains(name));
            objections.extend(unknown.map(|(one, _)| format!("attribute {one} of {name}")));
            let is_missing = |one: &&&str| attributes.iter().all(|(name, _)| name != *one);
            let missing = required.iter().filter(is_missing);
            objections.extend(missing.map(|one| format!("no attribute {one} of {name}")));
        }
        // Pattern of the schema: digits, and at most three of them after a point.
        let is_time = |value: &str| {
            let (whole, part) = value.split_once('.').unwrap_or((value, ""));
            part.len() <= 3
                && [whole, part]
                    .concat()
                    .bytes()
                    .all(|byte| byte.is_ascii_digit())
        };
        let times = attributes
            .iter()
            .filter(|(one, value)| *one == "time" && !is_time(value));
        objections.extend(times.map(|(_, value)| format!("time {value} of {name}")));
        if !is_empty {
            open.push(name);
        }
    }
    objections
}

/// Splits the attributes of a tag into names and values.
fn attributes(text: &str) -> Vec<(&str, &str)> {
    let parts: Vec<&str> = text.split('"').collect();
    let pairs = parts.chunks_exact(2);
    pairs
        .map(|pair| (pair[0].trim().trim_end_matches('='), pair[1]))
        .collect()
}

#[test]
fn the_restated_schema_refuses_the_same_texts_as_that_of_jenkins() {
    let suites = |inside: &str| {
        format!("<?xml version=\"1.0\"?><testsuites name=\"a\">{inside}</testsuites>")
    };
    let suite = |inside: &str| {
        suites(&format!(
            "<testsuite name=\"a\" tests=\"1\" failures=\"0\" errors=\"0\">{inside}</testsuite>"
        ))
    };
    assert!(objections(&suite("<testcase name=\"b\"/>")).is_empty());
    for wrong in [
        "<testsuites skipped=\"0\"></testsuites>".to_owned(),
        "<testsuites uuid=\"0\"></testsuites>".to_owned(),
        suites("<testcase name=\"b\"/>"),
        suites("<testsuite name=\"a\"/>"),
        suite("<testcase/>"),
        suite("<testcase name=\"b\" assertions=\"1\"/>"),
        suite("<testcase name=\"b\"><properties></properties></testcase>"),
        suite("<failure/>"),
        "<testsuites time=\"1.2345\"></testsuites>".to_owned(),
    ] {
        assert_eq!(objections(&wrong).len().clamp(0, 1), 1, "{wrong}");
    }
}

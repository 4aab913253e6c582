//! Programs started by tests: ours only through the rig, which gives each test its own sessions.

use std::fs;
use std::path::Path;

use crate::support::programs::workspace;

/// Tools that tests start without the rig, as spelled in the sources; they start none of our programs.
const TOOLS: [&str; 24] = [
    "\"cat\"",
    "\"cc\"",
    "\"cmake\"",
    "\"cp\"",
    "\"gdb\"",
    "\"git\"",
    "\"kill\"",
    "\"make\"",
    "\"node\"",
    "\"npm\"",
    "\"parallel\"",
    "\"pdffonts\"",
    "\"pdfinfo\"",
    "\"pdftotext\"",
    "\"rustc\"",
    "\"rustup\"",
    "\"sleep\"",
    "\"tcpdump\"",
    "\"touch\"",
    "chromium",
    "compiler",
    "env!(\"CARGO\")",
    "python",
    "rustc",
];

/// Locations that start another program without the rig, with the reason.
const OTHERS: [(&str, &str, &str); 8] = [
    ("book.rs", "program", "the preprocessor of the book"),
    ("intrusion.rs", "\"sh\"", "attempts of another user"),
    (
        "mutations.rs",
        "program",
        "an explorer that the test compiled",
    ),
    ("quad.rs", "\"sh\"", "the script that builds Betaflight"),
    (
        "quad.rs",
        "\"nsenter\"",
        "a question to Betaflight in its own network",
    ),
    ("reader.rs", "\"bash\"", "lines that only end"),
    ("realtime_settings.rs", "\"setpriv\"", "a trial with `true`"),
    (
        "monitor.rs",
        "std::env::current_exe().expect(\"this program\")",
        "the test binary",
    ),
];

/// Returns the argument of each `Command::new` in a source.
fn started(source: &str) -> Vec<&str> {
    let calls = source.split("Command::new(").skip(1);
    calls
        .map(|call| {
            let mut open = 1;
            let end = call.find(|sign| {
                open += i32::from(sign == '(') - i32::from(sign == ')');
                open == 0
            });
            call[..end.expect("a call ends")].trim_start_matches('&')
        })
        .collect()
}

fn check(folder: &Path, wrong: &mut Vec<String>) {
    for entry in fs::read_dir(folder).expect("a folder of tests") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_owned();
        if path.is_dir() {
            // The rig itself, and this test, which contains such calls.
            if name != "support" && name != "architecture" {
                check(&path, wrong);
            }
            continue;
        }
        let source = fs::read_to_string(&path).expect("text");
        for program in started(&source) {
            let is_known =
                |(file, known, _): &(&str, &str, &str)| name == *file && program == *known;
            if !TOOLS.contains(&program) && !OTHERS.iter().any(is_known) {
                wrong.push(format!("{}: Command::new({program})", path.display()));
            }
        }
    }
}

#[test]
fn tests_start_our_programs_through_the_rig() {
    let mut wrong = Vec::new();
    check(&workspace().join("tests/tests"), &mut wrong);
    assert_eq!(
        wrong, [""; 0],
        "`Rig::command` keeps the sessions of a test apart from all others"
    );
}

#[test]
fn started_programs_are_found_in_the_source() {
    let source = "let a = Command::new(&python);\nstd::process::Command::new(program(\"hil\"))";
    assert_eq!(started(source), ["python", "program(\"hil\")"]);
}

//! Texts with more mistakes than anybody reads, or with control sequences for the terminal.

use hil_config::problem::Problems;

use crate::{base_with, check};

fn refused(text: &str) -> Problems {
    check(text).expect_err("something is wrong")
}

#[test]
fn very_many_problems_are_truncated_with_a_note() {
    for (count, reported, more) in [
        (99, 99, false),
        (100, 100, false),
        (101, 100, true),
        (50_000, 100, true),
    ] {
        let unknown: String = (0..count).map(|n| format!("odd{n} = 1\n")).collect();
        let Problems(problems) = refused(&base_with(
            "schema = 1\n",
            &format!("schema = 1\n{unknown}"),
        ));
        assert_eq!(problems.len(), reported, "{count}");
        let help = problems[reported - 1].help.as_deref().unwrap_or_default();
        assert_eq!(help.contains("more problems"), more, "{count}: {help}");
    }
}

#[test]
fn a_problem_in_a_very_long_line_shows_the_part_around_it() {
    let unknown: String = (0..100_000).map(|n| format!("odd{n} = 1, ")).collect();
    let Problems(problems) = refused(&format!("schema = 1\nrun = {{ {unknown} }}\n"));
    for problem in &problems {
        let length = problem.excerpt.as_ref().map_or(0, |at| at.text.len());
        assert!(length <= 400, "{length}");
    }
    let last = problems
        .last()
        .expect("a problem")
        .excerpt
        .as_ref()
        .expect("a line");
    let marked = last
        .text
        .chars()
        .skip(last.column - last.text_column)
        .take(last.width);
    assert!(marked.collect::<String>().starts_with("odd"), "{last:?}");
}

#[test]
fn a_name_as_long_as_a_file_is_truncated() {
    let name = "x".repeat(5 << 20);
    let text = refused(&format!("schema = 1\n{name} = 1\n")).to_string();
    assert!(text.contains("unknown key `xxx"), "{}", &text[..200]);
    assert!(text.len() < 20_000, "{}", text.len());
}

#[test]
fn no_text_controls_the_terminal() {
    let odd = r#""\u001b[2J\u0007\r\n0""#;
    for text in [
        base_with("seed = 7", &format!("{odd} = 7")),
        base_with("\"base\"", odd),
        base_with("model = \"drhas\"", &format!("model = {odd}")),
        base_with("target = \"load_n\"", &format!("target = {odd}")),
    ] {
        let message = refused(&text).to_string();
        let is_named = message.contains("\u{fffd}[2J") || message.contains("control character");
        assert!(is_named, "{message}");
        let steers = |c: char| c.is_control() && c != '\n';
        assert!(!message.contains(steers), "{message:?}");
    }
}

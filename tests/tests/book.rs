//! The book: pages at the top of the workspace, in `docs`, and the READMEs of `examples`.
//!
//! Every command block of a page is executed and the output shown after it is compared, code is part of the
//! examples or is compiled, links resolve, and generated pages are up to date.
//!
//! A block that cannot run in a test (it needs root, a window or the network) is fenced as `console` instead of
//! `sh`.

mod links;
mod page;
mod reader;
mod references;
mod shown;

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use page::{Page, pages};
use reader::Desk;
use serde_json::{Value, json};

use crate::support::harness::Rig;
use crate::support::programs::{self, outside, shipped, workspace};

fn example(path: &str) -> String {
    shipped(Path::new("examples").join(path))
}

#[test]
fn every_command_block_of_the_book_runs() {
    // Set before the first page, because tests that must run alone wait for the end of a page.
    for name in [
        "own-plant",
        "quad",
        "own-controller",
        "own-fault",
        "unix-socket-link",
    ] {
        programs::example(name);
    }
    let desk = Desk::new();
    let only = std::env::var("HIL_TEST_PAGE").unwrap_or_default();
    let mut failures = Vec::new();
    for page in pages() {
        if page.path.to_string_lossy().contains(&only) {
            failures.extend(desk.follow(&page).err());
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

#[test]
fn every_data_block_of_the_book_can_be_parsed() {
    for page in pages() {
        for block in page.blocks() {
            let place = format!("{}:{}", page.path.display(), block.line);
            match block.language {
                "toml" => {
                    let read: Result<toml::Table, _> = toml::from_str(&block.text);
                    read.unwrap_or_else(|error| panic!("{place}: {error}"));
                }
                "json" => {
                    let text = block.text.trim();
                    let text = if text.starts_with('{') {
                        text.to_owned()
                    } else {
                        format!("{{{text}}}")
                    };
                    let read: Result<serde_json::Value, _> = serde_json::from_str(&text);
                    read.unwrap_or_else(|error| panic!("{place}: {error}"));
                }
                "sh" | "console" | "text" | "rust" | "python" | "c" | "matlab" => {}
                other => panic!("{place}: a block of `{other}`: nobody looks after it"),
            }
        }
    }
}

#[test]
fn the_code_of_the_chapters_is_that_of_the_examples() {
    for (chapter, name) in [
        ("docs/own-plant.md", "own-plant"),
        ("docs/own-controller.md", "own-controller"),
    ] {
        let page = Page::read(chapter.into());
        let blocks = page.blocks();
        let of_program = |file: Option<(&str, bool)>| file.is_some_and(|f| f.0 == "src/main.rs");
        let code: String = (blocks.iter())
            .filter(|block| of_program(block.file))
            .map(|block| block.text.as_str())
            .collect();
        let example = example(&format!("{name}/src/main.rs"));
        let begin = example.find("use ").expect("it imports something");
        // Snippets are joined without the blank lines between them.
        let lines = |text: &str| -> Vec<String> {
            let lines = text.lines().filter(|line| !line.trim().is_empty());
            lines.map(str::to_owned).collect()
        };
        assert_eq!(lines(&code), lines(&example[begin..]), "{chapter}");
    }
}

#[test]
fn every_line_of_rust_in_the_book_is_in_an_example_or_is_compiled() {
    let examples: String = [
        "own-plant/src/main.rs",
        "own-controller/src/main.rs",
        "own-fault/src/main.rs",
        "unix-socket-link/tests/conformance.rs",
        "../tests/shared/patchy_plant.rs",
        "../tests/shared/watchful_law.rs",
        "../tools/recording/examples/extremes.rs",
        "../tools/recording/examples/fall.rs",
    ]
    .map(example)
    .concat();
    for page in pages() {
        let blocks = page.blocks();
        let text = blocks
            .iter()
            .filter(|block| block.language == "rust" && block.file.is_none());
        for block in text {
            for line in block.text.lines().map(str::trim) {
                let place = format!("{}:{}", page.path.display(), block.line);
                let comment = line.is_empty() || line.starts_with("//");
                assert!(comment || examples.contains(line), "{place}: `{line}`");
            }
        }
    }
}

#[test]
fn every_line_of_c_in_the_book_is_in_an_example() {
    let examples = ["c-plant/pendulum.c", "c-controller/state_feedback.c"].map(example);
    let examples = examples.concat();
    for page in pages() {
        let blocks = page.blocks();
        for block in blocks.iter().filter(|block| block.language == "c") {
            for line in block.text.lines().map(str::trim) {
                let place = format!("{}:{}", page.path.display(), block.line);
                assert!(examples.contains(line), "{place}: `{line}`");
            }
        }
    }
}

#[test]
fn the_scenario_of_the_chapters_is_that_of_the_examples() {
    let page = Page::read("docs/own-controller.md".into());
    let view = page.blocks().into_iter().map(|block| block.text);
    let view = view.filter(|text| text.contains("name = \"pendulum\"") && text.contains("[run]"));
    // Each names the programs where its reader has built them.
    let read = |text: String| -> toml::Table {
        let mut scenario: toml::Table = toml::from_str(&text).expect("TOML");
        for side in ["plant", "controller"] {
            let side = scenario[side].as_table_mut().expect("a table");
            assert!(side.remove("program").is_some());
        }
        scenario
    };
    let view: Vec<toml::Table> = view.map(read).collect();
    assert_eq!(view, [read(example("own-plant/pendulum.toml"))]);
}

/// Passes the preprocessor the input of mdBook, and returns its output.
fn preprocessed(pages: &[Page]) -> Value {
    let chapters: Vec<Value> = (pages.iter())
        .map(|page| {
            let path = page.path.strip_prefix("docs").expect("a page of the book");
            json!({"Chapter": {"content": page.text, "source_path": path, "sub_items": []}})
        })
        .collect();
    let input = json!([{"root": workspace().join("docs")}, {"items": chapters}]);
    let program = outside(Path::new("tests/book"), "book");
    let mut child = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the preprocessor");
    let mut stdin = child.stdin.take().expect("piped");
    // The preprocessor reads everything before it writes.
    stdin
        .write_all(input.to_string().as_bytes())
        .expect("it reads");
    drop(stdin);
    let output = child.wait_with_output().expect("the preprocessor");
    assert!(output.status.success(), "its message is above");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn every_equation_of_the_book_can_be_rendered() {
    let pages: Vec<Page> = pages()
        .into_iter()
        .filter(|page| page.path.starts_with("docs"))
        .collect();
    let book = preprocessed(&pages);
    let mut drawn = 0;
    for (page, chapter) in pages.iter().zip(book["items"].as_array().expect("items")) {
        let text = chapter["Chapter"]["content"].as_str().expect("content");
        drawn += text.matches("<math").count();
        let place = page.path.display();
        let left = |line: &str| line.starts_with("$$") || line.starts_with("<!-- include:");
        assert!(!text.lines().any(left), "{place}");
    }
    // Equations of the plant and of the laws, at least one for each number.
    assert!(drawn > 50, "{drawn}");
}

/// Collects the keys of a value at any depth.
fn keys(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Array(values) => values.iter().for_each(|value| keys(value, found)),
        Value::Object(object) => {
            for (key, value) in object {
                found.push(key.clone());
                keys(value, found);
            }
        }
        _ => {}
    }
}

#[test]
fn every_key_of_a_summary_is_documented() {
    let rig = Rig::new();
    let run = rig.run("scenarios/spring-breaks.toml").expect(0);
    let mut entries = Vec::new();
    keys(&run.summary(), &mut entries);
    let page = Page::read("docs/reading.md".into());
    let (_, documented) = (page.text)
        .split_once("## `summary.json`")
        .expect("the section");
    entries.retain(|key| !documented.contains(&format!("`{key}`")));
    assert!(entries.is_empty(), "{entries:?}");
}

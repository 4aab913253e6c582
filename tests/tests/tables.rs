//! Mistakes in a `table!`: the compiler names each and points at its row.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;

use crate::support::programs::build;

/// Returns the library of contracts as Cargo built it for the programs under test.
fn contracts() -> &'static Path {
    static FOUND: OnceLock<PathBuf> = OnceLock::new();
    FOUND.get_or_init(|| {
        let output = build().arg("--message-format=json").output();
        let output = output.expect("cargo can be run");
        assert!(output.status.success(), "cargo build failed");
        let text = String::from_utf8(output.stdout).expect("text");
        let mut messages = text.lines().flat_map(serde_json::from_str::<Value>);
        let built = messages
            .find(|one| one["target"]["name"] == "shared_types")
            .expect("it was built");
        let files = built["filenames"].as_array().expect("files").iter();
        let mut files = files.flat_map(Value::as_str).map(PathBuf::from);
        let is_library = |file: &PathBuf| file.extension().is_some_and(|end| end == "rlib");
        files.find(is_library).expect("a library")
    })
}

/// Returns the compiler's messages for a program; empty if it compiles.
fn compiled(program: &str) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("own.rs"), program).expect("written");
    let library = contracts();
    let own = std::env::current_exe().expect("a path to this program");
    let dependencies = own.parent().expect("it lies among the dependencies");
    let rustc = Path::new(env!("CARGO")).with_file_name("rustc");
    let output = Command::new(rustc)
        .current_dir(folder.path())
        .args(["own.rs", "--edition=2024", "--crate-type=lib"])
        .args(["--emit=metadata", "--color=never", "-Dwarnings"])
        .arg(format!("--extern=shared_types={}", library.display()))
        .arg(format!("-Ldependency={}", dependencies.display()))
        .output()
        .expect("rustc can be run");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.success(), text.is_empty(), "{text}");
    text
}

/// Returns a program with a table of parameters that ends with these rows.
fn with(rows: &str) -> String {
    format!(
        "shared_types::table! {{\n/// What it can be told.\npub struct Parameters {{\n\
         /// Mass m.\nmass_kg: \"kg\" = 1.0 in 1e-3..=1e3 [faultable],\n{rows}\n}}\n}}\n"
    )
}

/// Line of [`with`]'s rows, and the line below it.
const FIRST: usize = 6;
const SECOND: usize = 7;

#[track_caller]
fn refused(rows: &str, line: usize, words: &[&str]) {
    let output = compiled(&with(rows));
    let place = format!("--> own.rs:{line}:");
    for part in words.iter().chain([&place.as_str()]) {
        assert!(output.contains(part), "{part:?} is not in\n{output}");
    }
    let errors = output.lines().filter(|line| line.starts_with("error["));
    assert_eq!(errors.count(), 1, "{output}");
}

/// Fails unless each of these rows, after a description, is refused with these words.
#[track_caller]
fn each_is_refused(rows: &[&str], words: &[&str]) {
    for row in rows {
        refused(&format!("/// A quantity.\n{row}"), SECOND, words);
    }
}

#[test]
fn valid_tables_compile_without_a_warning() {
    let rows = "/// From below 0.\nangle_rad: \"rad\" = (-0.1) in (-1.5)..=(f64::MAX),";
    assert_eq!(compiled(&with(rows)), "");
}

#[test]
fn a_range_that_begins_above_its_end_is_named() {
    let words = ["the range of a row begins above its end"];
    let rows = [
        "length_m: \"m\" = 1.0 in 2.0..=0.5,",
        "length_m: \"m\" = 1.0 in (f64::MAX)..=0.5,",
    ];
    each_is_refused(&rows, &words);
}

#[test]
fn a_default_outside_its_range_is_named() {
    let words = ["the default of a row is outside its range"];
    let rows = [
        "length_m: \"m\" = 3.0 in 0.5..=2.0,",
        "length_m: \"m\" = (f64::NAN) in 0.5..=2.0,",
    ];
    each_is_refused(&rows, &words);
}

#[test]
fn a_misspelt_flag_is_named_with_the_one_that_exists() {
    let words = ["`fautable`", "help", "faultable"];
    each_is_refused(&["length_m: \"m\" = 1.0 in 0.5..=2.0 [fautable],"], &words);
}

#[test]
fn a_parameter_without_a_default_is_named() {
    let words = ["a parameter has no default"];
    let rows = [
        "length_m: \"m\",",
        "length_m: \"m\" in 0.5..=2.0,",
        "length_m: \"m\" in 0.5..=2.0 [faultable],",
    ];
    each_is_refused(&rows, &words);
}

#[test]
fn a_flag_without_a_default_is_named_in_a_table_of_signals_too() {
    let output = compiled(
        "shared_types::table! {\n/// True.\nstruct Truth {\n/// Length.\nlength_m: \"m\" [faultable],\n}\n}\n",
    );
    for part in ["a parameter has no default", "own.rs:5:"] {
        assert!(output.contains(part), "{part:?} is not in\n{output}");
    }
}

#[test]
fn a_row_without_a_description_is_named() {
    let words = ["a row of a table has no description", "///"];
    refused("length_m: \"m\" = 1.0 in 0.5..=2.0,", FIRST, &words);
}

#[test]
fn a_row_without_a_unit_is_named() {
    let words = ["a row of a table has no unit"];
    refused("/// Length.\nlength_m = 1.0 in 0.5..=2.0,", FIRST, &words);
}

#[test]
fn a_row_of_a_name_alone_is_named() {
    let output = compiled(&with("length_m = 1.0,"));
    assert!(
        output.contains("the row `length_m` of a table has no description and no unit"),
        "{output}"
    );
}

#[test]
fn a_negative_number_without_parentheses_is_named() {
    let words = ["a negative number stands in parentheses"];
    let rows = [
        "angle_rad: \"rad\" = 0.0 in -1.5..=1.5,",
        "angle_rad: \"rad\" = (-2.0) in (-3.0)..=-1.5,",
        "angle_rad: \"rad\" = -0.1 in (-1.5)..=1.5,",
    ];
    each_is_refused(&rows, &words);
}

#[test]
fn a_table_without_defaults_is_not_a_parameter_table() {
    let output = compiled(
        "shared_types::table! {\n/// Gains.\npub struct Gains {\n/// Gain.\nk: \"1\" in 0.0..=1.0,\n}\n}\n\
         pub fn set<T: shared_types::table::Parameters>() {}\n\
         pub fn all() { set::<Gains>() }\n",
    );
    for part in ["`Gains` is not a table of parameters", "own.rs:9:"] {
        assert!(output.contains(part), "{part:?} is not in\n{output}");
    }
}

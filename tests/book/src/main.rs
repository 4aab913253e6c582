//! Changes to the pages of `docs` that mdBook cannot make, as a preprocessor for it: the book as JSON
//! comes on standard input and goes to standard output. `docs/book.toml` names it.
//!
//! - Equations between dollars become MathML, which browsers draw without any script.
//! - Links that leave `docs` lead to the source tree, which the built book, in `target/book`, is in.
//! - `<!-- include: FILE -->` is replaced by that file, for pages outside of `docs`.
//!
//! Changes nothing else, and needs no network.

mod equations;
mod links;

use std::io::{Read, Write};
use std::path::Path;
use std::process::ExitCode;

use serde_json::Value;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    if arguments.next().as_deref() == Some("supports") {
        let html = arguments.next().as_deref() == Some("html");
        return ExitCode::from(u8::from(!html));
    }
    match preprocess() {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("error: {reason}");
            ExitCode::FAILURE
        }
    }
}

fn preprocess() -> Result<(), String> {
    let mut text = String::new();
    let read = std::io::stdin().read_to_string(&mut text);
    read.map_err(|e| e.to_string())?;
    let input: Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    let root = input[0]["root"].as_str().unwrap_or(".");
    let mut book = input[1].clone();
    chapters(&mut book, Path::new(root))?;
    let mut output = std::io::stdout();
    write!(output, "{book}").map_err(|e| e.to_string())
}

/// Returns every chapter below a value, however deep.
fn chapters(value: &mut Value, root: &Path) -> Result<(), String> {
    match value {
        Value::Array(values) => values
            .iter_mut()
            .try_for_each(|value| chapters(value, root)),
        Value::Object(object) => {
            if let Some(chapter) = object.get_mut("Chapter")
                && let Some(content) = chapter["content"].as_str()
            {
                let path = chapter["source_path"]
                    .as_str()
                    .unwrap_or_default()
                    .to_owned();
                let new =
                    page(content, &path, root).map_err(|reason| format!("{path}: {reason}"))?;
                chapter["content"] = Value::String(new);
            }
            object
                .values_mut()
                .try_for_each(|value| chapters(value, root))
        }
        _ => Ok(()),
    }
}

/// Prepares a page, named by its path from `docs`.
fn page(content: &str, path: &str, root: &Path) -> Result<String, String> {
    let depth = path.matches('/').count();
    let mut whole = String::new();
    for line in content.split_inclusive('\n') {
        let named = line.trim().strip_prefix("<!-- include:");
        match named.and_then(|named| named.strip_suffix("-->")) {
            Some(file) => {
                let file = root.join(file.trim());
                let text = std::fs::read_to_string(&file)
                    .map_err(|e| format!("{}: {e}", file.display()))?;
                whole += &links::from_top(&text);
            }
            None => whole += line,
        }
    }
    equations::as_mathml(&links::to_source(&whole, depth))
}

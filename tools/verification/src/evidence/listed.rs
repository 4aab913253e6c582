//! Requirements that are to be verified, as listed by another program: JSON of sphinx-needs, or CSV.

use std::collections::HashSet;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use hil_console::terminal::exit::Failure;
use serde::Deserialize;
use serde_json::Value;
use shared_types::text::{line, line_of};

/// Maximum size of a list, in bytes.
const LARGEST: u64 = 64 << 20;

/// Listed requirement.
#[derive(Debug, Deserialize)]
pub(super) struct Listed {
    #[serde(deserialize_with = "line_of")]
    pub(super) id: String,
    #[serde(default, deserialize_with = "line_of")]
    pub(super) title: String,
}

/// Reads a list.
pub(super) fn read(path: &Path) -> Result<Vec<Listed>, Failure> {
    let path_text = path.display();
    let cannot = |error: &dyn std::fmt::Display| {
        Failure::usage(format!(
            "cannot read requirements from {path_text}: {error}"
        ))
    };
    let mut text = Vec::new();
    let file = File::open(path).map_err(|error| cannot(&error))?;
    (file.take(LARGEST + 1).read_to_end(&mut text)).map_err(|error| cannot(&error))?;
    if text.len() as u64 > LARGEST {
        return Err(cannot(&format!("it is larger than {} MiB", LARGEST >> 20)));
    }
    let is_json = path.extension().is_some_and(|ending| ending == "json");
    let listed = if is_json {
        from_json(&text)
    } else {
        from_csv(&text)
    }
    .map_err(|error| cannot(&error))?;
    let mut ids = HashSet::new();
    if let Some(twice) = listed.iter().find(|listed| !ids.insert(&listed.id)) {
        return Err(cannot(&format!("`{}` is listed twice", twice.id)));
    }
    Ok(listed)
}

/// Returns the needs of the current version whose type contains `req`, sorted by their identifiers.
fn from_json(text: &[u8]) -> Result<Vec<Listed>, String> {
    let all: Value = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    let version = all["current_version"].as_str().unwrap_or_default();
    let needs = all["versions"][version]["needs"].as_object().ok_or(
        "it has no needs of the current version; a file of sphinx-needs has versions.<current_version>.needs",
    )?;
    let is_requirement = |need: &Value| {
        let kind = need["type"].as_str();
        kind.is_some_and(|kind| kind.to_ascii_lowercase().contains("req"))
    };
    let requirements = needs.iter().filter(|(_, need)| is_requirement(need));
    let mut listed: Vec<Listed> = requirements
        .map(|(id, need)| Listed {
            id: line(id),
            title: line(need["title"].as_str().unwrap_or_default()),
        })
        .collect();
    if listed.is_empty() {
        return Err("none of its needs has a type that contains `req`".into());
    }
    listed.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(listed)
}

/// Returns the rows of a table that has a column `id` and perhaps a column `title`.
fn from_csv(text: &[u8]) -> Result<Vec<Listed>, String> {
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let mut reader = csv::Reader::from_reader(text);
    let header = reader.headers().map_err(|error| error.to_string())?;
    if !header.iter().any(|name| name == "id") {
        let header = line(&header.iter().collect::<Vec<_>>().join(", "));
        return Err(format!("its first line lacks the column `id`: {header}"));
    }
    let rows: Result<Vec<Listed>, _> = reader.deserialize().collect();
    let listed = rows.map_err(|error| error.to_string())?;
    if listed.is_empty() {
        return Err("it has no rows".into());
    }
    if listed.iter().any(|listed| listed.id.is_empty()) {
        return Err("a row has no `id`".into());
    }
    Ok(listed)
}

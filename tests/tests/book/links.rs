//! Links of the pages: what they point to exists, and every page can be reached.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use super::page::{Page, pages};
use crate::support::programs::{shipped, workspace};

/// Lists the links of a page with their lines; none from inside code.
fn links(page: &Page) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut fenced = false;
    for (number, line) in page.text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced {
            continue;
        }
        // Every second piece between backticks is code.
        let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        for piece in prose.split("](").skip(1) {
            if let Some((target, _)) = piece.split_once(')') {
                found.push((number + 1, target.to_owned()));
            }
        }
        for attribute in ["src=\"", "srcset=\"", "href=\""] {
            for piece in line.split(attribute).skip(1) {
                let target = piece.split('"').next().unwrap_or_default();
                found.push((number + 1, target.to_owned()));
            }
        }
    }
    found
}

/// Returns the anchors of a page's headings, as code-hosting sites and mdBook make them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    let mut fenced = false;
    for line in text.lines() {
        fenced ^= line.trim_start().starts_with("```");
        let heading = line.trim_start_matches('#');
        if fenced || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let mut anchor = String::new();
        for letter in heading.trim().to_lowercase().chars() {
            match letter {
                ' ' => anchor.push('-'),
                '-' | '_' => anchor.push(letter),
                letter if letter.is_alphanumeric() => anchor.push(letter),
                _ => {}
            }
        }
        let mut numbered = anchor.clone();
        let mut count = 0;
        while !anchors.insert(numbered.clone()) {
            count += 1;
            numbered = format!("{anchor}-{count}");
        }
    }
    anchors
}

/// A path without `..` inside.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir {
            plain.pop();
        } else {
            plain.push(part);
        }
    }
    plain
}

#[test]
fn every_link_of_the_book_leads_somewhere() {
    let mut broken = Vec::new();
    let mut seen = 0;
    for page in pages() {
        let folder = page.path.parent().expect("a file is in a folder");
        for (line, target) in links(&page) {
            seen += 1;
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            let (file, anchor) = match target.split_once('#') {
                Some((file, anchor)) => (file, Some(anchor)),
                None => (target.as_str(), None),
            };
            let path = if file.is_empty() {
                page.path.clone()
            } else {
                plain(&folder.join(file))
            };
            let whole = workspace().join(&path);
            let leads = match anchor {
                None => whole.exists(),
                Some(anchor) => std::fs::read_to_string(&whole)
                    .is_ok_and(|text| anchors(&text).contains(anchor)),
            };
            if !leads {
                broken.push(format!("{}:{line}: {target}", page.path.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
    assert!(seen > 100, "{seen}");
}

#[test]
fn every_page_stands_in_the_summary_once() {
    let summary = Page::read("docs/SUMMARY.md".into());
    let mut listed: Vec<PathBuf> = (links(&summary).into_iter())
        .map(|(_, target)| Path::new("docs").join(target))
        .collect();
    listed.sort();
    let written: Vec<PathBuf> = (pages().into_iter())
        .map(|page| page.path)
        .filter(|path| path.starts_with("docs") && !path.ends_with("SUMMARY.md"))
        .collect();
    assert_eq!(listed, written);
}

#[test]
fn editors_link_every_workspace() {
    let settings = shipped(".vscode/settings.json");
    let settings: serde_json::Value = serde_json::from_str(&settings).expect("JSON");
    let linked = settings["rust-analyzer.linkedProjects"].as_array();
    let linked: BTreeSet<&str> = (linked.expect("a list").iter())
        .filter_map(serde_json::Value::as_str)
        .collect();
    let manifest: toml::Table = shipped("Cargo.toml").parse().expect("TOML");
    let excluded = manifest["workspace"]["exclude"].as_array();
    let mut manifests = BTreeSet::from(["Cargo.toml".to_owned()]);
    for folder in excluded.expect("a list") {
        let folder = folder.as_str().expect("a path");
        let inside = std::fs::read_dir(workspace().join(folder)).expect("a folder");
        let inside = inside.map(|entry| entry.expect("an entry").file_name());
        let inside = inside.map(|name| format!("{folder}/{}/Cargo.toml", name.display()));
        manifests.extend(
            inside
                .chain([format!("{folder}/Cargo.toml")])
                .filter(|path| workspace().join(path).exists()),
        );
    }
    let manifests: BTreeSet<&str> = manifests.iter().map(String::as_str).collect();
    assert_eq!(linked, manifests);
}

#[test]
fn anchors_are_those_of_code_hosting_sites() {
    let text = "# What is `x`?\n## Once more, in lockstep\n```\n# no heading\n```\n## Once more, in lockstep\n";
    let found: Vec<String> = anchors(text).into_iter().collect();
    assert_eq!(
        found,
        [
            "once-more-in-lockstep",
            "once-more-in-lockstep-1",
            "what-is-x"
        ]
    );
}

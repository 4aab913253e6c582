//! The rooms of packages and the modules of those without: each looks only down, and in no circle.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;

use super::sources::{Named, named_below};
use crate::support::programs::workspace;

/// Packages with rooms from top to bottom: each room names only itself and what is below it.
const ROOMS: [(&str, &[&str]); 3] = [
    ("tools/hil", &["commands", "arguments"]),
    (
        "tools/facts",
        &["session", "checkpoint", "results", "programs", "arguments"],
    ),
    ("tools/console", &["files", "terminal"]),
];

/// Files shared by tests of several packages, at the root of each.
const SHARED: [&str; 2] = ["fixture", "rig"];

fn sources(package: &str) -> PathBuf {
    workspace().join(package).join("src")
}

/// Returns the modules declared at the root of a package.
fn modules(package: &str) -> BTreeSet<String> {
    let root = fs::read_to_string(sources(package).join("lib.rs")).expect("a root");
    let declared = root.lines().filter_map(|line| {
        let line = line.trim_start_matches("pub(crate) ");
        let name = line.trim_start_matches("pub ").strip_prefix("mod ")?;
        name.strip_suffix(';')
    });
    let declared = declared.filter(|name| !SHARED.contains(name));
    declared.map(Into::into).collect()
}

#[test]
fn packages_have_these_rooms_and_nothing_beside_them() {
    for (package, rooms) in ROOMS {
        let known: BTreeSet<String> = rooms.iter().map(|room| (*room).to_owned()).collect();
        assert_eq!(modules(package), known, "{package}");
        for entry in fs::read_dir(sources(package)).expect("sources") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_room = path.is_dir() && known.contains(&*name);
            let is_root = ["lib.rs", "main.rs"].contains(&&*name);
            assert!(is_room || is_root, "{name} is no room of {package}");
            if is_room {
                let text = fs::read_to_string(path.join("mod.rs")).expect("a room has a mod.rs");
                assert!(
                    says_what_never(&text),
                    "{package}/src/{name} does not say what it is and what never"
                );
            }
        }
    }
}

/// Returns true if the first paragraph of a room also excludes something.
fn says_what_never(text: &str) -> bool {
    let lines = text.lines().map_while(|line| line.strip_prefix("//! "));
    let mut words = lines.flat_map(|line| line.split(|c: char| !c.is_alphabetic()));
    words.any(|word| ["no", "nothing", "never", "neither"].contains(&&*word.to_lowercase()))
}

#[test]
fn rooms_name_only_rooms_below_them() {
    for (package, rooms) in ROOMS {
        let floor = |room: &str| rooms.iter().position(|known| *known == room);
        let wrong: Vec<String> = named_below(&sources(package))
            .iter()
            .filter_map(|named| {
                let from = &named.from[0];
                let what = match named.to.first() {
                    None => "the root of the package",
                    Some(to) if SHARED.contains(&&**to) => return None,
                    Some(to) => match (floor(from), floor(to)) {
                        (Some(from), Some(to)) if from <= to => return None,
                        (Some(_), Some(_)) => "a room above it",
                        _ => "no room",
                    },
                };
                let (place, path) = (named.place(), named.to.join("::"));
                Some(format!(
                    "{package}/src/{place}: `{from}` names `crate::{path}`, {what}"
                ))
            })
            .collect();
        assert!(wrong.is_empty(), "\n{}\n", wrong.join("\n"));
    }
}

/// Returns the first circle among the modules of a root, as its paths.
fn circle(named: &[Named], modules: &BTreeSet<String>) -> Option<Vec<String>> {
    let mut arrows: BTreeMap<&str, BTreeMap<&str, &Named>> = BTreeMap::new();
    for named in named {
        let Some(to) = named.to.first().filter(|to| modules.contains(*to)) else {
            continue;
        };
        if *to != named.from[0] {
            let from = arrows.entry(&named.from[0]).or_default();
            from.entry(to).or_insert(named);
        }
    }
    // Removes modules that name no remaining module, until only circles and the modules leading to them remain.
    loop {
        let left: BTreeSet<&str> = arrows.keys().copied().collect();
        let before = left.len();
        arrows.retain(|_, to| to.keys().any(|to| left.contains(to)));
        if arrows.is_empty() {
            return None;
        }
        if arrows.len() == before {
            break;
        }
    }
    let left: BTreeSet<&str> = arrows.keys().copied().collect();
    let mut module = *left.first()?;
    let mut way = Vec::new();
    let mut seen = Vec::new();
    while !seen.contains(&module) {
        seen.push(module);
        let (to, named) = (arrows[module].iter()).find(|(to, _)| left.contains(*to))?;
        way.push(format!(
            "{}: `{module}` names `{}`",
            named.place(),
            named.to.join("::")
        ));
        module = *to;
    }
    let begin = seen.iter().position(|seen| *seen == module)?;
    Some(way.split_off(begin))
}

#[test]
fn modules_of_lower_packages_form_no_circle() {
    for package in [
        "shared-types",
        "hil-config",
        "tools/recording",
        "tools/remote",
        "tools/campaign",
    ] {
        let (named, modules) = (named_below(&sources(package)), modules(package));
        for named in &named {
            // A package re-exported by the root imports no module of this one; the macro belongs to `link`.
            let handed_on = ["zerocopy", "pass_on"];
            let is_told = (named.to.first())
                .is_some_and(|to| modules.contains(to) || handed_on.contains(&&**to))
                || (named.to.first()).is_some_and(|to| SHARED.contains(&&**to));
            let (place, path) = (named.place(), named.to.join("::"));
            assert!(is_told, "{package}/src/{place}: `{path}` hides its module");
        }
        let result = circle(&named, &modules);
        let way = result.unwrap_or_default().join("\n");
        assert!(way.is_empty(), "a circle in {package}/src:\n{way}\n");
    }
}

#[test]
fn a_circle_is_found_without_the_modules_leading_to_it() {
    let arrow = |from: &str, to: &str| Named {
        file: format!("{from}.rs").into(),
        line: 1,
        from: vec![from.into()],
        to: vec![to.into(), "Item".into()],
    };
    let modules = BTreeSet::from(["a", "b", "c", "d"].map(String::from));
    let mut named = vec![arrow("a", "b"), arrow("b", "c"), arrow("c", "d")];
    assert_eq!(circle(&named, &modules), None);
    named.push(arrow("d", "b"));
    let way = circle(&named, &modules).expect("a circle");
    assert_eq!(way.len(), 3, "{way:?}");
}

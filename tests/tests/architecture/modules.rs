//! The modules of packages: those of three packages in a fixed order, and those of every package in no circle.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::sources::{Import, Named, imports, named_below};
use super::{packages, text};
use crate::support::programs::workspace;

/// Packages whose modules have an order, from top to bottom: each names only itself and what is below it.
const ORDERS: [(&str, &[&str]); 3] = [
    ("tools/hil", &["commands", "arguments"]),
    (
        "tools/facts",
        &[
            "session",
            "checkpoint",
            "results",
            "programs",
            "tables",
            "arguments",
        ],
    ),
    ("tools/console", &["files", "terminal"]),
];

/// Files shared by tests of several packages, at the root of each.
const SHARED: [&str; 2] = ["fixture", "rig"];

/// Path of a module from the root of its package.
type Module = Vec<String>;

fn sources(package: &str) -> PathBuf {
    workspace().join(package).join("src")
}

/// Returns the modules that the root of a package declares.
fn declared(package: &str) -> BTreeSet<String> {
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
fn three_packages_have_these_modules_and_nothing_beside_them() {
    for (package, modules) in ORDERS {
        let known: BTreeSet<String> = modules.iter().map(|name| (*name).to_owned()).collect();
        assert_eq!(declared(package), known, "{package}");
        for entry in fs::read_dir(sources(package)).expect("sources") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_module = path.is_dir() && known.contains(&*name);
            let is_root = ["lib.rs", "main.rs"].contains(&&*name);
            assert!(is_module || is_root, "{name} is no module of {package}");
            if is_module {
                let text = fs::read_to_string(path.join("mod.rs")).expect("a mod.rs");
                assert!(
                    says_what_never(&text),
                    "{package}/src/{name} does not say what it is and what never"
                );
            }
        }
    }
}

/// Returns `true` if the first paragraph of a module also excludes something.
fn says_what_never(text: &str) -> bool {
    let lines = text.lines().map_while(|line| line.strip_prefix("//! "));
    let mut words = lines.flat_map(|line| line.split(|c: char| !c.is_alphabetic()));
    words.any(|word| ["no", "nothing", "never", "neither"].contains(&&*word.to_lowercase()))
}

#[test]
fn modules_in_order_name_only_modules_below_them() {
    for (package, modules) in ORDERS {
        let place = |module: &str| modules.iter().position(|known| *known == module);
        let wrong: Vec<String> = named_below(&sources(package))
            .iter()
            .filter_map(|named| {
                let from = &named.from[0];
                let what = match named.to.first() {
                    None => "the root of the package",
                    Some(to) if SHARED.contains(&&**to) => return None,
                    Some(to) => match (place(from), place(to)) {
                        (Some(from), Some(to)) if from <= to => return None,
                        (Some(_), Some(_)) => "a module above it",
                        _ => "no module",
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

/// Modules of a package, each with the names that it imports.
#[derive(Default)]
struct Package {
    modules: BTreeMap<Module, Vec<Import>>,
    /// Those that are there for tests alone, with all that is below them.
    of_tests: BTreeSet<Module>,
}

impl Package {
    fn of(sources: &Path) -> Self {
        let mut package = Self::default();
        let mut folders = vec![sources.to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).expect("a folder of sources") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|end| end == "rs") {
                    let file = path.strip_prefix(sources).expect("below");
                    let text = fs::read_to_string(&path).expect("text");
                    package.add(file, &text);
                }
            }
        }
        package
    }

    fn add(&mut self, file: &Path, text: &str) {
        let (module, imports) = imports(file, text);
        for declared in text.split("#[cfg(test)]\n").skip(1) {
            let mut lines = declared.lines().map(str::trim_start);
            let line = lines
                .find(|line| !line.starts_with("#["))
                .unwrap_or_default();
            let line = line.trim_start_matches("pub(crate) ");
            let name = line
                .strip_prefix("mod ")
                .map(|name| name.trim_end_matches(';'));
            self.of_tests
                .extend(name.map(|name| [&module[..], &[name.to_owned()]].concat()));
        }
        self.modules.insert(module, imports);
    }

    /// Returns `true` if a module is there for tests alone.
    fn is_of_tests(&self, module: &[String]) -> bool {
        let mut above = (1..=module.len()).map(|end| &module[..end]);
        module.iter().any(|part| part == "tests") || above.any(|one| self.of_tests.contains(one))
    }

    /// Finds the module that has what a path from the root leads to, through the names that modules pass on.
    fn home(&self, path: &[String]) -> Module {
        let mut path = path.to_vec();
        // A name that leads round in a circle is no import.
        for _ in 0..16 {
            let known = (0..=path.len())
                .rev()
                .find(|end| self.modules.contains_key(&path[..*end]));
            let known = known.unwrap_or(0);
            let imports = self.modules.get(&path[..known]);
            let import = path.get(known).and_then(|name| {
                let mut imports = imports?.iter();
                imports.find(|import| import.name == *name)
            });
            let Some(import) = import.filter(|import| self.is_inside(&import.path)) else {
                return path[..known].to_vec();
            };
            path = [&import.path, &path[known + 1..]].concat();
        }
        Module::new()
    }

    /// Returns `true` if a path from the root begins with a module of this package.
    fn is_inside(&self, path: &[String]) -> bool {
        path.first()
            .is_some_and(|first| self.modules.contains_key(&[first.clone()][..]))
    }
}

/// Arrow from a module to another, with the place that names it.
struct Arrow {
    from: Module,
    to: Module,
    place: String,
}

/// Returns the first circle among the parts of one module, as its paths.
///
/// A module and the parts in its folder are one subject: a part may name its parent, as the parent names its parts.
/// The compared parts are those of one parent, each with everything below it, at every level: a reader of one part needs
/// no part that in turn needs it. A `use super::Name` counts as an arrow to the part from which the parent has the name.
fn circle(arrows: &[Arrow]) -> Option<Vec<String>> {
    let mut levels: BTreeMap<&[String], BTreeMap<&str, BTreeMap<&str, &Arrow>>> = BTreeMap::new();
    for arrow in arrows {
        let common = arrow.from.iter().zip(&arrow.to);
        let common = common.take_while(|(from, to)| from == to).count();
        if let (Some(from), Some(to)) = (arrow.from.get(common), arrow.to.get(common)) {
            let level = levels.entry(&arrow.from[..common]).or_default();
            level.entry(from).or_default().entry(to).or_insert(arrow);
        }
    }
    levels.values().find_map(circle_of_level)
}

fn circle_of_level(arrows: &BTreeMap<&str, BTreeMap<&str, &Arrow>>) -> Option<Vec<String>> {
    // Parts that name nothing of what is left go, until only circles and what leads to them are left.
    let mut left: BTreeSet<&str> = arrows.keys().copied().collect();
    loop {
        let before = left.len();
        let names_one = |part: &&str| arrows[part].keys().any(|to| left.contains(to));
        left = left.iter().copied().filter(names_one).collect();
        if left.len() == before {
            break;
        }
    }
    let mut part = *left.first()?;
    let (mut steps, mut seen) = (Vec::new(), Vec::new());
    while !seen.contains(&part) {
        seen.push(part);
        let (to, arrow) = (arrows[part].iter()).find(|(to, _)| left.contains(*to))?;
        let (from, named) = (arrow.from.join("::"), arrow.to.join("::"));
        steps.push(format!("{}: `{from}` names `{named}`", arrow.place));
        part = *to;
    }
    let begin = seen.iter().position(|seen| *seen == part)?;
    Some(steps.split_off(begin))
}

#[test]
fn modules_of_a_package_have_no_circular_imports() {
    let mut circles = Vec::new();
    for package in packages() {
        let manifest = Path::new(text(&package["manifest_path"]));
        let sources = manifest.with_file_name("src");
        if !sources.join("lib.rs").is_file() {
            continue; // of tests alone
        }
        let modules = Package::of(&sources);
        let is_test = |module: &[String]| modules.is_of_tests(module);
        let in_product = |module: &Module| !is_test(module);
        let arrows = named_below(&sources)
            .into_iter()
            .filter(|named| !is_test(&named.from));
        let arrows = arrows.map(|named: Named| Arrow {
            place: named.place(),
            to: modules.home(&named.to),
            from: modules.home(&named.from),
        });
        let arrows = arrows.filter(|arrow| in_product(&arrow.from) && in_product(&arrow.to));
        if let Some(steps) = circle(&arrows.collect::<Vec<_>>()) {
            circles.push(format!("{}:\n{}", text(&package["name"]), steps.join("\n")));
        }
    }
    assert!(circles.is_empty(), "\n{}\n", circles.join("\n"));
}

fn arrow(from: &str, to: &str) -> Arrow {
    let module = |path: &str| path.split("::").map(Into::into).collect();
    Arrow {
        from: module(from),
        to: module(to),
        place: "file.rs:1".into(),
    }
}

#[test]
fn a_circle_is_found_without_the_modules_leading_to_it() {
    let mut arrows = vec![arrow("a", "b"), arrow("b", "c"), arrow("c", "d")];
    assert_eq!(circle(&arrows), None);
    arrows.push(arrow("d", "b"));
    let steps = circle(&arrows).expect("a circle");
    assert_eq!(steps.len(), 3, "{steps:?}");
}

#[test]
fn a_circle_of_parts_is_found_at_their_level_and_one_with_their_parent_is_none() {
    let with_parent = [arrow("a", "a::x"), arrow("a::x", "a"), arrow("a::y", "a")];
    assert_eq!(circle(&with_parent), None);
    let of_parts = [arrow("a::x::deep", "a::y"), arrow("a::y", "a::x")];
    assert_eq!(circle(&of_parts).expect("a circle").len(), 2);
    let of_parents = [arrow("a::x", "b::y"), arrow("b::z", "a::w")];
    assert_eq!(circle(&of_parents).expect("a circle").len(), 2);
}

#[test]
fn a_name_that_a_module_passes_on_leads_to_its_home() {
    let mut modules = Package::default();
    for (file, text) in [
        ("lib.rs", "mod a;\npub use a::b::Deep;"),
        (
            "a.rs",
            "mod b;\n#[cfg(test)]\nmod c;\nuse b::{Own, Other as Renamed};\nuse std::fmt;",
        ),
        ("a/b.rs", "mod tests {\n    use super::super::c::Tested;\n}"),
        ("a/c.rs", ""),
    ] {
        modules.add(Path::new(file), text);
    }
    let is_of_tests = |path: [&str; 2]| modules.is_of_tests(&path.map(String::from));
    assert!(is_of_tests(["a", "c"]) && !is_of_tests(["a", "b"]));
    let home = |path: &str| {
        let path: Module = path.split("::").map(Into::into).collect();
        modules.home(&path).join("::")
    };
    for (path, module) in [
        ("Deep", "a::b"),
        ("a::Own", "a::b"),
        ("a::Renamed::of", "a::b"),
        ("a::fmt", "a"),
        ("a::Tested", "a"),
        ("a::c::item", "a::c"),
    ] {
        assert_eq!(home(path), module, "{path}");
    }
}

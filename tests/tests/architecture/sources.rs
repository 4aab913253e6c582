//! Paths named in the sources of a package, read from their text.
//!
//! Parses just enough Rust for that: comments, strings, characters, `use` trees and inline modules.

use std::fs;
use std::path::{Path, PathBuf};

/// Path that begins with `crate` or `super`, in code.
pub(super) struct Named {
    /// File, relative to the source folder.
    pub(super) file: PathBuf,
    pub(super) line: usize,
    /// Module that contains it, relative to the root of the package.
    pub(super) from: Vec<String>,
    /// Path relative to the root of the package; may end with an item or `*`.
    pub(super) to: Vec<String>,
}

impl Named {
    /// Describes its location.
    pub(super) fn place(&self) -> String {
        format!("{}:{}", self.file.display(), self.line)
    }
}

/// Parses every source file below a folder, except the root, `lib.rs` and `main.rs`.
pub(super) fn named_below(sources: &Path) -> Vec<Named> {
    let mut folders = vec![sources.to_owned()];
    let mut named = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let file = path.strip_prefix(sources).expect("below").to_owned();
            let is_root = ["lib.rs", "main.rs"].map(Path::new).contains(&&*file);
            if path.extension().is_some_and(|end| end == "rs") && !is_root {
                let text = fs::read_to_string(&path).expect("text");
                named.extend(named_in(&file, &text));
            }
        }
    }
    named.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
    named
}

/// Parses one file.
fn named_in(file: &Path, text: &str) -> Vec<Named> {
    // Files shared by tests of several packages name no module of any of them.
    let moved = text.split("#[path = \"").skip(1);
    let moved = moved.filter(|path| {
        !path
            .split('"')
            .next()
            .unwrap_or_default()
            .contains("/tests/shared/")
    });
    assert_eq!(moved.count(), 0, "{file:?} moves a module elsewhere");
    let code = without_texts(text);
    let words = words(&code);
    // Open inline modules, with the depth at which each began.
    let (mut inner, mut depth) = (Vec::<(String, usize)>::new(), 0);
    let mut named = Vec::new();
    let mut at = 0;
    while at < words.len() {
        let followed = |words: &[(usize, &str)], by: &str| {
            words.get(at + 1).is_some_and(|(_, word)| *word == by)
        };
        match words[at].1 {
            "mod" if words.get(at + 2).is_some_and(|(_, word)| *word == "{") => {
                inner.push((words[at + 1].1.to_owned(), depth));
            }
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                inner.pop_if(|(_, began)| *began == depth);
            }
            root @ ("crate" | "super") => {
                let is_path = followed(&words, "::");
                // As in `pub(crate)`, and as the key of an attribute.
                let is_no_path = followed(&words, ")") || followed(&words, "=");
                let line = code[..words[at].0].matches('\n').count() + 1;
                assert!(
                    is_path || is_no_path,
                    "{file:?}:{line}: `{root}` without a path behind it hides what is meant"
                );
                if is_path {
                    let (paths, end) = tree(&words, at);
                    let mut from = module_of(file);
                    from.extend(inner.iter().map(|(name, _)| name.clone()));
                    named.extend(paths.into_iter().map(|path| Named {
                        file: file.to_owned(),
                        line,
                        to: from_root(&from, &path),
                        from: from.clone(),
                    }));
                    at = end;
                    continue;
                }
            }
            _ => {}
        }
        at += 1;
    }
    named
}

/// Name that a module has from another one.
pub(super) struct Import {
    pub(super) name: String,
    /// The path from the root of the package; that of another package begins with its name.
    pub(super) path: Vec<String>,
}

/// Reads the module of a file and its imports, without those of modules in braces.
pub(super) fn imports(file: &Path, text: &str) -> (Vec<String>, Vec<Import>) {
    let code = without_texts(text);
    let words = words(&code);
    let mut module = module_of(file);
    module.pop_if(|last| last == "lib");
    let follows_mod = |at: usize| at > 0 && words[at - 1].1 == "mod";
    let is_name =
        |at: &usize| follows_mod(*at) && words.get(at + 1).is_some_and(|(_, word)| *word == ";");
    let parts: Vec<&str> = (0..words.len())
        .filter(is_name)
        .map(|at| words[at].1)
        .collect();
    let (mut depth, mut at) = (0, 0);
    let mut imports = Vec::new();
    while at < words.len() {
        match words[at].1 {
            "{" => depth += 1,
            "}" => depth -= 1,
            "use" if depth == 0 => {
                let (paths, end) = renamed_tree(&words, at + 1);
                for (path, name) in paths {
                    let path = match path[0] {
                        "crate" | "super" | "self" => from_root(&module, &path),
                        first if parts.contains(&first) => {
                            from_root(&module, &[&["self"], &path[..]].concat())
                        }
                        _ => continue,
                    };
                    let name = name.to_owned();
                    imports.push(Import { name, path });
                }
                at = end;
                continue;
            }
            _ => {}
        }
        at += 1;
    }
    (module, imports)
}

/// Returns the module of a file.
fn module_of(file: &Path) -> Vec<String> {
    let module = file.with_extension("");
    let mut parts: Vec<String> = (module.iter())
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    parts.pop_if(|last| last == "mod");
    parts
}

/// Resolves a path from the root.
fn from_root(module: &[String], path: &[&str]) -> Vec<String> {
    let (mut whole, mut rest) = match path.split_first() {
        Some((&"crate", rest)) => (Vec::new(), rest),
        _ => (module.to_vec(), path),
    };
    while let Some((&"super", after)) = rest.split_first() {
        whole.pop();
        rest = after;
    }
    let rest = rest.iter().filter(|part| **part != "self");
    whole.extend(rest.map(|part| (*part).to_owned()));
    whole
}

/// Returns the paths of a `use` tree, and the first word after it.
fn tree<'t>(words: &[(usize, &'t str)], at: usize) -> (Vec<Vec<&'t str>>, usize) {
    let (paths, end) = renamed_tree(words, at);
    (paths.into_iter().map(|(path, _)| path).collect(), end)
}

/// The paths of a tree as in `use`, each with the name that it gets, and the first word behind it.
fn renamed_tree<'t>(
    words: &[(usize, &'t str)],
    mut at: usize,
) -> (Vec<(Vec<&'t str>, &'t str)>, usize) {
    let word = |at: usize| words.get(at).map_or("", |(_, word)| *word);
    if word(at) == "{" {
        let mut paths = Vec::new();
        at += 1;
        while word(at) != "}" {
            let (more, end) = renamed_tree(words, at);
            paths.extend(more);
            at = end;
            if word(at) == "," {
                at += 1;
            }
        }
        return (paths, at + 1);
    }
    let first = word(at);
    let goes_on = |word: &str| {
        word == "{" || word == "*" || word.starts_with(|c: char| c.is_alphabetic() || c == '_')
    };
    if word(at + 1) == "as" {
        return (vec![(vec![first], word(at + 2))], at + 3);
    }
    if word(at + 1) != "::" || !goes_on(word(at + 2)) {
        return (vec![(vec![first], first)], at + 1);
    }
    let (below, end) = renamed_tree(words, at + 2);
    let paths = below.into_iter().map(|(path, name)| {
        let name = if name == "self" { first } else { name };
        ([&[first], &path[..]].concat(), name)
    });
    (paths.collect(), end)
}

/// Splits code into words with their positions; punctuation and `::` count as words.
fn words(code: &str) -> Vec<(usize, &str)> {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let mut words = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let length = match first {
            ':' if rest.starts_with("::") => 2,
            _ if is_part(first) => rest.find(|c| !is_part(c)).unwrap_or(rest.len()),
            _ => first.len_utf8(),
        };
        words.push((code.len() - rest.len(), &rest[..length]));
        rest = rest[length..].trim_start();
    }
    words
}

/// Blanks out comments, strings and characters, keeping line breaks.
fn without_texts(text: &str) -> String {
    let mut code = String::with_capacity(text.len());
    let mut rest = text;
    let mut is_in_word = false;
    while let Some(first) = rest.chars().next() {
        let length = text_at(rest, is_in_word);
        if length == 0 {
            code.push(first);
            is_in_word = first.is_alphanumeric() || first == '_';
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let blank = |c: char| if c == '\n' { '\n' } else { ' ' };
        code.extend(rest[..length].chars().map(blank));
        is_in_word = false;
        rest = &rest[length..];
    }
    code
}

/// Returns the length of the comment, string or character at the beginning of the code; 0 if there is none.
fn text_at(code: &str, is_in_word: bool) -> usize {
    if code.starts_with("//") {
        return code.find('\n').unwrap_or(code.len());
    }
    if code.starts_with("/*") {
        let (mut depth, mut length) = (0, 0);
        loop {
            let rest = &code[length..];
            let step = match rest.get(..2) {
                Some("/*") => (1, 2),
                Some("*/") => (-1, 2),
                _ => (0, rest.chars().next().expect("a comment ends").len_utf8()),
            };
            depth += step.0;
            length += step.1;
            if depth == 0 {
                return length;
            }
        }
    }
    if let Some(inside) = code.strip_prefix('\'') {
        // A character, unless it is a lifetime.
        let mut signs = inside.char_indices();
        let escaped = match signs.next() {
            Some((_, '\\')) => signs
                .next()
                .map_or(0, |(place, sign)| place + sign.len_utf8()),
            Some((_, sign)) if inside[sign.len_utf8()..].starts_with('\'') => sign.len_utf8(),
            _ => return 0,
        };
        let end = inside[escaped..].find('\'').expect("a character ends");
        return 1 + escaped + end + 1;
    }
    let prefix = match is_in_word {
        true => 0,
        false => code.find(|c| !matches!(c, 'b' | 'c' | 'r')).unwrap_or(0),
    };
    let (letters, rest) = code.split_at(prefix);
    let hashes = rest.len() - rest.trim_start_matches('#').len();
    let is_raw = letters.ends_with('r');
    if !rest[hashes..].starts_with('"') || (hashes > 0 && !is_raw) {
        return 0;
    }
    let start = prefix + hashes + 1;
    if is_raw {
        let end = format!("\"{}", "#".repeat(hashes));
        let length = code[start..].find(&end).expect("a string ends");
        return start + length + end.len();
    }
    let mut is_escaped = false;
    for (place, sign) in code[start..].char_indices() {
        match sign {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return start + place + 1,
            _ => {}
        }
    }
    panic!("a string ends");
}

#[test]
fn paths_are_found_in_code_and_nowhere_else() {
    let text = r##"
//! [`a`](crate::a)
use crate::b::{self, C, d::{E as F, *}};
pub(crate) use super::g; /* crate::h /* */ crate::h */
const TEXT: &str = "crate::i \" crate::i";
const RAW: &str = r#"" crate::j"#;
fn k<'a>(l: &'a str) -> crate::l::M<'a> { ('"', '\'', "\\", crate::n!()) }
mod tests {
    use super::super::o;
    fn p() { super::q::<u8>() }
}
macro_rules! r { () => { $crate::s::t }; }
"##;
    let named = named_in(Path::new("part/file.rs"), text);
    let found: Vec<(usize, String)> = (named.iter())
        .map(|named| (named.line, named.to.join("::")))
        .collect();
    let expected = [
        (3, "b"),
        (3, "b::C"),
        (3, "b::d::E"),
        (3, "b::d::*"),
        (4, "part::g"),
        (7, "l::M"),
        (7, "n"),
        (9, "part::o"),
        (10, "part::file::q"),
        (12, "s::t"),
    ];
    assert_eq!(found, expected.map(|(line, path)| (line, path.to_owned())));
    assert_eq!(named[8].from, ["part", "file", "tests"]);
}

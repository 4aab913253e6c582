//! Page of the book as a list of blocks: shown output, commands, and files to write.
//!
//! HTML comments of a page instruct the test: `<!-- file: PATH -->` before a block writes it to that file (`<!--
//! file: PATH, continued -->` appends), and `<!-- sh` .. `-->` contains commands that are executed but not shown,
//! such as those of another terminal.

use std::path::{Path, PathBuf};

use crate::support::programs::{shipped, workspace};

/// Page: a Markdown file, given by its path relative to the workspace.
pub(super) struct Page {
    pub(super) path: PathBuf,
    pub(super) text: String,
}

/// Fenced or hidden block.
#[derive(Debug)]
pub(super) struct Block<'p> {
    /// Line of its fence, from 1.
    pub(super) line: usize,
    /// Text after the fence.
    pub(super) language: &'p str,
    /// Content; the parser refuses a block without an end.
    pub(super) text: String,
    /// File named by a preceding comment, with `true` if the block is appended.
    pub(super) file: Option<(&'p str, bool)>,
    /// `true` if only blank lines separate the block from the previous one.
    pub(super) follows: bool,
}

/// Pages at the top of the workspace.
const TOP: [&str; 5] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
];

/// Reads all pages: those in the root folder, in the book and in the examples.
pub(super) fn pages() -> Vec<Page> {
    let mut paths: Vec<PathBuf> = TOP.map(PathBuf::from).into();
    let mut expected: Vec<PathBuf> = ["docs", "docs/design", "docs/reference"]
        .into_iter()
        .flat_map(|folder| markdown(Path::new(folder)))
        .collect();
    let examples = std::fs::read_dir(workspace().join("examples")).expect("the examples");
    expected.extend(examples.map(|example| {
        let name = example.expect("an example").file_name();
        Path::new("examples").join(name).join("README.md")
    }));
    expected.sort();
    paths.append(&mut expected);
    paths.into_iter().map(Page::read).collect()
}

fn markdown(folder: &Path) -> Vec<PathBuf> {
    let Ok(files) = std::fs::read_dir(workspace().join(folder)) else {
        return Vec::new();
    };
    let names = files.map(|file| file.expect("a file").file_name());
    let paths = names.map(|name| folder.join(name));
    paths
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .collect()
}

impl Page {
    pub(super) fn read(path: PathBuf) -> Self {
        let text = shipped(&path);
        Self { path, text }
    }

    /// Parses the blocks in order.
    pub(super) fn blocks(&self) -> Vec<Block<'_>> {
        let mut blocks = Vec::new();
        let mut lines = self.text.lines().enumerate();
        let (mut file, mut follows) = (None, false);
        while let Some((number, line)) = lines.next() {
            let line_of = number + 1;
            let start = line.trim_start();
            let indent = line.len() - start.len();
            let (language, end) = match (start.strip_prefix("```"), start) {
                (Some(language), _) => (language.trim(), "```"),
                (None, "<!-- sh") => ("sh", "-->"),
                (None, _) => {
                    if let Some(name) = comment(start, "file:") {
                        let continued = name.strip_suffix(", continued");
                        file = Some((continued.unwrap_or(name), continued.is_some()));
                    } else if !start.is_empty() {
                        (file, follows) = (None, false);
                    }
                    continue;
                }
            };
            let mut text = String::new();
            loop {
                let Some((_, line)) = lines.next() else {
                    panic!("{}:{line_of}: a block without an end", self.path.display());
                };
                if line.trim() == end {
                    break;
                }
                text += line.get(indent..).unwrap_or_default();
                text.push('\n');
            }
            blocks.push(Block {
                line: line_of,
                language,
                text,
                file: file.take(),
                follows,
            });
            follows = true;
        }
        blocks
    }
}

/// Returns the text after a keyword in a one-line comment.
fn comment<'l>(line: &'l str, word: &str) -> Option<&'l str> {
    let output = line.strip_prefix("<!--")?.strip_suffix("-->")?;
    Some(output.trim().strip_prefix(word)?.trim())
}

#[test]
fn blocks_are_parsed_with_lines_files_and_hidden_commands() {
    let page = Page {
        path: "page.md".into(),
        text: "Text.\n\n```sh\nhil run\n```\n\n```text\npass\n```\n<!-- sh\nhil resume\n-->\n\
               <!-- file: src/main.rs -->\n```rust\nfn main() {}\n```\nMore.\n- in a list\n  ```sh\n  hil\n    two\n  ```\n"
            .into(),
    };
    let blocks = page.blocks();
    let result: Vec<_> = (blocks.iter())
        .map(|block| {
            (
                block.line,
                block.language,
                block.text.as_str(),
                block.follows,
            )
        })
        .collect();
    let expected = [
        (3, "sh", "hil run\n", false),
        (7, "text", "pass\n", true),
        (10, "sh", "hil resume\n", true),
        (14, "rust", "fn main() {}\n", true),
        (19, "sh", "hil\n  two\n", false),
    ];
    assert_eq!(result, expected);
    assert_eq!(blocks[3].file, Some(("src/main.rs", false)));
}

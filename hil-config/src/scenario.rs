//! Scenario as written: a file, with `--set` values applied.
//!
//! The launcher reads a scenario, applies the flags and has the scenario [checked](Scenario::check) against the plants
//! and laws that the binaries describe. Nothing in a `Scenario` has been validated.

use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use crate::document::{Table, Value};
use crate::flag;
use crate::keys;
use crate::problem::{FLAG, Problem, ProblemKind, Problems};
use crate::reader::{Reader, Section};
use crate::source::{Place, Sources};
use crate::table_file::Format;

/// Scenario as written.
#[derive(Clone, Debug)]
pub struct Scenario {
    pub(crate) path: PathBuf,
    pub(crate) sources: Sources,
    pub(crate) table: Table,
    /// Problems of flags, kept until the check, which reports all problems at once.
    pub(crate) problems: Vec<Problem>,
    pub(crate) advice: Advice,
    pub(crate) formats: &'static [Format],
    /// Folder of its files, if not that of the scenario.
    pub(crate) home: Option<PathBuf>,
}

/// Advice for an undescribed plant or law, depending on the command and its arguments.
#[derive(Clone, Debug, Default)]
pub struct Advice {
    /// Advice for an unknown plant; may be empty.
    pub plant: String,
    /// Advice for an unknown law; may be empty.
    pub law: String,
}

impl Scenario {
    /// Reads a scenario file.
    ///
    /// # Errors
    /// If the file cannot be read or is not TOML.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Problems> {
        let path = path.as_ref();
        let text = read_regular(path).map_err(|error| unreadable("scenario", path, &error))?;
        Self::parse(&text, path)
    }

    /// Parses the text of a scenario. `origin` is its file, which need not exist: messages name the file, the scenario
    /// takes its name from it, and tables of points are read from its folder.
    ///
    /// # Errors
    /// If the text is not TOML.
    pub fn parse(text: &str, origin: impl Into<PathBuf>) -> Result<Self, Problems> {
        let path = origin.into();
        let mut sources = Sources::default();
        let source = sources.add(path.display().to_string(), text.into());
        let table = Table::parse(text, source).map_err(|errors| {
            let mut reader = Reader::new(sources.clone(), Vec::new());
            for error in errors {
                let place = Place {
                    source,
                    span: error.span().unwrap_or(0..0),
                };
                let message = format!("not TOML: {}", error.message().replace('\n', ", "));
                reader.report(ProblemKind::Syntax, "", &place, message);
            }
            Problems(reader.problems)
        })?;
        Ok(Self {
            path,
            sources,
            table,
            problems: Vec::new(),
            advice: Advice::default(),
            formats: &[],
            home: None,
        })
    }

    /// Names the folder to which paths are relative, for a text that is no file of its own.
    #[must_use]
    pub fn beside(self, folder: &Path) -> Self {
        Self {
            home: Some(folder.to_owned()),
            ..self
        }
    }

    /// Adds readers of further formats of tables.
    #[must_use]
    pub fn with_formats(self, formats: &'static [Format]) -> Self {
        Self { formats, ..self }
    }

    /// Adds advice for an unknown plant or law.
    #[must_use]
    pub fn advise(self, advice: Advice) -> Self {
        Self { advice, ..self }
    }

    /// Returns the scenario's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the text of the scenario's file.
    #[must_use]
    pub fn text(&self) -> &str {
        self.sources.whole(Sources::SCENARIO)
    }

    /// Lists the tables of points that the scenario names, with their keys.
    #[must_use]
    pub fn files(&self) -> Vec<(String, String)> {
        let mut list = Vec::new();
        files(&self.table, "", &mut list);
        list
    }

    /// Applies `KEY=VALUE` flags in order; no flag may replace the value of an earlier one. Flags that cannot be
    /// applied are reported by the [check](Self::check), together with all other problems.
    #[must_use]
    pub fn set<S: AsRef<str>>(mut self, flags: &[S]) -> Self {
        for text in flags {
            let text = text.as_ref();
            let source = self.sources.add(format!("{FLAG}{text}"), text.into());
            if let Err(error) = flag::apply(&mut self.table, text, source) {
                let (sources, problems) = (&mut self.sources, &mut self.problems);
                let mut reader = Reader::new(std::mem::take(sources), std::mem::take(problems));
                let place = Place {
                    source,
                    span: error.span,
                };
                let message = format!("--set: {}", error.message);
                match error.earlier.map(|source| reader.sources.name(source)) {
                    Some(earlier) => {
                        let message = format!("{message} `{earlier}`");
                        reader
                            .report(ProblemKind::Duplicate, error.key, &place, message)
                            .help("omit one of them");
                    }
                    None => {
                        reader
                            .report(ProblemKind::Syntax, error.key, &place, message)
                            .help("--set takes KEY=VALUE, for example faults[0].effects[1].speed_per_s=2");
                    }
                }
                (self.sources, self.problems) = (reader.sources, reader.problems);
            }
        }
        self
    }
}

/// Returns the root table of a scenario.
pub(crate) fn root(scenario: &Scenario) -> Section<'_> {
    const START: &Place = &Place {
        source: Sources::SCENARIO,
        span: 0..0,
    };
    Section {
        table: &scenario.table,
        keys: keys::SCENARIO,
        path: String::new(),
        place: START,
    }
}

/// Creates the problem of an unreadable file.
pub(crate) fn unreadable(what: &str, path: &Path, error: &std::io::Error) -> Problems {
    Problems(vec![Problem {
        kind: ProblemKind::Unreadable,
        key: String::new(),
        message: format!("the {what} cannot be read: {error}"),
        expected: None,
        nearest: Vec::new(),
        help: None,
        source: path.display().to_string(),
        excerpt: None,
    }])
}

/// Returns advice on a missing file that a scenario or study names.
pub(crate) fn advice_on_missing(folder: &Path, name: &str, owner: &str) -> String {
    let absolute = |path: &Path| {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        path.display().to_string()
    };
    let path = absolute(&folder.join(name));
    if Path::new(name).is_absolute() {
        return format!("check the spelling of {path}");
    }
    let folder = absolute(&Path::new(".").join(folder));
    format!(
        "paths in a {owner} are relative to the folder of the {owner}, {folder}, so this path means {path}"
    )
}

/// Collects every `file` below a table.
fn files(table: &Table, path: &str, list: &mut Vec<(String, String)>) {
    for entry in table.entries() {
        let path = match path {
            "" => entry.key.clone(),
            path => format!("{path}.{}", entry.key),
        };
        match &entry.node.value {
            Value::Text(name) if entry.key == "file" => list.push((path, name.clone())),
            value => files_in(value, &path, list),
        }
    }
}

fn files_in(value: &Value, path: &str, list: &mut Vec<(String, String)>) {
    match value {
        Value::Table(table) => files(table, path, list),
        Value::List(items) => {
            for (index, item) in items.iter().enumerate() {
                files_in(&item.value, &format!("{path}[{index}]"), list);
            }
        }
        _ => {}
    }
}

/// Reads a text of limited size: a pipe or a device may be endless, and no sensible scenario or table of points is so
/// large.
///
/// # Errors
/// If the file cannot be read, is not a regular text file, or is too large.
pub fn read_regular(path: &Path) -> std::io::Result<String> {
    const LARGEST: u64 = 16 << 20;
    const BYTE_ORDER_MARK: char = '\u{feff}';
    let file_info = std::fs::metadata(path)?;
    // Reading a folder fails with an error of its own.
    let ends = file_info.is_dir() || (file_info.is_file() && file_info.len() <= LARGEST);
    let refusal = || std::io::Error::other("not a regular file of at most 16 MiB");
    if !ends {
        return Err(refusal());
    }
    let mut text = String::new();
    // Files in kernel file systems have size 0 and may be endless.
    let read = std::fs::File::open(path)?
        .take(LARGEST + 1)
        .read_to_string(&mut text)
        .map_err(|error| match error.kind() {
            ErrorKind::InvalidData => std::io::Error::other("not UTF-8 text"),
            _ => error,
        })?;
    if read as u64 > LARGEST {
        return Err(refusal());
    }
    // Spreadsheets and Windows editors begin a file with a byte order mark.
    if text.starts_with(BYTE_ORDER_MARK) {
        text.remove(0);
    }
    Ok(text)
}

//! Problems of a scenario: each mistake, its place and its remedy.
//!
//! Collected while a scenario is read and checked; the launcher shows them to a person ([`Problems`]' `Display`) or a
//! machine (the list, which serialises). A check never stops at the first problem.

use std::fmt;

use serde::Serialize;

use crate::source::SourceLine;

/// Prefix of a source name that denotes a flag instead of a file.
pub(crate) const FLAG: &str = "--set ";
/// Maximum number of problems reported: a wrong kind of file may have a million problems, each with its line.
pub(crate) const MOST_PROBLEMS: usize = 100;
/// Maximum number of alternatives listed.
const MOST_LISTED: usize = 100;

/// Kind of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProblemKind {
    /// A file cannot be read.
    Unreadable,
    /// The text is not TOML, not a table of points, or not a `--set KEY=VALUE`.
    Syntax,
    /// An unknown key.
    UnknownKey,
    /// A missing required key.
    MissingKey,
    /// A value of the wrong type.
    WrongType,
    /// A value outside its range.
    OutOfRange,
    /// A name of something that does not exist.
    UnknownName,
    /// A name that is used twice.
    Duplicate,
    /// Parts that contradict each other.
    Mismatch,
    /// A required signal that nothing provides.
    Unbound,
    /// Error in an expression.
    Expression,
}

/// Problem, with its place.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Kind of the problem.
    pub kind: ProblemKind,
    /// Key, for example `faults[0].effects[1].speed_per_s`; empty for the whole scenario.
    pub key: String,
    /// Description of the problem.
    pub message: String,
    /// Expected value: type, range and unit, or the alternatives.
    pub expected: Option<String>,
    /// Known names that are closest to the unknown one, best first.
    pub nearest: Vec<String>,
    /// Remedy, if one is known.
    pub help: Option<String>,
    /// File or `--set` flag that contains the problem.
    pub source: String,
    /// Line of the problem; `None` if there is no text.
    pub excerpt: Option<SourceLine>,
}

impl Problem {
    /// Adds the expected value.
    pub(crate) fn expected(&mut self, expected: impl Into<String>) -> &mut Self {
        self.expected = Some(expected.into());
        self
    }

    /// Adds the known names closest to an unknown one.
    pub(crate) fn nearest<'a>(
        &mut self,
        unknown: &str,
        names: impl IntoIterator<Item = &'a str>,
    ) -> &mut Self {
        // Without its line it is beyond the limit and not reported.
        if self.excerpt.is_none() {
            return self;
        }
        self.nearest = shared_types::table::nearest(unknown, names)
            .into_iter()
            .map(Into::into)
            .collect();
        self
    }

    /// Adds the known names as the expected value, and those closest to an unknown one.
    pub(crate) fn one_of<'a>(
        &mut self,
        unknown: &str,
        names: impl IntoIterator<Item = &'a str> + Clone,
    ) -> &mut Self {
        self.expected(format!("one of {}", listed(names.clone())))
            .nearest(unknown, names)
    }

    /// Adds the remedy, if there is one.
    pub(crate) fn help(&mut self, help: impl Into<String>) -> &mut Self {
        self.help = Some(help.into()).filter(|help| !help.is_empty());
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error: {}", Printable(&self.message))?;
        let mut margin = String::new();
        match &self.excerpt {
            None => write!(f, "\n --> {}", Printable(&self.source))?,
            Some(SourceLine {
                line,
                column,
                width,
                text,
                text_column,
            }) => {
                let number = line.to_string();
                margin = " ".repeat(number.len());
                let source = Printable(&self.source);
                write!(f, "\n{margin}--> {source}")?;
                if !self.source.starts_with(FLAG) {
                    write!(f, ":{line}:{column}")?;
                }
                write!(f, "\n{margin} |")?;
                let printable = Printable(text);
                // Tabs stay tabs, so that the mark stands below its text at any tab width.
                let indent: String = text
                    .chars()
                    .take(column - text_column)
                    .map(|c| if c == '\t' { c } else { ' ' })
                    .collect();
                write!(f, "\n{number} | {printable}")?;
                write!(f, "\n{margin} | {indent}{}", "^".repeat(*width))?;
            }
        }
        if let Some(expected) = &self.expected {
            write!(f, "\n{margin} = expected: {}", Printable(expected))?;
        }
        if !self.nearest.is_empty() {
            let quoted = |name: &String| format!("`{}`", Printable(name));
            let names: Vec<String> = self.nearest.iter().map(quoted).collect();
            write!(f, "\n{margin} = nearest: {}", names.join(", "))?;
        }
        if let Some(help) = &self.help {
            // Lines to paste stand below each other.
            for (number, line) in help.split('\n').enumerate() {
                let begin = if number == 0 { "= help: " } else { "  " };
                write!(f, "\n{margin} {begin}{}", Printable(line))?;
            }
        }
        Ok(())
    }
}

/// Text for display: no text from a file may control the terminal.
struct Printable<'a>(&'a str);

impl fmt::Display for Printable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = self.0.split(|c: char| c.is_control() && c != '\t');
        f.write_str(parts.next().unwrap_or_default())?;
        parts.try_for_each(|part| write!(f, "{}{part}", char::REPLACEMENT_CHARACTER))
    }
}

/// All problems of a scenario, never empty.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[serde(transparent)]
pub struct Problems(pub Vec<Problem>);

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for problem in &self.0 {
            write!(f, "{problem}\n\n")?;
        }
        match self.0.len() {
            1 => write!(f, "1 problem"),
            count => write!(f, "{count} problems"),
        }
    }
}

/// Formats names as text: `` `a`, `b` ``, or `none`; shows only the first of very many.
pub(crate) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names = names.into_iter();
    let quoted = |name| format!("`{name}`");
    let first: Vec<String> = names.by_ref().take(MOST_LISTED).map(quoted).collect();
    match (first.join(", "), names.count()) {
        (first, 0) if first.is_empty() => "none".into(),
        (first, 0) => first,
        (first, more) => format!("{first} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_shows_the_line_the_mark_and_the_remedy() {
        let problem = Problem {
            kind: ProblemKind::OutOfRange,
            key: "run.rate_hz".into(),
            message: "`run.rate_hz` is out of\nrange".into(),
            expected: Some("a number from 0.001 to 1000000 in Hz".into()),
            nearest: vec!["a".into(), "b".into()],
            help: Some("raise it".into()),
            source: "x.toml".into(),
            excerpt: Some(SourceLine {
                line: 12,
                column: 12,
                width: 2,
                text: "\trate_hz = -1\u{1b}[2J".into(),
                text_column: 1,
            }),
        };
        let expected = "\
error: `run.rate_hz` is out of\u{fffd}range
  --> x.toml:12:12
   |
12 | \trate_hz = -1\u{fffd}[2J
   | \t          ^^
   = expected: a number from 0.001 to 1000000 in Hz
   = nearest: `a`, `b`
   = help: raise it";
        assert_eq!(problem.to_string(), expected);
    }
}

//! Log of a process: its output, limited in size on disk, in memory and on display.
//!
//! The process appends to a file, so neither the process nor `hil` ever waits for the other, as with a pipe.
//! [`processes`](super::processes) checks the length while it supervises the process; if a log grows too long, its
//! beginning and end are kept, with a line between them that states the number of omitted bytes.

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use shared_types::text;

/// Maximum length of a complete log.
const LONGEST_BYTES: u64 = 8 << 20;
/// Length of the beginning and of the end kept of a longer log.
const KEPT_BYTES: u64 = 1 << 20;
/// Maximum number of attempts to read the end of a growing log.
const LOOKS: u32 = 16;
/// Length read at each end for display.
const READ_BYTES: u64 = 64 << 10;
/// Number of lines displayed from each end.
const EXCERPT: usize = 6;

/// Log of one process.
pub(crate) struct Log {
    path: PathBuf,
    file: File,
    left_out_bytes: u64,
    /// Length of the line that marks the omission.
    marker_bytes: u64,
}

impl Log {
    /// Creates the log file.
    ///
    /// # Errors
    /// If the file cannot be written, or already exists.
    pub(crate) fn create(path: PathBuf) -> io::Result<Self> {
        let mut options = File::options();
        let file = (options.read(true).append(true).create_new(true)).open(&path)?;
        Ok(Self {
            path,
            file,
            left_out_bytes: 0,
            marker_bytes: 0,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the file for the process to write to.
    ///
    /// # Errors
    /// If there are too many open files.
    pub(crate) fn output(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Empties the log.
    pub(crate) fn clear(&mut self) {
        // A log that cannot be emptied is read again.
        if self.file.set_len(0).is_ok() {
            (self.left_out_bytes, self.marker_bytes) = (0, 0);
        }
    }

    /// Omits the middle of a log that is too long.
    pub(super) fn bound(&mut self) {
        // Failing to shorten a log must not end the run.
        let _ = self.leave_out_middle();
    }

    fn leave_out_middle(&mut self) -> io::Result<()> {
        if self.length() <= LONGEST_BYTES {
            return Ok(());
        }
        // Data appended between the last read and the cut is lost and not counted. Therefore each pass reads only
        // what was appended meanwhile, which takes less time each pass; of a log that grows faster than it can be
        // read, something is still lost.
        let mut length = self.length();
        let mut end = self.read(length.saturating_sub(KEPT_BYTES), KEPT_BYTES);
        for _ in 0..LOOKS {
            let more = self.read(length, KEPT_BYTES);
            if more.is_empty() {
                break;
            }
            length += more.len() as u64;
            end.extend(more);
        }
        end.drain(..end.len().saturating_sub(KEPT_BYTES as usize));
        let left_out = length.saturating_sub(2 * KEPT_BYTES + self.marker_bytes);
        self.file.set_len(KEPT_BYTES)?;
        self.left_out_bytes += left_out;
        let marker = format!(
            "\n[hil omitted {} bytes here: the log was longer than {} MiB]\n",
            self.left_out_bytes,
            LONGEST_BYTES >> 20
        );
        self.marker_bytes = marker.len() as u64;
        self.file.write_all(&[marker.as_bytes(), &end].concat())
    }

    /// Returns the last non-blank line, printable, without the prefix `error`.
    pub(crate) fn last_word(&self) -> Option<String> {
        let line = self.last_line()?;
        Some(text::line(line.trim_start_matches("error: ")))
    }

    /// Returns the error with this beginning with which the process ended, without the prefix `error`.
    pub(super) fn last_error(&self, begin: &str) -> Option<String> {
        let line = self.last_line()?;
        // Other writers to the same log may leave lines unterminated.
        let at = line.find(&format!("error: {begin}"))?;
        Some(text::line(&line[at + "error: ".len()..]))
    }

    fn last_line(&self) -> Option<String> {
        let end = self.end(READ_BYTES);
        let end = String::from_utf8_lossy(&end);
        let line = end.lines().rfind(|line| !line.trim().is_empty())?;
        Some(line.to_owned())
    }

    /// Returns the warnings of the process, printable, at most as many as an excerpt has lines.
    pub(super) fn warnings(&self) -> Vec<String> {
        let content = self.read(0, KEPT_BYTES);
        let content = String::from_utf8_lossy(&content);
        let warnings = content.lines().filter(|line| line.starts_with("warning: "));
        warnings.map(text::line).take(EXCERPT).collect()
    }

    /// Returns the first and last lines, printable: a panic's message precedes its backtrace.
    pub(crate) fn excerpt(&self) -> String {
        let is_short = self.length() <= 2 * READ_BYTES;
        let read = if is_short { 2 * READ_BYTES } else { READ_BYTES };
        let (begin, end) = (self.read(0, read), self.end(READ_BYTES));
        let lines = |bytes: &[u8]| -> Vec<String> {
            let text = String::from_utf8_lossy(bytes);
            text.lines().map(text::line).collect()
        };
        let first = lines(&begin);
        if is_short && first.len() <= 2 * EXCERPT {
            return first.join("\n");
        }
        let last = if is_short { first.clone() } else { lines(&end) };
        let first = &first[..EXCERPT.min(first.len())];
        let last = &last[last.len().saturating_sub(EXCERPT)..];
        [first, &["...".to_owned()], last].concat().join("\n")
    }

    fn length(&self) -> u64 {
        self.file.metadata().map_or(0, |metadata| metadata.len())
    }

    /// Returns up to `bytes` bytes from the end.
    fn end(&self, bytes: u64) -> Vec<u8> {
        self.read(self.length().saturating_sub(bytes), bytes)
    }

    /// Reads up to `bytes` bytes from an offset; fewer if the log ends earlier, none if it cannot be read.
    fn read(&self, from: u64, bytes: u64) -> Vec<u8> {
        let there = self.length().saturating_sub(from).min(bytes);
        let mut content = vec![0; usize::try_from(there).unwrap_or(0)];
        match self.file.read_exact_at(&mut content, from) {
            Ok(()) => content,
            Err(_) => Vec::new(), // truncated by another process
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log() -> (tempfile::TempDir, Log) {
        let folder = tempfile::tempdir().expect("a folder");
        let log = Log::create(folder.path().join("plant.log")).expect("a log");
        (folder, log)
    }

    #[test]
    fn warnings_are_extracted_from_a_log_and_limited() {
        let (_folder, log) = log();
        let mut process = log.output().expect("a file");
        process
            .write_all(b"admitted\nwarning: one\x1b[2J\nno warning: here\n")
            .expect("written");
        let fffd = char::REPLACEMENT_CHARACTER;
        assert_eq!(log.warnings(), [format!("warning: one{fffd}[2J")]);
        let many = "warning: again\n".repeat(1000);
        process.write_all(many.as_bytes()).expect("written");
        assert_eq!(log.warnings().len(), EXCERPT);
    }

    #[test]
    fn the_last_word_is_an_error_if_there_is_one_and_not_a_note() {
        let (_folder, log) = log();
        let mut process = log.output().expect("a file");
        for (written, word, error) in [
            (
                "error: the wire\nnote: it goes on\n\n",
                "note: it goes on",
                None,
            ),
            ("error: the law\n", "the law", None),
            ("error: the wire\n", "the wire", Some("the wire")),
            (
                "law's last word, error: the wire: error: cut\n",
                "law's last word, error: the wire: error: cut",
                Some("the wire: error: cut"),
            ),
        ] {
            process.write_all(written.as_bytes()).expect("written");
            assert_eq!(log.last_word().as_deref(), Some(word));
            assert_eq!(log.last_error("the wire").as_deref(), error);
        }
    }

    #[test]
    fn a_long_log_keeps_both_ends_and_counts_the_omitted_bytes() {
        let (_folder, mut log) = log();
        let mut process = log.output().expect("a file");
        process.write_all(b"first\n").expect("written");
        let mut written = 6_u64;
        for round in 0..40_u8 {
            let block = vec![b'a' + round % 26; 1 << 20];
            process.write_all(&block).expect("written");
            written += block.len() as u64;
            log.bound();
            assert!(log.length() <= LONGEST_BYTES, "{}", log.length());
        }
        process.write_all(b"\nlast\n").expect("written");
        written += 6;
        let marker = format!("\n[hil omitted {} bytes", log.left_out_bytes);
        let content = log.read(0, u64::MAX);
        let text = String::from_utf8(content).expect("text");
        assert!(text.starts_with("first\naaaa") && text.ends_with("\nlast\n"));
        assert_eq!(text.matches("[hil omitted").count(), 1);
        assert!(text.contains(&marker));
        let length = text.len() as u64 - log.marker_bytes;
        assert_eq!(length + log.left_out_bytes, written);
        assert_eq!(log.last_word().as_deref(), Some("last"));
        // Lines of 1 MiB each are cut.
        assert!(log.excerpt().len() < 20_000);
        assert!(log.excerpt().starts_with("first\naaaa"));
    }

    #[test]
    fn displayed_output_contains_no_terminal_control_characters() {
        let (_folder, log) = log();
        let mut process = log.output().expect("a file");
        assert_eq!((log.last_word(), log.excerpt()), (None, String::new()));
        let output = b"one\n\x1b]52;c;eA==\x07\rtwo\nerror: \xc2\x9b2Jthree\xff\n\n";
        process.write_all(output).expect("written");
        let fffd = '\u{fffd}';
        assert_eq!(log.last_word(), Some(format!("{fffd}2Jthree{fffd}")));
        let excerpt = format!("one\n{fffd}]52;c;eA=={fffd}{fffd}two\nerror: {fffd}2Jthree{fffd}\n");
        assert_eq!(log.excerpt(), excerpt);
    }

    #[test]
    fn a_short_log_is_shown_completely_and_a_longer_one_by_its_ends() {
        let (_folder, log) = log();
        let mut process = log.output().expect("a file");
        let lines = |all: std::ops::Range<u32>| -> String {
            let lines: Vec<String> = all.map(|line| line.to_string()).collect();
            lines.join("\n")
        };
        write!(process, "{}", lines(0..12)).expect("written");
        assert_eq!(log.excerpt(), lines(0..12));
        write!(process, "\n12").expect("written");
        assert_eq!(
            log.excerpt(),
            format!("{}\n...\n{}", lines(0..6), lines(7..13))
        );
    }
}

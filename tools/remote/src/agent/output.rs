//! Output of a target: the latest command, in a file of the session that a driver of the board's outputs can read.
//!
//! Exists only in real time, because a plant that waits for commands is not a process on which outputs could act. The
//! agent switches the output to the safe command by itself, and never leaves another command behind.

use std::fs::File;
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;

use hil_session::session::SessionInfo;
use serde::Serialize;
use shared_types::describe::Settings;
use shared_types::hello::Welcome;
use shared_types::layout::SignalKind;
use shared_types::table::Field;

/// Name of the file in the session's folder with the names and units of the values.
const TABLE_FILE: &str = "output.json";
/// Name of the file with the values.
const FILE: &str = "output";
/// Bytes of the checksum at the end of the file.
const SUM: usize = 8;

/// The output, which exists as long as the agent lives.
#[derive(Debug)]
pub(super) struct Output {
    file: File,
    /// Positions of the commands in a frame of the controller.
    places: Vec<usize>,
    safe: Vec<f64>,
    is_safe: bool,
    step: u64,
    written: u64,
    values: Vec<f64>,
    bytes: Vec<u8>,
}

/// Facts about the values that a driver needs.
#[derive(Serialize)]
struct Table {
    commands: Vec<Field>,
    safe: Vec<f64>,
}

impl Output {
    /// Creates the output of a run, with the safe command; a command that the safe command does not name is 0.
    pub(super) fn create(
        session: &SessionInfo,
        welcome: &Welcome,
        safe: &Settings,
    ) -> Result<Self, String> {
        let signals = welcome.command.0.iter().enumerate();
        let places = signals.filter(|(_, signal)| signal.kind == SignalKind::Command);
        let places: Vec<usize> = places.map(|(place, _)| place).collect();
        let commands = welcome.command.fields(SignalKind::Command);
        let value = |field: &Field| safe.get(&field.name).unwrap_or(0.0);
        let safe: Vec<f64> = commands.iter().map(value).collect();
        let table = Table { commands, safe };
        let result = session.write_file(TABLE_FILE, &table);
        result.map_err(|error| error.to_string())?;
        let path = session.folder.join(FILE);
        let file = create(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let mut output = Self {
            file,
            places,
            safe: table.safe,
            is_safe: false,
            step: 0,
            written: 0,
            values: Vec::new(),
            bytes: Vec::new(),
        };
        output.switch();
        Ok(output)
    }

    /// Returns `true` if each command in a frame of the controller is a finite number.
    pub(super) fn is_finite(&self, row: &[f64]) -> bool {
        let mut places = self.places.iter();
        places.all(|place| row.get(*place).is_none_or(|value| value.is_finite()))
    }

    /// Applies the command of a step.
    pub(super) fn put(&mut self, step: u64, row: &[f64]) {
        let value = |place: &usize| row.get(*place).copied().unwrap_or(0.0);
        self.values.clear();
        self.values.extend(self.places.iter().map(value));
        (self.step, self.is_safe) = (step, false);
        self.write();
    }

    /// Switches to the safe command until the next command is applied.
    pub(super) fn switch(&mut self) {
        self.values.clone_from(&self.safe);
        self.is_safe = true;
        self.write();
    }

    /// Writes the file: number of the write, step, 1 if safe, the values, and the beginning of the hash of all that,
    /// each as 64 bits, little-endian.
    fn write(&mut self) {
        self.written += 1;
        self.bytes.clear();
        let words = [self.written, self.step, u64::from(self.is_safe)];
        let values = self.values.iter().map(|value| value.to_bits());
        for word in words.into_iter().chain(values) {
            self.bytes.extend(word.to_le_bytes());
        }
        let sum = blake3::hash(&self.bytes);
        self.bytes.extend(&sum.as_bytes()[..SUM]);
        // Memory that cannot be written now is written by the next, and a driver sees that nothing new comes.
        let _ = self.file.write_all_at(&self.bytes, 0);
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        self.switch(); // a driver may have it open still
    }
}

fn create(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.write(true).create_new(true).mode(0o600).open(path)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use hil_session::session::Session;
    use shared_types::layout::SignalTable;
    use shared_types::time::{Rate, Step};

    use super::*;

    /// Reads the file as a driver does: returns step, safe flag and values.
    fn read(path: &Path) -> (u64, bool, Vec<f64>) {
        let bytes = std::fs::read(path).expect("there");
        let (content, sum) = bytes.split_at(bytes.len() - SUM);
        assert_eq!(sum, &blake3::hash(content).as_bytes()[..SUM]);
        let words = content.chunks_exact(8);
        let words: Vec<u64> = words
            .map(|word| u64::from_le_bytes(word.try_into().expect("8 bytes")))
            .collect();
        let values = words[3..].iter().copied().map(f64::from_bits).collect();
        (words[1], words[2] == 1, values)
    }

    #[test]
    fn the_output_is_safe_before_the_first_command_after_a_switch_and_at_the_end() {
        let session = Session::of_one_process(None).expect("a session");
        let field = |name: &str| Field::signal(name, "A", "a command");
        let welcome = Welcome {
            protocol: 0,
            session: 0,
            epoch: 1,
            layout: 0,
            rate: Rate::new(1000.0).expect("a rate"),
            steps: 10,
            first: Step(0),
            against_clock: true,
            sample: SignalTable::default(),
            command: SignalTable::of(SignalKind::Command, &[field("one_a"), field("two_a")])
                .and(SignalKind::Internal, &[field("inner_a")]),
        };
        let mut safe = Settings::default();
        safe.set("two_a", -0.5);
        let mut output = Output::create(session.info(), &welcome, &safe).expect("made");
        let path = session.info().folder.join(FILE);
        let mode = std::fs::metadata(&path)
            .expect("there")
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(read(&path), (0, true, vec![0.0, -0.5]));
        output.put(7, &[1.0, 2.0, 3.0]);
        assert_eq!(read(&path), (7, false, vec![1.0, 2.0]));
        output.switch();
        assert_eq!(read(&path), (7, true, vec![0.0, -0.5]));
        for row in [[f64::NAN, 2.0, 3.0], [1.0, f64::NEG_INFINITY, 3.0]] {
            assert!(!output.is_finite(&row));
        }
        assert!(output.is_finite(&[1.0, 2.0, f64::NAN]), "an internal");
        output.put(9, &[4.0, 5.0, 6.0]);
        assert_eq!(read(&path), (9, false, vec![4.0, 5.0]));
        let link = session.info().folder.join("kept");
        std::fs::hard_link(&path, &link).expect("linked");
        drop(output);
        assert_eq!(read(&link), (9, true, vec![0.0, -0.5]));
    }
}

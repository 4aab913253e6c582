//! Port files: frames on a wire, the media on which they travel, and the signal of each field.
//!
//! Read by `hil describe`, by ports and by the bus in simulation. Media are data here and never opened; the frames are
//! those of [`hil_codec`], whose packers and receivers carry them out.

pub mod counts;
mod dbc;
mod fields;
mod frames;
mod media;
mod safety;

use std::collections::BTreeMap;
use std::path::Path;

use hil_codec::frame::Frame;
use shared_types::layout::{SignalKind, SignalTable};
use shared_types::table::{Field, unit_of_name};
use shared_types::time::Rate;

use crate::document::Value;
use crate::keys::PORT;
use crate::problem::{ProblemKind, Problems};
use crate::reader::{Reader, Section};
use crate::scenario::{Scenario, read_regular, root, unreadable};
use crate::title::{TITLE, is_title};

use dbc::DbcFiles;
pub use dbc::dbc_files;
pub(crate) use dbc::read_text as read_dbc;

pub use safety::{Safe, Safety};

/// Port file.
#[derive(Clone, Debug, PartialEq)]
pub struct Port {
    /// Name.
    pub name: String,
    /// Purpose.
    pub description: String,
    /// Exchange as a controller.
    pub exchange: Exchange,
    /// `false` if the far end keeps a clock of its own, so that two equal runs differ.
    pub is_repeatable: bool,
    /// Start of the far end.
    pub start: Start,
    /// Media.
    pub media: Vec<Medium>,
    /// Frames.
    pub frames: Vec<PortFrame>,
    /// Sending of the safe frames.
    pub safety: Safety,
}

/// Exchange of a port as a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exchange {
    /// Each sample is answered by the commands that are due at its step.
    Answers,
    /// The newest commands are used, and none is waited for.
    Free,
}

/// Start of the program at the far end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// Program and arguments; empty if the far end is started by others.
    pub command: Vec<String>,
    /// Beginning of the line that the program prints once it is ready.
    pub ready: Option<String>,
}

/// Medium on which frames travel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Medium {
    /// Name.
    pub name: String,
    /// Kind with its settings.
    pub kind: MediumKind,
}

/// Kind of medium.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MediumKind {
    /// Datagrams.
    Udp {
        /// Address of the peer.
        to: Option<std::net::SocketAddr>,
        /// Own address.
        listen: Option<std::net::SocketAddr>,
    },
    /// Stream between two addresses.
    Tcp {
        /// Address of the peer, or own address if the port listens.
        address: std::net::SocketAddr,
        /// `true` if the peer connects to the port.
        listens: bool,
    },
    /// Socket of this machine.
    Unix {
        /// Path.
        path: String,
        /// `true` for a stream, `false` for datagrams.
        is_stream: bool,
        /// `true` if the port makes the socket.
        listens: bool,
    },
    /// Serial line.
    Serial {
        /// Device.
        device: String,
        /// Symbols a second.
        baud: u32,
        /// Parity.
        parity: Parity,
        /// Bits of a character.
        data_bits: u8,
        /// Stop bits.
        stop_bits: u8,
    },
    /// CAN interface.
    Can {
        /// Interface.
        interface: String,
        /// `true` for CAN FD.
        fd: bool,
    },
    /// CAN frames in UDP datagrams.
    Cannelloni {
        /// Address of the peer.
        to: Option<std::net::SocketAddr>,
        /// Own address.
        listen: Option<std::net::SocketAddr>,
        /// `true` for CAN FD.
        fd: bool,
    },
    /// File that holds one frame.
    File {
        /// Path.
        path: String,
    },
}

/// Parity of a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Even number of ones.
    Even,
    /// Odd number of ones.
    Odd,
}

/// Frame of a port.
#[derive(Clone, Debug, PartialEq)]
pub struct PortFrame {
    /// Layout and contents.
    pub frame: Frame,
    /// Direction.
    pub carries: Carries,
    /// Index of the medium; `None` if the port has none.
    pub medium: Option<usize>,
    /// Time from one frame to the next.
    pub period: Period,
    /// Age in s above which a received value is stale.
    pub stale_s: Option<f64>,
    /// Safe values of its commands.
    pub safe: Vec<Safe>,
}

/// Direction of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Carries {
    /// From the plant to the controller.
    Sample,
    /// From the controller to the plant.
    Command,
}

impl Carries {
    /// Returns the word in a port file.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Command => "command",
        }
    }

    /// Returns the opposite direction.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Sample => Self::Command,
            Self::Command => Self::Sample,
        }
    }

    /// Returns the kinds of signals that travel in this direction.
    #[must_use]
    pub const fn kinds(self) -> &'static [SignalKind] {
        match self {
            Self::Sample => &[SignalKind::Measured, SignalKind::Reference],
            Self::Command => &[SignalKind::Command],
        }
    }
}

/// Time from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Period {
    /// Number of steps.
    Steps(u64),
    /// Seconds.
    Seconds(f64),
}

impl Period {
    /// Returns the period in steps of a run at this rate.
    ///
    /// # Errors
    /// The nearest periods in s that are whole steps, if this one is not.
    pub fn steps(self, rate: Rate) -> Result<u64, (f64, f64)> {
        let period_s = match self {
            Self::Steps(steps) => return Ok(steps),
            Self::Seconds(period_s) => period_s,
        };
        let steps = period_s * rate.hz();
        let whole = steps.round();
        if whole >= 1.0 && (steps - whole).abs() <= 1e-9 * (1.0 + steps) {
            return Ok(whole as u64);
        }
        let seconds = |steps: f64| {
            let steps = if steps < 1.0 { 1.0 } else { steps };
            steps / rate.hz()
        };
        Err((seconds(steps.floor()), seconds(steps.ceil())))
    }
}

/// Signals that the fields of a port may name.
#[derive(Clone, Copy, Debug)]
pub struct PortTables<'a> {
    /// Measured signals.
    pub measured: &'a [Field],
    /// Reference signals.
    pub reference: &'a [Field],
    /// Commands.
    pub commands: &'a [Field],
}

impl PortTables<'_> {
    /// Returns the signals of a kind.
    fn of(&self, kind: SignalKind) -> &[Field] {
        match kind {
            SignalKind::Measured => self.measured,
            SignalKind::Reference => self.reference,
            SignalKind::Command => self.commands,
            SignalKind::Truth | SignalKind::Internal => &[],
        }
    }
}

impl Port {
    /// Reads a port file. Without tables its fields define the signals; with tables every signal must be in them.
    ///
    /// # Errors
    /// If the file cannot be read, or all problems of its content.
    pub fn read(path: &Path, tables: Option<&PortTables<'_>>) -> Result<Self, Problems> {
        let text = read_regular(path).map_err(|error| unreadable("port file", path, &error))?;
        Self::parse(&text, path, tables)
    }

    /// Parses the text of a port file; DBC files are relative to the folder of `origin`.
    ///
    /// # Errors
    /// All problems.
    pub fn parse(
        text: &str,
        origin: &Path,
        tables: Option<&PortTables<'_>>,
    ) -> Result<Self, Problems> {
        Self::parse_with(text, origin, tables, &BTreeMap::new())
    }

    /// Parses the text of a port file; a DBC file with a text among these is not read.
    ///
    /// # Errors
    /// All problems.
    pub fn parse_with(
        text: &str,
        origin: &Path,
        tables: Option<&PortTables<'_>>,
        dbc: &BTreeMap<String, String>,
    ) -> Result<Self, Problems> {
        let scenario = Scenario::parse(text, origin)?;
        let mut reader = Reader::new(scenario.sources.clone(), Vec::new());
        let root = root(&scenario).with_keys(PORT);
        let is_other_version =
            root.table.get("port").is_some() && reader.integer(&root, "port").is_none();
        let port = match is_other_version {
            true => None,
            false => port(&mut reader, &root, (origin, dbc), tables),
        };
        reader.finish(port)
    }

    /// Returns the table of a direction: every signal once, in the order of the frames.
    #[must_use]
    pub fn table(&self, carries: Carries) -> SignalTable {
        let mut table = SignalTable::default();
        for kind in carries.kinds() {
            let mut fields: Vec<Field> = Vec::new();
            let frames = self.frames.iter().filter(|one| one.carries == carries);
            for frame in frames.clone().map(|one| &one.frame) {
                for (signal, number) in frame.signals().filter(|(one, _)| one.kind == *kind) {
                    let (min, max) = number.range();
                    let description = format!("Field of frame {}.", frame.name);
                    fields.push(Field {
                        min,
                        max,
                        ..Field::signal(&signal.name, &signal.unit, &description)
                    });
                }
            }
            table = table.and(*kind, &fields);
        }
        table
    }
}

/// Returns `true` if a text is that of a port file: its first key is `port`.
#[must_use]
pub fn is_port(text: &str) -> bool {
    let is_key = |line: &&str| !line.is_empty() && !line.starts_with('#');
    let first = text
        .trim_start_matches('\u{feff}')
        .lines()
        .map(str::trim)
        .find(is_key);
    let value = first.and_then(|line| line.strip_prefix("port"));
    value.is_some_and(|rest| rest.trim_start().starts_with('='))
}

fn port(
    reader: &mut Reader,
    root: &Section<'_>,
    (origin, dbc): (&Path, &BTreeMap<String, String>),
    tables: Option<&PortTables<'_>>,
) -> Option<Port> {
    reader.integer(root, "port");
    reader.refuse_unknown(root, &[]);
    let first = root.table.entries().first();
    if let Some(first) = first.filter(|first| first.key != "port") {
        let message = format!("`{}` comes before `port`", first.key);
        reader
            .report(ProblemKind::Mismatch, &first.key, &first.key_place, message)
            .help("a port file is recognised by `port = 1` as its first key");
    }
    let stem = origin
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let stem = stem.unwrap_or_default();
    let stem = stem.split('.').next().unwrap_or_default();
    let name = reader.text(root, "name").unwrap_or(stem).to_owned();
    if !is_title(&name) {
        let message = format!("the port's name is `{name}`");
        reader
            .report_at(root, "name", ProblemKind::OutOfRange, message)
            .expected(TITLE);
    }
    let description = reader.text(root, "description").unwrap_or_default().into();
    let exchange = match reader.text(root, "exchange") {
        Some("free") => Exchange::Free,
        _ => Exchange::Answers,
    };
    let is_repeatable = reader.boolean(root, "repeatable");
    let start = start(reader, root);
    let safety = safety::read(reader, root);
    let media = media::read(reader, root);
    let frames = frames::read(reader, root, &media, DbcFiles::new(origin, dbc), tables);
    Some(Port {
        name,
        description,
        exchange,
        // Commands that are not awaited depend on the clock.
        is_repeatable: is_repeatable? && exchange == Exchange::Answers,
        start: start?,
        media: media?,
        frames: frames?,
        safety: safety?,
    })
}

fn start(reader: &mut Reader, root: &Section<'_>) -> Option<Start> {
    let ready = reader.text(root, "ready").map(str::to_owned);
    let command: Vec<String> = match root.table.get("start") {
        None => Vec::new(),
        Some(_) => {
            let texts = reader.texts(root, "start")?;
            texts
                .into_iter()
                .map(|(_, _, text)| text.to_owned())
                .collect()
        }
    };
    if command.is_empty() && ready.is_some() {
        let message = "`ready` needs `start`";
        reader.report_at(root, "ready", ProblemKind::Mismatch, message);
        return None;
    }
    Some(Start { command, ready })
}

/// Returns the unit of a signal without a table.
fn unit_of(name: &str) -> &'static str {
    unit_of_name(name).unwrap_or("1")
}

/// Returns `true` if a list under a key is too long to read, which is reported.
fn is_too_long(reader: &mut Reader, section: &Section<'_>, key: &str, most: usize) -> bool {
    let Some(Value::List(items)) = section.table.get(key).map(|entry| &entry.node.value) else {
        return false;
    };
    let is_too_long = items.len() > most;
    if is_too_long {
        let path = section.path_of(key);
        let message = format!("`{path}` has {} entries", items.len());
        reader
            .report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(format!("at most {most}"));
    }
    is_too_long
}

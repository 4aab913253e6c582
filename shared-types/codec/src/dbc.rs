//! Messages of a DBC file, the description of a CAN bus that most tools write.
//!
//! Of a file only the messages (`BO_`), their signals (`SG_`) and the signals that are floats (`SIG_VALTYPE_`) are read,
//! as in "DBC File Format Documentation" (Vector, version 01/2007); all else, such as comments, attributes and nodes, does
//! not change any bit of a frame. The crate `can-dbc` is not used: it keeps no places, so that a contradiction could not
//! be shown in its line, and it cuts an identifier beyond 11 bits to 16 without a word.

use std::ops::Range;

use shared_types::units::Conversion;

use crate::bits::{BitField, ByteOrder};
use crate::frame::CanId;
use crate::number::Encoding;

/// Bit that marks an identifier of 29 bits.
const EXTENDED: u64 = 1 << 31;
/// Message without a frame, which lists signals of no message.
const INDEPENDENT: &str = "VECTOR__INDEPENDENT_SIG_MSG";
/// Largest number of mistakes that are listed.
const MOST_MISTAKES: usize = 100;
/// Largest length of a message in bytes, that of CAN FD.
pub const LONGEST_MESSAGE: usize = 64;

/// Messages of a DBC file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dbc {
    /// Messages, in the order of the file.
    pub messages: Vec<Message>,
}

/// Message.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Identifier.
    pub id: CanId,
    /// Name.
    pub name: String,
    /// Number of bytes.
    pub length: usize,
    /// Signals.
    pub signals: Vec<DbcSignal>,
    /// Place of its line.
    pub place: Range<usize>,
}

/// Signal of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct DbcSignal {
    /// Name.
    pub name: String,
    /// Place in the bytes.
    pub bits: BitField,
    /// Form of the raw number.
    pub encoding: Encoding,
    /// Factor and offset.
    pub wire: Conversion,
    /// Range in the unit; `None` for `[0|0]`.
    pub range: Option<(f64, f64)>,
    /// Unit.
    pub unit: String,
    /// `true` if a multiplexer selects the signal.
    pub is_multiplexed: bool,
    /// Place of its line.
    pub place: Range<usize>,
}

/// Mistake in a DBC file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DbcMistake {
    /// Place of the line.
    pub place: Range<usize>,
    /// Description.
    pub message: String,
}

impl Dbc {
    /// Finds a message by its name.
    #[must_use]
    pub fn message(&self, name: &str) -> Option<&Message> {
        self.messages.iter().find(|message| message.name == name)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// All mistakes and contradictions, up to a hundred.
    pub fn read(text: &str) -> Result<Self, Vec<DbcMistake>> {
        let mut reader = Reader::default();
        let mut is_in_text = false;
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let place = start..start + line.trim_end().len();
            start += line.len();
            if !is_in_text {
                reader.line(line.trim(), &place);
            }
            // Texts of comments may have several lines.
            is_in_text ^= quotes(line) % 2 == 1;
        }
        reader.contradictions();
        match reader.mistakes.is_empty() {
            true => Ok(reader.dbc),
            false => Err(reader.mistakes),
        }
    }
}

/// Counts the quotes of a line that are not escaped.
fn quotes(line: &str) -> usize {
    let mut is_escaped = false;
    let is_quote = |c: char| {
        let is_quote = c == '"' && !is_escaped;
        is_escaped = c == '\\' && !is_escaped;
        is_quote
    };
    line.chars()
        .map(is_quote)
        .filter(|is_quote| *is_quote)
        .count()
}

#[derive(Default)]
struct Reader {
    dbc: Dbc,
    mistakes: Vec<DbcMistake>,
    /// `true` behind a message, whose signals follow.
    is_in_message: bool,
}

impl Reader {
    fn report(&mut self, place: &Range<usize>, message: impl Into<String>) {
        if self.mistakes.len() < MOST_MISTAKES {
            self.mistakes.push(DbcMistake {
                place: place.clone(),
                message: message.into(),
            });
        }
    }

    fn line(&mut self, line: &str, place: &Range<usize>) {
        let (keyword, rest) = line.split_once([' ', '\t', ':']).unwrap_or((line, ""));
        match keyword {
            "BO_" => {
                self.is_in_message = true;
                match message(rest) {
                    Ok(None) => self.is_in_message = false,
                    Ok(Some((id, name, length))) => self.dbc.messages.push(Message {
                        id,
                        name,
                        length,
                        signals: Vec::new(),
                        place: place.clone(),
                    }),
                    Err(mistake) => {
                        self.is_in_message = false;
                        self.report(place, mistake);
                    }
                }
            }
            "SG_" => match signal(rest, place) {
                Ok(signal) => {
                    if let Some(message) =
                        self.dbc.messages.last_mut().filter(|_| self.is_in_message)
                    {
                        message.signals.push(signal);
                    }
                }
                Err(mistake) if self.is_in_message => self.report(place, mistake),
                Err(_) => {}
            },
            "SIG_VALTYPE_" => {
                if let Err(mistake) = self.value_type(rest) {
                    self.report(place, mistake);
                }
            }
            "" => {}
            _ => self.is_in_message = false,
        }
    }

    /// Reads `ID NAME : 1;`, which makes a signal a float.
    fn value_type(&mut self, rest: &str) -> Result<(), String> {
        let form = || "SIG_VALTYPE_ needs an id, a signal, `:` and 0 to 3".to_owned();
        let (names, kind) = rest.rsplit_once([':', ' ']).ok_or_else(form)?;
        let kind: u32 = kind
            .trim_matches([';', ' ', '\t'])
            .parse()
            .map_err(|_| form())?;
        let mut names = names
            .trim_end_matches([':', ' ', '\t'])
            .split_ascii_whitespace();
        let (id, name) = names.next().zip(names.next()).ok_or_else(form)?;
        let id = identifier(id)?;
        let message = self
            .dbc
            .messages
            .iter_mut()
            .find(|message| message.id == id);
        let message = message.ok_or_else(|| format!("no message has the id {id}"))?;
        let signal = message
            .signals
            .iter_mut()
            .find(|signal| signal.name == name);
        let signal =
            signal.ok_or_else(|| format!("message `{}` has no signal `{name}`", message.name))?;
        let width = match kind {
            0 => return Ok(()),
            1 => 32,
            2 => 64,
            _ => return Err(form()),
        };
        if signal.bits.width() != width {
            let bits = signal.bits.width();
            return Err(format!(
                "`{name}` is a float of {width} bits, and its field has {bits}"
            ));
        }
        signal.encoding = Encoding::Float;
        Ok(())
    }

    /// Reports what contradicts something else in the file.
    fn contradictions(&mut self) {
        let messages = std::mem::take(&mut self.dbc.messages);
        for (index, message) in messages.iter().enumerate() {
            let Message { name, length, .. } = message;
            let before = &messages[..index];
            if let Some(other) = before.iter().find(|other| other.id == message.id) {
                let (id, other) = (message.id, &other.name);
                self.report(
                    &message.place,
                    format!("messages `{other}` and `{name}` have the same id {id}"),
                );
            }
            if before.iter().any(|other| other.name == *name) {
                self.report(
                    &message.place,
                    format!("two messages have the name `{name}`"),
                );
            }
            for (index, signal) in message.signals.iter().enumerate() {
                let of = format!("signal `{}` of message `{name}`", signal.name);
                if signal.bits.end_byte() > *length {
                    let byte = signal.bits.end_byte() - 1;
                    self.report(
                        &signal.place,
                        format!("{of} reaches byte {byte}, and the message has {length} bytes"),
                    );
                }
                let before = &message.signals[..index];
                if before.iter().any(|other| other.name == signal.name) {
                    self.report(&signal.place, format!("{of} is described twice"));
                }
                let is_always_there = |one: &DbcSignal| !one.is_multiplexed;
                let overlap = before.iter().find(|other| {
                    (is_always_there(signal) || is_always_there(other))
                        && signal.bits.overlaps(&other.bits)
                });
                if let Some(other) = overlap {
                    self.report(
                        &signal.place,
                        format!("{of} shares bits with `{}`", other.name),
                    );
                }
                if signal.range.is_some_and(|(low, high)| low > high) {
                    self.report(
                        &signal.place,
                        format!("{of} has a range whose smallest value is above its largest"),
                    );
                }
            }
        }
        self.dbc.messages = messages;
    }
}

fn identifier(text: &str) -> Result<CanId, String> {
    let number: u64 = text.parse().map_err(|_| format!("`{text}` is not an id"))?;
    let range =
        "an id has 11 bits, or 29 bits plus 2147483648 (bit 31), which marks it as extended";
    if number & EXTENDED != 0 {
        let id = u32::try_from(number ^ EXTENDED)
            .ok()
            .filter(|id| *id < 1 << 29);
        return id
            .map(CanId::Extended)
            .ok_or_else(|| format!("the id {text} is out of range: {range}"));
    }
    let id = u16::try_from(number).ok().filter(|id| *id < 1 << 11);
    id.map(CanId::Standard)
        .ok_or_else(|| format!("the id {text} is out of range: {range}"))
}

/// Reads `ID NAME: LENGTH TRANSMITTER`; `None` for the message without a frame.
fn message(rest: &str) -> Result<Option<(CanId, String, usize)>, String> {
    let form = || "BO_ needs an id, a name, `:` and a length".to_owned();
    let (head, tail) = rest.split_once(':').ok_or_else(form)?;
    let mut head = head.split_ascii_whitespace();
    let (id, name) = head.next().zip(head.next()).ok_or_else(form)?;
    if name == INDEPENDENT {
        return Ok(None);
    }
    let length = tail.split_ascii_whitespace().next().ok_or_else(form)?;
    let length = length
        .parse()
        .ok()
        .filter(|length| *length <= LONGEST_MESSAGE);
    let length = length.ok_or_else(|| {
        format!("message `{name}` needs a length of 0 to {LONGEST_MESSAGE} bytes")
    })?;
    Ok(Some((identifier(id)?, name.into(), length)))
}

/// Reads `NAME [M|m0] : START|WIDTH@ORDER SIGN (FACTOR,OFFSET) [MIN|MAX] "UNIT" RECEIVERS`.
fn signal(rest: &str, place: &Range<usize>) -> Result<DbcSignal, String> {
    let form = || {
        "SG_ needs NAME : START|WIDTH@ORDER and SIGN, (FACTOR,OFFSET), [MIN|MAX] and \"UNIT\""
            .to_owned()
    };
    let (head, tail) = rest.split_once(':').ok_or_else(form)?;
    let mut head = head.split_ascii_whitespace();
    let name = head.next().ok_or_else(form)?;
    let selector = head.next();
    let between = |open: char, close: char| {
        let (_, inner) = tail.split_once(open)?;
        Some(inner.split_once(close)?.0)
    };
    let layout = tail.split('(').next().unwrap_or_default().trim();
    let (start, layout) = layout.split_once('|').ok_or_else(form)?;
    let (width, layout) = layout.split_once('@').ok_or_else(form)?;
    let (order, sign) = match layout.as_bytes() {
        [order @ (b'0' | b'1'), sign @ (b'+' | b'-')] => (order, sign),
        _ => return Err(form()),
    };
    let order = if *order == b'1' {
        ByteOrder::Little
    } else {
        ByteOrder::Big
    };
    let encoding = if *sign == b'+' {
        Encoding::Unsigned
    } else {
        Encoding::Signed
    };
    let number = |text: &str| text.trim().parse().map_err(|_| form());
    let (start, width) = (number(start)?, number(width)?);
    let bits = BitField::new(start, width as u32, order)
        .filter(|_| width <= 64)
        .ok_or_else(|| format!("signal `{name}` needs 1 to 64 bits inside of its message"))?;
    let pair = |text: Option<&str>, separator: char| -> Result<(f64, f64), String> {
        let (one, other) = text
            .and_then(|text| text.split_once(separator))
            .ok_or_else(form)?;
        let number = |text: &str| text.trim().parse().map_err(|_| form());
        Ok((number(one)?, number(other)?))
    };
    let (factor, offset) = pair(between('(', ')'), ',')?;
    let range = pair(between('[', ']'), '|')?;
    let is_sound = factor != 0.0
        && [factor, offset, range.0, range.1]
            .iter()
            .all(|number| number.is_finite());
    if !is_sound {
        return Err(format!(
            "signal `{name}` needs a factor other than 0 and finite numbers"
        ));
    }
    Ok(DbcSignal {
        name: name.into(),
        bits,
        encoding,
        wire: Conversion { factor, offset },
        range: Some(range).filter(|range| *range != (0.0, 0.0)),
        unit: between('"', '"').ok_or_else(form)?.into(),
        is_multiplexed: selector.is_some_and(|selector| selector.starts_with('m')),
        place: place.clone(),
    })
}

#[cfg(test)]
mod tests;

//! Reader of the fields of a frame of bytes; those of a line of JSON are in [`json`].

pub(super) mod json;
mod signal;

use hil_codec::bits::{BitField, ByteOrder};
use hil_codec::checksum::Algorithm;
use hil_codec::dbc::{DbcSignal, Message};
use hil_codec::frame::{Body, Content, Counter, Field, Signal};
use hil_codec::number::Encoding;

use super::{Carries, PortTables};
use crate::keys::FIELDS;
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};
use signal::{named, number};

/// Frame of the fields.
pub(super) struct FrameContext<'a> {
    pub carries: Carries,
    pub tables: Option<&'a PortTables<'a>>,
    pub order: ByteOrder,
    /// DBC message that describes the frame.
    pub message: Option<&'a Message>,
}

/// Returns the byte order of a word.
pub(super) fn order(word: &str) -> ByteOrder {
    match word {
        "big" => ByteOrder::Big,
        _ => ByteOrder::Little,
    }
}

/// Reports a key that has no effect.
pub(super) fn without_effect(reader: &mut Reader, section: &Section<'_>, key: &str, place: &str) {
    if section.table.get(key).is_some() {
        let message = format!("`{}` has no effect {place}", section.path_of(key));
        reader
            .report_at(section, key, ProblemKind::Mismatch, message)
            .help("omit it");
    }
}

/// Reads the fields of bytes, and returns the sections of those that are sound. Without a body one of them is faulty.
pub(super) fn bytes<'a>(
    reader: &mut Reader,
    frame: &Section<'a>,
    context: &FrameContext<'_>,
) -> (Option<Body>, Vec<Section<'a>>) {
    let all = reader.list(frame, "fields");
    let (mut fields, mut sections): (Vec<Field>, Vec<Section<'a>>) = (Vec::new(), Vec::new());
    let mut before = None;
    for section in &all {
        let field = field(reader, section, context, before);
        before = field.as_ref().map(|field| field.bits);
        if let Some(field) = field {
            fields.push(field);
            sections.push(section.clone());
        }
    }
    let is_whole = fields.len() == all.len();
    let end = fields.iter().map(|field| field.bits.end_byte()).max();
    let length = match (context.message, frame.table.get("length")) {
        (Some(message), _) => Some(message.length),
        (None, None) => Some(end.unwrap_or_default()),
        (None, Some(_)) => reader
            .integer(frame, "length")
            .map(|length| length as usize),
    };
    // The checksum ends with the frame, whose length follows from all fields.
    for field in &mut fields {
        if let (Content::Checksum { end, .. }, Some(length)) = (&mut field.content, length)
            && *end == usize::MAX
        {
            *end = length;
        }
    }
    let signals: Vec<Signal> = (fields.iter())
        .filter_map(|field| match &field.content {
            Content::Signal(signal, _) => Some(signal.clone()),
            _ => None,
        })
        .collect();
    // A validity bit has the unit of its signal.
    for field in &mut fields {
        if let Content::Valid(signal) = &mut field.content
            && let Some(with_unit) = signals.iter().find(|other| other.is(signal))
        {
            signal.clone_from(with_unit);
        }
    }
    let body = length
        .filter(|_| is_whole)
        .map(|length| Body::Bytes { length, fields });
    (body, sections)
}

fn field(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &FrameContext<'_>,
    before: Option<BitField>,
) -> Option<Field> {
    let kinds = FIELDS.iter().map(|kind| (kind.name, kind.keys));
    let (kind, own) = reader.of_kind(section, "field", kinds)?;
    without_effect(reader, section, "path", "in a frame of bytes");
    let (bits, encoding, dbc_signal) = match context.message {
        Some(message) => {
            let signal = of_message(reader, section, message)?;
            for key in ["type", "order", "byte", "bit", "scale", "offset"] {
                without_effect(reader, section, key, "beside a DBC signal, which gives it");
            }
            (signal.bits, signal.encoding, Some(signal))
        }
        None => {
            without_effect(reader, section, "dbc_signal", "without a DBC message");
            let (bits, encoding) = place(reader, section, context, before)?;
            (bits, encoding, None)
        }
    };
    let mut default_name = dbc_signal.map_or(kind, |signal| &signal.name).to_owned();
    let content = match kind {
        "signal" => {
            let named = named(reader, &own, context)?;
            let number = number(reader, &own, &named, encoding, bits.width(), dbc_signal)?;
            if dbc_signal.is_none() {
                default_name.clone_from(&named.signal.name);
            }
            Content::Signal(named.signal, number)
        }
        "valid" => Content::Valid(named(reader, &own, context)?.signal),
        "constant" => {
            without_effect(reader, section, "text", "in a frame of bytes");
            let Some(value) = reader.integer(&own, "value") else {
                if section.table.get("value").is_none() {
                    let path = section.path_of("value");
                    reader.missing(section, &path, "a whole number of at least 0".into());
                }
                return None;
            };
            Content::Constant(value.unsigned_abs())
        }
        "counter" => Content::Counter(counter(reader, &own, bits.width())?),
        _ => {
            let algorithm = reader.text(&own, "algorithm").and_then(Algorithm::named);
            let first = reader.integer(&own, "first_byte");
            let end = match section.table.get("last_byte") {
                Some(_) => reader
                    .integer(&own, "last_byte")
                    .map(|last| last as usize + 1),
                None => Some(usize::MAX),
            };
            Content::Checksum {
                algorithm: algorithm?,
                first: first? as usize,
                end: end?,
            }
        }
    };
    let name = reader
        .text(section, "name")
        .map_or(default_name, Into::into);
    Some(Field {
        name,
        bits,
        content,
    })
}

/// Reads type, order, byte and bit.
fn place(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &FrameContext<'_>,
    before: Option<BitField>,
) -> Option<(BitField, Encoding)> {
    const TYPES: &str = "u1 to u64, i2 to i64, f32 or f64";
    let Some(text) = reader.text(section, "type") else {
        if section.table.get("type").is_none() {
            let path = section.path_of("type");
            reader.missing(section, &path, TYPES.into());
        }
        return None;
    };
    let Some((encoding, width)) = form(text) else {
        reader.refuse(section, "type", text, TYPES);
        return None;
    };
    let order = match section.table.get("order") {
        Some(_) => order(reader.text(section, "order")?),
        None => context.order,
    };
    let has_byte = section.table.get("byte").is_some();
    let start = if has_byte {
        let byte = reader.integer(section, "byte");
        let first = match order {
            ByteOrder::Little => 0,
            ByteOrder::Big => 7,
        };
        let bit = match section.table.get("bit") {
            Some(_) => reader.integer(section, "bit"),
            None => Some(first),
        };
        byte? as usize * 8 + bit? as usize
    } else {
        without_effect(reader, section, "bit", "without `byte`");
        let Some(start) = next_start(before, order, width) else {
            let path = section.path_of("byte");
            let message = format!("`{path}` is missing");
            reader
                .report(ProblemKind::MissingKey, path, section.place, message)
                .expected("a byte: the field before ends inside of one, or in another byte order");
            return None;
        };
        start
    };
    let bits = BitField::new(start, width, order);
    if bits.is_none() {
        let message = format!(
            "the field begins at byte {} and has {width} bits",
            start / 8
        );
        reader
            .report_at(section, "byte", ProblemKind::OutOfRange, message)
            .expected("a frame of at most 4096 bytes");
    }
    Some((bits?, encoding))
}

/// Returns the start of a field behind another: at the next bit, or at the next byte if both are whole bytes.
fn next_start(before: Option<BitField>, order: ByteOrder, width: u32) -> Option<usize> {
    let first = match order {
        ByteOrder::Little => 0,
        ByteOrder::Big => 7,
    };
    let Some(before) = before else {
        return Some(first);
    };
    let ends_whole = match before.order() {
        ByteOrder::Little => before.next_start() % 8 == 0,
        ByteOrder::Big => before.next_start() % 8 == 7,
    };
    match ends_whole {
        true => Some(before.end_byte() * 8 + first),
        false if order == before.order() && !width.is_multiple_of(8) => Some(before.next_start()),
        false => None,
    }
}

fn form(text: &str) -> Option<(Encoding, u32)> {
    let (letter, digits) = text.split_at_checked(1)?;
    let is_number = !digits.starts_with('0') && digits.bytes().all(|c| c.is_ascii_digit());
    let width: u32 = digits
        .parse()
        .ok()
        .filter(|width| is_number && *width <= 64)?;
    match (letter, width) {
        ("u", 1..) => Some((Encoding::Unsigned, width)),
        ("i", 2..) => Some((Encoding::Signed, width)),
        ("f", 32 | 64) => Some((Encoding::Float, width)),
        _ => None,
    }
}

/// Returns the signal of a DBC message that a field names.
fn of_message<'m>(
    reader: &mut Reader,
    section: &Section<'_>,
    message: &'m Message,
) -> Option<&'m DbcSignal> {
    let names = message.signals.iter().map(|signal| signal.name.as_str());
    if section.table.get("dbc_signal").is_none() {
        let path = section.path_of("dbc_signal");
        let expected = format!("a signal of message `{}`: {}", message.name, listed(names));
        reader.missing(section, &path, expected);
        return None;
    }
    let name = reader.text(section, "dbc_signal")?;
    let signal = message.signals.iter().find(|signal| signal.name == name);
    if signal.is_none() {
        let text = format!("message `{}` has no signal `{name}`", message.name);
        reader
            .report_at(section, "dbc_signal", ProblemKind::UnknownName, text)
            .one_of(name, names);
    }
    let signal = signal?;
    if signal.is_multiplexed {
        let text = format!("signal `{name}` is multiplexed, which ports do not support");
        reader
            .report_at(section, "dbc_signal", ProblemKind::Mismatch, text)
            .expected("a signal that is in every frame of its message");
        return None;
    }
    Some(signal)
}

fn counter(reader: &mut Reader, own: &Section<'_>, width: u32) -> Option<Counter> {
    let bits = match own.table.get("counter_bits") {
        Some(_) => reader.integer(own, "counter_bits").map(|bits| bits as u32),
        None => Some(width.min(32)),
    };
    let max_jump = reader.integer(own, "max_jump");
    Some(Counter {
        width: bits?,
        max_jump: max_jump?.unsigned_abs(),
    })
}

//! `hil describe FILE` of a port file: the tables that follow from it, and its frames field by field.

mod safety;

use std::fmt::Write;

use hil_codec::bits::{BitField, ByteOrder};
use hil_codec::frame::{Body, CanId, Content, Counter, Frame, JsonContent, Signal};
use hil_codec::number::{Encoding, Number};
use hil_config::port::{Carries, Period, Port, PortFrame};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left};
use serde_json::{Map, Value, json};
use shared_types::number::{exact_in, short, short_in};

use super::Written;
use crate::arguments::describe::DescribeArguments;

/// Describes a port file.
pub(super) fn describe(arguments: &DescribeArguments) -> Result<Exit, Failure> {
    let flags = [
        (arguments.load, "--load"),
        (arguments.trust_archive, "--trust-archive"),
        (arguments.allow_execution_tool, "--allow-execution-tool"),
    ];
    let file = arguments.file.display().to_string();
    if let Some((_, flag)) = flags.iter().find(|(is_given, _)| *is_given) {
        let message = format!("{file} is a port file, and {flag} has an effect on FMUs only");
        return Err(Failure::usage(message));
    }
    let port = Port::read(&arguments.file, None)?;
    let frames: Vec<Value> = port
        .frames
        .iter()
        .map(|one| frame_json(&port, one))
        .collect();
    let media = port
        .media
        .iter()
        .map(|medium| json!({"name": medium.name, "medium": medium.kind.to_string()}));
    let result = json!({
        "file": file,
        "port": {
            "name": port.name,
            "description": port.description,
            "media": media.collect::<Vec<_>>(),
            "sample": port.table(Carries::Sample),
            "command": port.table(Carries::Command),
            "frames": frames,
            "safety": safety::json(&port),
        },
    });
    output::result(arguments.json, &result, || {
        output::text(|text| write_all(text, &file, &port))
    })?;
    Ok(Exit::Pass)
}

fn write_all(text: &mut String, file: &str, port: &Port) -> Written {
    let separator = if port.description.is_empty() {
        ""
    } else {
        ": "
    };
    writeln!(
        text,
        "{file}: port {}{separator}{}",
        port.name, port.description
    )?;
    if !port.media.is_empty() {
        writeln!(text, "\nmedia: {}", port.media.len())?;
    }
    let mut media = Table::new(2, [left(0), left(0)]);
    for medium in &port.media {
        media.row(&[&medium.name, &medium.kind]);
    }
    write!(text, "{media}")?;
    for carries in [Carries::Sample, Carries::Command] {
        let signals = port.table(carries);
        writeln!(
            text,
            "\nsignals of the {}: {}",
            carries.word(),
            signals.len()
        )?;
        let mut table = Table::new(2, [left(0), left(0), left(0)]);
        for signal in &signals.0 {
            let name = format!("{}.{}", signal.kind.prefix(), signal.field.name);
            let range = range(signal.field.min, signal.field.max, "");
            table.row(&[&name, &signal.field.unit, &range]);
        }
        write!(text, "{table}")?;
    }
    for one in &port.frames {
        write_frame(text, port, one)?;
    }
    safety::write(text, port)
}

fn write_frame(text: &mut String, port: &Port, one: &PortFrame) -> Written {
    let Frame { name, id, body } = &one.frame;
    let mut facts = vec![one.carries.word().to_owned()];
    facts.extend(
        one.medium
            .map(|medium| format!("on {}", port.media[medium].name)),
    );
    facts.extend(id.map(|id| format!("id {id}")));
    facts.push(match body {
        Body::Bytes { length, .. } => format!("{length} bytes"),
        Body::Json(_) => "a line of JSON".into(),
    });
    facts.push(match one.period {
        Period::Steps(1) => "at every step".into(),
        Period::Steps(steps) => format!("every {steps} steps"),
        Period::Seconds(period_s) => {
            let rate = short_in(1.0 / period_s, "Hz");
            format!("every {}, {rate}", exact_in(period_s, "s"))
        }
    });
    facts.extend(
        one.stale_s
            .map(|stale_s| format!("stale after {}", exact_in(stale_s, "s"))),
    );
    writeln!(text, "\nframe {name}: {}", facts.join(", "))?;
    let mut table = Table::new(2, [left(0); 5]);
    match body {
        Body::Bytes { length, fields } => {
            let mut fields: Vec<_> = fields.iter().collect();
            fields.sort_by_key(|field| (field.bits.first_byte(), bits_before(&field.bits)));
            table.row(&[&"bytes", &"type", &"field", &"resolution", &"content"]);
            for field in &fields {
                let (step, content) = content(&field.content);
                let kind = kind_of(&field.bits, &field.content);
                table.row(&[&place(&field.bits), &kind, &field.name, &step, &content]);
            }
            let unused = |byte| {
                !fields
                    .iter()
                    .fold(0_u8, |used, field| used | field.bits.mask_of(byte))
            };
            let unused = runs((0..*length).map(|byte| (byte, unused(byte))));
            if !unused.is_empty() {
                table.row(&[&unused, &"", &"", &"", &"unused"]);
            }
        }
        Body::Json(fields) => {
            table.row(&[&"path", &"content"]);
            for field in fields {
                let content = match &field.content {
                    JsonContent::Signal(signal, number) => of_signal(signal, number),
                    JsonContent::Text(constant) => format!("constant \"{constant}\""),
                    JsonContent::Number(constant) => format!("constant {}", short(*constant)),
                    JsonContent::Counter(counter) => of_counter(counter),
                };
                table.row(&[&field.path, &content]);
            }
        }
    }
    write!(text, "{table}")
}

/// Returns the number of bits before a field in its first byte, in the order of reading.
fn bits_before(bits: &BitField) -> u32 {
    let mask = bits.mask_of(bits.first_byte());
    match bits.order() {
        ByteOrder::Little => mask.trailing_zeros(),
        ByteOrder::Big => mask.leading_zeros(),
    }
}

/// Formats the bytes of a field: whole ones as `2 to 3`, parts with their bits as `4[7:4]`.
fn place(bits: &BitField) -> String {
    runs((bits.first_byte()..bits.end_byte()).map(|byte| (byte, bits.mask_of(byte))))
}

fn runs(bytes: impl Iterator<Item = (usize, u8)>) -> String {
    let mut parts: Vec<(usize, usize, u8)> = Vec::new();
    for (byte, mask) in bytes.filter(|(_, mask)| *mask != 0) {
        match parts.last_mut() {
            Some((_, last, 0xFF)) if mask == 0xFF && *last + 1 == byte => *last = byte,
            _ => parts.push((byte, byte, mask)),
        }
    }
    let part = |(first, last, mask): &(usize, usize, u8)| match mask {
        0xFF if first == last => first.to_string(),
        0xFF => format!("{first} to {last}"),
        mask => format!("{first}[{}]", bits(*mask)),
    };
    parts.iter().map(part).collect::<Vec<_>>().join(", ")
}

/// Formats the bits of a mask, the most significant first: `7:5, 2`.
fn bits(mask: u8) -> String {
    let is_set = |bit: u32| bit < 8 && mask & (1 << bit) != 0;
    let mut parts = Vec::new();
    for high in (0..8).rev().filter(|bit| is_set(*bit) && !is_set(bit + 1)) {
        let low = (0..=high)
            .rev()
            .take_while(|bit| is_set(*bit))
            .last()
            .unwrap_or(high);
        parts.push(match low == high {
            true => high.to_string(),
            false => format!("{high}:{low}"),
        });
    }
    parts.join(", ")
}

/// Formats a range; a float without limits takes any number.
fn range(low: f64, high: f64, unit: &str) -> String {
    /// Beyond any value of a signal, and less than what a float can express.
    const LARGE: f64 = 1e30;
    match high > LARGE {
        true => "any number".into(),
        false => format!("{} to {}", short(low), short_in(high, unit)),
    }
}

const fn letter(content: &Content) -> char {
    match content {
        Content::Signal(_, number) => match number.encoding() {
            Encoding::Unsigned => 'u',
            Encoding::Signed => 'i',
            Encoding::Float => 'f',
        },
        _ => 'u',
    }
}

fn kind_of(bits: &BitField, content: &Content) -> String {
    let order = match bits.order() {
        _ if bits.first_byte() + 1 == bits.end_byte() => "",
        ByteOrder::Little => " little",
        ByteOrder::Big => " big",
    };
    format!("{}{}{order}", letter(content), bits.width())
}

/// Returns resolution and content of a field.
fn content(content: &Content) -> (String, String) {
    match content {
        Content::Signal(signal, number) => {
            let step = number.resolution();
            let step = step.map_or(String::new(), |step| short_in(step, &signal.unit));
            (step, of_signal(signal, number))
        }
        Content::Valid(signal) => (String::new(), format!("1 while {signal} is valid")),
        Content::Constant(raw) => (String::new(), format!("constant {raw:#x}")),
        Content::Counter(counter) => (String::new(), of_counter(counter)),
        Content::Checksum {
            algorithm,
            first,
            end,
        } => {
            let (name, last) = (algorithm.name(), end - 1);
            (String::new(), format!("{name} of bytes {first} to {last}"))
        }
    }
}

fn of_signal(signal: &Signal, number: &Number) -> String {
    let (low, high) = number.range();
    let range = range(low, high, &signal.unit);
    match number.scale().invalid {
        Some(invalid) => format!("{signal}, {range}; {invalid:#x} is no value"),
        None => format!("{signal}, {range}"),
    }
}

fn of_counter(counter: &Counter) -> String {
    format!(
        "counter of {} bits, steps up to {}",
        counter.width, counter.max_jump
    )
}

fn frame_json(port: &Port, one: &PortFrame) -> Value {
    let (divider, period_s) = match one.period {
        Period::Steps(steps) => (Some(steps), None),
        Period::Seconds(period_s) => (None, Some(period_s)),
    };
    let (length, fields) = match &one.frame.body {
        Body::Bytes { length, fields } => {
            let fields = fields.iter().map(|field| {
                let mut entry = match &field.content {
                    Content::Signal(signal, number) => signal_json(signal, number),
                    Content::Valid(signal) => {
                        of_kind("valid", &[("signal", json!(signal.to_string()))])
                    }
                    Content::Constant(raw) => of_kind("constant", &[("value", json!(raw))]),
                    Content::Counter(counter) => counter_json(counter),
                    Content::Checksum {
                        algorithm,
                        first,
                        end,
                    } => of_kind(
                        "checksum",
                        &[
                            ("algorithm", json!(algorithm.name())),
                            ("first_byte", json!(first)),
                            ("last_byte", json!(end - 1)),
                        ],
                    ),
                };
                let order = match field.bits.order() {
                    ByteOrder::Little => "little",
                    ByteOrder::Big => "big",
                };
                for (key, value) in [
                    ("name", json!(field.name)),
                    (
                        "type",
                        json!(format!("{}{}", letter(&field.content), field.bits.width())),
                    ),
                    ("order", json!(order)),
                    ("byte", json!(field.bits.start() / 8)),
                    ("bit", json!(field.bits.start() % 8)),
                ] {
                    entry.insert(key.into(), value);
                }
                entry
            });
            (Some(*length), fields.collect::<Vec<_>>())
        }
        Body::Json(fields) => {
            let fields = fields.iter().map(|field| {
                let mut entry = match &field.content {
                    JsonContent::Signal(signal, number) => signal_json(signal, number),
                    JsonContent::Text(text) => of_kind("constant", &[("text", json!(text))]),
                    JsonContent::Number(number) => of_kind("constant", &[("value", json!(number))]),
                    JsonContent::Counter(counter) => counter_json(counter),
                };
                entry.insert("path".into(), json!(field.path.to_string()));
                entry
            });
            (None, fields.collect())
        }
    };
    let id = one.frame.id.map(|id| match id {
        CanId::Standard(id) => (u32::from(id), false),
        CanId::Extended(id) => (id, true),
    });
    json!({
        "name": one.frame.name,
        "carries": one.carries.word(),
        "medium": one.medium.map(|medium| &port.media[medium].name),
        "id": id.map(|(id, _)| id),
        "extended": id.map(|(_, is_extended)| is_extended),
        "length": length,
        "divider": divider,
        "period_s": period_s,
        "stale_s": one.stale_s,
        "fields": fields,
    })
}

fn of_kind(kind: &str, facts: &[(&str, Value)]) -> Map<String, Value> {
    let kind = ("kind".to_owned(), json!(kind));
    let facts = facts
        .iter()
        .map(|(key, value)| ((*key).to_owned(), value.clone()));
    std::iter::once(kind).chain(facts).collect()
}

fn signal_json(signal: &Signal, number: &Number) -> Map<String, Value> {
    let (low, high) = number.range();
    let scale = number.scale();
    of_kind(
        "signal",
        &[
            ("signal", json!(signal.to_string())),
            ("unit", json!(signal.unit)),
            ("scale", json!(scale.wire.factor)),
            ("offset", json!(scale.wire.offset)),
            ("min", json!(low)),
            ("max", json!(high)),
            ("resolution", json!(number.resolution())),
            ("invalid", json!(scale.invalid)),
        ],
    )
}

fn counter_json(counter: &Counter) -> Map<String, Value> {
    let Counter { width, max_jump } = counter;
    of_kind(
        "counter",
        &[
            ("counter_bits", json!(width)),
            ("max_jump", json!(max_jump)),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_shown_by_bytes_and_bits() {
        let place_of =
            |start, width, order| place(&BitField::new(start, width, order).expect("fits"));
        assert_eq!(place_of(0, 16, ByteOrder::Little), "0 to 1");
        assert_eq!(place_of(4, 12, ByteOrder::Little), "0[7:4], 1");
        assert_eq!(place_of(8, 1, ByteOrder::Big), "1[0]");
        assert_eq!(bits(0b1110_0101), "7:5, 2, 0");
        let unused = [(0, 0xFF), (1, 0), (2, 0x0F)];
        assert_eq!(runs(unused.into_iter()), "0, 2[3:0]");
    }
}

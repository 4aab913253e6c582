//! Reader of the frames of a port, and the checks of a frame as a whole and of frames among each other.

use std::collections::HashMap;

use hil_codec::bits::ByteOrder;
use hil_codec::frame::{Body, CanId, Content, Frame, JsonContent, Mistake};
use shared_types::layout::SignalKind;

use super::dbc::DbcFiles;
use super::fields::{self, FrameContext, order, without_effect};
use super::{Carries, Medium, Period, PortFrame, PortTables, is_too_long, safety};
use crate::keys::{MOST_FIELDS, MOST_FRAMES};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::title::{TITLE, is_title};

/// Lengths of CAN FD above 8 bytes (ISO 11898-1).
const FD_LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];

/// Reads all frames; `None` if one of them is faulty.
pub(super) fn read(
    reader: &mut Reader,
    root: &Section<'_>,
    media: &Option<Vec<Medium>>,
    mut files: DbcFiles<'_>,
    tables: Option<&PortTables<'_>>,
) -> Option<Vec<PortFrame>> {
    if is_too_long(reader, root, "frames", MOST_FRAMES) {
        return None;
    }
    let sections = reader.list(root, "frames");
    if sections.is_empty() {
        if root.table.get("frames").is_some() && reader.problems.is_empty() {
            let message = "the port has no frame";
            reader.report_at(root, "frames", ProblemKind::OutOfRange, message);
        }
        return None;
    }
    let mut frames = Vec::new();
    let mut is_whole = true;
    for section in &sections {
        match frame(reader, section, media.as_deref(), &mut files, tables) {
            Some(frame) => frames.push((section, frame)),
            None => is_whole = false,
        }
    }
    conflicts(reader, &frames);
    let frames = frames.into_iter().map(|(_, frame)| frame).collect();
    is_whole.then_some(frames)
}

fn frame(
    reader: &mut Reader,
    section: &Section<'_>,
    media: Option<&[Medium]>,
    files: &mut DbcFiles<'_>,
    tables: Option<&PortTables<'_>>,
) -> Option<PortFrame> {
    reader.refuse_unknown(section, &[]);
    let name = name(reader, section);
    let carries = reader.text(section, "carries").map(|word| match word {
        "sample" => Carries::Sample,
        _ => Carries::Command,
    });
    let medium = medium(reader, section, media);
    let is_json = reader
        .text(section, "format")
        .map(|format| format == "json");
    let order = reader.text(section, "order").map(order);
    let period = period(reader, section);
    let stale_s = reader.optional_number(section, "stale_s");
    let message = files.message(reader, section);
    if is_too_long(reader, section, "fields", MOST_FIELDS) {
        return None;
    }
    let (carries, is_json) = (carries?, is_json?);
    // With a wrong order all fields are read nevertheless, so that their mistakes are reported, too.
    let context = FrameContext {
        carries,
        tables,
        order: order.unwrap_or(ByteOrder::Little),
        message: message.as_ref().ok().and_then(Option::as_ref),
    };
    let (body, fields) = match is_json {
        true => {
            for key in ["order", "length", "id", "dbc", "message"] {
                without_effect(reader, section, key, "in a line of JSON");
            }
            fields::json::read(reader, section, &context)
        }
        false if message.is_err() => return None,
        false => fields::bytes(reader, section, &context),
    };
    let (name, _, medium) = (name?, order?, medium?);
    let kind = medium.zip(media).map(|(medium, media)| &media[medium].kind);
    let id = identifier(reader, section, &context)?;
    match (kind, id) {
        (Some(kind), None) if kind.is_can() => {
            let path = section.path_of("id");
            let expected = "an identifier: every frame on CAN has one".into();
            reader.missing(section, &path, expected);
        }
        (Some(kind), Some(_)) if !kind.is_can() => {
            let message = format!("frame `{name}` has an identifier, and its medium is not CAN");
            reader
                .report_at(section, "id", ProblemKind::Mismatch, message)
                .help("distinguish frames on other media by constants");
        }
        _ => {}
    }
    let length = match &body {
        Some(Body::Bytes { length, .. }) => Some(*length),
        _ => None,
    };
    let is_can = kind.is_none_or(super::MediumKind::is_can);
    if let (Some(length), Some(_), true) = (length, id, is_can) {
        // Without a medium a frame may be of CAN FD.
        let is_fd = kind.is_none_or(super::MediumKind::is_fd);
        if length > 8 && !(is_fd && FD_LENGTHS.contains(&length)) {
            let message = format!("frame `{name}` has {length} bytes");
            let expected = match is_fd {
                true => "0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes on CAN FD",
                false => "at most 8 bytes on CAN; a medium with `fd = true` takes up to 64",
            };
            reader
                .report_at(section, "length", ProblemKind::OutOfRange, message)
                .expected(expected);
        }
    }
    let frame = Frame {
        name,
        id,
        body: body?,
    };
    for mistake in frame.mistakes() {
        report(reader, section, &fields, &frame, &mistake);
    }
    let safe = safety::of_frame(reader, &fields, &frame, carries);
    Some(PortFrame {
        frame,
        carries,
        medium,
        period: period?,
        stale_s: stale_s?,
        safe: safe?,
    })
}

fn name(reader: &mut Reader, section: &Section<'_>) -> Option<String> {
    let name = reader.text(section, "name")?;
    if is_title(name) {
        return Some(name.into());
    }
    let message = format!("the frame's name is `{name}`");
    reader
        .report_at(section, "name", ProblemKind::OutOfRange, message)
        .expected(TITLE);
    None
}

/// Returns the index of the medium; the inner `None` without any media.
fn medium(
    reader: &mut Reader,
    section: &Section<'_>,
    media: Option<&[Medium]>,
) -> Option<Option<usize>> {
    let media = media?;
    let names = media.iter().map(|medium| medium.name.as_str());
    if section.table.get("medium").is_some() {
        let name = reader.text(section, "medium")?;
        let place = names.clone().position(|known| known == name);
        if place.is_none() {
            let message = format!("no medium has the name `{name}`");
            reader
                .report_at(section, "medium", ProblemKind::UnknownName, message)
                .one_of(name, names);
        }
        return place.map(Some);
    }
    if media.len() > 1 {
        let path = section.path_of("medium");
        let expected = format!("one of {}", crate::problem::listed(names));
        reader.missing(section, &path, expected);
        return None;
    }
    Some((media.len() == 1).then_some(0))
}

fn period(reader: &mut Reader, section: &Section<'_>) -> Option<Period> {
    let has_divider = section.table.get("divider").is_some();
    if section.table.get("period_s").is_none() {
        let steps = match has_divider {
            true => reader.integer(section, "divider")?,
            false => 1,
        };
        return Some(Period::Steps(steps.unsigned_abs()));
    }
    let period_s = reader.number(section, "period_s");
    if has_divider {
        let message = "a frame cannot have both a divider and a period";
        reader
            .report_at(section, "divider", ProblemKind::Mismatch, message)
            .help("omit one of them");
    }
    period_s.map(Period::Seconds)
}

/// Returns the identifier; the inner `None` without one.
fn identifier(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &FrameContext<'_>,
) -> Option<Option<CanId>> {
    if let Some(message) = context.message {
        for key in ["id", "extended", "length"] {
            without_effect(reader, section, key, "beside a DBC message, which gives it");
        }
        return Some(Some(message.id));
    }
    let is_extended = reader.boolean(section, "extended")?;
    if section.table.get("id").is_none() {
        without_effect(reader, section, "extended", "without an identifier");
        return Some(None);
    }
    let id = u32::try_from(reader.integer(section, "id")?).ok()?;
    if is_extended {
        return Some(Some(CanId::Extended(id)));
    }
    let standard = u16::try_from(id).ok().filter(|id| *id < 1 << 11);
    if standard.is_none() {
        let message = format!("`{}` is {id:#x}, out of range", section.path_of("id"));
        reader
            .report_at(section, "id", ProblemKind::OutOfRange, message)
            .expected("at most 0x7ff")
            .help("`extended = true` makes it an identifier of 29 bits");
    }
    standard.map(|id| Some(CanId::Standard(id)))
}

/// Reports a mistake of a frame at the field that it is about.
fn report(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Section<'_>],
    frame: &Frame,
    mistake: &Mistake,
) {
    let field_name = |field: usize| frame.field_name(field);
    let (length, bits) = match &frame.body {
        Body::Bytes { length, fields } => {
            (*length, fields.iter().map(|field| field.bits).collect())
        }
        Body::Json(_) => (0, Vec::new()),
    };
    let (field, key, message, expected, help) = match *mistake {
        Mistake::Length => {
            let message = "the frame has no field of at least one byte";
            reader.report_at(section, "fields", ProblemKind::OutOfRange, message);
            return;
        }
        Mistake::Outside { field } => {
            let last = bits[field].end_byte() - 1;
            let message = format!(
                "field `{}` ends in byte {last}, and the frame has {length} bytes",
                field_name(field)
            );
            (
                field,
                "byte",
                message,
                format!("bytes 0 to {}", length - 1),
                "",
            )
        }
        Mistake::Overlap { field, with } => {
            let other = bits[with];
            let shared = bits[field].shared_bytes(&other);
            let message = format!(
                "field `{}` shares bits with field `{}` in {}",
                field_name(field),
                field_name(with),
                shared.unwrap_or_default()
            );
            let next = other.next_start();
            let expected = format!(
                "bits outside of bytes {} to {}; behind it the next is byte {}, bit {}",
                other.first_byte(),
                other.end_byte() - 1,
                next / 8,
                next % 8
            );
            let help = "without `byte` and `bit`, a field is behind the one before";
            (field, "byte", message, expected, help)
        }
        Mistake::Twice { field, with } => {
            let message = format!(
                "field `{}` has the same content as field `{}`",
                field_name(field),
                field_name(with)
            );
            (
                field,
                "signal",
                message,
                "each content at most once in a frame".into(),
                "",
            )
        }
        Mistake::NoValue { field } => {
            let message = format!(
                "field `{}` is about a signal that the frame does not carry",
                field_name(field)
            );
            (
                field,
                "signal",
                message,
                "a signal of the same frame".into(),
                "",
            )
        }
        Mistake::Width { field } => {
            let width = bits.get(field).map_or(64, hil_codec::bits::BitField::width);
            let message = format!(
                "the content of field `{}` does not fit its width",
                field_name(field)
            );
            let key = ["value", "counter_bits", "text"]
                .into_iter()
                .find(|key| fields[field].table.get(key).is_some());
            let expected = match frame.body {
                Body::Bytes { .. } => format!("a number of at most {width} bits"),
                Body::Json(_) => "text without quotes, backslashes and control characters".into(),
            };
            (field, key.unwrap_or("type"), message, expected, "")
        }
        Mistake::Checksum { field } => {
            let message = format!("checksum `{}` does not fit its field", field_name(field));
            let expected = "whole bytes as wide as the algorithm's sum, over bytes of the frame that hold no later checksum";
            (field, "algorithm", message, expected.into(), "")
        }
        Mistake::Path { field } => {
            let message = format!(
                "the path `{}` contradicts another path of the frame",
                field_name(field)
            );
            let expected = "a path of its own, and lists without gaps";
            (field, "path", message, expected.into(), "")
        }
    };
    reader
        .report_at(&fields[field], key, ProblemKind::Mismatch, message)
        .expected(expected)
        .help(help);
}

/// Reports frames that share a name, an identifier or a signal, or that cannot be told apart.
fn conflicts(reader: &mut Reader, frames: &[(&Section<'_>, PortFrame)]) {
    let mut homes: HashMap<(Carries, SignalKind, &str), &str> = HashMap::new();
    for (index, (section, one)) in frames.iter().enumerate() {
        let name = &one.frame.name;
        for (signal, _) in one.frame.signals() {
            let key = (one.carries, signal.kind, signal.name.as_str());
            let other = homes.entry(key).or_insert(name);
            if *other != name {
                let message = format!("`{signal}` is in frame `{other}` and in frame `{name}`");
                reader
                    .report_at(section, "fields", ProblemKind::Duplicate, message)
                    .expected("each signal once in a direction");
            }
        }
        for (_, other) in &frames[..index] {
            let other_name = &other.frame.name;
            if name == other_name {
                let message = format!("two frames have the name `{name}`");
                reader.report_at(section, "name", ProblemKind::Duplicate, message);
            }
            if one.medium != other.medium {
                continue;
            }
            match (one.frame.id, other.frame.id) {
                (Some(id), Some(other_id)) if id == other_id => {
                    let key = if section.table.get("id").is_some() {
                        "id"
                    } else {
                        "message"
                    };
                    let message =
                        format!("frames `{other_name}` and `{name}` have the same id {id}");
                    reader
                        .report_at(section, key, ProblemKind::Duplicate, message)
                        .expected("an id of its own for each frame on a medium");
                }
                (None, None)
                    if one.carries == other.carries && are_alike(&one.frame, &other.frame) =>
                {
                    let message =
                        format!("frames `{other_name}` and `{name}` cannot be told apart");
                    reader
                        .report_at(section, "fields", ProblemKind::Mismatch, message)
                        .expected(
                            "another length, or a constant at the same place with another value",
                        );
                }
                _ => {}
            }
        }
    }
}

/// Returns `true` if the bytes of one frame may be those of the other.
fn are_alike(one: &Frame, other: &Frame) -> bool {
    match (&one.body, &other.body) {
        (Body::Bytes { length, fields }, Body::Bytes { length: other_length, fields: others }) => {
            length == other_length
                && !fields.iter().any(|field| {
                    let differs = |twin: &hil_codec::frame::Field| {
                        let contents = (&field.content, &twin.content);
                        matches!(contents, (Content::Constant(one), Content::Constant(other)) if one != other)
                            && field.bits == twin.bits
                    };
                    others.iter().any(differs)
                })
        }
        (Body::Json(fields), Body::Json(others)) => !fields.iter().any(|field| {
            let is_constant = |content: &JsonContent| {
                matches!(content, JsonContent::Text(_) | JsonContent::Number(_))
            };
            let twin = others.iter().find(|twin| twin.path == field.path);
            twin.is_some_and(|twin| {
                is_constant(&field.content) && is_constant(&twin.content) && twin.content != field.content
            })
        }),
        // A line of JSON begins with no constant that bytes could have by chance.
        (Body::Bytes { fields, .. }, Body::Json(_)) | (Body::Json(_), Body::Bytes { fields, .. }) => {
            !fields.iter().any(|field| matches!(field.content, Content::Constant(_)))
        }
    }
}

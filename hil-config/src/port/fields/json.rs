//! Reader of the fields of a line of JSON.

use hil_codec::frame::{Body, JsonContent, JsonField, Path};
use hil_codec::number::Encoding;

use super::signal::{named, number};
use super::{FrameContext, counter, without_effect};
use crate::keys::FIELDS;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Reads the fields of a line of JSON, and returns the sections of those that are sound.
pub(in crate::port) fn read<'a>(
    reader: &mut Reader,
    frame: &Section<'a>,
    context: &FrameContext<'_>,
) -> (Option<Body>, Vec<Section<'a>>) {
    let all = reader.list(frame, "fields");
    let (mut fields, mut sections): (Vec<JsonField>, Vec<Section<'a>>) = (Vec::new(), Vec::new());
    for section in &all {
        if let Some(field) = field(reader, section, context) {
            fields.push(field);
            sections.push(section.clone());
        }
    }
    let is_whole = fields.len() == all.len();
    (is_whole.then_some(Body::Json(fields)), sections)
}

fn field(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &FrameContext<'_>,
) -> Option<JsonField> {
    let kinds = FIELDS.iter().map(|kind| (kind.name, kind.keys));
    let (kind, own) = reader.of_kind(section, "field", kinds)?;
    for key in [
        "name",
        "type",
        "order",
        "byte",
        "bit",
        "dbc_signal",
        "invalid",
    ] {
        without_effect(reader, section, key, "in a line of JSON");
    }
    const PATH: &str = "keys with dots between them and indices in brackets, as imu.gyro[0]";
    let Some(text) = reader.text(section, "path") else {
        if section.table.get("path").is_none() {
            let path = section.path_of("path");
            reader.missing(section, &path, PATH.into());
        }
        return None;
    };
    let Some(path) = Path::parse(text) else {
        reader.refuse(section, "path", text, PATH);
        return None;
    };
    let content = match kind {
        "signal" => {
            let named = named(reader, &own, context)?;
            let number = number(reader, &own, &named, Encoding::Float, 64, None)?;
            JsonContent::Signal(named.signal, number)
        }
        "constant" => {
            let has_text = section.table.get("text").is_some();
            if has_text == section.table.get("value").is_some() {
                let path = section.path_of("value");
                let message = format!("`{path}` needs a number or a text");
                reader
                    .report(ProblemKind::Mismatch, path, section.place, message)
                    .expected("`value` or `text`");
                return None;
            }
            match has_text {
                true => JsonContent::Text(reader.text(&own, "text")?.into()),
                false => JsonContent::Number(reader.integer(&own, "value")? as f64),
            }
        }
        "counter" => JsonContent::Counter(counter(reader, &own, 32)?),
        kind => {
            let message = format!("a line of JSON has no field of the kind `{kind}`");
            reader
                .report_at(section, "kind", ProblemKind::Mismatch, message)
                .expected("one of `signal`, `constant`, `counter`; `null` is no value");
            return None;
        }
    };
    Some(JsonField { path, content })
}

//! Reader of the signal of a field: its name, unit, scale and range.

use hil_codec::dbc::DbcSignal;
use hil_codec::frame::Signal;
use hil_codec::number::{Encoding, Number, Scale, Unfit};
use shared_types::number::exact;
use shared_types::table::Field;
use shared_types::units::{Conversion, Unit};

use super::FrameContext;
use crate::port::unit_of;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Signal and whether its values are differences.
pub(super) struct Named {
    pub signal: Signal,
    is_difference: bool,
}

/// Reads the name of a signal and, if there are tables, finds it in them.
pub(super) fn named(
    reader: &mut Reader,
    own: &Section<'_>,
    context: &FrameContext<'_>,
) -> Option<Named> {
    let text = reader.text(own, "signal")?;
    let kinds = context.carries.kinds();
    let (prefix, name) = text.split_once('.').unwrap_or(("", text));
    let Some(kind) = kinds.iter().copied().find(|kind| kind.prefix() == prefix) else {
        let names = kinds.iter().map(|kind| format!("{}.NAME", kind.prefix()));
        let message = format!(
            "a frame that carries a {} has no signal `{text}`",
            context.carries.word()
        );
        reader
            .report_at(own, "signal", ProblemKind::UnknownName, message)
            .expected(names.collect::<Vec<_>>().join(" or "));
        return None;
    };
    // A validity bit has no unit.
    let has_unit = own.keys.iter().any(|key| key.name == "signal_unit");
    let table_unit = match own.table.get("signal_unit").filter(|_| has_unit) {
        Some(_) => Some(reader.text(own, "signal_unit")?),
        None => None,
    };
    let Some(tables) = context.tables else {
        if !name.split('.').all(shared_types::layout::is_name) {
            reader.refuse(
                own,
                "signal",
                text,
                "letters, digits and _, as measured.angle_rad",
            );
            return None;
        }
        let unit = table_unit.unwrap_or_else(|| unit_of(name)).to_owned();
        let name = name.into();
        return Some(Named {
            signal: Signal { kind, name, unit },
            is_difference: false,
        });
    };
    let Some(field) = tables.of(kind).iter().find(|field| field.is_called(name)) else {
        let all = kinds.iter().flat_map(|kind| {
            let names = tables.of(*kind).iter().flat_map(Field::names);
            names.map(|name| format!("{}.{name}", kind.prefix()))
        });
        let all: Vec<String> = all.collect();
        let message = format!("there is no signal `{text}`");
        reader
            .report_at(own, "signal", ProblemKind::UnknownName, message)
            .one_of(text, all.iter().map(String::as_str));
        return None;
    };
    if let Some(unit) = table_unit.filter(|unit| *unit != field.unit) {
        let message = format!("`{text}` has the unit `{}`, not `{unit}`", field.unit);
        reader
            .report_at(own, "signal_unit", ProblemKind::Mismatch, message)
            .help("`unit` is the unit on the wire; omit `signal_unit`");
        return None;
    }
    Some(Named {
        signal: Signal {
            kind,
            name: field.name.clone(),
            unit: field.unit.clone(),
        },
        is_difference: field.is_difference,
    })
}

/// Reads scale, range and unit of a number.
pub(super) fn number(
    reader: &mut Reader,
    own: &Section<'_>,
    named: &Named,
    encoding: Encoding,
    width: u32,
    dbc_signal: Option<&DbcSignal>,
) -> Option<Number> {
    let (to_signal, to_wire, unit) = conversions(reader, own, named, dbc_signal)?;
    let wire = match dbc_signal {
        Some(signal) => signal.wire,
        None => {
            let (factor, offset) = (reader.number(own, "scale"), reader.number(own, "offset"));
            Conversion {
                factor: factor?,
                offset: offset?,
            }
        }
    };
    let range = match own.table.get("range") {
        Some(entry) => Some(reader.pair(&own.path_of("range"), &entry.node, &unit)?),
        None => dbc_signal.and_then(|signal| signal.range),
    };
    let invalid = match own.table.get("invalid") {
        Some(_) => Some(reader.integer(own, "invalid")?.unsigned_abs()),
        None => None,
    };
    let scale = Scale {
        wire,
        range,
        invalid,
        to_signal,
        to_wire,
    };
    let unfit = match Number::new(encoding, width, scale) {
        Ok(number) => return Some(number),
        Err(unfit) => unfit,
    };
    let name = &named.signal;
    let (key, expected) = match unfit {
        Unfit::Factor => ("scale", "a scale other than 0".to_owned()),
        Unfit::FloatWidth(_) => ("type", "f32 or f64".into()),
        Unfit::Range {
            possible: (low, high),
        } => {
            let (low, high) = (exact(low), exact(high));
            (
                "range",
                format!("a range inside of [{low}, {high}] in {unit}"),
            )
        }
        Unfit::Empty => ("range", "a range that contains a raw number".into()),
        Unfit::InvalidInside => (
            "invalid",
            "a number outside of `range`, or the least or greatest number of the type".into(),
        ),
        Unfit::InvalidForm => ("invalid", format!("a whole number of at most {width} bits")),
    };
    // A range of a DBC file stands in no line of the port file.
    let key = if own.table.get(key).is_some() {
        key
    } else {
        "dbc_signal"
    };
    let message = format!("the encoding of `{name}` is invalid: {unfit}");
    reader
        .report_at(own, key, ProblemKind::OutOfRange, message)
        .expected(expected);
    None
}

/// Returns the conversions between the units of signal and wire, and the unit of the wire.
fn conversions(
    reader: &mut Reader,
    own: &Section<'_>,
    named: &Named,
    dbc_signal: Option<&DbcSignal>,
) -> Option<(Conversion, Conversion, String)> {
    let signal_unit = named.signal.unit.as_str();
    let own_unit = match own.table.get("unit") {
        Some(_) => Some(reader.text(own, "unit")?),
        None => None,
    };
    let of_dbc = dbc_signal
        .map(|signal| signal.unit.as_str())
        .filter(|unit| !unit.is_empty());
    let unit = own_unit.or(of_dbc).unwrap_or(signal_unit);
    if unit == signal_unit {
        let same = Conversion::IDENTITY;
        return Some((same, same, unit.into()));
    }
    let key = if own_unit.is_some() {
        "unit"
    } else {
        "dbc_signal"
    };
    let mut parsed = |key: &str, unit: &str| match Unit::parse(unit) {
        Ok(unit) => Some(unit),
        Err(error) => {
            reader
                .report_at(own, key, ProblemKind::UnknownName, error.to_string())
                .help("`unit` gives the unit on the wire");
            None
        }
    };
    let (wire, signal) = (parsed(key, unit)?, parsed("signal_unit", signal_unit)?);
    let both = wire.conversion_to(&signal).zip(signal.conversion_to(&wire));
    let Some((mut to_signal, mut to_wire)) = both else {
        let message = format!(
            "`{}` is in {signal_unit}, but its field is in {unit}",
            named.signal
        );
        reader
            .report_at(own, key, ProblemKind::Mismatch, message)
            .expected(format!("a unit of the dimension {}", signal.base()));
        return None;
    };
    if named.is_difference {
        (to_signal.offset, to_wire.offset) = (0.0, 0.0);
    }
    Some((to_signal, to_wire, unit.into()))
}

//! `[[connect]]`: signals of the law bound to signals of the plant with other names and units.

use shared_types::connection::Connection;
use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::SignalKind;
use shared_types::table::Field;
use shared_types::units::{Conversion, Unit};

use super::inputs::Inputs;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Advice for a scenario whose units do not determine the conversion.
const GIVE_FACTOR: &str =
    "give `factor` and, if needed, `offset`: received = factor * sent + offset";

/// Kinds of signals that cross the link.
const KINDS: [SignalKind; 3] = [
    SignalKind::Measured,
    SignalKind::Reference,
    SignalKind::Command,
];

/// Both ends of connections.
pub(super) struct Ends<'a> {
    pub(super) law: &'a LawDescription,
    /// All available laws: the scenario may also contain connections of other laws, so that one flag can switch the
    /// law.
    pub(super) laws: &'a [LawDescription],
    pub(super) plant: &'a PlantDescription,
    /// The plant with all its commands, and those that the scenario drives.
    pub(super) driven: (&'a PlantDescription, &'a Inputs<'a>),
    /// Reference signals; `None` if a stimulus is faulty.
    pub(super) reference: Option<&'a [Field]>,
}

impl Ends<'_> {
    /// Returns the signals of a kind of the plant or its rig, if known.
    fn of_plant(&self, kind: SignalKind) -> Option<&[Field]> {
        match kind {
            SignalKind::Measured => Some(&self.plant.measured),
            SignalKind::Reference => self.reference,
            _ => Some(&self.plant.commands),
        }
    }
}

/// Returns the signals of a kind that a law names itself.
fn of_law(law: &LawDescription, kind: SignalKind) -> &[Field] {
    match kind {
        SignalKind::Measured => &law.measured,
        SignalKind::Reference => &law.reference,
        _ => law.commands.as_deref().unwrap_or_default(),
    }
}

/// Returns the connections of the law; `None` if one of them is faulty.
pub(super) fn check(
    reader: &mut Reader,
    sections: &[Section<'_>],
    ends: &Ends<'_>,
) -> Option<Vec<Connection>> {
    let problems = reader.problems.len();
    let mut connections: Vec<Connection> = Vec::new();
    for section in sections {
        reader.refuse_unknown(section, &[]);
        let Some(connection) = connection(reader, section, ends) else {
            continue;
        };
        let is_command = connection.kind == SignalKind::Command;
        let of_kind = || connections.iter().filter(|one| one.kind == connection.kind);
        let kind = connection.kind.prefix();
        let twice = if of_kind().any(|one| one.law == connection.law) {
            Some(("law", &connection.law))
        } else if is_command && of_kind().any(|one| one.plant == connection.plant) {
            Some(("plant", &connection.plant))
        } else {
            None
        };
        if let Some((whose, name)) = twice {
            let message = format!("`{kind}.{name}` of the {whose} is connected twice");
            reader.report_at(section, whose, ProblemKind::Duplicate, message);
            continue;
        }
        connections.push(connection);
    }
    if let (Err(error), Some(section)) = (ends.law.connected(&connections), sections.first()) {
        let message = error.to_string();
        reader
            .report_at(section, "plant", ProblemKind::Duplicate, message)
            .help("connect the law's own command of that name to another command as well");
    }
    (reader.problems.len() == problems).then_some(connections)
}

/// Returns a connection; `None` if the connection is faulty or belongs to another law.
fn connection(reader: &mut Reader, section: &Section<'_>, ends: &Ends<'_>) -> Option<Connection> {
    let law = signal(reader, section, "law");
    let plant = signal(reader, section, "plant");
    let (factor, offset) = (
        reader.optional_number(section, "factor"),
        reader.optional_number(section, "offset"),
    );
    let ((kind, law), (other, plant)) = (law?, plant?);
    if kind != other {
        let (kind, other) = (kind.prefix(), other.prefix());
        let message = format!("a {kind} signal of the law cannot be a {other} signal of the plant");
        reader
            .report_at(section, "plant", ProblemKind::Mismatch, message)
            .expected(format!("{kind}.NAME"));
        return None;
    }
    let of_others = || ends.laws.iter().flat_map(|other| of_law(other, kind));
    let Some(law_field) = of_law(ends.law, kind)
        .iter()
        .find(|field| field.is_called(law))
    else {
        if !of_others().any(|field| field.is_called(law)) {
            unknown(
                reader,
                section,
                ("law", &ends.law.name),
                (kind, law),
                of_law(ends.law, kind),
            );
        }
        return None;
    };
    let (whole, inputs) = ends.driven;
    if kind == SignalKind::Command
        && let Some(key) = inputs.key_of(whole, plant)
    {
        let path = section.path_of("plant");
        let message = format!("`{path}` binds the input `{plant}`, which `{key}` drives");
        reader
            .report_at(section, "plant", ProblemKind::Duplicate, message)
            .help("leave one of them out: an input has one source");
        return None;
    }
    let fields = ends.of_plant(kind)?;
    let Some(plant_field) = fields.iter().find(|field| field.is_called(plant)) else {
        unknown(
            reader,
            section,
            ("plant", &ends.plant.name),
            (kind, plant),
            fields,
        );
        return None;
    };
    let conversion = match (factor?, offset?) {
        (Some(factor), offset) => {
            if factor == 0.0 {
                reader
                    .report_at(
                        section,
                        "factor",
                        ProblemKind::OutOfRange,
                        "a factor of 0 removes the signal",
                    )
                    .expected("a factor other than 0");
                return None;
            }
            let offset = offset.unwrap_or(0.0);
            Some(Conversion { factor, offset })
        }
        (None, Some(_)) => {
            reader
                .report_at(
                    section,
                    "offset",
                    ProblemKind::MissingKey,
                    "an `offset` without a `factor`",
                )
                .expected("both, or neither if the units determine the conversion");
            return None;
        }
        (None, None) => None,
    };
    let is_given = conversion.is_some();
    let conversion = match conversion {
        Some(conversion) => conversion,
        None if kind == SignalKind::Command => by_units(reader, section, law_field, plant_field)?,
        None => by_units(reader, section, plant_field, law_field)?,
    };
    Some(Connection {
        kind,
        law: law_field.name.clone(),
        law_unit: law_field.unit.clone(),
        plant: plant_field.name.clone(),
        plant_unit: plant_field.unit.clone(),
        conversion,
        is_given,
    })
}

/// Returns the kind and name under a key.
fn signal<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    key: &'static str,
) -> Option<(SignalKind, &'a str)> {
    let text = reader.text(section, key)?;
    let parts = text.split_once('.').and_then(|(kind, name)| {
        let kind = KINDS.into_iter().find(|one| one.prefix() == kind)?;
        Some((kind, name))
    });
    if parts.is_none() {
        let expected = "measured.NAME, reference.NAME or command.NAME";
        reader.refuse(section, key, text, expected);
    }
    parts
}

fn unknown(
    reader: &mut Reader,
    section: &Section<'_>,
    (whose, of): (&'static str, &str),
    (kind, name): (SignalKind, &str),
    fields: &[Field],
) {
    let kind = kind.prefix();
    let owner = match (whose, kind) {
        ("plant", "reference") => "the scenario's [[stimuli]]".to_owned(),
        _ => format!("{whose} `{of}`"),
    };
    let message = format!("`{kind}.{name}` is not a signal of {owner}");
    let paths: Vec<String> = (fields.iter().map(|field| &field.name))
        .map(|name| format!("{kind}.{name}"))
        .collect();
    let paths = || paths.iter().map(String::as_str);
    reader
        .report_at(section, whose, ProblemKind::UnknownName, message)
        .one_of(&format!("{kind}.{name}"), paths());
}

/// Derives the conversion from both units.
fn by_units(
    reader: &mut Reader,
    section: &Section<'_>,
    sender: &Field,
    received: &Field,
) -> Option<Conversion> {
    if sender.unit == received.unit {
        return Some(Conversion::IDENTITY);
    }
    let (from, to) = (Unit::parse(&sender.unit), Unit::parse(&received.unit));
    let names = format!(
        "`{}` in {} and `{}` in {}",
        sender.name, sender.unit, received.name, received.unit
    );
    let message = match (&from, &to) {
        (Ok(from), Ok(to)) => match from.conversion_to(to) {
            Some(conversion) if conversion.offset == 0.0 => return Some(conversion),
            Some(conversion) => match (sender.is_difference, received.is_difference) {
                (false, false) => return Some(conversion),
                (true, true) => {
                    return Some(Conversion {
                        offset: 0.0,
                        ..conversion
                    });
                }
                _ => {
                    let (one, other) = match sender.is_difference {
                        true => (sender, received),
                        false => (received, sender),
                    };
                    format!(
                        "{names}: `{}` is declared as a difference (relativeQuantity) but `{}` is not, so it is unclear whether the offsets of the units apply",
                        one.name, other.name
                    )
                }
            },
            None => {
                let (from, to) = (from.base(), to.base());
                format!("{names} have different dimensions, {from} and {to}")
            }
        },
        (Err(unknown), _) | (_, Err(unknown)) => {
            format!("{names} cannot be converted: {unknown}")
        }
    };
    reader
        .report_at(section, "plant", ProblemKind::Mismatch, message)
        .help(GIVE_FACTOR);
    None
}

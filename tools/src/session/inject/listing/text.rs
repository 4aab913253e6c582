//! The listing as a person reads it.

use std::fmt::Write as _;

use shared_types::number::{exact, unit_shown};
use shared_types::table::Field;

use super::{Entry, Listing};

/// A line for each kind.
pub(super) fn in_short(listings: &[Listing]) -> String {
    let mut text = String::new();
    let entries = listings.iter().flat_map(|listing| &listing.faults);
    let width = entries.map(|entry| entry.kind.len()).max().unwrap_or(0);
    // What several plants share is told once, after all that is their own.
    let mut shared: Vec<&Entry> = Vec::new();
    for listing in listings {
        let of_session = listing
            .session
            .as_ref()
            .map_or(String::new(), |name| format!(" of session `{name}`"));
        let (own, others): (Vec<_>, Vec<_>) = listing
            .faults
            .iter()
            .partition(|entry| entry.class == "plant");
        if !own.is_empty() {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "plant {}{of_session}", listing.plant);
        }
        own.into_iter()
            .for_each(|entry| line(&mut text, entry, width));
        for entry in others {
            if shared.iter().all(|told| told.kind != entry.kind) {
                shared.push(entry);
            }
        }
    }
    for class in ["signal", "communication", "timing"] {
        let mut of_class = shared
            .iter()
            .filter(|entry| entry.class == class)
            .peekable();
        if of_class.peek().is_some() {
            let _ = writeln!(text, "{class}");
        }
        of_class.for_each(|entry| line(&mut text, entry, width));
    }
    text += "keys, ranges and targets of one: hil inject --list --kind KIND\n";
    text
}

fn line(text: &mut String, entry: &Entry, width: usize) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "  {:<width$}  {}", entry.kind, entry.summary);
}

/// Everything about each kind.
pub(super) fn in_full(listings: &[Listing]) -> String {
    let mut text = String::new();
    for listing in listings {
        for entry in &listing.faults {
            // Writing to a string cannot fail.
            let _ = write_entry(&mut text, entry, &listing.plant);
        }
    }
    text
}

fn write_entry(text: &mut String, entry: &Entry, plant: &str) -> std::fmt::Result {
    writeln!(text, "{} (plant {plant})", entry.kind)?;
    writeln!(text, "  {}", entry.summary)?;
    writeln!(text, "  {}", entry.equation)?;
    let width = entry
        .parameters
        .iter()
        .map(|field| field.name.len())
        .max()
        .unwrap_or(0);
    for field in &entry.parameters {
        let unit = match field.unit.as_str() {
            "target" => "the target's unit",
            unit => unit_shown(unit),
        };
        let unit = match unit {
            "" => String::new(),
            unit => format!("[{unit}] "),
        };
        let default = field.default.map_or(String::new(), |value| {
            format!(", {} if not given", exact(value))
        });
        let name = &field.name;
        writeln!(
            text,
            "  --{name:<width$}  {unit}{}{default}. {}",
            range(field),
            field.description
        )?;
    }
    if let Some(list) = &entry.list {
        let row = vec!["NUMBER"; list.columns].join(":");
        writeln!(
            text,
            "  --{} {row},{row},..  {}",
            list.key, list.description
        )?;
    }
    if let Some(selector) = &entry.selector {
        writeln!(text, "  --{selector} N: the target by its number")?;
    }
    writeln!(text, "  targets: {}", entry.targets.join(", "))
}

/// The range of a field as text.
fn range(field: &Field) -> String {
    match (field.min.is_finite(), field.max.is_finite()) {
        (true, true) => format!("{} to {}", exact(field.min), exact(field.max)),
        (true, false) => format!("at least {}", exact(field.min)),
        (false, true) => format!("at most {}", exact(field.max)),
        (false, false) => "any number".into(),
    }
}

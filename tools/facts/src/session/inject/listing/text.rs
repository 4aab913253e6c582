//! The listing as text.

use std::fmt::Write as _;

use hil_console::terminal::table::{Table, left};
use shared_types::number::{exact, unit_shown};
use shared_types::table::Field;

use super::{Entry, Listing};

/// Formats a line for each kind.
pub(super) fn in_short(listings: &[Listing]) -> String {
    let mut table = Table::new(2, [left(0); 2]);
    let line = |table: &mut Table, entry: &Entry| table.row(&[&entry.kind, &entry.summary]);
    // Kinds shared by several plants are listed once, after each plant's own.
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
            table.line(format!("plant {}{of_session}", listing.plant));
        }
        own.into_iter().for_each(|entry| line(&mut table, entry));
        for entry in others {
            if shared.iter().all(|listed| listed.kind != entry.kind) {
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
            table.line(class);
        }
        of_class.for_each(|entry| line(&mut table, entry));
    }
    table.line("keys, ranges and targets of one: hil inject --list --kind KIND");
    table.to_string()
}

/// Formats the full description of each kind.
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
    let mut table = Table::new(2, [left(0); 2]);
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
        let (name, range) = (format!("--{}", field.name), range(field));
        let description = format!("{unit}{range}{default}. {}", field.description);
        table.row(&[&name, &description]);
    }
    write!(text, "{table}")?;
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

/// Formats the range of a field.
fn range(field: &Field) -> String {
    match (field.min.is_finite(), field.max.is_finite()) {
        (true, true) => format!("{} to {}", exact(field.min), exact(field.max)),
        (true, false) => format!("at least {}", exact(field.min)),
        (false, true) => format!("at most {}", exact(field.max)),
        (false, false) => "any number".into(),
    }
}

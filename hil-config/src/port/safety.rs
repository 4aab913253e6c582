//! Safe values of a port, which stands in front of a plant: the last commands that the plant is to receive, however a
//! run ends, and the watchdog that acts if this machine cannot send them.

use hil_codec::frame::{Body, Content, Frame, JsonContent, Signal};
use hil_codec::number::Number;
use shared_types::number::exact;

use super::{Carries, Port};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Sending of the safe frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Safety {
    /// Number of times that each safe frame is sent.
    pub repeats: u32,
    /// Time from one to the next, in s.
    pub period_s: f64,
    /// Watchdog device.
    pub watchdog: Option<String>,
}

/// Safe value of a signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Safe {
    /// Signal.
    pub signal: Signal,
    /// Value in the signal's unit.
    pub value: f64,
}

/// Reads the settings at the root of a port file.
pub(super) fn read(reader: &mut Reader, root: &Section<'_>) -> Option<Safety> {
    let repeats = reader.integer(root, "safe_repeats");
    let period_s = reader.number(root, "safe_period_s");
    let watchdog = match root.table.get("watchdog") {
        Some(_) => reader.text(root, "watchdog").map(|path| Some(path.into())),
        None => Some(None),
    };
    Some(Safety {
        repeats: u32::try_from(repeats?).ok()?,
        period_s: period_s?,
        watchdog: watchdog?,
    })
}

/// Reads the safe values of a frame, whose sections are those of its fields.
pub(super) fn of_frame(
    reader: &mut Reader,
    fields: &[Section<'_>],
    frame: &Frame,
    carries: Carries,
) -> Option<Vec<Safe>> {
    let mut values = Vec::new();
    let mut is_whole = true;
    for (section, content) in fields.iter().zip(contents(&frame.body)) {
        let Some(entry) = section.table.get("safe") else {
            continue;
        };
        let path = section.path_of("safe");
        if carries == Carries::Sample {
            let message = format!("`{path}` has no effect in a frame that carries a sample");
            reader
                .report_at(section, "safe", ProblemKind::Mismatch, message)
                .expected("safe values of commands only");
            is_whole = false;
            continue;
        }
        let Some((signal, number)) = content else {
            continue; // refused as an unknown key
        };
        let any = crate::quantity::Quantity::finite("");
        let value = reader.quantity(&path, &entry.node, &any);
        let value = value.map(|value| number.scale().to_signal.apply(value));
        let (low, high) = number.range();
        match value {
            Some(value) if (low..=high).contains(&value) => values.push(Safe {
                signal: signal.clone(),
                value,
            }),
            Some(value) => {
                let unit = &signal.unit;
                let message = format!("the safe value of `{signal}` is {} {unit}", exact(value));
                reader
                    .report_at(section, "safe", ProblemKind::OutOfRange, message)
                    .expected(format!("{} to {} {unit}", exact(low), exact(high)));
                is_whole = false;
            }
            None => is_whole = false,
        }
    }
    is_whole.then_some(values)
}

/// Returns the signal of each field; `None` for a field of another kind.
fn contents(body: &Body) -> Vec<Option<(&Signal, &Number)>> {
    match body {
        Body::Bytes { fields, .. } => (fields.iter())
            .map(|field| match &field.content {
                Content::Signal(signal, number) => Some((signal, number)),
                _ => None,
            })
            .collect(),
        Body::Json(fields) => (fields.iter())
            .map(|field| match &field.content {
                JsonContent::Signal(signal, number) => Some((signal, number)),
                _ => None,
            })
            .collect(),
    }
}

impl Port {
    /// Returns the safe value of each command, in the order of the [table](Port::table).
    ///
    /// # Errors
    /// The commands without one.
    pub fn safe_row(&self) -> Result<Vec<f64>, String> {
        let mut safe = self.frames.iter().flat_map(|frame| &frame.safe);
        let (mut row, mut missing) = (Vec::new(), Vec::new());
        for signal in &self.table(Carries::Command).0 {
            match safe
                .clone()
                .find(|safe| safe.signal.name == signal.field.name)
            {
                Some(safe) => row.push(safe.value),
                None => missing.push(format!("`command.{}`", signal.field.name)),
            }
        }
        let is_useless = safe.next().is_none() && missing.is_empty();
        match missing.is_empty() {
            true if is_useless => Err("the port carries no command".into()),
            true => Ok(row),
            false => Err(format!(
                "a port in front of a plant needs a safe value for each command, which the plant gets last however a run ends; write `safe = ..` into the field of {}",
                missing.join(", ")
            )),
        }
    }
}

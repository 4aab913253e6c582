//! `[[faults]]`: events, when they take effect and end, and their effects on targets.
//!
//! The same code checks the faults of a scenario and those requested during a run; the [`EventContext`] holds the
//! differences. Events are read in two passes: first names and triggers, which refer to each other, then ends and
//! effects, which must fit into the remaining time.

mod effect;
mod end;
mod kind;
mod list;
mod moves;
mod names;
mod profile;
mod span;
mod target;
mod trigger;

use std::path::Path;

use shared_types::describe::{FaultKindDescription, PlantDescription, Settings};
use shared_types::table::Field;

use super::inputs::Advice;
use super::run::Grid;
use crate::document::Value;
use crate::expression::Columns;
use crate::plan::{FaultEvent, FaultSource, Trigger};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use names::Names;

pub(crate) use effect::unit_of;
use kind::FaultKind;
pub(crate) use target::{groups, targets};

/// Context against which faults are checked. A part that is `None` is itself faulty; anything that depends on it is not
/// checked.
#[derive(Debug)]
pub(crate) struct EventContext<'a> {
    /// Plant.
    pub plant: Option<&'a PlantDescription>,
    /// Fault kinds other than the plant's own.
    pub kinds: &'a [FaultKindDescription],
    /// The plant's healthy parameters.
    pub healthy: Option<&'a Settings>,
    /// Reference signals.
    pub reference: Option<&'a [Field]>,
    /// Inputs of the plant that stimuli drive.
    pub inputs: Option<&'a [Field]>,
    /// Inputs of the plant that the scenario drives, for advice.
    pub advice: Advice<'a>,
    /// Number of networks that carry the frames of the link.
    pub networks: u8,
    /// Columns that expressions may name: a record's signals and every derived signal.
    pub columns: Option<&'a Columns>,
    /// Steps of the run.
    pub grid: Option<Grid>,
    /// Origin of the events: a scenario or a command line.
    pub origin: Origin<'a>,
}

/// Origin of the events: a scenario or a command line.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Origin<'a> {
    /// A scenario in this folder.
    Scenario {
        /// Folder for files of points.
        folder: &'a Path,
    },
    /// A command line, during the run.
    Live {
        /// Names and numbers of the existing events.
        names: &'a [(String, u32)],
        /// Number of the first new event.
        first_id: u32,
    },
}

impl<'a> Origin<'a> {
    const fn first_id(self) -> u32 {
        match self {
            Self::Scenario { .. } => 1,
            Self::Live { first_id, .. } => first_id,
        }
    }

    const fn source(self) -> FaultSource {
        match self {
            Self::Scenario { .. } => FaultSource::Scenario,
            Self::Live { .. } => FaultSource::Cli,
        }
    }

    /// Returns the folder to which file paths are relative; `None` if files are refused.
    const fn folder(self) -> Option<&'a Path> {
        match self {
            Self::Scenario { folder } => Some(folder),
            Self::Live { .. } => None,
        }
    }
}

/// Returns the valid events and reports the others.
pub(crate) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    context: &EventContext<'_>,
) -> Vec<FaultEvent> {
    let sections = reader.list(root, "faults");
    let names = Names::collect(reader, &sections, context.origin);
    let triggers: Vec<_> = sections
        .iter()
        .map(|section| trigger::check(reader, section, context, &names))
        .collect();
    let earliest = trigger::earliest(reader, &sections, &triggers, context, &names);
    let first_id = context.origin.first_id();
    let mut events = Vec::new();
    for (index, section) in sections.iter().enumerate() {
        let effects = effects(reader, section);
        let event = Event {
            context,
            trigger: triggers[index].as_ref(),
            earliest: earliest[index],
        };
        let id = first_id + index as u32;
        if let Some(event) = event.check(reader, section, &effects, id) {
            events.push((event, effects));
        }
    }
    moves::stay_in_range_together(reader, context, &events);
    events.into_iter().map(|(event, _)| event).collect()
}

/// Returns the tables of an event's effects, at least one.
fn effects<'a>(reader: &mut Reader, section: &Section<'a>) -> Vec<Section<'a>> {
    let effects = reader.list(section, "effects");
    if let Some(entry) = section.table.get("effects")
        && matches!(&entry.node.value, Value::List(items) if items.is_empty())
    {
        let path = section.path_of("effects");
        let message = format!("`{path}` is empty, so the fault would have no effect");
        reader
            .report(ProblemKind::MissingKey, path, &entry.node.place, message)
            .expected("at least one effect");
    }
    effects
}

/// Facts of an event that are known when its remaining keys are checked.
struct Event<'a> {
    context: &'a EventContext<'a>,
    trigger: Option<&'a Trigger>,
    /// First step at which the event could take effect.
    earliest: Option<u64>,
}

impl Event<'_> {
    fn check(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        effects: &[Section<'_>],
        id: u32,
    ) -> Option<FaultEvent> {
        let kind = kind::find(reader, section, self.context);
        let of_effects = kind.map_or_else(|| vec!["target"], FaultKind::keys);
        reader.refuse_misplaced(section, &[], &of_effects, "a table [[faults.effects]]");
        let name = match section.table.get("name") {
            Some(_) => reader.text(section, "name").map(Some),
            None => Some(None),
        };
        let end = end::check(reader, section, self.context);
        let checked: Vec<_> = match kind {
            Some(kind) => (effects.iter())
                .map(|section| self.effect(reader, section, kind))
                .collect(),
            None => Vec::new(),
        };
        let effects: Option<Vec<_>> = checked.into_iter().collect();
        if let (Some(end), Some(effects)) = (&end, &effects) {
            end::leaves_time(reader, section, self, end, effects).ok()?;
        }
        Some(FaultEvent {
            id,
            name: name?.map(Into::into),
            kind: kind?.name().into(),
            source: self.context.origin.source(),
            trigger: self.trigger?.clone(),
            end: end?,
            effects: effects?,
        })
    }
}

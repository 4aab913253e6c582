//! Kind of an event: a fault of the plant, or a fault on signals, links or timing.

use shared_types::describe::{FaultDescription, FaultKindDescription, ProfileDescription};

use super::EventContext;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Fault kind.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FaultKind<'d> {
    /// Fault of the plant itself, which moves its parameters.
    Own(&'d FaultDescription),
    /// Shared kind, on signals, links or timing.
    Shared(&'d FaultKindDescription),
}

impl<'d> FaultKind<'d> {
    pub(crate) fn name(self) -> &'d str {
        match self {
            Self::Own(fault) => &fault.kind,
            Self::Shared(kind) => &kind.kind,
        }
    }

    /// Lists the keys of the kind's effects in addition to those of all effects.
    pub(crate) fn keys(self) -> Vec<&'d str> {
        match self {
            Self::Own(fault) => {
                let speed = match &fault.profile {
                    ProfileDescription::Step => None,
                    ProfileDescription::Exponential { speed } => Some(speed.name.as_str()),
                };
                (fault.selector.as_deref().into_iter())
                    .chain(fault.sizes.iter().map(|size| size.name.as_str()))
                    .chain(speed)
                    .collect()
            }
            Self::Shared(kind) => (["target"].into_iter())
                .chain(kind.parameters.iter().map(|field| field.name.as_str()))
                .chain(kind.list.iter().map(|list| list.key.as_str()))
                .collect(),
        }
    }
}

/// Finds the kind that an event names.
pub(super) fn find<'a>(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'a>,
) -> Option<FaultKind<'a>> {
    let name = reader.text(section, "kind")?;
    let own = context.plant.map_or(&[][..], |plant| &plant.faults);
    if let Some(fault) = own.iter().find(|fault| fault.kind == name) {
        return Some(FaultKind::Own(fault));
    }
    if let Some(kind) = context.kinds.iter().find(|kind| kind.kind == name) {
        return Some(FaultKind::Shared(kind));
    }
    let plant = context.plant?; // it may well be a fault of a plant that is not known
    let names = (own.iter().map(|fault| fault.kind.as_str()))
        .chain(context.kinds.iter().map(|kind| kind.kind.as_str()));
    let message = format!("plant `{}` has no fault `{name}`", plant.name);
    let problem = reader.report_at(section, "kind", ProblemKind::UnknownName, message);
    if names.clone().next().is_none() {
        problem.expected("no faults: this plant offers none");
    } else {
        problem.one_of(name, names);
    }
    None
}

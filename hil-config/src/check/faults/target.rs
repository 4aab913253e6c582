//! Target of an effect.

use shared_types::describe::{ActsOn, FaultDescription, FaultKindDescription, PlantDescription};
use shared_types::table::Field;

use super::EventContext;
use crate::document::Value;
use crate::expression::{Columns, Group};
use crate::plan::PLANT_TARGET;
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};

/// Target of a plant fault without a selector.
const PLANT: &str = "plant";

/// Lists the valid selector numbers of a fault, as text: the groups that have all the parameters that the fault moves.
pub(crate) fn groups<'d>(plant: &'d PlantDescription, fault: &FaultDescription) -> Vec<&'d str> {
    let Some(selector) = &fault.selector else {
        return Vec::new();
    };
    let mut numbers = Vec::new();
    for field in &plant.parameters {
        let group = field.name.split_once('.').map(|(group, _)| group);
        let Some(number) = group.and_then(|group| group.strip_prefix(selector.as_str())) else {
            continue;
        };
        let is_number = !number.is_empty() && number.bytes().all(|c| c.is_ascii_digit());
        if is_number
            && !numbers.contains(&number)
            && moved(plant, fault, &format!("{selector}{number}.")).is_ok()
        {
            numbers.push(number);
        }
    }
    numbers
}

/// Returns the parameters that a fault moves, with `prefix` before their names; on error the first name that is not a
/// faultable parameter.
fn moved<'d>(
    plant: &'d PlantDescription,
    fault: &FaultDescription,
    prefix: &str,
) -> Result<Vec<&'d Field>, String> {
    (fault.moves.iter())
        .map(|described| {
            let name = format!("{prefix}{}", described.parameter);
            let mut parameters = plant.parameters.iter();
            let parameter = parameters.find(|field| field.faultable && field.name == name);
            parameter.ok_or(name)
        })
        .collect()
}

/// Returns the target of a plant fault's effect, and the parameters that are moved.
pub(super) fn of_plant<'d>(
    reader: &mut Reader,
    section: &Section<'_>,
    plant: &'d PlantDescription,
    fault: &FaultDescription,
) -> Option<(String, Vec<&'d Field>)> {
    let Some(selector) = &fault.selector else {
        return match moved(plant, fault, "") {
            Ok(parameters) => Some((PLANT.into(), parameters)),
            Err(name) => {
                let message = format!(
                    "fault `{}` changes `{name}`, which is not faultable in plant `{}`",
                    fault.kind, plant.name
                );
                let path = section.path.clone();
                reader
                    .report(ProblemKind::Mismatch, path, section.place, message)
                    .expected("another kind of fault, because the plant's description is wrong");
                None
            }
        };
    };
    let path = section.path_of(selector);
    let numbers = groups(plant, fault);
    let expected = format!("one of {}", listed(numbers.iter().copied()));
    let Some(entry) = section.table.get(selector) else {
        reader.missing(section, &path, expected);
        return None;
    };
    let Value::Integer(number) = entry.node.value else {
        reader.wrong_type(&path, &entry.node, expected);
        return None;
    };
    let number = number.to_string();
    if !numbers.contains(&number.as_str()) {
        let message = format!("plant `{}` has no {selector} {number}", plant.name);
        reader
            .report(ProblemKind::UnknownName, path, &entry.node.place, message)
            .expected(expected);
        return None;
    }
    let target = format!("{selector}{number}");
    let parameters = moved(plant, fault, &format!("{target}.")).ok()?;
    Some((target, parameters))
}

/// Target of an effect.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// Name.
    pub name: String,
    /// Unit; `1` for a target that is not a number.
    pub unit: String,
}

/// Describes the targets of a fault kind, in a run with or without driven inputs of the plant.
const fn described(acts_on: ActsOn, has_inputs: bool) -> &'static str {
    match acts_on {
        ActsOn::Signals if has_inputs => "a signal: measured.x, reference.x, command.x or input.x",
        ActsOn::Numbers if has_inputs => {
            "a signal (measured.x, reference.x, command.x, input.x) or a faultable parameter (parameter.x)"
        }
        ActsOn::Signals => "a signal: measured.x, reference.x or command.x",
        ActsOn::Numbers => {
            "a signal (measured.x, reference.x, command.x) or a faultable parameter (parameter.x)"
        }
        ActsOn::Links => "a direction of the link: `link.sample` or `link.command`",
        ActsOn::Sides => "a side: `controller` or `plant`",
        ActsOn::Controller => "`controller`",
    }
}

/// Lists the groups of signals and parameters on which a kind acts.
const fn groups_of(acts_on: ActsOn) -> &'static [Group] {
    match acts_on {
        ActsOn::Signals => &[
            Group::Measured,
            Group::Reference,
            Group::Command,
            Group::Input,
        ],
        ActsOn::Numbers => &[
            Group::Measured,
            Group::Reference,
            Group::Command,
            Group::Input,
            Group::Parameter,
        ],
        ActsOn::Links | ActsOn::Sides | ActsOn::Controller => &[],
    }
}

/// Lists the targets without a unit on which a kind acts.
const fn names_of(acts_on: ActsOn) -> &'static [&'static str] {
    match acts_on {
        ActsOn::Signals | ActsOn::Numbers => &[],
        ActsOn::Links => &["link.sample", "link.command"],
        ActsOn::Sides => &["controller", PLANT],
        ActsOn::Controller => &["controller"],
    }
}

/// Both networks of each direction of the link.
const NETWORKS: [&str; 4] = [
    "link.sample.a",
    "link.sample.b",
    "link.command.a",
    "link.command.b",
];

/// All kinds of targets.
const ANY: [ActsOn; 3] = [ActsOn::Numbers, ActsOn::Links, ActsOn::Sides];

/// Returns the fields of a group that a target may name; `None` if the fields are unknown.
fn fields<'a>(context: &EventContext<'a>, group: Group) -> Option<Vec<&'a Field>> {
    let plant = context.plant?;
    Some(match group {
        Group::Measured => plant.measured.iter().collect(),
        Group::Command => plant.commands.iter().collect(),
        Group::Reference => context.reference?.iter().collect(),
        Group::Input => context.inputs?.iter().collect(),
        _ => faultable(plant).collect(),
    })
}

fn faultable(plant: &PlantDescription) -> impl Iterator<Item = &Field> {
    plant.parameters.iter().filter(|field| field.faultable)
}

/// Splits a name into its group and the rest.
fn parts(name: &str) -> Option<(Group, &str)> {
    let (prefix, rest) = name.split_once('.')?;
    let groups = groups_of(ActsOn::Numbers);
    let group = groups.iter().find(|group| group.prefix() == prefix)?;
    Some((*group, rest))
}

/// Returns the target named by an effect of a kind.
pub(super) fn of_kind(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'_>,
    kind: &FaultKindDescription,
    name: &str,
) -> Option<Target> {
    let acts_on = kind.acts_on;
    let is_network = acts_on == ActsOn::Links && NETWORKS.contains(&name);
    if is_network && context.networks < 2 {
        let message = format!("`{name}` is one of two networks, and this run has one");
        reader
            .report_at(section, "target", ProblemKind::Mismatch, message)
            .expected("`link.sample` or `link.command`")
            .help("`redundancy = 2` in `[bus]` makes two networks");
        return None;
    }
    if is_network || names_of(acts_on).contains(&name) {
        return Some(Target {
            name: name.into(),
            unit: "1".into(),
        });
    }
    let parsed = parts(name).filter(|(group, _)| groups_of(acts_on).contains(group));
    let Some((group, last)) = parsed else {
        refuse(reader, section, context, kind, name);
        return None;
    };
    let plant = context.plant?;
    let fields = fields(context, group)?;
    if let Some(field) = fields.iter().find(|field| field.is_called(last)) {
        return Some(Target {
            name: format!("{}.{}", group.prefix(), field.name),
            unit: field.unit.clone(),
        });
    }
    let is_fixed = group == Group::Parameter && plant.parameters.iter().any(|f| f.is_called(last));
    let (sort, message) = match group {
        Group::Parameter if is_fixed => (
            ProblemKind::Mismatch,
            format!(
                "parameter `{last}` of plant `{}` is not faultable",
                plant.name
            ),
        ),
        Group::Parameter => (
            ProblemKind::UnknownName,
            format!("plant `{}` has no parameter `{last}`", plant.name),
        ),
        Group::Reference => (
            ProblemKind::UnknownName,
            format!("no stimulus provides the reference signal `{last}`"),
        ),
        Group::Input => (
            ProblemKind::UnknownName,
            format!(
                "no stimulus drives the input `{last}` of plant `{}`",
                plant.name
            ),
        ),
        _ => (
            ProblemKind::UnknownName,
            format!("plant `{}` has no signal `{name}`", plant.name),
        ),
    };
    let names: Vec<String> = (fields.iter())
        .map(|field| format!("{}.{}", group.prefix(), field.name))
        .collect();
    let columns = Columns::named(names.clone());
    let problem = reader
        .report_at(section, "target", sort, message)
        .expected(format!(
            "one of {}",
            listed(names.iter().map(String::as_str))
        ));
    if !is_fixed {
        problem.nearest = columns.nearest(name);
    }
    let advice = context.advice.on(name);
    if let Some(help) = advice {
        problem.help(help);
    } else if group == Group::Input {
        problem.help(format!(
            "[[stimuli]] with target = \"{PLANT_TARGET}{last}\" drives an input; one without a course cannot be faulted"
        ));
    }
    None
}

/// Reports a target that is unknown or not valid for this kind.
fn refuse(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'_>,
    kind: &FaultKindDescription,
    name: &str,
) {
    let acts_on = kind.acts_on;
    let exists = parts(name).is_some()
        || NETWORKS.contains(&name)
        || ANY.iter().any(|all| names_of(*all).contains(&name));
    let (sort, message) = if exists {
        (
            ProblemKind::Mismatch,
            format!("a fault of kind `{}` cannot act on `{name}`", kind.kind),
        )
    } else {
        (ProblemKind::UnknownName, format!("unknown target `{name}`"))
    };
    let problem = reader
        .report_at(section, "target", sort, message)
        .expected(described(
            acts_on,
            context.inputs.is_some_and(|inputs| !inputs.is_empty()),
        ));
    if !exists {
        let possible = Columns::named(possible(context, acts_on));
        problem.nearest = possible.nearest(name);
    }
    if let Some(help) = context.advice.on(name) {
        problem.help(help);
    }
}

/// Lists all valid targets of a kind, as far as known.
fn possible(context: &EventContext<'_>, acts_on: ActsOn) -> Vec<String> {
    let mut names: Vec<String> = names_of(acts_on).iter().map(|&name| name.into()).collect();
    if acts_on == ActsOn::Links && context.networks == 2 {
        names.extend(NETWORKS.map(Into::into));
    }
    for group in groups_of(acts_on) {
        let fields = fields(context, *group).unwrap_or_default();
        let of_group = fields
            .iter()
            .map(|field| format!("{}.{}", group.prefix(), field.name));
        names.extend(of_group);
    }
    names
}

/// Lists every kind of fault with its valid targets, the plant's own first.
pub(crate) fn targets(context: &EventContext<'_>) -> Vec<(String, Vec<String>)> {
    let own = context.plant.into_iter().flat_map(|plant| {
        plant.faults.iter().map(move |fault| {
            let targets = match &fault.selector {
                Some(selector) => (groups(plant, fault).into_iter())
                    .map(|number| format!("{selector} = {number}"))
                    .collect(),
                None => vec![String::new()],
            };
            (fault.kind.clone(), targets)
        })
    });
    let shared =
        (context.kinds.iter()).map(|kind| (kind.kind.clone(), possible(context, kind.acts_on)));
    own.chain(shared)
        .filter(|(_, targets)| !targets.is_empty())
        .collect()
}

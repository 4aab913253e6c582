//! `hil inject --list`: the possible faults with their targets and values.
//!
//! Queries a running session, or a plant's binary if there is no session: a user's plant is listed as completely as the
//! built-in ones.

mod text;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_session::session;
use serde::Serialize;
use shared_types::describe::{
    ActsOn, Description, FaultDescription, FaultKindDescription, ListDescription, PlantDescription,
    ProfileDescription,
};
use shared_types::live::{Possible, Refusal};
use shared_types::table::{Field, listed};

use crate::arguments::inject::InjectArguments;
use crate::programs::binaries::Binary;
use crate::programs::binaries::named::Named;
use crate::session::live::{self, RequestError, closest, refusal};
use text::{in_full, in_short};

/// Targets on a link of two networks: both of a direction alike, or one of them.
const REDUNDANT: [&str; 6] = [
    "link.sample",
    "link.sample.a",
    "link.sample.b",
    "link.command",
    "link.command.a",
    "link.command.b",
];

/// Faults offered by one plant.
#[derive(Debug, Serialize)]
struct Listing {
    /// Name of the queried session; null for a binary.
    session: Option<String>,
    plant: String,
    /// Step rate; null without a session, because the scenario determines it.
    rate_hz: Option<f64>,
    faults: Vec<Entry>,
}

/// Kind of fault.
#[derive(Debug, Serialize)]
struct Entry {
    kind: String,
    /// `plant`, `signal`, `communication` or `timing`.
    class: &'static str,
    summary: String,
    equation: String,
    /// Key that selects the target by number, if there is such a key.
    selector: Option<String>,
    /// Name of each target.
    targets: Vec<String>,
    parameters: Vec<Field>,
    list: Option<ListDescription>,
    /// Default profile of its size.
    profile: &'static str,
}

/// Lists the possible faults.
///
/// # Errors
/// If nothing can be queried, or there is no such kind or target.
pub(super) fn list(arguments: &InjectArguments) -> Result<String, RequestError> {
    let mut listings = listings(arguments)?;
    let names = |pick: fn(&Entry) -> Vec<&String>| {
        let entries = listings.iter().flat_map(|listing| &listing.faults);
        let mut names: Vec<&str> = entries.flat_map(pick).map(String::as_str).collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    let unknown = |what: &str, name: &str, names_of_kinds: &[&str]| {
        let expected = match what {
            // There are many targets; the closest names are more helpful.
            "target" => "a target that `hil inject --list --kind KIND` shows".to_owned(),
            _ => format!("one of {}", listed(names_of_kinds)),
        };
        Refusal {
            nearest: closest(name, names_of_kinds.iter().copied()),
            ..refusal(what, format!("no {what} `{name}`"), expected)
        }
    };
    if let Some(kind) = &arguments.list_kind {
        let names_of_kinds = names(|entry| vec![&entry.kind]);
        if !names_of_kinds.contains(&kind.as_str()) {
            return Err(unknown("kind", kind, &names_of_kinds).into());
        }
    }
    if let Some(target) = &arguments.target {
        let names_of_kinds = names(|entry| entry.targets.iter().collect());
        if !names_of_kinds.contains(&target.as_str()) {
            return Err(unknown("target", target, &names_of_kinds).into());
        }
    }
    for listing in &mut listings {
        listing.faults.retain(|entry| {
            arguments
                .list_kind
                .as_ref()
                .is_none_or(|kind| entry.kind == *kind)
                && arguments
                    .target
                    .as_ref()
                    .is_none_or(|target| entry.targets.contains(target))
        });
    }
    listings.retain(|listing| !listing.faults.is_empty());
    if arguments.session.json {
        return Ok(live::to_json(&serde_json::json!({ "plants": listings }))?);
    }
    Ok(if arguments.list_kind.is_some() {
        in_full(&listings)
    } else {
        in_short(&listings)
    })
}

/// Returns the faults of a session as JSON.
pub(super) fn of(possible: &Possible) -> serde_json::Value {
    serde_json::json!(Listing::of(possible, None).faults)
}

/// Kind of fault, with its targets and keys.
#[derive(Clone, Debug)]
pub struct ListedKind {
    /// Name of the kind.
    pub kind: String,
    /// Effect of the kind in a sentence.
    pub summary: String,
    /// Valid targets.
    pub targets: Vec<String>,
    /// Keys with their descriptions.
    pub keys: Vec<(String, String)>,
}

/// Returns the fault kinds of a plant with these reference signals and driven inputs behind a link of so many networks,
/// its own and the common ones.
pub fn kinds_of(
    plant: &PlantDescription,
    driven: [&[Field]; 2],
    networks: u8,
    shared: &[FaultKindDescription],
) -> Vec<ListedKind> {
    let listing = Listing::new(plant, driven, networks, shared);
    (listing.faults.into_iter())
        .map(|entry| {
            let selector = (entry.selector.into_iter())
                .map(|selector| (selector, "the target by its number".to_owned()));
            let sizes = (entry.parameters.into_iter()).map(|field| (field.name, field.description));
            let list = (entry.list.into_iter()).map(|list| (list.key, list.description));
            ListedKind {
                kind: entry.kind,
                summary: entry.summary,
                targets: entry.targets,
                keys: selector.chain(sizes).chain(list).collect(),
            }
        })
        .collect()
}

fn listings(arguments: &InjectArguments) -> Result<Vec<Listing>, RequestError> {
    let wants_binary = arguments.plant_bin.is_some() || arguments.model.is_some();
    let running = session::list().map_err(Failure::infrastructure)?;
    if !wants_binary && (arguments.session.session.is_some() || running.len() == 1) {
        let session = live::find(&arguments.session)?;
        let possible = super::possible(&session)?;
        return Ok(vec![Listing::of(&possible, Some(session.name))]);
    }
    let program = arguments.plant_bin.as_deref();
    let binary = Binary::plant(program, &Named::Nothing, &Interruption::listen()?)?;
    Ok(of_binary(&binary.description, arguments.model.as_deref())?)
}

fn of_binary(description: &Description, model: Option<&str>) -> Result<Vec<Listing>, Refusal> {
    let is_meant = |plant: &&PlantDescription| model.is_none_or(|model| plant.name == model);
    let listings: Vec<Listing> = (description.plants.iter().filter(is_meant))
        .map(|plant| Listing::new(plant, [&[], &[]], 1, &description.faults))
        .collect();
    if let (true, Some(model)) = (listings.is_empty(), model) {
        let names: Vec<&str> = description
            .plants
            .iter()
            .map(|plant| plant.name.as_str())
            .collect();
        let message = format!("{} has no plant `{model}`", description.program);
        return Err(Refusal {
            nearest: closest(model, names.iter().copied()),
            ..refusal("model", message, format!("one of {}", listed(&names)))
        });
    }
    Ok(listings)
}

impl Listing {
    fn of(possible: &Possible, session: Option<String>) -> Self {
        Self {
            session,
            rate_hz: Some(possible.rate.hz()),
            ..Self::new(
                &possible.plant,
                [&possible.reference, &possible.inputs],
                possible.networks,
                &possible.kinds,
            )
        }
    }

    /// Lists the faults of a plant with these reference signals and driven inputs behind a link of so many networks.
    fn new(
        plant: &PlantDescription,
        driven: [&[Field]; 2],
        networks: u8,
        kinds: &[FaultKindDescription],
    ) -> Self {
        let own = plant
            .faults
            .iter()
            .map(|fault| Entry::of_plant(fault, plant));
        let shared = kinds.iter();
        let shared = shared.map(|kind| Entry::shared(kind, plant, driven, networks));
        Self {
            session: None,
            plant: plant.name.clone(),
            rate_hz: None,
            faults: own.chain(shared).collect(),
        }
    }
}

impl Entry {
    fn of_plant(fault: &FaultDescription, plant: &PlantDescription) -> Self {
        let mut parameters = fault.sizes.clone();
        let profile = match &fault.profile {
            ProfileDescription::Step => "step",
            ProfileDescription::Exponential { speed } => {
                parameters.push(speed.clone());
                "exponential"
            }
        };
        let targets = match &fault.selector {
            Some(selector) => groups(plant, fault, selector),
            None => vec!["plant".into()],
        };
        Self {
            kind: fault.kind.clone(),
            class: "plant",
            summary: fault.summary.clone(),
            equation: fault.equation.clone(),
            selector: fault.selector.clone(),
            targets,
            parameters,
            list: None,
            profile,
        }
    }

    fn shared(
        kind: &FaultKindDescription,
        plant: &PlantDescription,
        [reference, inputs]: [&[Field]; 2],
        networks: u8,
    ) -> Self {
        let of = |group: &str, fields: &[Field]| -> Vec<String> {
            fields
                .iter()
                .map(|field| format!("{group}.{}", field.name))
                .collect()
        };
        let signals = || {
            [
                of("measured", &plant.measured),
                of("reference", reference),
                of("command", &plant.commands),
                of("input", inputs),
            ]
            .concat()
        };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Self {
            kind: kind.kind.clone(),
            class: kind.acts_on.class(),
            summary: kind.summary.clone(),
            equation: kind.equation.clone(),
            selector: None,
            targets: match kind.acts_on {
                ActsOn::Signals => signals(),
                ActsOn::Numbers => {
                    let faultable: Vec<Field> = plant
                        .parameters
                        .iter()
                        .filter(|field| field.faultable)
                        .cloned()
                        .collect();
                    [signals(), of("parameter", &faultable)].concat()
                }
                ActsOn::Links if networks > 1 => names(&REDUNDANT),
                ActsOn::Links => names(&["link.sample", "link.command"]),
                ActsOn::Sides => names(&["controller", "plant"]),
                ActsOn::Controller => names(&["controller"]),
            },
            parameters: kind.parameters.clone(),
            list: kind.list.clone(),
            profile: "step",
        }
    }
}

/// Returns the numbered groups of parameters that contain every parameter changed by a fault.
fn groups(plant: &PlantDescription, fault: &FaultDescription, selector: &str) -> Vec<String> {
    let faultable = || plant.parameters.iter().filter(|field| field.faultable);
    let mut groups: Vec<&str> = Vec::new();
    for field in faultable() {
        let group = field.name.split_once('.').map(|(group, _)| group);
        let number = group.and_then(|group| group.strip_prefix(selector));
        let is_numbered = number.is_some_and(|number| number.parse::<u32>().is_ok());
        groups.extend(group.filter(|group| is_numbered && !groups.contains(group)));
    }
    let has_all = |group: &&str| {
        let mut moves = fault.moves.iter();
        moves.all(|moved| {
            let name = format!("{group}.{}", moved.parameter);
            faultable().any(|field| field.name == name)
        })
    };
    groups.into_iter().filter(has_all).map(Into::into).collect()
}

#[cfg(test)]
mod tests {
    use super::super::request::tests::possible;
    use super::*;

    #[test]
    fn each_kind_lists_the_targets_it_can_act_on() {
        let listing = Listing::of(&possible(), Some("demo".into()));
        let targets: Vec<(&str, String)> = (listing.faults.iter())
            .map(|entry| (entry.kind.as_str(), entry.targets.join(" ")))
            .collect();
        let signals =
            "measured.surface_angle_rad reference.surface_angle_rad command.valve1_current_a";
        let numbers = format!("{signals} parameter.actuator1.leak parameter.actuator2.leak");
        let expected = [
            ("leakage", "actuator1 actuator2"),
            ("supply-loss", "plant"),
            ("bias", &numbers),
            ("saturation", &numbers),
            ("dropout", signals),
            ("message-loss", "link.sample link.command"),
            ("late", "controller plant"),
            ("skip", "controller"),
        ];
        let expected: Vec<(&str, String)> = expected
            .map(|(kind, targets)| (kind, targets.to_owned()))
            .into();
        assert_eq!(targets, expected);
    }

    #[test]
    fn a_link_of_two_networks_offers_each_of_them() {
        let possible = Possible {
            networks: 2,
            ..possible()
        };
        let listing = Listing::of(&possible, None);
        let mut kinds = listing.faults.iter();
        let lost = kinds.find(|entry| entry.kind == "message-loss");
        let targets = lost.map(|entry| entry.targets.join(" "));
        let expected =
            "link.sample link.sample.a link.sample.b link.command link.command.a link.command.b";
        assert_eq!(targets.as_deref(), Some(expected));
    }

    #[test]
    fn the_full_listing_of_a_kind_shows_keys_units_and_ranges() {
        let mut listing = Listing::of(&possible(), None);
        listing.faults.truncate(1);
        let expected = "\
leakage (plant rig)
  A leak.
  q = C g
  --coefficient_m3ps_per_sqrt_pa  [m3/s/sqrt(Pa)] 0 to 0.0001. C at the end.
  --speed_per_s                   [1/s] at least 0, 3 if not given. mu.
  --actuator N: the target by its number
  targets: actuator1, actuator2
";
        assert_eq!(in_full(&[listing]), expected);
    }

    #[test]
    fn an_unknown_plant_of_a_binary_is_refused_with_the_known_ones() {
        let mut description = Description::new("some-plant", "1");
        description.plants = vec![possible().plant];
        let refused = of_binary(&description, Some("rug")).expect_err("no such plant");
        assert_eq!(refused.nearest, ["rig"]);
        assert_eq!(of_binary(&description, None).expect("one").len(), 1);
    }
}

//! Candidates for an argument.

use std::ffi::OsStr;
use std::path::Path;

use clap::builder::StyledStr;
use clap::{Arg, Command};
use clap_complete::engine::{CompletionCandidate, PathCompleter, ValueCompleter};
use hil_config::expression::Columns;
use hil_config::plan::{INPUT_KEYS, PLANT_KEYS, REFERENCE_KEYS, driven, law_keys};
use hil_config::show::show;
use hil_console::files::runs;
use hil_facts::session::inject::{ListedKind, kinds_of};
use hil_run::alone::built_in;
use hil_session::session;
use hil_views::plots::columns_of;
use shared_types::describe::{FaultKindDescription, PlantDescription};
use shared_types::number::unit_shown;
use shared_types::table::Field;
use toml_edit::{DocumentMut, Item, Value};

use super::line::{Line, Subject};

/// Maximum number of offered runs, newest first.
const MOST_RUNS: usize = 50;

/// Source of an argument's candidates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Sessions,
    Runs,
    Scenarios,
    /// Keys of a scenario, as `KEY=`.
    Keys,
    /// Reference signals, as keys of a change.
    References,
    Signals,
    Kinds,
    /// Targets of the fault kind on the line, or of any.
    Targets,
    /// Keys of the fault kind on the line, as `KEY=`.
    Sizes,
    Models,
}

impl Source {
    /// Returns the source for an argument of a command.
    pub(super) fn of(command: &str, argument: &Arg) -> Option<Self> {
        let id = argument.get_id().as_str();
        let names = argument.get_value_names().unwrap_or_default();
        let name = names.first().map_or("", |name| name.as_str());
        Some(match (command, id, name) {
            // A new session can have any name.
            ("run" | "rerun" | "replay", "session", _) => return None,
            (_, "session", _) => Self::Sessions,
            (_, _, "SCENARIO.toml") => Self::Scenarios,
            (_, _, "RUN" | "CHECKPOINT") | ("compare", "a" | "b", _) => Self::Runs,
            (_, "set", _) => Self::Keys,
            ("set", "clear", _) => Self::References,
            (_, "signal" | "signals" | "record", "SIGNAL" | "PATTERN") => Self::Signals,
            ("inject", "kind" | "list_kind", _) => Self::Kinds,
            ("inject", "words" | "target", _) => Self::Targets,
            ("inject", "parameter", _) => Self::Sizes,
            ("inject", "model", _) => Self::Models,
            _ => return None,
        })
    }
}

/// Lists the candidates for an argument that match the typed prefix.
pub(super) fn of(source: Source, line: &Line, typed: &OsStr) -> Vec<CompletionCandidate> {
    let candidates = match source {
        Source::Sessions => sessions(),
        Source::Runs => return runs(typed),
        Source::Scenarios => return scenarios(typed),
        Source::Keys => keys(line, typed),
        Source::References => references(line)
            .map(|(name, unit)| candidate(&name, &unit))
            .collect(),
        Source::Signals => signals(line),
        Source::Kinds => kinds(line)
            .iter()
            .map(|kind| candidate(&kind.kind, &kind.summary))
            .collect(),
        Source::Targets => targets(line),
        Source::Sizes => sizes(line)
            .map(|(name, about)| candidate(&format!("{name}="), &about))
            .collect(),
        Source::Models => {
            let plants = plants(line).0;
            plants
                .iter()
                .map(|plant| candidate(&plant.name, &plant.summary))
                .collect()
        }
    };
    let fits = |one: &CompletionCandidate| {
        let (value, typed) = (one.get_value().as_encoded_bytes(), typed.as_encoded_bytes());
        value.starts_with(typed)
    };
    let mut candidates: Vec<_> = candidates.into_iter().filter(fits).collect();
    candidates.dedup_by(|a, b| a.get_value() == b.get_value());
    candidates
}

fn candidate(value: &str, about: &str) -> CompletionCandidate {
    let about = about.lines().next().unwrap_or_default();
    let help = (!about.is_empty()).then(|| StyledStr::from(about.to_owned()));
    CompletionCandidate::new(value).help(help)
}

fn sessions() -> Vec<CompletionCandidate> {
    let running = session::peek();
    (running.iter())
        .map(|session| {
            let folder = session.run_dir.as_ref();
            let folder = folder.map(|folder| folder.display().to_string());
            candidate(&session.name, &folder.unwrap_or_default())
        })
        .collect()
}

/// Lists the newest runs by their folders, or paths that match the typed prefix.
fn runs(typed: &OsStr) -> Vec<CompletionCandidate> {
    let begin = typed.as_encoded_bytes();
    let candidates = runs::newest(Path::new(runs::RUNS), MOST_RUNS);
    let latest = (!candidates.is_empty()).then(|| candidate(runs::LATEST, "the newest run"));
    let candidates = candidates.into_iter().map(CompletionCandidate::new);
    let fitting: Vec<_> = (latest.into_iter().chain(candidates))
        .filter(|one| one.get_value().as_encoded_bytes().starts_with(begin))
        .collect();
    if fitting.is_empty() {
        PathCompleter::any().complete(typed)
    } else {
        fitting
    }
}

fn scenarios(typed: &OsStr) -> Vec<CompletionCandidate> {
    let is_scenario = |path: &Path| path.extension() == Some(OsStr::new("toml"));
    PathCompleter::file().filter(is_scenario).complete(typed)
}

/// Lists keys of the scenario with their values, or the possible values after `=`.
fn keys(line: &Line, typed: &OsStr) -> Vec<CompletionCandidate> {
    let Some(subject) = line.subject() else {
        return Vec::new();
    };
    let typed = typed.to_string_lossy();
    if let Some((key, _)) = typed.split_once('=') {
        let names: Vec<(String, String)> = match key {
            "controller.law" => (subject.controller.laws.iter())
                .filter(|law| law.suits(&subject.plan.plant.model))
                .map(|law| (law.name.clone(), law.summary.clone()))
                .collect(),
            "plant.model" => (subject.plant.plants.iter())
                .map(|plant| (plant.name.clone(), plant.summary.clone()))
                .collect(),
            "run.clock" => ["lockstep", "paced", "realtime"]
                .map(|clock| (clock.to_owned(), String::new()))
                .into(),
            _ => Vec::new(),
        };
        let names = names.into_iter();
        return names
            .map(|(name, about)| candidate(&format!("{key}={name}"), &about))
            .collect();
    }
    let Subject {
        plan,
        plant,
        controller,
    } = &subject;
    let complete = show(plan, &plant.plants, &controller.laws, &plant.faults);
    let document: Option<DocumentMut> = complete.ok().and_then(|text| text.parse().ok());
    let mut entries = Vec::new();
    if let Some(document) = document {
        flatten("", document.as_item(), &mut entries);
    }
    // A swap changes the controller alone; `hil set` accepts only tunable keys.
    if line.is_of("swap") {
        entries.retain(|(key, _)| key.starts_with("controller."));
    }
    if line.is_of("set") {
        let offered = tunable(&subject);
        entries.retain(|(key, _)| offered.iter().any(|(_, own)| own == key));
        let value = |own: &String| entries.iter().find(|(key, _)| key == own);
        let further = (offered.iter())
            .filter(|(key, own)| key != own)
            .filter_map(|(key, own)| Some((key.clone(), value(own)?.1.clone())));
        let further: Vec<_> = further.collect();
        entries.extend(further);
        entries.extend(references(line));
    }
    entries
        .iter()
        .map(|(key, value)| candidate(&format!("{key}="), value))
        .collect()
}

/// Collects the values of a table by their keys, in the form of `--set`.
fn flatten(key: &str, item: &Item, entries: &mut Vec<(String, String)>) {
    let below = |name: &str| match key {
        "" => name.to_owned(),
        key => format!("{key}.{name}"),
    };
    match item {
        Item::Table(table) => {
            for (name, item) in table {
                flatten(&below(name), item, entries);
            }
        }
        Item::ArrayOfTables(tables) => {
            for (number, table) in tables.iter().enumerate() {
                flatten(
                    &format!("{key}[{number}]"),
                    &Item::Table(table.clone()),
                    entries,
                );
            }
        }
        Item::Value(Value::InlineTable(table)) => {
            for (name, value) in table {
                flatten(&below(name), &Item::Value(value.clone()), entries);
            }
        }
        Item::Value(value) => {
            let value = value.clone().decorated("", "").to_string();
            entries.push((key.to_owned(), value));
        }
        Item::None => {}
    }
}

/// Returns the parameters that can be changed while a session runs, under each of their names, with the primary
/// name.
fn tunable(subject: &Subject) -> Vec<(String, String)> {
    let Subject {
        plan,
        plant,
        controller,
    } = subject;
    let plant = plan.plant_among(&plant.plants);
    let keys = |group: &str, field: &Field| {
        let key = |name: &str| format!("{group}{name}");
        let keys = field.names().map(|name| (key(name), key(&field.name)));
        keys.collect::<Vec<_>>()
    };
    let of_plant = { plant.iter() }
        .flat_map(|plant| &plant.parameters)
        .filter(|field| field.tunable || field.faultable)
        .flat_map(|field| keys(PLANT_KEYS, field));
    let law = plan.law_among(&controller.laws);
    let of_law = (law.iter()).flat_map(|law| {
        let group = law_keys(&law.name);
        (law.tunable()).flat_map(move |field| keys(&group, field))
    });
    of_plant.chain(of_law).collect()
}

/// Returns the reference signals and driven inputs of the session as keys of `hil set`, with their units.
fn references(line: &Line) -> impl Iterator<Item = (String, String)> {
    let stimuli = line.subject().map(|subject| subject.plan.stimuli);
    (stimuli.into_iter().flatten()).flat_map(|stimulus| {
        let unit = unit_shown(&stimulus.unit).to_owned();
        let group = match stimulus.input() {
            Some(_) => INPUT_KEYS,
            None => REFERENCE_KEYS,
        };
        let further = stimulus.aliases.iter();
        let further = further.map(|alias| format!("{group}{alias}"));
        let keys: Vec<String> = std::iter::once(stimulus.key()).chain(further).collect();
        keys.into_iter().map(move |key| (key, unit.clone()))
    })
}

/// Lists the recorded and the derived signals.
fn signals(line: &Line) -> Vec<CompletionCandidate> {
    let Some(Subject {
        plan,
        plant,
        controller,
    }) = line.subject()
    else {
        return Vec::new();
    };
    let both = (plan.plant_among(&plant.plants)).zip(plan.law_among(&controller.laws));
    let layout = both.map(|(plant, law)| plan.record_layout(&plant, &law));
    let columns = layout.as_ref().map(|layout| columns_of(layout, &[]));
    let aliases = layout.map(|layout| Columns::from(&layout).aliases());
    let columns = columns.unwrap_or_default();
    let recorded = columns.iter().map(|one| (&one.name, &one.unit));
    let derived = plan.derived.iter().map(|one| (&one.name, &one.unit));
    let own = (recorded.chain(derived)).map(|(name, unit)| candidate(name, unit_shown(unit)));
    let further = aliases.iter().flatten();
    own.chain(further.map(|(alias, name)| candidate(alias, &format!("another name of {name}"))))
        .collect()
}

/// Returns the plants in question (those of the running session or the built-in ones), with the session's reference
/// signals and driven inputs, the number of its networks, and the fault kinds common to all plants.
fn plants(
    line: &Line,
) -> (
    Vec<PlantDescription>,
    [Vec<Field>; 2],
    u8,
    Vec<FaultKindDescription>,
) {
    if let Some(notice) = line.notice()
        && let Ok(plan) = notice.plan()
    {
        let mut plant = notice.plant;
        plant.plants = plan.plant_among(&plant.plants).into_iter().collect();
        let signals = [plan.reference(), driven(&plan.stimuli)];
        let networks = plan.bus.as_ref().map_or(1, |bus| bus.networks);
        return (plant.plants, signals, networks, plant.faults);
    }
    let [plant, _] = built_in();
    (plant.plants, Default::default(), 1, plant.faults)
}

/// Lists fault kinds of the running session or of the built-in plants.
fn kinds(line: &Line) -> Vec<ListedKind> {
    let (plants, signals, networks, shared) = plants(line);
    let [reference, inputs] = &signals;
    let mut kinds: Vec<ListedKind> = (plants.iter())
        .flat_map(|one| kinds_of(one, [reference, inputs], networks, &shared))
        .collect();
    kinds.sort_by(|a, b| a.kind.cmp(&b.kind));
    kinds
}

/// Lists the fault kinds named on the line, or all.
fn meant(line: &Line) -> Vec<ListedKind> {
    let kinds = kinds(line);
    let named: Vec<ListedKind> = (kinds.iter())
        .filter(|kind| line.has(&kind.kind))
        .cloned()
        .collect();
    if named.is_empty() { kinds } else { named }
}

fn targets(line: &Line) -> Vec<CompletionCandidate> {
    let mut names: Vec<String> = meant(line)
        .into_iter()
        .flat_map(|kind| kind.targets)
        .collect();
    names.sort_unstable();
    names.dedup();
    let (plants, signals, ..) = plants(line);
    let further = names.iter().flat_map(|target| {
        let about = format!("another name of {target}");
        let aliases = aliases_of(target, &plants, &signals);
        aliases.map(move |alias| candidate(&alias, &about))
    });
    let own = names.iter().map(|name| candidate(name, ""));
    own.chain(further).collect()
}

/// Returns further names of a signal or parameter that is a target of faults.
fn aliases_of<'a>(
    target: &'a str,
    plants: &'a [PlantDescription],
    [reference, inputs]: &'a [Vec<Field>; 2],
) -> impl Iterator<Item = String> + use<'a> {
    let (group, name) = target.split_once('.').unwrap_or((target, ""));
    let of_plants = plants.iter().flat_map(move |plant| match group {
        "measured" => &plant.measured[..],
        "command" => &plant.commands,
        "parameter" => &plant.parameters,
        _ => &[],
    });
    let of_stimuli = match group {
        "reference" => &reference[..],
        "input" => inputs,
        _ => &[],
    };
    let fields = of_plants.chain(of_stimuli);
    let fields = fields.filter(move |field| field.name == name);
    fields.flat_map(move |field| {
        let aliases = field.aliases.iter();
        aliases.map(move |alias| format!("{group}.{alias}"))
    })
}

/// Returns the keys of the fault kinds named on the line, with descriptions.
fn sizes(line: &Line) -> impl Iterator<Item = (String, String)> {
    let kinds = kinds(line).into_iter().filter(|kind| line.has(&kind.kind));
    let mut keys: Vec<(String, String)> = kinds.flat_map(|kind| kind.keys).collect();
    keys.sort();
    keys.dedup_by(|a, b| a.0 == b.0);
    keys.into_iter()
}

/// Adds the keys of the fault kind on the line to the command, in the form of options.
pub(super) fn with_keys_of_the_kind(command: Command, line: &Line) -> Command {
    if !line.is_of("inject") {
        return command;
    }
    let keys: Vec<(String, String)> = sizes(line).collect();
    command.mut_subcommand("inject", |mut inject| {
        for (key, about) in keys {
            // Leaks are irrelevant: the process ends with its answer.
            let key: &'static str = key.leak();
            let is_there = |one: &Arg| one.get_long() == Some(key) || one.get_id() == key;
            if !inject.get_arguments().any(is_there) {
                inject = inject.arg(Arg::new(key).long(key).help(about));
            }
        }
        inject
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_the_form_accepted_by_set() {
        let text = "schema = 1\n[run]\nrate_hz = 10.0 # often\n[plant.parameters]\nmass.first_kg = 1\n\
                    [[faults]]\nkind = \"a\"\n[[faults.effects]]\nsize = 1\n[[faults.effects]]\nsize = { x = 2 }\n";
        let document: DocumentMut = text.parse().expect("TOML");
        let mut entries = Vec::new();
        flatten("", document.as_item(), &mut entries);
        let entries: Vec<String> = entries
            .iter()
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        let expected = [
            "schema=1",
            "run.rate_hz=10.0",
            "plant.parameters.mass.first_kg=1",
            "faults[0].kind=\"a\"",
            "faults[0].effects[0].size=1",
            "faults[0].effects[1].size.x=2",
        ];
        assert_eq!(entries, expected);
    }
}

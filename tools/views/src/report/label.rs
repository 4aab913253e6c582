//! Labels of a report's runs: for each run the shortest label that distinguishes it from the others.
//!
//! A label is the law, or else scenario and law. Runs that share these are distinguished by the settings in which they
//! differ, in the form of `--set`, and then by their programs. Only indistinguishable runs are numbered.

use std::collections::{BTreeMap, BTreeSet};

use shared_types::number::exact;
use toml_edit::{DocumentMut, Item, TableLike, Value};

use super::run::Run;

/// Maximum number of settings in a label.
const MOST: usize = 3;

/// Facts that can distinguish a run from another.
#[derive(Clone, Debug, Default)]
struct Facts {
    law: String,
    scenario: String,
    /// Settings of the effective scenario, by key.
    settings: BTreeMap<String, String>,
    /// Hashes of the run's programs.
    programs: [String; 2],
}

/// Sets the label of each run.
pub(super) fn label(runs: &mut [Run]) {
    let facts: Vec<Facts> = runs.iter().map(facts).collect();
    for (run, label) in runs.iter_mut().zip(labels(&facts)) {
        run.label = label;
    }
}

fn facts(run: &Run) -> Facts {
    let scenario = run.outcome.reader.attachment("scenario.toml");
    Facts {
        law: run.law().to_owned(),
        scenario: run.fact("scenario").to_owned(),
        settings: scenario.map_or_else(|_| BTreeMap::new(), settings),
        programs: ["plant_blake3", "controller_blake3"].map(|name| run.fact(name).to_owned()),
    }
}

fn labels(facts: &[Facts]) -> Vec<String> {
    let laws: BTreeSet<&str> = facts.iter().map(|one| &*one.law).collect();
    let scenarios: BTreeSet<&str> = facts.iter().map(|one| &*one.scenario).collect();
    let is_told_by_law = laws.len() == facts.len() && !laws.contains("");
    let mut labels: Vec<String> = (facts.iter())
        .map(|one| match is_told_by_law || scenarios.len() == 1 {
            true => one.law.clone(),
            false => format!("{} {}", one.scenario, one.law).trim().to_owned(),
        })
        .collect();
    add(&mut labels, facts, differing_settings);
    add(&mut labels, facts, differing_programs);
    let shared = labels.clone();
    for (number, label) in (1..).zip(&mut labels) {
        if shared.iter().filter(|one| *one == label).count() > 1 || label.is_empty() {
            *label = format!("{number} {label}").trim().to_owned();
        }
    }
    labels
}

/// Extends each label shared by several runs by distinguishing facts.
fn add(labels: &mut [String], facts: &[Facts], differing: fn(&[&Facts]) -> Vec<String>) {
    let before = labels.to_vec();
    for label in before.iter().collect::<BTreeSet<_>>() {
        let places: Vec<usize> = (0..before.len())
            .filter(|at| before[*at] == *label)
            .collect();
        if places.len() < 2 {
            continue;
        }
        let alike: Vec<&Facts> = places.iter().map(|at| &facts[*at]).collect();
        for (at, difference) in places.iter().zip(differing(&alike)) {
            labels[*at] = format!("{label} {difference}").trim().to_owned();
        }
    }
}

/// Returns the few settings that distinguish each run from the others, by the last part of their key where that is
/// unambiguous, and the number of further differences.
fn differing_settings(runs: &[&Facts]) -> Vec<String> {
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.settings.keys()).collect();
    let is_other = |key: &&&String| {
        let mut values = runs.iter().map(|run| run.settings.get(**key));
        let first = values.next();
        values.any(|value| Some(value) != first)
    };
    let keys: Vec<&String> = keys.iter().filter(is_other).copied().collect();
    let last = |key: &str| key.rsplit('.').next().unwrap_or(key).to_owned();
    let name = |key: &String| {
        let is_ambiguous = keys.iter().filter(|one| last(one) == last(key)).count() > 1;
        if is_ambiguous { key.clone() } else { last(key) }
    };
    let telling = telling(runs, &keys);
    let of_run = |run: &&Facts| {
        let set = telling.iter().filter_map(|key| {
            let value = run.settings.get(*key)?;
            Some(format!("{}={}", name(key), cut(value)))
        });
        let mut set: Vec<String> = set.collect();
        let others = keys.iter().filter(|key| !telling.contains(key));
        match others
            .filter(|key| run.settings.contains_key(**key))
            .count()
        {
            0 => {}
            more => set.push(format!("and {more} more")),
        }
        set.join(" ")
    };
    runs.iter().map(of_run).collect()
}

/// Selects the few keys that distinguish most runs: greedily, each time the key that separates most of them.
fn telling<'a>(runs: &[&Facts], keys: &[&'a String]) -> Vec<&'a String> {
    let mut selected: Vec<&String> = Vec::new();
    while selected.len() < MOST {
        let apart = |keys: &[&String]| {
            let values = runs.iter().map(|run| {
                let values = keys.iter().map(|key| run.settings.get(*key));
                values.collect::<Vec<_>>()
            });
            values.collect::<BTreeSet<_>>().len()
        };
        let with = |key| apart(&[&selected[..], &[key]].concat());
        let Some((more, key)) = (keys.iter().rev())
            .map(|key| (with(*key), *key))
            .max_by_key(|(more, _)| *more)
        else {
            break;
        };
        if more <= apart(&selected) {
            break;
        }
        selected.push(key);
    }
    selected
}

/// Truncates a value that is too long for a label.
fn cut(value: &str) -> String {
    const LONGEST: usize = 24;
    match value.char_indices().nth(LONGEST) {
        None => value.to_owned(),
        Some((end, _)) => format!("{}..", &value[..end]),
    }
}

/// Returns the programs in which runs differ, by the beginning of their hash.
fn differing_programs(runs: &[&Facts]) -> Vec<String> {
    let of_run = |run: &&Facts| {
        let programs = ["plant", "controller"].into_iter().enumerate();
        let programs = programs.filter(|(side, _)| {
            (runs.iter()).any(|one| one.programs[*side] != run.programs[*side])
        });
        let programs = programs.map(|(side, name)| {
            let hash = &run.programs[side];
            format!("{name} {}", hash.get(..8).unwrap_or(hash))
        });
        programs.collect::<Vec<_>>().join(" ")
    };
    runs.iter().map(of_run).collect()
}

/// Returns the settings of a scenario without its texts for readers; none if it is not valid TOML.
fn settings(text: &str) -> BTreeMap<String, String> {
    let mut settings = BTreeMap::new();
    if let Ok(document) = text.parse::<DocumentMut>() {
        collect(document.as_table(), "", &mut settings);
    }
    for words in ["name", "description", "controller.law"] {
        settings.remove(words);
    }
    settings
}

fn collect(table: &dyn TableLike, prefix: &str, into: &mut BTreeMap<String, String>) {
    for (key, item) in table.iter() {
        let key = format!("{prefix}{key}");
        match item {
            Item::ArrayOfTables(tables) => {
                for (index, table) in tables.iter().enumerate() {
                    collect(table, &format!("{key}[{index}]."), into);
                }
            }
            Item::Value(Value::Float(float)) => {
                into.insert(key, exact(*float.value()));
            }
            Item::Value(value) if !value.is_inline_table() => {
                let plain = value.clone().decorated("", "").to_string();
                into.insert(key, plain.trim_matches('"').to_owned());
            }
            item => {
                if let Some(table) = item.as_table_like() {
                    collect(table, &format!("{key}."), into);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(law: &str, scenario: &str, text: &str, controller: &str) -> Facts {
        Facts {
            law: law.into(),
            scenario: scenario.into(),
            settings: settings(text),
            programs: ["p".repeat(64), controller.repeat(64)],
        }
    }

    #[test]
    fn a_law_is_enough_where_each_run_has_its_own() {
        let runs = ["pid", "ftsc"].map(|law| run(law, law, "a = 1", "c"));
        assert_eq!(labels(&runs), ["pid", "ftsc"]);
    }

    #[test]
    fn runs_of_one_law_are_distinguished_by_their_settings() {
        let text = |gain: &str| {
            format!(
                "name = \"x\"\n[run]\nseed = 1 # x\n[controller.pid]\ngain_n_per_m = {gain} # N/m\n"
            )
        };
        let runs = ["200.0", "2.8e7", "300.0"].map(|gain| run("pid", "x", &text(gain), "c"));
        assert_eq!(
            labels(&runs),
            [
                "pid gain_n_per_m=200",
                "pid gain_n_per_m=2.8e7",
                "pid gain_n_per_m=300"
            ]
        );
    }

    #[test]
    fn an_ambiguous_key_is_written_in_full_and_further_keys_are_counted() {
        let text = |force: u32| {
            let effect =
                format!("[[faults]]\nkind = \"push\"\n[[faults.effects]]\nforce_n = {force}\n");
            format!("{effect}{effect}")
        };
        let runs = [1, 2].map(|force| run("pid", "x", &text(force), "c"));
        assert_eq!(
            labels(&runs)[1],
            "pid faults[0].effects[0].force_n=2 and 1 more"
        );
        let text =
            |value: u32| format!("a = {value}\nb = {value}\nc = {value}\nd = {value}\ne = {value}");
        let runs = [1, 2].map(|value| run("pid", "x", &text(value), "c"));
        assert_eq!(labels(&runs)[0], "pid a=1 and 4 more");
    }

    #[test]
    fn the_most_distinguishing_settings_come_first() {
        // One of eight has different values of all keys that come first by name.
        let text = |run: u32| {
            let other = run == 7;
            format!(
                "a = {other}\nb = {other}\nc = {other}\nd = {}\ne = {}",
                run / 2,
                run % 2
            )
        };
        let runs: Vec<Facts> = (0..8).map(|at| run("pid", "x", &text(at), "c")).collect();
        let labels = labels(&runs);
        assert_eq!(labels[0], "pid d=0 e=0 and 3 more");
        assert_eq!(labels[7], "pid d=3 e=1 and 3 more");
    }

    #[test]
    fn a_long_value_is_truncated_and_equal_labels_are_numbered() {
        let text = |last: u32| format!("values = [{}{last}]", "1.0, ".repeat(1000));
        let runs = [1, 2].map(|last| run("pid", "x", &text(last), "c"));
        let cut = "pid values=[1.0, 1.0, 1.0, 1.0, 1.0..";
        assert_eq!(labels(&runs), [format!("1 {cut}"), format!("2 {cut}")]);
    }

    #[test]
    fn other_scenarios_and_other_programs_are_named() {
        let runs = [
            run("pid", "calm", "", "c"),
            run("pid", "storm", "", "c"),
            run("pid", "storm", "", "d"),
        ];
        assert_eq!(
            labels(&runs),
            [
                "calm pid",
                "storm pid controller cccccccc",
                "storm pid controller dddddddd"
            ]
        );
    }

    #[test]
    fn indistinguishable_runs_are_numbered() {
        let runs = ["c", "c"].map(|program| run("pid", "x", "a = 1", program));
        assert_eq!(labels(&runs), ["1 pid", "2 pid"]);
        let unknown = ["c", "c"].map(|program| run("", "", "", program));
        assert_eq!(labels(&unknown), ["1", "2"]);
    }
}

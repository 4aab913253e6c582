//! Reader of studies: from text to checked values, or all problems.

mod faults;
mod search;
mod spread;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use shared_types::layout::is_name;

use super::{Correlation, FAULT, Goal, Item, Sampling, Spread, Study, Variant, Varied, flag_key};
use crate::expression::{Columns, Group, is_reserved};
use crate::flag;
use crate::keys::{MOST_CASES, SPREADS, STUDY};
use crate::problem::{ProblemKind, Problems};
use crate::reader::{Reader, Section};
use crate::scenario::{Scenario, read_regular, root, unreadable};
use crate::source::Place;
use crate::title::{TITLE, is_title};
use search::{nominal, search};
use spread::{spread, whole};

/// Columns of the table of results next to the varied values.
const TAKEN: [&str; 9] = [
    "case", "draw", "variant", "seed", "class", "steps", "digest", "reason", "margin",
];

pub(super) fn file(path: &Path) -> Result<Study, Problems> {
    let text = read_regular(path).map_err(|error| unreadable("study", path, &error))?;
    self::text(&text, path.to_owned())
}

pub(super) fn text(text: &str, origin: PathBuf) -> Result<Study, Problems> {
    let scenario = Scenario::parse(text, origin)?;
    let mut reader = Reader::new(scenario.sources.clone(), Vec::new());
    let root = root(&scenario).with_keys(STUDY);
    let is_other_schema =
        root.table.get("schema").is_some() && reader.integer(&root, "schema").is_none();
    let study = if is_other_schema {
        None
    } else {
        study(&mut reader, &root, &scenario)
    };
    reader.finish(study)
}

fn study(reader: &mut Reader, root: &Section<'_>, source: &Scenario) -> Option<Study> {
    let path = &source.path;
    reader.integer(root, "schema");
    reader.refuse_unknown(root, &[]);
    let stem = path
        .file_stem()
        .map(|stem| stem.to_string_lossy().into_owned());
    let name = reader
        .text(root, "name")
        .map_or(stem.unwrap_or_default(), Into::into);
    if !is_title(&name) {
        let message = format!("the study's name is `{name}`");
        reader
            .report_at(root, "name", ProblemKind::OutOfRange, message)
            .expected(TITLE);
    }
    let description = reader.text(root, "description").unwrap_or_default().into();
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let scenario = reader.text(root, "scenario").map(|file| folder.join(file));
    let mut homes = Homes::default();
    homes.add("scenario", root.place_of("scenario"));
    let set = homes.flags(reader, root, &[]);
    let sampling = match reader.text(root, "sampling")? {
        "latin-hypercube" => Sampling::LatinHypercube,
        "sobol" => Sampling::Sobol,
        "grid" => Sampling::Grid,
        "saltelli" => Sampling::Saltelli,
        _ => Sampling::Independent,
    };
    let sampling = faults::sampling(reader, root, sampling);
    let fault_table = faults::faults(reader, root, &mut homes);
    let fault = fault_table.as_ref().and_then(faults::chooses);
    let varied = varied(reader, root, sampling, fault, &mut homes);
    let variants = variants(reader, root, &mut homes);
    let correlations = correlations(reader, root, sampling, &varied);
    let confidence = reader.number(root, "confidence");
    let goals = goals(reader, root, confidence, sampling, &variants, &mut homes);
    let draws = draws(reader, root, sampling, &varied, variants.len() as u64);
    let search = search(reader, root, &variants, &mut homes);
    let seed = reader
        .integer(root, "seed")
        .and_then(|seed| u64::try_from(seed).ok());
    let case_limit_s = reader.number(root, "case_limit_s");
    let wait_limit_s = reader.number(root, "wait_limit_s");
    let fresh_processes = reader.boolean(root, "fresh_processes");
    Some(Study {
        name,
        description,
        scenario: scenario?,
        set,
        draws: draws?,
        seed: seed?,
        sampling,
        confidence: confidence?,
        case_limit_s: case_limit_s?,
        wait_limit_s: wait_limit_s?,
        fresh_processes: fresh_processes?,
        varied,
        variants,
        correlations,
        goals,
        search: search?,
        faults: fault_table,
        sources: source.sources.clone(),
        folder,
        homes: homes.all,
    })
}

/// Places of the flags of a study.
#[derive(Default)]
struct Homes {
    all: Vec<(String, Place)>,
}

impl Homes {
    /// Claims a key that nothing else may set; each variant may set the keys of variants.
    fn take(&mut self, reader: &mut Reader, key: &str, place: &Place, allowed: &[String]) {
        let is_taken = self.all.iter().any(|(key_taken, _)| key_taken == key);
        if is_taken && !allowed.iter().any(|one| one == key) {
            let message = format!("`{key}` is already set by this study");
            reader.report(ProblemKind::Duplicate, key, place, message);
        }
        self.all.push((key.into(), place.clone()));
    }

    /// Adds the place of a key that is no flag.
    fn add(&mut self, key: &str, place: &Place) {
        self.all.push((key.into(), place.clone()));
    }

    /// Reads the flags of a section.
    fn flags(
        &mut self,
        reader: &mut Reader,
        section: &Section<'_>,
        allowed: &[String],
    ) -> Vec<String> {
        if section.table.get("set").is_none() {
            return Vec::new();
        }
        let texts = reader.texts(section, "set").unwrap_or_default();
        let mut flags = Vec::new();
        for (path, place, text) in texts {
            if let Err(message) = flag::check(text) {
                reader
                    .report(ProblemKind::Syntax, path, place, message)
                    .expected("KEY=VALUE, as --set takes it");
                continue;
            }
            self.take(reader, flag_key(text), place, allowed);
            flags.push(text.into());
        }
        flags
    }
}

fn varied(
    reader: &mut Reader,
    root: &Section<'_>,
    sampling: Sampling,
    fault: Option<Varied>,
    homes: &mut Homes,
) -> Vec<Varied> {
    let mut all: Vec<Varied> = fault.into_iter().collect();
    let mut columns = Columns::default();
    let kinds = SPREADS.iter().map(|kind| (kind.name, kind.keys));
    for section in &reader.list(root, "vary") {
        let Some((kind, own)) = reader.of_kind(section, "variation", kinds.clone()) else {
            continue;
        };
        let key = reader.text(section, "key");
        if let Some(key) = key {
            let place = section.place_of("key");
            match flag::check(&format!("{key}=0")) {
                Ok(()) => homes.take(reader, key, place, &[]),
                Err(message) => {
                    reader
                        .report(ProblemKind::Syntax, section.path_of("key"), place, message)
                        .expected("a key as --set takes it, for example faults[0].at_s");
                }
            }
        }
        let name = name(reader, root, section, key, &all);
        let is_whole = own.keys.iter().any(|key| key.name == "whole")
            && reader.boolean(&own, "whole").unwrap_or_default();
        let spread = spread(reader, &own, kind, &columns)
            .and_then(|spread| whole(reader, &own, spread, is_whole));
        let Some(name) = name else { continue };
        let Some(spread) = spread else {
            columns.push(Group::Derived, &name); // who names it in an expression has made no mistake there
            continue;
        };
        let nominal = nominal(reader, section, &spread);
        if sampling == Sampling::Grid
            && !matches!(spread, Spread::Choice(_) | Spread::Expression(_))
        {
            let message = format!("`{name}` is {kind}, but grid sampling needs a list of points");
            reader
                .report_at(section, "kind", ProblemKind::OutOfRange, message)
                .expected("list, grid or expression, or another sampling");
        }
        let is_number = match &spread {
            Spread::Choice(items) => items.iter().all(|item| matches!(item, Item::Number(..))),
            _ => true,
        };
        if is_number {
            columns.push(Group::Derived, &name);
        }
        let key = key.map(Into::into);
        all.push(Varied {
            name,
            key,
            spread,
            is_whole,
            nominal,
        });
    }
    all
}

/// Returns the name of a variation: its own, or the last part of its key.
fn name(
    reader: &mut Reader,
    root: &Section<'_>,
    section: &Section<'_>,
    key: Option<&str>,
    others: &[Varied],
) -> Option<String> {
    let own_name = reader.text(section, "name");
    let name = own_name.or_else(|| key.and_then(|key| key.rsplit('.').next()));
    let Some(name) = name else {
        reader.missing(section, &section.path_of("name"), "a name or a key".into());
        return None;
    };
    let place = if own_name.is_some() { "name" } else { "key" };
    let message = if !is_name(name) || is_reserved(name) {
        format!("`{name}` cannot be used as a name in expressions")
    } else if TAKEN.contains(&name) {
        format!("`{name}` is already a column of every table of results")
    } else if name == FAULT && root.table.get("faults").is_some() {
        format!("`{name}` is the column of the fault that [faults] tries")
    } else if others.iter().any(|other| other.name == name) {
        format!("another varied value has the name `{name}`")
    } else {
        return Some(name.into());
    };
    reader
        .report_at(section, place, ProblemKind::OutOfRange, message)
        .help("give it a `name` of its own");
    None
}

fn variants(reader: &mut Reader, root: &Section<'_>, homes: &mut Homes) -> Vec<Variant> {
    let mut all: Vec<Variant> = Vec::new();
    let mut names = HashSet::new();
    let mut allowed: Vec<String> = Vec::new();
    for section in &reader.list(root, "variants") {
        reader.refuse_unknown(section, &[]);
        let name = reader.text(section, "name");
        let detected = reader.text(section, "detected").map(Into::into);
        if detected.is_some() && root.table.get("faults").is_none() {
            let message = "a variant has an alarm, and the study has no [faults]";
            reader.report_at(section, "detected", ProblemKind::Mismatch, message);
        }
        let set = homes.flags(reader, section, &allowed);
        allowed.extend(set.iter().map(|flag| flag_key(flag).to_owned()));
        let Some(name) = name else { continue };
        if !is_title(name) || !names.insert(name.to_owned()) {
            let expected = "1 to 64 letters, digits, - and _, and no name twice";
            reader.refuse(section, "name", name, expected);
        }
        let name = name.into();
        all.push(Variant {
            name,
            set,
            detected,
        });
    }
    if all.is_empty() {
        all.push(Variant {
            name: "scenario".into(),
            set: Vec::new(),
            detected: None,
        });
    }
    all
}

fn correlations(
    reader: &mut Reader,
    root: &Section<'_>,
    sampling: Sampling,
    varied: &[Varied],
) -> Vec<Correlation> {
    let mut all: Vec<Correlation> = Vec::new();
    for section in &reader.list(root, "correlate") {
        reader.refuse_unknown(section, &[]);
        let coefficient = reader.number(section, "coefficient");
        let Some(names) = reader.texts(section, "names") else {
            continue;
        };
        let normal =
            |one: &&Varied| matches!(one.spread, Spread::Normal { .. } | Spread::Lognormal { .. });
        let normal_names: Vec<&str> = varied.iter().filter(normal).map(|one| &*one.name).collect();
        let mut of = Vec::new();
        for (path, place, name) in &names {
            match varied
                .iter()
                .position(|one| one.name == *name && normal(&one))
            {
                Some(found) => of.push(found),
                None => {
                    reader
                        .report(
                            ProblemKind::UnknownName,
                            path.clone(),
                            place,
                            format!("`{name}` is not a normal or lognormal value"),
                        )
                        .one_of(name, normal_names.iter().copied());
                }
            }
        }
        if of.len() != names.len() {
            continue;
        }
        of.sort_unstable();
        let &[first, second] = &of[..] else {
            let message = format!("`{}` has {} names", section.path_of("names"), of.len());
            reader
                .report_at(section, "names", ProblemKind::OutOfRange, message)
                .expected("two names");
            continue;
        };
        let of = [first, second];
        if first == second || all.iter().any(|other| other.of == of) {
            let message = "a value is correlated with itself, or a correlation is given twice";
            reader.report_at(section, "names", ProblemKind::Duplicate, message);
        }
        if !matches!(sampling, Sampling::Independent | Sampling::Sobol) {
            let message = format!(
                "correlations are not possible with sampling = \"{}\"",
                sampling.name()
            );
            reader
                .report_at(section, "names", ProblemKind::OutOfRange, message)
                .expected("independent or sobol");
        }
        if let Some(coefficient) = coefficient {
            all.push(Correlation { of, coefficient });
        }
    }
    all
}

fn goals(
    reader: &mut Reader,
    root: &Section<'_>,
    confidence: Option<f64>,
    sampling: Sampling,
    variants: &[Variant],
    homes: &mut Homes,
) -> Vec<Goal> {
    let mut all = Vec::new();
    for section in &reader.list(root, "goals") {
        reader.refuse_unknown(section, &[]);
        if sampling != Sampling::Independent {
            let message = format!(
                "a probability from sampling = \"{}\" has no confidence bounds",
                sampling.name()
            );
            reader
                .report_at(section, "probability", ProblemKind::OutOfRange, message)
                .expected("sampling = \"independent\"");
        }
        let variant = reader.text(section, "variant");
        if let Some(name) = variant
            && !variants.iter().any(|candidate| candidate.name == name)
        {
            let names: Vec<&str> = variants.iter().map(|one| &*one.name).collect();
            reader
                .report_at(
                    section,
                    "variant",
                    ProblemKind::UnknownName,
                    format!("there is no variant `{name}`"),
                )
                .one_of(name, names.iter().copied());
        }
        let own = match section.table.get("confidence") {
            Some(_) => reader.number(section, "confidence"),
            None => confidence,
        };
        let requirement = reader.text(section, "requirement").map(Into::into);
        let probability = reader.number(section, "probability");
        if let (Some(probability), Some(confidence)) = (probability, own) {
            let home = format!("goals[{}]", all.len());
            homes.add(&home, section.place_of("requirement"));
            all.push(Goal {
                requirement,
                variant: variant.map(Into::into),
                probability,
                confidence,
            });
        }
    }
    all
}

/// Returns the number of draws, which for a grid follows from its points.
fn draws(
    reader: &mut Reader,
    root: &Section<'_>,
    sampling: Sampling,
    varied: &[Varied],
    variants: u64,
) -> Option<u64> {
    let cases_key = match root.table.get("cases") {
        Some(_) => Some(reader.integer(root, "cases")?),
        None => None,
    };
    let most = MOST_CASES.cast_unsigned();
    let drawn = { varied.iter() }
        .filter(|one| !matches!(one.spread, Spread::Expression(_)))
        .count();
    let draws = match (sampling, cases_key) {
        (Sampling::Grid, Some(_)) => {
            let message = "a grid has as many cases as points, so `cases` contradicts it";
            reader
                .report_at(root, "cases", ProblemKind::OutOfRange, message)
                .help("leave out `cases`, or choose another sampling");
            return None;
        }
        (Sampling::Grid, None) => varied.iter().fold(1_u64, |product, one| match &one.spread {
            Spread::Choice(items) => product.saturating_mul(items.len() as u64),
            _ => product,
        }),
        (Sampling::Saltelli, Some(rows)) => rows.cast_unsigned().saturating_mul(drawn as u64 + 2),
        (_, Some(cases_key)) => cases_key.cast_unsigned(),
        // The points of a search are not drawn.
        (_, None) if root.table.get("search").is_some() => 1,
        (_, None) => {
            reader.missing(
                root,
                "cases",
                "a whole number of draws, or [search] for hil search".into(),
            );
            return None;
        }
    };
    if draws.saturating_mul(variants) > most {
        let message = format!("{draws} draws of {variants} variants are more than {most} cases");
        reader.report_at(root, "cases", ProblemKind::OutOfRange, message);
        return None;
    }
    let sobol = 1 << 32;
    let most_values = match sampling {
        Sampling::Sobol if varied.len() > super::MOST_SOBOL => Some(super::MOST_SOBOL),
        // Each value takes a dimension of either point.
        Sampling::Saltelli if 2 * drawn > super::MOST_SOBOL => Some(super::MOST_SOBOL / 2),
        Sampling::Sobol if draws > sobol => Some(super::MOST_SOBOL),
        _ => None,
    };
    if let Some(most) = most_values {
        let message = format!("Sobol' points support at most {most} values");
        reader.report_at(root, "sampling", ProblemKind::OutOfRange, message);
        return None;
    }
    Some(draws)
}

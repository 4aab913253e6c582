//! `hil campaign check` and `plan`: checks a study and writes the [folder] of its campaign.

mod folder;
mod ports;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::results::curve::Grid;
use hil_run::alone;
use hil_run::kept::Kept;

use crate::manifest::FaultPlan;
use crate::table::{Column, ColumnKind};
use hil_config::problem::Problems;
use hil_config::study::{Spread, Study, Varied};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use shared_types::number::counted;
use shared_types::time::Step;

use super::cases::Cases;
use super::result::CaseResult;
use super::{envelopes, quoted};
use crate::arguments::{CheckArguments, PlanArguments};
pub(super) use folder::shard_cases;
use folder::{refuse_other, write};

/// Study that passed all checks.
struct Checked {
    cases: Cases,
    columns: Vec<Column>,
    curves: Option<Grid>,
    faults: Option<FaultPlan>,
    facts: Facts,
}

/// Facts about a checked study.
#[derive(Debug, Serialize)]
struct Facts {
    study: String,
    cases: u64,
    draws: u64,
    sampling: &'static str,
    variants: Vec<String>,
    varied: Vec<String>,
    /// Duration of one case, in s.
    case_s: f64,
    /// Duration of all cases on one core, in s.
    core_s: f64,
    /// Size of the table of results before compression.
    bytes: u64,
    /// Set if plant and law are built into `hil` and run in one process.
    is_built_in: bool,
}

impl Facts {
    fn describe(&self) -> String {
        let Self {
            study,
            cases,
            draws,
            sampling,
            ..
        } = self;
        let seconds = |s: f64| shown_ns((s * 1e9) as u64);
        let programs = match self.is_built_in {
            true => "built into hil, both sides in one process",
            false => "external, in two processes for each worker",
        };
        let names = |names: &[String]| match names {
            [] => "nothing".into(),
            names => names.join(", "),
        };
        format!(
            "{study}: {}, {} ({sampling}) for {}\n  varies   {}\n  variants {}\n  programs {programs}\n  a case   {}, all of them {} on one core\n  results  {}\n",
            counted(*cases, "case"),
            counted(*draws, "draw"),
            counted(self.variants.len() as u64, "variant"),
            names(&self.varied),
            names(&self.variants),
            seconds(self.case_s),
            seconds(self.core_s),
            hil_recording::size::shown(self.bytes),
        )
    }
}

/// Checks a study.
///
/// # Errors
/// All errors of the study.
pub(super) fn check(arguments: &CheckArguments) -> Result<Exit, Failure> {
    let checked = checked(arguments, &Interruption::listen()?)?;
    output::result(arguments.json, &checked.facts, || checked.facts.describe())?;
    Ok(Exit::Pass)
}

/// Writes the folder of a campaign.
///
/// # Errors
/// If the study is invalid, or the folder cannot be written.
pub(super) fn plan(arguments: &PlanArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let checked = checked(&arguments.check, &interruption)?;
    let out = arguments.out.clone();
    let out = out.unwrap_or_else(|| Path::new("runs").join(&checked.facts.study));
    refuse_other(&out, &checked)?;
    write(&checked, &out)?;
    let (out_text, quoted) = (out.display(), quoted(&out));
    output::result(arguments.check.json, &checked.facts, || {
        format!(
            "{}\nplanned in {out_text}; hil campaign run {quoted}\n",
            checked.facts.describe()
        )
    })?;
    Ok(Exit::Pass)
}

fn checked(arguments: &CheckArguments, interruption: &Interruption) -> Result<Checked, Failure> {
    let study = Study::read(&arguments.study)?;
    let cases = Cases::of_study(study, &arguments.binaries, interruption)?;
    let faults = cases.fault_plan(interruption)?;
    let study = cases.study();
    let impossible = faults.as_ref().map(|faults| &faults.impossible);
    let firsts = first_cases(study, impossible);
    let Some((first_case, _)) = firsts.first() else {
        return Err(Failure::usage("no case of the study is possible"));
    };
    let first = cases.plan(*first_case)?;
    alone::refuse_clock(&first)?;
    refuse_ineffective(&cases)?;
    let longest_s = every_plan(&cases, 0, impossible, interruption)?;
    let mut processes = Kept::new(study.wait_limit_s);
    let mut result = cases.run(&first, &mut processes, interruption)?;
    if cases.keeps_processes(&first) {
        // The first run started its processes; later runs do not, and are representative.
        result = cases.run(&first, &mut processes, interruption)?;
    }
    let columns = columns(&cases, &result, &firsts, &mut processes, interruption)?;
    refuse_unknown_goals(study, &columns)?;
    let curves = curves(&cases, &firsts, longest_s)?;
    let bytes: u64 = columns.iter().map(cell_bytes).sum();
    let facts = Facts {
        study: study.name.clone(),
        cases: study.cases(),
        draws: study.draws,
        sampling: study.sampling.name(),
        variants: study.variants.iter().map(|one| one.name.clone()).collect(),
        varied: study.varied.iter().map(|one| one.name.clone()).collect(),
        case_s: result.wall_s,
        core_s: result.wall_s * study.cases() as f64,
        bytes: bytes * study.cases(),
        is_built_in: cases.binaries().is_none(),
    };
    Ok(Checked {
        cases,
        columns,
        curves,
        faults,
        facts,
    })
}

/// Returns the first possible case of each variant that has one, with the index of the variant.
fn first_cases(study: &Study, impossible: Option<&BTreeMap<u64, String>>) -> Vec<(u64, usize)> {
    let variants = study.variants.len();
    let is_possible = |case: &u64| impossible.is_none_or(|all| !all.contains_key(case));
    (0..variants)
        .filter_map(|variant| {
            let mut cases = (variant as u64..study.cases()).step_by(variants);
            Some((cases.find(is_possible)?, variant))
        })
        .collect()
}

/// Chooses the curves that are recorded for the report.
fn curves(cases: &Cases, firsts: &[(u64, usize)], longest_s: f64) -> Result<Option<Grid>, Failure> {
    let study = cases.study();
    let first = firsts.iter().map(|(case, _)| {
        let plan = cases.plan(*case)?;
        let layout = cases.record_layout(&plan)?;
        Ok((plan, layout))
    });
    let first = first.collect::<Result<Vec<_>, Failure>>()?;
    Ok(envelopes::chosen(&first, longest_s, study.draws))
}

/// Estimates the size of a cell in bytes.
fn cell_bytes(column: &Column) -> u64 {
    match (column.kind, &*column.name) {
        (ColumnKind::Text, "digest") => 64,
        _ => 8,
    }
}

/// Lists the columns of the results, which must be the same for every variant.
fn columns(
    cases: &Cases,
    first: &CaseResult,
    firsts: &[(u64, usize)],
    processes: &mut Kept,
    interruption: &Interruption,
) -> Result<Vec<Column>, Failure> {
    let columns = cases.columns(first);
    for (place, column) in columns.iter().enumerate() {
        if columns[..place]
            .iter()
            .any(|other| other.name == column.name)
        {
            return Err(Failure::usage(format!(
                "two columns of the results would be called `{}`: rename the varied value or the metric",
                column.name
            )));
        }
    }
    let variants = &cases.study().variants;
    for (case, variant) in firsts.iter().skip(1) {
        let (plan, variant) = (cases.plan(*case)?, &variants[*variant]);
        let variant_columns = cases.columns(&cases.run(&plan, processes, interruption)?);
        if variant_columns != columns {
            let differs = variant_columns
                .iter()
                .find(|column| !columns.contains(column));
            let differs = differs.or_else(|| {
                columns
                    .iter()
                    .find(|column| !variant_columns.contains(column))
            });
            let name = differs.map_or("", |column| &column.name);
            return Err(Failure::usage(format!(
                "variants `{}` and `{}` differ in the result `{name}`; all variants need the same metrics and requirements",
                variant.name, variants[firsts[0].1].name
            )));
        }
    }
    Ok(columns)
}

/// Refuses a study in which nothing varies, and varied values without an effect in any variant.
pub(super) fn refuse_ineffective(cases: &Cases) -> Result<(), Failure> {
    let study = cases.study();
    if study.varied.is_empty() && study.sets("run.seed") && study.draws > 1 {
        return Err(Failure::usage(
            "nothing varies from draw to draw, because the study has no [[vary]] and sets run.seed",
        ));
    }
    let first = cases.draws.values(0);
    for (place, one) in study.varied.iter().enumerate() {
        let Some(key) = &one.key else {
            let uses = |other: &Varied| match &other.spread {
                Spread::Expression(expression) => expression.signals().any(|name| name == one.name),
                _ => false,
            };
            // A computed value may be a mere column of the table.
            let is_computed = matches!(one.spread, Spread::Expression(_));
            if !is_computed && !study.varied.iter().any(uses) {
                return Err(Failure::usage(format!(
                    "`{}` has no key, and no expression uses it, so it has no effect",
                    one.name
                )));
            }
            continue;
        };
        let other = (1..study.draws).map(|draw| cases.draws.values(draw)[place].clone());
        let Some(other) = other.into_iter().find(|value| *value != first[place]) else {
            continue; // one draw, or all alike by chance
        };
        let mut changed = first.clone();
        changed[place] = other;
        let mut is_effective = false;
        for variant in 0..study.variants.len() {
            let plan_text = |values| {
                let flags = cases.draws.flags_of(variant, 0, values);
                let plan = cases.planned(flags)?;
                cases.scenario_text(&plan)
            };
            // No case has this combination of values; a refusal also shows that they have an effect.
            is_effective |= match (plan_text(&first), plan_text(&changed)) {
                (Ok(first), Ok(changed)) => first != changed,
                _ => true,
            };
        }
        if !is_effective {
            return Err(ineffective(study, key));
        }
    }
    Ok(())
}

/// Creates the error for a key without an effect.
pub(super) fn ineffective(study: &Study, key: &str) -> Failure {
    let problem = study.problem_of(
        key,
        &format!("`{key}` has no effect in the scenario that runs"),
        "the scenario may set the same value under another name, or use another law; `hil config show` prints what runs",
    );
    Problems(vec![problem]).into()
}

/// Refuses goals for requirements that the scenario does not have.
fn refuse_unknown_goals(study: &Study, columns: &[Column]) -> Result<(), Failure> {
    let names = columns
        .iter()
        .filter_map(|column| column.name.strip_prefix("verdict."));
    let names: Vec<&str> = names.collect();
    for (place, goal) in study.goals.iter().enumerate() {
        let known = match &goal.requirement {
            Some(name) => names.contains(&&**name),
            None => !names.is_empty(),
        };
        if !known {
            let what = goal.requirement.as_ref().map_or_else(
                || "the scenario has no requirement that a case could pass".into(),
                |name| format!("the scenario has no requirement `{name}`"),
            );
            let problem = study.problem_of(
                &format!("goals[{place}]"),
                &what,
                &format!("its requirements: {}", names.join(", ")),
            );
            return Err(Problems(vec![problem]).into());
        }
    }
    Ok(())
}

/// Plans every possible case from `from` on once, on all cores, so that no case is refused later; returns the longest
/// simulated time, in s.
pub(super) fn every_plan(
    cases: &Cases,
    from: u64,
    impossible: Option<&BTreeMap<u64, String>>,
    interruption: &Interruption,
) -> Result<f64, Failure> {
    let all = cases.study().cases();
    let bar = bar(all - from, "checking cases");
    let (next, is_over) = (AtomicU64::new(from), AtomicBool::new(false));
    let first: Mutex<Option<(u64, Failure)>> = Mutex::new(None);
    // Positive floating-point numbers are ordered like their bits.
    let longest = AtomicU64::new(0);
    let work = || {
        while !is_over.load(Ordering::Relaxed) && !interruption.came() {
            let case = next.fetch_add(1, Ordering::Relaxed);
            if case >= all {
                break;
            }
            if impossible.is_some_and(|all| all.contains_key(&case)) {
                bar.inc(1);
                continue;
            }
            match cases.check(case) {
                Ok(plan) => {
                    let end_s = plan.run.rate.seconds(Step(plan.run.steps));
                    longest.fetch_max(end_s.to_bits(), Ordering::Relaxed);
                }
                Err(refused) => {
                    let mut first = first.lock().unwrap_or_else(PoisonError::into_inner);
                    if first.as_ref().is_none_or(|(known, _)| case < *known) {
                        *first = Some((case, refused));
                    }
                    is_over.store(true, Ordering::Relaxed);
                }
            }
            bar.inc(1);
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(work);
        }
    });
    bar.finish_and_clear();
    interruption.check()?;
    match first.into_inner().unwrap_or_else(PoisonError::into_inner) {
        None => Ok(f64::from_bits(longest.into_inner())),
        Some((case, refused)) => Err(Failure::Usage(format!("{refused}\nin case {case}"))),
    }
}

/// Creates a progress bar over `all` items, drawn only on a terminal.
pub(super) fn bar(all: u64, what: &'static str) -> ProgressBar {
    if !output::person_watches() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(all);
    let template = "{msg} {wide_bar} {human_pos} of {human_len}, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar
}

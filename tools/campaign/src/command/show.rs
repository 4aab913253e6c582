//! `hil campaign show`: prints the evaluation of a campaign and determines the exit code.

use std::fmt::Write as _;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};

use crate::collect::Collected;
use crate::folder::Folder;
use shared_types::number::{counted, short, unit_shown};

use super::answers::outcomes::FAULT_COLUMNS;
use super::answers::{
    self, Answers, BoundsAnswer, Gathered, IndicesAnswer, QuantileAnswer, Share, VariantAnswer,
};
use super::collect::{self, set_aside};
use super::planned::study;
use super::quoted;
use super::work::open;
use crate::arguments::ShowArguments;

/// Runs the command.
///
/// # Errors
/// If the campaign is incomplete.
pub(super) fn show(arguments: &ShowArguments) -> Result<Exit, Failure> {
    let folder = open(&arguments.folder)?;
    let study = study(&folder)?;
    let mut gathered = Gathered::new(&folder, &study);
    let collected = collect::read(&folder, false, |part| gathered.take(part))?;
    let exit = print(&folder, &collected, gathered, arguments.json)?;
    let are_whole =
        collect::tell_damaged_tables(&folder, &study, &collected) & tell_changed_copies(&folder);
    Ok(match exit {
        Exit::Pass | Exit::Failed if !are_whole => Exit::Infrastructure,
        exit => exit,
    })
}

/// Reports copies that have changed since planning; the results belong to the originals.
///
/// Returns `true` if there are none.
fn tell_changed_copies(folder: &Folder) -> bool {
    let changed = (folder.manifest().files()).filter_map(|copy| folder.check_copies([copy]).err());
    changed.fold(true, |_, why| {
        tell!(
            "error: {why}; the figures below belong to the campaign as planned, and no case can be run again until the file is restored"
        );
        false
    })
}

/// Prints the evaluation of a collected campaign.
///
/// # Errors
/// If the output cannot be written.
pub(super) fn print(
    folder: &Folder,
    collected: &Collected,
    gathered: Gathered,
    json: bool,
) -> Result<Exit, Failure> {
    let answers = answers::of(gathered, collected);
    output::result(json, &answers, || text(&answers, folder))?;
    let conflicts = collect::tell_conflicts(folder)?;
    let exit = collect::exit(collected, conflicts > 0);
    let is_missed = answers.goals.iter().any(|goal| !goal.is_met);
    Ok(match exit {
        Exit::Pass if is_missed => Exit::Failed,
        exit => exit,
    })
}

fn text(answers: &Answers, folder: &Folder) -> String {
    let folder_text = quoted(folder.path());
    output::text(|text| write(text, answers, &folder_text))
}

fn write(text: &mut String, answers: &Answers, folder_text: &str) -> std::fmt::Result {
    let Answers {
        name,
        cases,
        draws,
        sampling,
        ..
    } = answers;
    if !answers.lost.is_empty() {
        writeln!(
            text,
            "{}; probabilities have no bounds",
            set_aside(&answers.lost)
        )?;
    }
    writeln!(
        text,
        "{name}: {}, {} ({sampling}) for {}",
        counted(*cases, "case"),
        counted(*draws, "draw"),
        counted(answers.variants.len() as u64, "variant")
    )?;
    if let Some(digest) = &answers.digest {
        writeln!(text, "  digest {digest}")?;
    }
    let percent = answers.confidence * 100.0;
    let has_bounds = answers
        .variants
        .iter()
        .any(|one| one.passes.bounds.is_some());
    if has_bounds {
        writeln!(text, "  bounds: Clopper-Pearson at {percent} %, two-sided")?;
    } else {
        let why = match (answers.lost.is_empty(), answers.sampling) {
            (false, _) => "cases are set aside",
            (true, "independent") => "the scenario has no requirement that a case could fail",
            (true, _) => "they need independent draws",
        };
        writeln!(text, "  no bounds: {why}")?;
    }
    writeln!(text)?;
    classes(text, answers)?;
    faults(text, answers)?;
    for variant in &answers.variants {
        requirements(text, variant, *sampling == "saltelli", folder_text)?;
    }
    for goal in &answers.goals {
        let what = goal.requirement.as_deref().unwrap_or("pass");
        let verdict = if goal.is_met { "met" } else { "NOT MET" };
        writeln!(
            text,
            "goal {verdict}: {} {what} with probability {} at {} %: at least {} demonstrated",
            goal.variant,
            goal.probability,
            goal.confidence * 100.0,
            short(goal.lower)
        )?;
    }
    Ok(())
}

fn classes(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let words = answers::classes_in_words(answers.requirements());
    let places = answers::shown_classes(&answers.variants);
    let widths = [6, 6, 8, 9, 4, 7, 12];
    let mut columns = vec![left(0)];
    columns.extend(places.iter().map(|place| right(widths[*place])));
    columns.extend([right(8), left(0)]);
    let mut table = Table::new(2, columns);
    let head = ["variant"]
        .into_iter()
        .chain(places.iter().map(|place| words[*place]))
        .chain(["passes", "probability"]);
    table.cells(head);
    for variant in &answers.variants {
        let counts = places
            .iter()
            .map(|place| variant.classes[*place].to_string());
        let share = percent(variant.passes);
        let cells = [variant.name.clone()].into_iter().chain(counts);
        table.cells(cells.chain([share, bounds(variant.passes)]));
    }
    writeln!(text, "{table}")
}

/// Writes the table of faults by outcomes.
fn faults(text: &mut String, answers: &Answers) -> std::fmt::Result {
    if answers.faults.is_empty() {
        return Ok(());
    }
    let mut columns = vec![left(0); FAULT_COLUMNS.len() + 1];
    for place in [3, 7, 8] {
        columns[place] = right(0);
    }
    let mut table = Table::new(2, columns);
    table.cells(FAULT_COLUMNS.into_iter().chain(["repeated by"]));
    for row in &answers.faults {
        let cells = row.shown(answers.requirements());
        table.cells(cells.into_iter().chain([row.command.clone()]));
        if !row.reason.is_empty() {
            table.line(format!("    {}", row.reason));
        }
    }
    writeln!(text, "{table}")
}

fn percent(share: Share) -> String {
    format!("{} %", short(share.count as f64 / share.of as f64 * 100.0))
}

/// Formats the bounds of a probability.
pub(super) fn bounds(share: Share) -> String {
    match share.bounds {
        None => "-".into(),
        Some(BoundsAnswer { upper, .. }) if share.count == 0 => format!("at most {}", short(upper)),
        Some(BoundsAnswer { lower, .. }) if share.count == share.of => {
            format!("at least {}", short(lower))
        }
        Some(BoundsAnswer { lower, upper, .. }) => format!("{} to {}", short(lower), short(upper)),
    }
}

fn requirements(
    text: &mut String,
    variant: &VariantAnswer,
    is_saltelli: bool,
    folder_text: &str,
) -> std::fmt::Result {
    if variant.requirements.is_empty() {
        return Ok(());
    }
    let columns = [
        left(0),
        right(8),
        left(0),
        right(9),
        right(9),
        right(9),
        right(9),
        left(0),
    ];
    let mut table = Table::new(2, columns);
    table.cells([
        &*variant.name,
        "holds",
        "probability",
        "worst",
        "1 %",
        "5 %",
        "median",
        "",
    ]);
    for one in &variant.requirements {
        let worst = one
            .worst
            .first()
            .map_or_else(|| "-".into(), |worst| margin(worst.margin.0));
        let quantiles = one
            .quantiles
            .iter()
            .map(|QuantileAnswer { value, .. }| margin(value.0));
        let cells = [
            one.name.clone(),
            percent(one.holds),
            bounds(one.holds),
            worst,
        ]
        .into_iter();
        table.cells(
            cells
                .chain(quantiles)
                .chain([unit_shown(&one.unit).to_owned()]),
        );
        let strong = one.correlations.iter().filter(|(_, rho)| rho.abs() >= 0.1);
        let strong: Vec<String> = strong
            .map(|(name, rho)| format!("{name} {rho:+.2}"))
            .collect();
        if !strong.is_empty() {
            table.line(format!("    margin follows {}", strong.join(", ")));
        }
        for IndicesAnswer { name, indices } in &one.indices {
            let share = |value: f64, within: f64| format!("{} +- {}", short(value), short(within));
            table.line(format!(
                "    {name} explains {} of the variance alone, {} with its interactions",
                share(indices.first, indices.first_within),
                share(indices.total, indices.total_within)
            ));
        }
        if is_saltelli && one.indices.is_empty() && !one.is_rounding {
            table.line("    no Sobol' indices: they need a finite margin of every case, and margins that differ");
        }
        if one.is_rounding {
            table.line("    margin varies by rounding only");
        }
        if one.without > 0 {
            table.line(format!(
                "    {} without a margin",
                counted(one.without, "case")
            ));
        }
    }
    write!(text, "{table}")?;
    let worst = variant
        .requirements
        .iter()
        .filter_map(|one| Some((one.worst.first()?, one)));
    let worst = worst.filter(|(worst, _)| worst.margin.0 < 0.0);
    let mut listed: Vec<u64> = Vec::new();
    for (worst, one) in worst {
        if !listed.contains(&worst.case) {
            listed.push(worst.case);
            writeln!(
                text,
                "  worst of {}: hil campaign case {folder_text} {}",
                one.name, worst.case
            )?;
        }
    }
    writeln!(text)
}

fn margin(value: f64) -> String {
    if value.is_nan() {
        "-".into()
    } else {
        short(value)
    }
}

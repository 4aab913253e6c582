//! `[[stimuli]]`: reference signals and driven inputs of the plant, with their waveforms.

mod whole;

use std::collections::HashSet;
use std::path::Path;

use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::is_name;
use shared_types::number::exact as number;
use shared_types::table::{Field, unit_of_name};

use super::run::Grid;
use super::tables;
use super::waveforms;
use crate::document::Value;
use crate::keys::{SEQUENCE_KIND, WAVEFORMS};
use crate::plan::{PLANT_TARGET, Stimulus, Sweep, Waveform};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Returns the stimuli; `None` if one of them is faulty.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    (law, plant): (Option<&LawDescription>, Option<&PlantDescription>),
) -> Option<Vec<Stimulus>> {
    let sections = reader.list(root, "stimuli");
    let mut stimuli = Vec::new();
    let mut names: HashSet<String> = HashSet::new();
    for section in &sections {
        let stimulus = stimulus(reader, section, folder, grid, (law, plant));
        if let Some(stimulus) = &stimulus {
            whole::refuse_fractions(reader, section, stimulus, grid);
            let fields = stimulus.fields();
            let again = fields.iter().find(|field| names.contains(&field.name));
            if let Some(field) = again {
                let message = format!("two stimuli provide the reference signal `{}`", field.name);
                reader.report_at(section, "target", ProblemKind::Duplicate, message);
            }
            names.extend(fields.into_iter().map(|field| field.name));
        }
        stimuli.push(stimulus);
    }
    // A name means one signal: the one that has it as its own, or the first one that has it as an alias.
    let references = stimuli.iter_mut().flatten();
    for stimulus in references.filter(|stimulus| stimulus.input().is_none()) {
        stimulus.aliases.retain(|alias| names.insert(alias.clone()));
    }
    stimuli.into_iter().collect()
}

fn stimulus(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    (law, plant): (Option<&LawDescription>, Option<&PlantDescription>),
) -> Option<Stimulus> {
    if let Some(input) = input_of(section) {
        return of_input(reader, section, folder, grid, plant, input);
    }
    let target = target(reader, section, law);
    let needed = target.zip(law).and_then(|(target, law)| {
        let mut reference = law.reference.iter();
        reference.find(|field| field.is_called(target))
    });
    let unit = unit(reader, section, target, needed, law);
    let signal = tables::Signal {
        what: "a stimulus",
        name: target.unwrap_or_default(),
        unit: unit.as_deref(),
    };
    let waveform = waveform(reader, section, folder, grid, &signal);
    let names = needed.into_iter().flat_map(Field::names);
    Some(Stimulus {
        aliases: (names.filter(|name| Some(*name) != target))
            .map(Into::into)
            .collect(),
        target: target?.into(),
        unit: unit?,
        range: Stimulus::any_range(),
        is_whole: needed.is_some_and(|field| field.is_whole),
        waveform: waveform?,
    })
}

/// Returns the name after `plant.`, if the target is an input of the plant.
fn input_of<'a>(section: &Section<'a>) -> Option<&'a str> {
    match &section.table.get("target")?.node.value {
        Value::Text(target) => target.strip_prefix(PLANT_TARGET),
        _ => None,
    }
}

/// Returns the stimulus of an input of the plant; an unknown name is reported with all driven inputs.
fn of_input(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    plant: Option<&PlantDescription>,
    input: &str,
) -> Option<Stimulus> {
    let field =
        plant.and_then(|plant| (plant.commands.iter()).find(|field| field.is_called(input)));
    let signal = tables::Signal {
        what: "a stimulus",
        name: input,
        unit: field.map(|field| &*field.unit),
    };
    let waveform = waveform(reader, section, folder, grid, &signal);
    let (plant, field) = plant.zip(field)?;
    if section.table.get("unit").is_some() {
        let unit = reader.text(section, "unit")?;
        if unit != field.unit {
            let path = section.path_of("unit");
            let message = format!(
                "`{path}` is {unit}, but plant `{}` takes the input `{}` in {}",
                plant.name, field.name, field.unit
            );
            reader
                .report_at(section, "unit", ProblemKind::Mismatch, message)
                .help("leave out `unit`");
            return None;
        }
    }
    Some(Stimulus {
        target: format!("{PLANT_TARGET}{}", field.name),
        aliases: field.aliases.clone(),
        unit: field.unit.clone(),
        range: [field.min, field.max].map(|end| end.clamp(f64::MIN, f64::MAX)),
        is_whole: field.is_whole,
        waveform: waveform?,
    })
}

/// Returns the target: a name, or a reference signal of the law, whose name may have dots.
fn target<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    law: Option<&LawDescription>,
) -> Option<&'a str> {
    let target = reader.text(section, "target")?;
    let is_reference =
        |law: &LawDescription| (law.reference.iter()).any(|field| field.is_called(target));
    if is_name(target) || law.is_none_or(is_reference) {
        return Some(target);
    }
    let path = section.path_of("target");
    let message = format!("`{path}` is `{target}`");
    let references = law.into_iter().flat_map(|law| &law.reference);
    reader
        .report_at(section, "target", ProblemKind::OutOfRange, message)
        .expected("a name of letters, digits and _, for example surface_angle_rad, or a reference signal of the law")
        .nearest(target, references.flat_map(Field::names));
    None
}

/// Returns the unit: as given, or as expected by the law, or as implied by the name's suffix.
fn unit(
    reader: &mut Reader,
    section: &Section<'_>,
    target: Option<&str>,
    needed: Option<&Field>,
    law: Option<&LawDescription>,
) -> Option<String> {
    if section.table.get("unit").is_some() {
        return reader.text(section, "unit").map(Into::into);
    }
    let target = target?;
    let of_law = needed.map(|field| field.unit.clone());
    let unit = of_law.or_else(|| unit_of_name(target).map(Into::into));
    if unit.is_none() {
        let path = section.path_of("unit");
        let message = format!("the unit of `{target}` is not known from its name");
        reader
            .report(
                ProblemKind::MissingKey,
                path,
                section.place_of("target"),
                message,
            )
            .expected("a name that ends with its unit, or the key `unit`")
            .nearest(
                target,
                law.into_iter()
                    .flat_map(|law| law.reference.iter().map(|field| &*field.name)),
            );
    }
    unit
}

fn waveform(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    signal: &tables::Signal<'_>,
) -> Option<Waveform> {
    waveform_of(reader, section, folder, grid, signal, true)
}

/// Returns the waveform of a stimulus, or of a part of a sequence, which is no sequence itself.
fn waveform_of(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    signal: &tables::Signal<'_>,
    is_whole: bool,
) -> Option<Waveform> {
    let kinds = WAVEFORMS.iter().map(|kind| (kind.name, kind.keys));
    let kinds = kinds.filter(move |(name, _)| is_whole || *name != SEQUENCE_KIND);
    let (name, section) = &reader.of_kind(section, "stimulus", kinds)?;
    match *name {
        "square" => return waveforms::square(reader, section),
        "pulse" => {
            let at_s = reader.number(section, "at_s");
            let at_s = in_run(reader, section, at_s, grid);
            return waveforms::pulse(reader, section, at_s);
        }
        "prbs" => return waveforms::prbs(reader, section, grid),
        "multisine" => return waveforms::multisine(reader, section, grid),
        SEQUENCE_KIND => {
            let part = |reader: &mut Reader, part: &Section<'_>, grid: Option<Grid>| {
                waveform_of(reader, part, folder, grid, signal, false)
            };
            return waveforms::sequence(reader, section, grid, part);
        }
        _ => {}
    }
    // All numbers are read before a missing one is reported, so that every problem is.
    let mut number = |name| reader.number(section, name);
    let waveform = match *name {
        "paper" => {
            let (amplitude, frequency_hz) = (number("amplitude"), number("frequency_hz"));
            let onset_per_s3 = number("onset_per_s3");
            Waveform::Paper {
                amplitude: amplitude?,
                frequency_hz: frequency_hz?,
                onset_per_s3: onset_per_s3?,
            }
        }
        "step" => {
            let (at_s, before, after) = (number("at_s"), number("before"), number("after"));
            Waveform::Step {
                at_s: in_run(reader, section, at_s, grid)?,
                before: before?,
                after: after?,
            }
        }
        "ramp" => {
            let (at_s, duration_s) = (number("at_s"), number("duration_s"));
            let (start, end) = (number("start"), number("end"));
            Waveform::Ramp {
                at_s: in_run(reader, section, at_s, grid)?,
                duration_s: duration_s?,
                start: start?,
                end: end?,
            }
        }
        "sine" => {
            let (amplitude, frequency_hz) = (number("amplitude"), number("frequency_hz"));
            let (phase_rad, offset) = (number("phase_rad"), number("offset"));
            Waveform::Sine {
                amplitude: amplitude?,
                frequency_hz: frequency_hz?,
                phase_rad: phase_rad?,
                offset: offset?,
            }
        }
        "chirp" => {
            let (start_hz, end_hz) = (number("start_hz"), number("end_hz"));
            let (amplitude, duration_s) = (number("amplitude"), number("duration_s"));
            let offset = number("offset");
            let sweep = reader.text(section, "sweep");
            let (start_hz, end_hz) = (start_hz?, end_hz?);
            Waveform::Chirp {
                amplitude: amplitude?,
                start_hz,
                end_hz,
                duration_s: duration_s?,
                sweep: sweep_between(reader, section, sweep?, [start_hz, end_hz])?,
                offset: offset?,
            }
        }
        "table" => {
            let (table, _) = tables::check(reader, section, folder, grid, signal)?;
            Waveform::Table(table)
        }
        _ => unreachable!("every kind is read"),
    };
    Some(waveform)
}

/// Returns the sweep of this name; a logarithmic sweep needs a ratio of frequencies.
fn sweep_between(
    reader: &mut Reader,
    section: &Section<'_>,
    name: &str,
    [start_hz, end_hz]: [f64; 2],
) -> Option<Sweep> {
    let sweep = Sweep::ALL.into_iter().find(|sweep| sweep.name() == name)?;
    let has_ratio = start_hz > 0.0 && end_hz > 0.0 && start_hz != end_hz;
    if sweep == Sweep::Linear || has_ratio {
        return Some(sweep);
    }
    let path = section.path_of("sweep");
    let message = format!(
        "`{path}` is a logarithmic sweep from {} to {} Hz",
        number(start_hz),
        number(end_hz)
    );
    reader
        .report_at(section, "sweep", ProblemKind::OutOfRange, message)
        .expected("`start_hz` and `end_hz` above 0 that differ, or a linear sweep");
    None
}

/// Refuses a time after the end of the run, where it would have no effect.
fn in_run(
    reader: &mut Reader,
    section: &Section<'_>,
    at_s: Option<f64>,
    grid: Option<Grid>,
) -> Option<f64> {
    let at_s = at_s?;
    let Some(grid) = grid else {
        return Some(at_s);
    };
    let end_s = grid.end_s();
    if at_s <= end_s {
        return Some(at_s);
    }
    let path = section.path_of("at_s");
    let message = format!(
        "`{path}` is {}, which is after the end of the run",
        number(at_s)
    );
    reader
        .report_at(section, "at_s", ProblemKind::OutOfRange, message)
        .expected(format!("a time from 0 to {} in s", number(end_s)));
    None
}

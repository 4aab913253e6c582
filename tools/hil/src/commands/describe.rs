//! `hil describe FILE`: prints the description of a program or an FMU against which scenarios are checked, or the
//! tables and frames of a port file. A name in place of a file is a plant or a law of the programs next to `hil`.

mod port;

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use hil_config::plan::Permissions;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left};
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::host::is_port_file;
use hil_facts::programs::binaries::named::{CONTROLLER, Named, PLANT};
use hil_facts::programs::binaries::{Binary, Choices};
use serde_json::json;
use shared_types::describe::{
    Description, Imported, ImportedModule, LawDescription, LibraryNeeds, PlantDescription,
};
use shared_types::number::exact;
use shared_types::table::Field;

use crate::arguments::describe::{DescribeArguments, DescribedSide};

/// Runs the command.
///
/// # Errors
/// If the file is neither a sound port file nor a program or an FMU that can run on this machine.
pub(crate) fn describe(arguments: &DescribeArguments) -> Result<Exit, Failure> {
    if is_port_file(&arguments.file) {
        return port::describe(arguments);
    }
    let interruption = Interruption::listen()?;
    let role = match arguments.side {
        DescribedSide::Plant => &PLANT,
        DescribedSide::Controller => &CONTROLLER,
    };
    if let Some((program, description)) = built_in(&arguments.file, &interruption)? {
        let program = program.display().to_string();
        let result = json!({ "file": program, "description": description });
        return output::result(arguments.json, &result, || {
            output::text(|text| write_all(text, &program, &description))
        })
        .map(|()| Exit::Pass);
    }
    let permissions = Permissions {
        trust_archive: arguments.trust_archive,
        allow_execution_tool: arguments.allow_execution_tool,
    };
    let fmu = (permissions, arguments.load);
    let binary = Binary::described(&arguments.file, role, fmu, &interruption)?;
    let Binary {
        description,
        blake3,
        host,
        ..
    } = &binary;
    let file = arguments.file.display().to_string();
    let host = host.as_ref().map(|host| &host.blake3);
    let result = json!({
        "file": file,
        "blake3": blake3,
        "host_blake3": host,
        "description": description,
    });
    output::result(arguments.json, &result, || {
        output::text(|text| write_all(text, &file, description))
    })?;
    let library = (description.imported.as_ref()).and_then(|imported| imported.library.as_ref());
    match library.and_then(|library| library.refusal.as_ref()) {
        None => Ok(Exit::Pass),
        Some(reason) => Err(Failure::usage(format!(
            "{file}: the FMU's library cannot be loaded: {reason}"
        ))),
    }
}

/// Returns the plant or the laws of this name with their program, which is one of those next to `hil` or in their place;
/// `None` for the path of a file.
///
/// # Errors
/// If there is neither a file nor a plant or a law of this name.
fn built_in(
    name: &Path,
    interruption: &Interruption,
) -> Result<Option<(PathBuf, Description)>, Failure> {
    let is_name = name.components().count() == 1 && name.extension().is_none() && !name.exists();
    let Some(name) = name.to_str().filter(|_| is_name) else {
        return Ok(None);
    };
    let choices = Choices::of(&BinaryArguments::default(), &Named::Nothing, None)?;
    let binaries = choices.find(interruption)?;
    let [mut plant, mut controller] = [binaries.plant.clone(), binaries.controller.clone()];
    (plant.description.plants).retain(|one| one.name == name);
    (controller.description.laws).retain(|one| one.name == name);
    if !plant.description.plants.is_empty() {
        return Ok(Some((plant.path, plant.description)));
    }
    if !controller.description.laws.is_empty() {
        return Ok(Some((controller.path, controller.description)));
    }
    let (plants, laws, _) = binaries.described();
    let names: BTreeSet<String> = { plants.iter().map(|plant| &plant.name) }
        .chain(laws.iter().map(|law| &law.name))
        .map(|name| format!("`{name}`"))
        .collect();
    let names: Vec<String> = names.into_iter().collect();
    Err(Failure::usage(format!(
        "there is neither a file `{name}` nor a plant or a law of that name; there are {}",
        listed(&names)
    )))
}

type Written = std::fmt::Result;

fn write_all(text: &mut String, file: &str, description: &Description) -> Written {
    let Description {
        program,
        version,
        plants,
        laws,
        faults,
        imported,
        ..
    } = description;
    writeln!(text, "{file}: {program} {version}")?;
    if let Some(imported) = imported {
        write_format(text, imported)?;
    }
    for plant in plants {
        write_plant(text, plant)?;
    }
    for law in laws {
        write_law(text, law)?;
    }
    if let Some(imported) = imported {
        write_imported(text, imported, plants.is_empty())?;
    }
    let is_of_another_tool = imported.as_ref().is_some_and(|one| one.modules.is_empty());
    if !is_of_another_tool && !faults.is_empty() {
        let kinds: Vec<&str> = faults.iter().map(|fault| fault.kind.as_str()).collect();
        writeln!(
            text,
            "\nkinds of faults on signals and links: {}",
            kinds.join(", ")
        )?;
    }
    Ok(())
}

fn write_plant(text: &mut String, plant: &PlantDescription) -> Written {
    writeln!(text, "\nplant {}: {}", plant.name, plant.summary)?;
    writeln!(text, "  checkpoints: {}", yes(plant.saves))?;
    write_fields(text, "parameters", &plant.parameters)?;
    write_fields(text, "commands", &plant.commands)?;
    write_fields(text, "measured", &plant.measured)?;
    write_fields(text, "truth", &plant.truth)?;
    write_fields(text, "state", plant.state.as_deref().unwrap_or_default())?;
    for fault in &plant.faults {
        writeln!(text, "  fault {}: {}", fault.kind, fault.summary)?;
    }
    Ok(())
}

fn write_law(text: &mut String, law: &LawDescription) -> Written {
    let plants = match law.plants.is_empty() {
        true => "any plant".into(),
        false => law.plants.join(", "),
    };
    writeln!(text, "\nlaw {} for {plants}: {}", law.name, law.summary)?;
    writeln!(text, "  checkpoints: {}", yes(law.saves))?;
    write_fields(text, "parameters", &law.parameters)?;
    write_fields(text, "model", &law.model)?;
    write_fields(text, "measured", &law.measured)?;
    write_fields(text, "reference", &law.reference)?;
    match &law.commands {
        Some(commands) => write_fields(text, "commands", commands)?,
        None => writeln!(text, "  commands: those of the plant")?,
    }
    write_fields(text, "internals", &law.internals)?;
    write_fields(text, "state", law.state.as_deref().unwrap_or_default())
}

const fn yes(is_so: bool) -> &'static str {
    if is_so { "yes" } else { "no" }
}

fn write_fields(text: &mut String, title: &str, fields: &[Field]) -> Written {
    if fields.is_empty() {
        return Ok(());
    }
    writeln!(text, "  {title}: {}", fields.len())?;
    let longest = |of: fn(&Field) -> usize| fields.iter().map(of).max().unwrap_or_default() + 2;
    let name = longest(|field| field.name.len());
    let unit = longest(|field| field.unit.len());
    let mut table = Table::new(4, [left(name), left(unit), left(34), left(0)]);
    for field in fields {
        let Field {
            name,
            unit,
            description,
            ..
        } = field;
        let text = match field.aliases.is_empty() {
            true => description.clone(),
            false => format!("{description} Also {}.", field.aliases.join(", ")),
        };
        table.row(&[name, unit, &values(field), &text]);
    }
    write!(text, "{table}")
}

/// Formats default and range, if any, and whether `hil set` or a fault can change the value.
fn values(field: &Field) -> String {
    let mut parts = Vec::new();
    parts.extend(field.default.filter(|_| !field.is_optional).map(exact));
    if field.min.is_finite() || field.max.is_finite() {
        parts.push(format!("in {} to {}", exact(field.min), exact(field.max)));
    }
    if field.tunable || field.faultable {
        parts.push("tunable".into());
    }
    parts.join(" ")
}

fn write_format(text: &mut String, imported: &Imported) -> Written {
    let Imported { format, tool, .. } = imported;
    match tool.as_str() {
        "" => writeln!(text, "{format}")?,
        tool => writeln!(text, "{format}, made by {tool}")?,
    }
    if let Some(step_s) = imported.internal_step_s {
        writeln!(
            text,
            "advances in steps of {} s; the period of a run must be a multiple of this",
            exact(step_s)
        )?;
    }
    Ok(())
}

fn write_imported(text: &mut String, imported: &Imported, is_law: bool) -> Written {
    let direct = match is_law {
        true => "the sample of the same step, and the internal states lead by one period",
        false => "the command of the previous step",
    };
    if !imported.direct.is_empty() {
        writeln!(
            text,
            "\noutputs with direct feedthrough, which reflect {direct}:"
        )?;
    }
    for direct in &imported.direct {
        writeln!(text, "  {} on {}", direct.output, direct.inputs.join(", "))?;
    }
    if !imported.locals.is_empty() {
        let names = imported.locals.join(", ");
        writeln!(
            text,
            "\nlocal signals, part of the truth on request (`plant.locals`):\n  {names}"
        )?;
    }
    if !imported.initial.is_empty() {
        let names = imported.initial.join(", ");
        writeln!(
            text,
            "\ninitial values that can be set, besides those of inputs (`plant.initial`):\n  {names}"
        )?;
    }
    if !imported.units.is_empty() {
        writeln!(text, "\nunits as the model defines them:")?;
    }
    for unit in &imported.units {
        let (factor, offset) = (exact(unit.factor), exact(unit.offset));
        writeln!(text, "  {} = {factor} {} + {offset}", unit.name, unit.base)?;
    }
    if !imported.left_out.is_empty() {
        writeln!(text, "\nleft out:")?;
    }
    for left_out in &imported.left_out {
        writeln!(text, "  {}: {}", left_out.name, left_out.reason)?;
    }
    if !imported.notes.is_empty() {
        writeln!(text, "\nerrors in the model description:")?;
    }
    for note in &imported.notes {
        writeln!(text, "  {note}")?;
    }
    if !imported.modules.is_empty() {
        writeln!(text, "\nimported modules:")?;
    }
    for module in &imported.modules {
        let ImportedModule {
            name,
            version,
            blake3,
        } = module;
        let version = if version.is_empty() { "-" } else { version };
        writeln!(text, "  {name} {version} {blake3}")?;
    }
    match &imported.library {
        Some(library) => write_library(text, library),
        None => Ok(()),
    }
}

fn write_library(text: &mut String, library: &LibraryNeeds) -> Written {
    writeln!(text, "\nthe library needs: {}", listed(&library.needs))?;
    writeln!(
        text,
        "missing libraries: {}",
        listed(&library.lacks_libraries)
    )?;
    writeln!(
        text,
        "undefined symbols: {}",
        listed(&library.lacks_symbols)
    )
}

fn listed(names: &[String]) -> String {
    match names.is_empty() {
        true => "none".into(),
        false => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_shows_whether_it_can_change_during_a_run() {
        for (tunable, faultable, expected) in [
            (false, false, "in 0 to 2"),
            (true, false, "in 0 to 2 tunable"),
            (false, true, "in 0 to 2 tunable"),
        ] {
            let field = Field {
                min: 0.0,
                max: 2.0,
                tunable,
                faultable,
                ..Field::signal("gain", "1", "A gain.")
            };
            assert_eq!(values(&field), expected);
        }
    }
}

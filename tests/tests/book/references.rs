//! References of the book, `docs/reference`, generated from the code.
//!
//! `HIL_WRITE_BOOK=1 cargo test --release -p tests book::references` regenerates them.

use std::fmt::Write as _;

use clap::CommandFactory;
use hil::CommandLine;
use serde_json::Value;
use shared_types::describe::{ActsOn, FaultDescription, ProfileDescription};
use shared_types::number::exact as number;
use shared_types::table::Field;

use crate::support::programs::{demanded, workspace};

const MADE: &str = "<!-- Made from the code: `HIL_WRITE_BOOK=1 cargo test --release -p tests book::references` writes it anew. -->\n";
const EXITS: &str = include_str!("../../../tools/console/src/terminal/exit.rs");

#[test]
fn the_references_agree_with_the_code() {
    let pages = [
        ("commands", commands()),
        ("scenario", scenario()),
        ("study", study()),
        ("port", port()),
        ("signals", signals()),
        ("faults", faults()),
        ("exit-codes", exit_codes()),
    ];
    let mut stale = Vec::new();
    for (name, text) in pages {
        let path = workspace().join(format!("docs/reference/{name}.md"));
        if demanded("HIL_WRITE_BOOK") {
            std::fs::write(&path, &text).expect("the book can be written");
        }
        if std::fs::read_to_string(&path).unwrap_or_default() != text {
            stale.push(path);
        }
    }
    let renew = "HIL_WRITE_BOOK=1 cargo test --release -p tests book::references";
    assert!(stale.is_empty(), "{stale:?} are stale; `{renew}`");
}

/// Generates the page of all commands with their help, as `hil` prints it on a terminal of 100 columns.
fn commands() -> String {
    let mut page = format!("# Commands\n\n{MADE}\n");
    let mut hil = CommandLine::command().term_width(100);
    hil.build();
    command(&mut page, &mut hil, "hil");
    page.truncate(page.trim_end().len());
    page + "\n"
}

fn command(page: &mut String, one: &mut clap::Command, name: &str) {
    let help = one.render_long_help().to_string();
    let help: String = help
        .lines()
        .map(|line| line.trim_end().to_owned() + "\n")
        .collect();
    write!(page, "## `{name}`\n\n```text\n{}\n```\n\n", help.trim_end()).expect("text");
    let seen = |one: &&mut clap::Command| !one.is_hide_set() && one.get_name() != "help";
    for inner in one.get_subcommands_mut().filter(seen) {
        let name = format!("{name} {}", inner.get_name());
        command(page, inner, &name);
    }
}

/// Generates the page of all scenario keys, from the tables used by the check and `hil config schema`.
fn scenario() -> String {
    let mut page = format!(
        "# Scenario keys\n\n{MADE}\nA scenario is TOML. `hil config schema` prints the same for editors, with the keys of \
         plants and laws; those are under [Plants and laws](signals.md), those of faults under [Kinds of faults](faults.md). \
         `hil config show` prints a scenario with every default.\n\n"
    );
    let schema = hil_config::schema::schema(&[], &[], &[]);
    section(&mut page, "The file", "", &schema);
    page.truncate(page.trim_end().len());
    page + "\n"
}

/// Generates the page of all study keys, from the table used by `hil campaign check`.
fn study() -> String {
    let mut page = format!(
        "# Study keys\n\n{MADE}\nA study is TOML; [Campaigns](../campaigns.md) shows one. `hil config schema --study` prints \
         the same for editors.\n\n"
    );
    section(&mut page, "The file", "", &hil_config::schema::study());
    page.truncate(page.trim_end().len());
    page + "\n"
}

/// Generates the page of all keys of port files, from the table used by `hil describe`.
fn port() -> String {
    let mut page = format!(
        "# Port keys\n\n{MADE}\nA port file is TOML; [Ports](../ports.md) shows one with every kind of field.\n\n"
    );
    section(&mut page, "The file", "", &hil_config::schema::port());
    page.truncate(page.trim_end().len());
    page + "\n"
}

fn section(page: &mut String, title: &str, path: &str, table: &Value) {
    write!(page, "## {title}\n\n").expect("text");
    if let Some(kinds) = table["oneOf"].as_array() {
        for kind in kinds {
            let name = kind["properties"]["kind"]["const"]
                .as_str()
                .unwrap_or_default();
            let text = kind["description"].as_str().unwrap_or_default();
            write!(page, "### `kind = \"{name}\"`\n\n{text}\n\n").expect("text");
            rows(page, kind);
        }
        return;
    }
    rows(page, table);
    for (key, value) in table["properties"].as_object().into_iter().flatten() {
        let path = if path.is_empty() {
            key.clone()
        } else {
            format!("{path}.{key}")
        };
        let items = &value["items"];
        if items["properties"].is_object() || items["oneOf"].is_array() {
            section(page, &format!("`[[{path}]]`"), &path, items);
        } else if value["properties"].is_object() {
            section(page, &format!("`[{path}]`"), &path, value);
        }
    }
}

fn rows(page: &mut String, table: &Value) {
    page.push_str("| key | takes | default | meaning |\n|---|---|---|---|\n");
    let required: Vec<&str> = (table["required"].as_array().into_iter().flatten())
        .filter_map(Value::as_str)
        .collect();
    for (key, value) in table["properties"].as_object().into_iter().flatten() {
        let text = value["description"].as_str().unwrap_or_default();
        let (text, expected) = text.split_once(" Expected: ").unwrap_or((text, ""));
        let takes = match (value["const"].as_str(), value["enum"].as_array(), expected) {
            (Some(name), ..) => format!("`{name}`"),
            (_, Some(choices), _) => {
                let choices: Vec<String> = (choices.iter().filter_map(Value::as_str))
                    .map(|choice| format!("`{choice}`"))
                    .collect();
                choices.join(", ")
            }
            (.., "") => kind(value).into(),
            (.., expected) => expected.trim_end_matches('.').into(),
        };
        let default = match &value["default"] {
            Value::Null if required.contains(&key.as_str()) => "required".into(),
            Value::Null => String::new(),
            default => format!("`{}`", default.to_string().trim_matches('"')),
        };
        writeln!(page, "| `{key}` | {takes} | {default} | {} |", cell(text)).expect("text");
    }
    page.push('\n');
}

fn kind(value: &Value) -> &'static str {
    match value["type"].as_str() {
        Some("string") => "text",
        Some("boolean") => "`true`, `false`",
        Some("object") => "a table",
        Some("array") if value["maxItems"] == 2 => "two numbers",
        Some("array") if value["items"]["type"] == "number" => "numbers",
        Some("array") if value["items"]["type"] == "array" => "pairs of numbers",
        Some("array") => "tables",
        _ if value["anyOf"].is_array() => "text or a table",
        _ => "text or a number",
    }
}

/// Generates the page of the descriptions of built-in plants and laws.
fn signals() -> String {
    let mut page = format!(
        "# Plants and laws\n\n{MADE}\nWhat `plant-process --describe` and `controller-process --describe` say. A parameter with a \
         star can be moved by faults, as `parameter.NAME`. Of a group, such as `actuator1.piston_mass_kg`, a scenario may \
         give the last part alone and set both.\n\n"
    );
    for plant in plant_process::models::all() {
        let plant = plant.description;
        write!(page, "## Plant `{}`\n\n{}\n\n", plant.name, plant.summary).expect("text");
        parameters(
            &mut page,
            "Parameters, `[plant.parameters]`",
            &plant.parameters,
        );
        columns(
            &mut page,
            "Truth; a range is a limit of validity, `[plant.limits]`",
            &plant.truth,
        );
        columns(&mut page, "Measured", &plant.measured);
        columns(&mut page, "Commands", &plant.commands);
    }
    for law in controller_process::laws::all() {
        let law = law.description;
        let plants = match law.plants.as_slice() {
            [] => "any plant".into(),
            plants => plants
                .iter()
                .map(|plant| format!("`{plant}`"))
                .collect::<Vec<_>>()
                .join(", "),
        };
        let name = &law.name;
        write!(page, "## Law `{name}` for {plants}\n\n{}\n\n", law.summary).expect("text");
        parameters(
            &mut page,
            &format!("Parameters, `[controller.{name}]`"),
            &law.parameters,
        );
        parameters(
            &mut page,
            "Beliefs about the plant, `[controller.model]`",
            &law.model,
        );
        columns(&mut page, "Measured", &law.measured);
        columns(&mut page, "Reference", &law.reference);
        columns(
            &mut page,
            "Commands",
            law.commands.as_deref().unwrap_or_default(),
        );
        columns(&mut page, "Internals", &law.internals);
    }
    page.truncate(page.trim_end().len());
    page + "\n"
}

fn parameters(page: &mut String, title: &str, fields: &[Field]) {
    let own = |field: &Field| {
        let star = if field.faultable { " *" } else { "" };
        let default = match field.default {
            _ if field.is_optional => String::new(),
            default => default.map_or("required".into(), number),
        };
        (star, format!(" {default} |"))
    };
    list(page, title, (" default |", "---|"), fields, own);
}

fn columns(page: &mut String, title: &str, fields: &[Field]) {
    list(page, title, ("", ""), fields, |_| ("", String::new()));
}

/// Formats a list of fields; `own` returns the text after a field's name, and further cells.
fn list(
    page: &mut String,
    title: &str,
    (head, line): (&str, &str),
    fields: &[Field],
    own: impl Fn(&Field) -> (&'static str, String),
) {
    if fields.is_empty() {
        return;
    }
    *page += &format!(
        "{title}:\n\n| name | unit |{head} range | what it is |\n|---|---|{line}---|---|\n"
    );
    for field in fields {
        let (Field { name, unit, .. }, (star, cells)) = (field, own(field));
        let (range, description) = (range(field), cell(&field.description));
        *page += &format!("| `{name}`{star} | {unit} |{cells} {range} | {description} |\n");
    }
    page.push('\n');
}

fn range(field: &Field) -> String {
    if field.min <= f64::MIN && field.max >= f64::MAX {
        return String::new();
    }
    format!("{} to {}", number(field.min), number(field.max))
}

/// Escapes text for a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// Generates the page of all fault kinds, each with a link to its full description.
fn faults() -> String {
    let mut page = format!(
        "# Kinds of faults\n\n{MADE}\nThe built-in kinds act on any plant: on its signals, its faultable parameters, the link and \
         the time of both sides. [Faults](../faults.md) tells each in full; `hil inject --list` shows what is possible with \
         the plant at hand, your own included.\n\n| kind | acts on | keys | what it does |\n|---|---|---|---|\n"
    );
    for kind in plant_process::faults::kinds::all() {
        let kind = kind.description;
        let acts_on = match kind.acts_on {
            ActsOn::Signals => "signals",
            ActsOn::Numbers => "signals, parameters",
            ActsOn::Links => "`link.sample`, `link.command`",
            ActsOn::Sides => "`controller`, `plant`",
            ActsOn::Controller => "`controller`",
        };
        let list = kind.list.iter().map(|list| list.key.clone());
        let keys = kind
            .parameters
            .iter()
            .map(|field| field.name.clone())
            .chain(list);
        let keys: Vec<String> = keys.map(|key| format!("`{key}`")).collect();
        let (name, summary) = (&kind.kind, cell(&kind.summary));
        writeln!(
            page,
            "| [`{name}`](../faults.md#{name}) | {acts_on} | {} | {summary} |",
            keys.join(", ")
        )
        .expect("text");
    }
    for plant in plant_process::models::all() {
        let plant = plant.description;
        write!(page, "\n## Of the plant `{}`\n\n", plant.name).expect("text");
        page.push_str("| kind | keys | equation | what it does |\n|---|---|---|---|\n");
        for fault in &plant.faults {
            let FaultDescription {
                kind,
                summary,
                equation,
                ..
            } = fault;
            let kind = if plant.name == "drhas" {
                format!("[`{kind}`](../faults-drhas.md#{kind})")
            } else {
                format!("`{kind}`")
            };
            let (summary, equation) = (cell(summary), cell(equation));
            writeln!(
                page,
                "| {kind} | {} | `{equation}` | {summary} |",
                sizes(fault)
            )
            .expect("text");
        }
    }
    page
}

/// Formats the keys of an effect of a plant's fault.
fn sizes(fault: &FaultDescription) -> String {
    let speed = match &fault.profile {
        ProfileDescription::Exponential { speed } => Some(speed),
        ProfileDescription::Step => None,
    };
    let sizes = fault.sizes.iter().chain(speed);
    let names = fault.selector.iter().chain(sizes.map(|size| &size.name));
    names
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Returns the exit codes of `hil`, from the lines of their enum.
fn exit_codes() -> String {
    let mut page = format!("# Exit codes\n\n{MADE}\n| code | name | |\n|---|---|---|\n");
    let (_, codes) = EXITS.split_once("pub enum Exit {").expect("the enum");
    let (codes, _) = codes.split_once("\n}").expect("its end");
    let mut meaning = String::new();
    for line in codes.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("///") {
            meaning.push_str(text);
        } else if let Some((name, code)) = line.trim_end_matches(',').split_once(" = ") {
            writeln!(page, "| {code} | {} |{meaning} |", name.to_lowercase()).expect("text");
            meaning.clear();
        }
    }
    #[rustfmt::skip] // a table
    let process = [
        (hil_session::program::COMPLETED, "completed"),
        (hil_session::program::DIVERGED, "the plant left its range of validity"),
        (hil_session::program::UNUSABLE, "a job that cannot be run as it is"),
        (hil_session::program::FAILED, "the run ended otherwise; the log has the reason"),
    ];
    page.push_str("\nA plant or controller process, yours included:\n\n| code | |\n|---|---|\n");
    for (code, meaning) in process {
        writeln!(page, "| {code} | {meaning} |").expect("text");
    }
    page
}

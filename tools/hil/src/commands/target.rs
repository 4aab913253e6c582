//! `hil target`: checks and cleans the machines on which controllers run, and listens on such a machine.

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left};
use hil_facts::programs::binaries::reached::{Reached, failed};
use hil_session::program;
use hil_target::machine::Findings;
use hil_target::programs::no_room;
use hil_target::{key, serve};
use serde::Serialize;

use crate::arguments::target::{ServeArguments, TargetAction, TargetContact};

/// Number of round trips measured by a check.
const TRIPS: u32 = 200;
/// Maximum share of a step that a round trip may take at the highest suitable rate.
const SHARE: f64 = 0.5;

/// Result of a check.
#[derive(Serialize)]
struct Checked<'a> {
    schema: u32,
    target: String,
    #[serde(flatten)]
    findings: &'a Findings,
    /// Round trip of a message through the connection.
    round_trip_ns: Trips,
    /// Highest rate at which the 99th percentile of the round trips takes half a step.
    fit_for_hz: f64,
}

#[derive(Serialize)]
struct Trips {
    p50: u64,
    p99: u64,
}

/// Executes an action on a target.
///
/// # Errors
/// If the target or a file cannot be used.
pub(super) fn target(action: &TargetAction) -> Result<Exit, Failure> {
    match action {
        TargetAction::Check(contact) => check(contact),
        TargetAction::Clean(contact) => clean(contact),
        TargetAction::Key { file } => {
            key::make_key(file).map_err(Failure::usage)?;
            tell!(
                "{}: a key that only you can read; copy it to the target",
                file.display()
            );
            Ok(Exit::Pass)
        }
        TargetAction::Serve(arguments) => listen(arguments),
    }
}

fn reach(contact: &TargetContact, interruption: &Interruption) -> Result<Reached, Failure> {
    let reached = Reached::by(&contact.arguments(), f64::INFINITY, interruption)?;
    reached.ok_or_else(|| Failure::usage("no target was named"))
}

fn check(arguments: &TargetContact) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let reached = reach(arguments, &interruption)?;
    let contact = reached.contact(&interruption)?;
    let mut trips = contact
        .round_trips(TRIPS, &|| interruption.came())
        .map_err(failed)?;
    trips.sort_unstable();
    let at = |share: f64| trips[((trips.len() - 1) as f64 * share) as usize];
    let findings = reached.findings();
    if let Some(free) = findings.cache_free_bytes {
        let needed = reached.agent_bytes()?;
        if free < needed {
            let target = reached.target();
            let why = no_room(needed, free);
            return Err(Failure::infrastructure(format!("target {target}: {why}")));
        }
    }
    let checked = Checked {
        schema: 1,
        target: reached.target().to_string(),
        findings,
        round_trip_ns: Trips {
            p50: at(0.5),
            p99: at(0.99),
        },
        fit_for_hz: (SHARE * 1e9 / at(0.99) as f64).floor(),
    };
    if arguments.json {
        output::write(&output::pretty(&checked)?)?;
        return Ok(Exit::Pass);
    }
    let mut table = Table::new(0, [left(0), left(0)]);
    let free = findings.free_bytes.unwrap_or(0) >> 20;
    let priority = match findings.most_priority {
        0 => "none: the loop runs with ordinary scheduling".into(),
        most => format!("real-time priorities up to {most}"),
    };
    let trip = &checked.round_trip_ns;
    for (name, value) in [
        ("target", checked.target.clone()),
        ("host", findings.host.clone()),
        (
            "machine",
            format!("{}, {} cores", findings.machine, findings.cores),
        ),
        ("kernel", findings.kernel.clone()),
        ("shared memory", format!("{free} MiB free in /dev/shm")),
        (
            "programs",
            match findings.cache_free_bytes {
                Some(free) => format!("room for {} MiB in the cache folder", free >> 20),
                None => "those listed when the agent was started".into(),
            },
        ),
        ("scheduling", priority),
        (
            "round trip",
            format!(
                "p50 {}, p99 {} through the connection; datagrams take less",
                shown_ns(trip.p50),
                shown_ns(trip.p99)
            ),
        ),
        (
            "fit for",
            format!(
                "real time up to {} Hz, where half a step remains at p99",
                checked.fit_for_hz
            ),
        ),
    ] {
        table.row(&[&name, &value]);
    }
    output::write(&table.to_string())?;
    Ok(Exit::Pass)
}

fn clean(arguments: &TargetContact) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let contact = reach(arguments, &interruption)?.contact(&interruption)?;
    let files = contact.clean(&|| interruption.came()).map_err(failed)?;
    output::write(&if arguments.json {
        format!("{}\n", serde_json::json!({ "schema": 1, "removed": files }))
    } else {
        format!("{files} programs removed\n")
    })?;
    Ok(Exit::Pass)
}

fn listen(arguments: &ServeArguments) -> Result<Exit, Failure> {
    let ServeArguments {
        listen,
        key_file,
        allow,
    } = arguments;
    serve::serve(*listen, key_file, allow, program::say).map_err(Failure::usage)?;
    Ok(Exit::Pass)
}

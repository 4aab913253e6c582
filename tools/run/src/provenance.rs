//! Provenance of a run in its recording: scenario, programs, machine and origin.

use std::collections::BTreeMap;
use std::path::Path;

use hil_config::plan::Plan;
use hil_facts::programs::binaries::named::{LOCALS, MODEL_SETTINGS, PERMISSIONS};
use hil_facts::programs::binaries::{Binaries, seal};
use hil_facts::programs::scenario::ScenarioFile;
use hil_facts::results::summary::BY_HAND;
use hil_facts::results::target::Target;
use hil_session::session::SessionInfo;
use shared_types::describe::{Description, PROTOCOL};
use shared_types::side::Side;

use super::settings::Settings;
use hil_recording::reader::EXCERPT;
use hil_recording::writer::{Attachment, Provenance};

/// Collects the facts about a run that its recording contains.
pub(super) fn of(
    plan: &Plan,
    session: &SessionInfo,
    binaries: &Binaries,
    settings: &Settings,
    effective: &str,
    started_utc: &str,
) -> Provenance {
    let mut facts = BTreeMap::new();
    let mut fact = |name: &str, value: String| facts.insert(name.to_owned(), value);
    fact("scenario", plan.name.clone());
    for (name, content) in settings.scenario_file.iter().flat_map(ScenarioFile::facts) {
        fact(name, content);
    }
    fact("session", session.name.clone());
    fact("session_id", format!("{:016x}", session.id));
    let evidence = settings.evidence(plan, binaries);
    fact("evidence", evidence.into());
    let by_hand: Vec<&str> = settings.by_hand.roles().map(Side::name).collect();
    if !by_hand.is_empty() {
        fact(BY_HAND, by_hand.join(" "));
    }
    for (name, content) in Target::of(&binaries.controller)
        .iter()
        .flat_map(Target::facts)
    {
        fact(name, content);
    }
    fact("seed", plan.run.seed.to_string());
    fact("rate_hz", plan.run.rate.hz().to_string());
    fact("steps", plan.run.steps.to_string());
    fact("protocol", PROTOCOL.to_string());
    fact("hil_version", env!("CARGO_PKG_VERSION").into());
    fact("hil_commit", hil_facts::programs::own::commit().into());
    let (plant, controller) = (&binaries.plant, &binaries.controller);
    let mut is_one_named = false;
    for (side, program) in [("plant", plant), ("controller", controller)] {
        fact(&format!("{side}_blake3"), program.blake3.clone());
        if let Some(host) = &program.host {
            fact(&format!("{side}_host_blake3"), host.blake3.clone());
        }
        if let Some(build) = &program.description.build {
            fact(&format!("{side}_build"), build.to_string());
        }
        if let Some(path) = program.named().and_then(Path::to_str) {
            fact(&format!("{side}_binary"), path.into());
            is_one_named = true;
        }
    }
    let programs = binaries.programs();
    let of_models = [programs.plant_settings, programs.controller_settings];
    if of_models.iter().any(|one| one.given().next().is_some()) {
        fact(MODEL_SETTINGS, serde_json::json!(of_models).to_string());
    }
    let locals = programs.locals;
    if !locals.is_empty() {
        fact(LOCALS, serde_json::json!(locals).to_string());
    }
    let permissions: Vec<String> = [("plant", plant), ("controller", controller)]
        .into_iter()
        .flat_map(|(side, binary)| {
            let keys = binary.permissions().given();
            keys.map(move |key| format!("{side}.{key}"))
        })
        .collect();
    if !permissions.is_empty() {
        fact(PERMISSIONS, serde_json::json!(permissions).to_string());
    }
    let host = rustix::system::uname();
    fact("host", host.nodename().to_string_lossy().into_owned());
    let kernel = format!(
        "{} {}",
        host.release().to_string_lossy(),
        host.version().to_string_lossy()
    );
    fact("kernel", kernel);
    fact("machine", host.machine().to_string_lossy().into_owned());
    let cores = std::thread::available_parallelism().map_or(0, std::num::NonZero::get);
    fact("cores", cores.to_string());
    for (name, finding) in hil_doctor::facts() {
        fact(&name, finding);
    }
    fact("started_utc", started_utc.into());
    let connections = &plan.controller.connections;
    if !connections.is_empty() {
        fact("connections", serde_json::json!(connections).to_string());
    }
    if !settings.set.is_empty() {
        fact("set", serde_json::json!(settings.set).to_string());
    }
    if is_one_named && let Err(why) = seal::seal(&mut facts) {
        tell!(
            "note: the recording cannot be marked as this user's ({why}), so `hil rerun` will ask for its programs"
        );
    }
    if let Some(recording) = settings
        .recording
        .as_ref()
        .filter(|one| !one.choice.is_all())
    {
        facts.insert(EXCERPT.into(), recording.choice.describe());
    }
    let attachment = |name, media_type, text| Attachment {
        name,
        media_type,
        text,
    };
    let json = |name, value: &Description| {
        let text = serde_json::to_string_pretty(value).unwrap_or_default();
        attachment(name, "application/json", text)
    };
    let attachments = vec![
        attachment("scenario.toml", "application/toml", effective.into()),
        json("plant-description.json", &plant.description),
        json("controller-description.json", &controller.description),
    ];
    Provenance { facts, attachments }
}

//! A plant and a law in lockstep over any link: the plant in this thread, the law in another.

use std::path::Path;

use controller_process::runner::{Runner, choose};
use hil_config::plan::Plan;
use hil_config::scenario::Scenario;
use plant_process::engine::Engine;
use plant_process::faults::kinds;
use shared_types::digest::Digest;
use shared_types::link::{Link, LinkError};
use shared_types::record::{Event, Outcome, RecordLayout};
use shared_types::stream::RecordSink;
use hil_session::supervision::Supervision;
use shared_types::wait::WaitLimit;
use hil_session::waiter::Waiter;

const WAIT_LIMIT_S: f64 = 20.0;

/// Runs a scenario with the built-in plants and laws and returns its digest.
///
/// # Errors
/// All problems of the scenario, or the reason why the run did not complete.
pub fn run<P: Link, C: Link>(
    scenario: &Path,
    session: u64,
    plant: P,
    opens: impl FnOnce() -> Result<C, LinkError> + Send + 'static,
) -> Result<String, String> {
    let plan = plan(scenario)?;
    let job = controller_job(&plan, session);
    let law = std::thread::spawn(move || -> Result<(), String> {
        let laws = controller_process::laws::all();
        let law = choose(&laws, &job.law, &job.plant).map_err(|e| e.to_string())?;
        let link = opens().map_err(|e| e.to_string())?;
        let mut runner = Runner::new(law, job, link).map_err(|e| e.to_string())?;
        controller_process::program::drive(&mut runner, waiter(), &Supervision::new())
            .map_err(|e| e.to_string())
    });

    let mut digest = Digest::default();
    let sink = Digesting {
        digest: &mut digest,
        hashed_words: 0,
    };
    let plants = plant_process::models::all();
    let mut plants = plants.iter();
    let kind = plants.find(|kind| kind.description.name == plan.plant.model);
    let kind = kind.ok_or("no such plant")?;
    let job = plant_process::job::Job::of(&plan, session, WAIT_LIMIT_S);
    let engine = Engine::new(kind, &kinds::all(), job, plant, sink);
    let mut engine = engine.map_err(|e| e.to_string())?;
    plant_process::program::drive(&mut engine, waiter(), &Supervision::new())
        .map_err(|e| e.to_string())?;
    let end = engine.end().cloned();
    drop(engine);
    law.join().map_err(|_| "the law panicked")??;
    match end {
        Some(end) if end.outcome == Outcome::Completed => Ok(digest.finish()),
        end => Err(format!("the run did not complete: {end:?}")),
    }
}

fn waiter() -> Waiter {
    Waiter::new(WaitLimit::from_seconds(WAIT_LIMIT_S))
}

fn plan(scenario: &Path) -> Result<Plan, String> {
    let plants: Vec<_> = (plant_process::models::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    let laws: Vec<_> = (controller_process::laws::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    let kinds: Vec<_> = (kinds::all().into_iter())
        .map(|kind| kind.description)
        .collect();
    Scenario::read(scenario)
        .and_then(|scenario| scenario.check(&plants, &laws, &kinds))
        .map_err(|problems| problems.to_string())
}

fn controller_job(plan: &Plan, session: u64) -> controller_process::job::Job {
    let (run, controller) = (&plan.run, &plan.controller);
    let (plant, law) = (&controller.made_for, &controller.law);
    controller_process::job::Job {
        parameters: controller.parameters.clone(),
        model: controller.model.clone(),
        connections: controller.connections.clone(),
        rate_divisor: controller.rate_divisor,
        command_delay_steps: controller.command_delay_steps,
        ..controller_process::job::Job::new(session, plant, law, run.rate, WAIT_LIMIT_S)
    }
}

/// Record stream that ends here: each record is only added to the digest.
struct Digesting<'a> {
    digest: &'a mut Digest,
    hashed_words: usize,
}

impl RecordSink for Digesting<'_> {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.hashed_words = layout.hashed_words();
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.digest.record(&words[..self.hashed_words]);
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.digest.event(event);
        Ok(())
    }
}

//! The plant's step and each law's step alone, in one thread.
//!
//! The paper's scenario is closed by hand once for each law, and every row is kept. Then the plant
//! is given the same commands and the law the same samples again, without anything in between.

use std::hint::black_box;

use controller_process::controller::{Law, LawKind, Row, Start};
use controller_process::runner::choose;
use hil_config::plan::{Plan, Stimulus};
use hil_config::scenario::Scenario;
use plant_process::faults::{FaultLayer, FaultWorkshop};
use plant_process::plant::{Model, PlantKind};
use plant_process::stimulus;
use serde_json::json;
use shared_types::clock::monotonic_ns;
use shared_types::record::RecordLayout;
use shared_types::time::{Interval, Step};

use crate::measure::{Bystanders, machine, median};
use crate::{ROUNDS, scenario};

/// One run, closed by hand.
struct Experiment {
    plan: Plan,
    plant: PlantKind,
    law: LawKind,
}

/// What went between plant and law, row after row.
#[derive(Default)]
struct Rows {
    measured: Vec<f64>,
    reference: Vec<f64>,
    command: Vec<f64>,
}

/// The plant with what the engine calls around it.
struct Rig {
    model: Box<dyn Model>,
    faults: FaultLayer,
    truth: Vec<f64>,
}

impl Experiment {
    fn new(law: &str) -> Self {
        let plants = plant_process::models::all();
        let laws = controller_process::laws::all();
        let described_plants: Vec<_> = plants.iter().map(|k| k.description.clone()).collect();
        let described_laws: Vec<_> = laws.iter().map(|k| k.description.clone()).collect();
        let plan = (Scenario::read(scenario()).expect("a scenario"))
            .set(&[format!("controller.law={law}")])
            .check(&described_plants, &described_laws, &[])
            .unwrap_or_else(|problems| panic!("{problems}"));
        let model = &plan.plant.model;
        choose(&laws, law, model).expect("a law of the plant");
        let suits = |kind: &LawKind| {
            let plants = &kind.description.plants;
            kind.description.name == law && (plants.is_empty() || plants.contains(model))
        };
        Self {
            plant: (plants
                .into_iter()
                .find(|kind| kind.description.name == *model))
            .expect("the scenario's plant"),
            law: laws.into_iter().find(suits).expect("the scenario's law"),
            plan,
        }
    }

    fn rig(&self) -> Rig {
        let parameters = &self.plan.plant.parameters;
        let description = &self.plant.description;
        let rate = self.plan.run.rate;
        let stimuli = &self.plan.stimuli;
        let reference: Vec<_> = stimuli.iter().flat_map(Stimulus::fields).collect();
        let seeded = (rate, self.plan.run.seed);
        let workshop = FaultWorkshop::new(description, &reference, &[], parameters, seeded, &[]);
        let workshop = workshop.expect("the plant's parameters");
        let faults = FaultLayer::new(&workshop, &self.plan.faults);
        let mut faults = faults.expect("the scenario's faults");
        let opened = faults.open(&workshop, &RecordLayout::default());
        opened.expect("no conditions");
        Rig {
            model: (self.plant.start)(parameters).expect("starts"),
            faults,
            truth: vec![0.0; description.truth.len()],
        }
    }

    fn law(&self) -> Box<dyn Law> {
        let start = Start {
            parameters: &self.plan.controller.parameters,
            model: &self.plan.controller.model,
            period_s: self.plan.run.rate.period_s(),
            commands: &self.plant.description.commands,
        };
        (self.law.start)(&start).expect("starts")
    }

    fn time_s(&self, step: u64) -> f64 {
        self.plan.run.rate.seconds(Step(step))
    }

    fn advance(&self, rig: &mut Rig, step: u64, command: &[f64]) {
        let interval = Interval {
            start_s: self.time_s(step),
            length_s: self.plan.run.rate.period_s(),
            substeps: self.plan.plant.substeps,
        };
        (rig.model).truth(interval.start_s, command, &mut rig.truth);
        black_box(&rig.truth);
        rig.model.advance(&interval, command);
    }

    fn measure(rig: &mut Rig, step: u64, measured: &mut [f64]) {
        if rig.faults.advance(Step(step), None) {
            rig.model.retune(rig.faults.parameters());
        }
        rig.model.measure(measured);
    }

    fn stimulate(&self, step: u64, mut reference: &mut [f64]) {
        for stimulus in &self.plan.stimuli {
            let count = 1 + stimulus.waveform.derivatives();
            let (row, rest) = reference.split_at_mut(count);
            stimulus::evaluate(&stimulus.waveform, self.time_s(step), row);
            reference = rest;
        }
    }

    /// The columns that the law needs, of a row with these columns.
    fn places(
        all: &[shared_types::table::Field],
        wanted: &[shared_types::table::Field],
    ) -> Vec<usize> {
        let place =
            |field: &shared_types::table::Field| all.iter().position(|f| f.name == field.name);
        wanted
            .iter()
            .map(|field| place(field).expect("bound"))
            .collect()
    }

    fn answer(&self, law: &mut dyn Law, step: u64, rows: (&[f64], &[f64]), command: &mut [f64]) {
        let mut internals = [0.0; 64];
        let (measured, reference) = rows;
        let row = Row {
            held_steps: 0,
            time_s: self.time_s(step),
            measured,
            reference,
            valid: true,
        };
        law.step(
            &row,
            command,
            &mut internals[..self.law.description.internals.len()],
        );
        black_box(&internals);
    }

    /// Closes the loop and keeps what went across.
    fn rows(&self) -> Rows {
        let (mut rig, mut law) = (self.rig(), self.law());
        let description = &self.plant.description;
        let fields: Vec<_> = self.plan.stimuli.iter().flat_map(|s| s.fields()).collect();
        let wanted = &self.law.description;
        let measured_places = Self::places(&description.measured, &wanted.measured);
        let reference_places = Self::places(&fields, &wanted.reference);
        let mut measured = vec![0.0; description.measured.len()];
        let mut reference = vec![0.0; fields.len()];
        let mut command = vec![0.0; description.commands.len()];
        let mut rows = Rows::default();
        for step in 0..self.plan.run.steps {
            Self::measure(&mut rig, step, &mut measured);
            self.stimulate(step, &mut reference);
            let from = rows.measured.len();
            rows.measured
                .extend(measured_places.iter().map(|&place| measured[place]));
            let reference_from = rows.reference.len();
            rows.reference
                .extend(reference_places.iter().map(|&place| reference[place]));
            let seen = (&rows.measured[from..], &rows.reference[reference_from..]);
            self.answer(&mut *law, step, seen, &mut command);
            rows.command.extend(&command);
            self.advance(&mut rig, step, &command);
        }
        rows
    }

    /// One step of the plant in ns: fault layer, measurement, truth and integration.
    fn plant_ns(&self, rows: &Rows) -> f64 {
        let mut rig = self.rig();
        let mut measured = vec![0.0; self.plant.description.measured.len()];
        let commands = self.plant.description.commands.len();
        let since_ns = monotonic_ns();
        for (step, command) in (0..).zip(rows.command.chunks_exact(commands)) {
            Self::measure(&mut rig, step, &mut measured);
            black_box(&measured);
            self.advance(&mut rig, step, command);
        }
        self.per_step(since_ns)
    }

    /// One evaluation of the stimuli in ns.
    fn stimuli_ns(&self) -> f64 {
        let count = self.plan.stimuli.iter().map(|s| s.fields().len()).sum();
        let mut reference = vec![0.0; count];
        let since_ns = monotonic_ns();
        for step in 0..self.plan.run.steps {
            self.stimulate(step, &mut reference);
            black_box(&reference);
        }
        self.per_step(since_ns)
    }

    /// One step of the law in ns.
    fn law_ns(&self, rows: &Rows) -> f64 {
        let mut law = self.law();
        let mut command = vec![0.0; self.plant.description.commands.len()];
        let wanted = &self.law.description;
        let measured = rows.measured.chunks_exact(wanted.measured.len());
        let reference = rows.reference.chunks_exact(wanted.reference.len());
        let since_ns = monotonic_ns();
        for (step, seen) in (0..).zip(measured.zip(reference)) {
            self.answer(&mut *law, step, seen, &mut command);
            black_box(&command);
        }
        self.per_step(since_ns)
    }

    fn per_step(&self, since_ns: u64) -> f64 {
        (monotonic_ns() - since_ns) as f64 / self.plan.run.steps as f64
    }
}

/// Measures plant, stimuli and laws in turns and prints them.
pub(crate) fn compare() {
    let experiments: Vec<(Experiment, Rows)> = (["pid", "nrsc", "ftsc"].iter())
        .map(|law| {
            let experiment = Experiment::new(law);
            let rows = experiment.rows();
            (experiment, rows)
        })
        .collect();
    let bystanders = Bystanders::watch();
    let mut done: Vec<(String, Vec<f64>)> = Vec::new();
    let mut note = |name: String, ns: f64| match done.iter_mut().find(|(n, _)| *n == name) {
        Some((_, values)) => values.push(ns),
        None => done.push((name, vec![ns])),
    };
    for _ in 0..ROUNDS {
        let (last, rows) = experiments.last().expect("there are laws");
        note("plant drhas, 4 substeps".into(), last.plant_ns(rows));
        note("stimuli".into(), last.stimuli_ns());
        for (experiment, rows) in &experiments {
            let name = format!("law {}", experiment.law.description.name);
            note(name, experiment.law_ns(rows));
        }
    }
    let others = bystanders.share();

    println!(
        "one step alone, medians of {ROUNDS} runs of 200000 steps, other programs took {:.0} % of the machine",
        100.0 * others
    );
    let mut lines = Vec::new();
    for (name, values) in done {
        let step_ns = median(values);
        println!("{name:<29} {step_ns:>8.0} ns");
        lines.push(json!({ "part": name, "step_ns": step_ns }));
    }
    let line = json!({
        "bench": "loop/steps",
        "machine": machine(),
        "rounds": ROUNDS,
        "others_share": others,
        "parts": lines,
    });
    println!("{line}\n");
}

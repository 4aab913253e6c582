//! The paper's scenario in one thread, with nothing between plant and law.
//!
//! Used by the benches `loop` and `c_twin`. The loop is closed by hand; to measure one part alone, a bench keeps every
//! row and then gives the plant the same commands and the law the same samples again.

use std::hint::black_box;
use std::path::{Path, PathBuf};

use controller_process::controller::{Law, LawKind, Row, Start};
use controller_process::runner::choose;
use hil_config::plan::{Plan, Stimulus};
use hil_config::scenario::Scenario;
use hil_session::clock::monotonic_ns;
use plant_process::faults::{FaultBuilder, FaultLayer};
use plant_process::plant::{Model, PlantKind};
use plant_process::stimulus;
use shared_types::record::RecordLayout;
use shared_types::time::{Interval, Step};

/// Path of the scenario.
pub(crate) fn scenario_file() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.join("../scenarios/severe-leakage.toml")
}

/// A run whose loop is closed by hand.
pub(crate) struct Experiment {
    plan: Plan,
    plant: PlantKind,
    law: LawKind,
}

/// Signals exchanged between plant and law, row after row.
#[derive(Default)]
pub(crate) struct Rows {
    measured: Vec<f64>,
    reference: Vec<f64>,
    command: Vec<f64>,
}

/// The plant, with the calls that the engine makes around it.
struct Rig {
    model: Box<dyn Model>,
    faults: FaultLayer,
    truth: Vec<f64>,
}

/// The law, with storage for its internals.
struct Answerer {
    law: Box<dyn Law>,
    internals: Vec<f64>,
}

impl Experiment {
    /// Creates the scenario with a law for its plant.
    pub(crate) fn new(law: &str) -> Self {
        let plants = plant_process::models::all();
        let laws = controller_process::laws::all();
        let described_plants: Vec<_> = plants.iter().map(|k| k.description.clone()).collect();
        let described_laws: Vec<_> = laws.iter().map(|k| k.description.clone()).collect();
        let plan = (Scenario::read(scenario_file()).expect("a scenario"))
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
        let builder = FaultBuilder::new(description, &reference, &[], parameters, seeded, &[]);
        let builder = builder.expect("the plant's parameters");
        let faults = FaultLayer::new(&builder, &self.plan.faults);
        let mut faults = faults.expect("the scenario's faults");
        let opened = faults.open(&builder, &RecordLayout::default());
        opened.expect("no conditions");
        Rig {
            model: (self.plant.start)(parameters).expect("starts"),
            faults,
            truth: vec![0.0; description.truth.len()],
        }
    }

    fn law(&self) -> Answerer {
        let start = Start {
            parameters: &self.plan.controller.parameters,
            model: &self.plan.controller.model,
            period_s: self.plan.run.rate.period_s(),
            commands: &self.plant.description.commands,
        };
        Answerer {
            law: (self.law.start)(&start).expect("starts"),
            internals: vec![0.0; self.law.description.internals.len()],
        }
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
        (rig.model.truth(interval.start_s, command, &mut rig.truth)).expect("told");
        black_box(&rig.truth);
        (rig.model.advance(&interval, command)).expect("goes on");
    }

    fn measure(rig: &mut Rig, step: u64, measured: &mut [f64]) {
        if rig.faults.advance(Step(step), None) {
            (rig.model.retune(rig.faults.parameters())).expect("retuned");
        }
        rig.model.measure(measured).expect("measured");
    }

    fn stimulate(&self, step: u64, mut reference: &mut [f64]) {
        for stimulus in &self.plan.stimuli {
            let count = 1 + stimulus.waveform.derivatives();
            let (row, rest) = reference.split_at_mut(count);
            stimulus::evaluate(&stimulus.waveform, self.time_s(step), row);
            reference = rest;
        }
    }

    /// Returns the columns that the law needs from a row with these columns.
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

    fn answer(
        &self,
        answerer: &mut Answerer,
        step: u64,
        rows: (&[f64], &[f64]),
        command: &mut [f64],
    ) {
        let (measured, reference) = rows;
        let row = Row {
            held_steps: 0,
            time_s: self.time_s(step),
            measured,
            reference,
            valid: true,
        };
        (answerer.law.step(&row, command, &mut answerer.internals)).expect("answers");
        black_box(&answerer.internals);
    }

    /// Closes the loop; `keep` receives the law's input and its commands. Returns the measurement after the last step.
    fn close(&self, mut keep: impl FnMut(&[f64], &[f64], &[f64])) -> Vec<f64> {
        let (mut rig, mut law) = (self.rig(), self.law());
        let description = &self.plant.description;
        let fields: Vec<_> = self.plan.stimuli.iter().flat_map(|s| s.fields()).collect();
        let wanted = &self.law.description;
        let measured_places = Self::places(&description.measured, &wanted.measured);
        let reference_places = Self::places(&fields, &wanted.reference);
        let mut measured = vec![0.0; description.measured.len()];
        let mut reference = vec![0.0; fields.len()];
        let mut command = vec![0.0; description.commands.len()];
        let mut seen_measured = vec![0.0; measured_places.len()];
        let mut seen_reference = vec![0.0; reference_places.len()];
        for step in 0..self.plan.run.steps {
            Self::measure(&mut rig, step, &mut measured);
            self.stimulate(step, &mut reference);
            for (seen, &place) in seen_measured.iter_mut().zip(&measured_places) {
                *seen = measured[place];
            }
            for (seen, &place) in seen_reference.iter_mut().zip(&reference_places) {
                *seen = reference[place];
            }
            let seen = (&seen_measured[..], &seen_reference[..]);
            self.answer(&mut law, step, seen, &mut command);
            keep(&seen_measured, &seen_reference, &command);
            self.advance(&mut rig, step, &command);
        }
        rig.model.measure(&mut measured).expect("measured");
        measured
    }

    /// Closes the loop and keeps the exchanged signals.
    pub(crate) fn rows(&self) -> Rows {
        let mut rows = Rows::default();
        self.close(|measured, reference, command| {
            rows.measured.extend(measured);
            rows.reference.extend(reference);
            rows.command.extend(command);
        });
        rows
    }

    /// Measures a step of the plant in ns: fault layer, measurement, truth and integration.
    pub(crate) fn plant_ns(&self, rows: &Rows) -> f64 {
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

    /// Measures an evaluation of the stimuli in ns.
    pub(crate) fn stimuli_ns(&self) -> f64 {
        let count = self.plan.stimuli.iter().map(|s| s.fields().len()).sum();
        let mut reference = vec![0.0; count];
        let since_ns = monotonic_ns();
        for step in 0..self.plan.run.steps {
            self.stimulate(step, &mut reference);
            black_box(&reference);
        }
        self.per_step(since_ns)
    }

    /// Measures a step of the law in ns.
    pub(crate) fn law_ns(&self, rows: &Rows) -> f64 {
        let mut law = self.law();
        let mut command = vec![0.0; self.plant.description.commands.len()];
        let wanted = &self.law.description;
        let measured = rows.measured.chunks_exact(wanted.measured.len());
        let reference = rows.reference.chunks_exact(wanted.reference.len());
        let since_ns = monotonic_ns();
        for (step, seen) in (0..).zip(measured.zip(reference)) {
            self.answer(&mut law, step, seen, &mut command);
            black_box(&command);
        }
        self.per_step(since_ns)
    }

    /// Returns the time in ns of a step of the closed loop without keeping anything, and the last measurement.
    pub(crate) fn closed(&self) -> (f64, Vec<f64>) {
        let since_ns = monotonic_ns();
        let end = self.close(|_, _, _| {});
        (self.per_step(since_ns), end)
    }

    /// Returns the law's name.
    pub(crate) fn law_name(&self) -> &str {
        &self.law.description.name
    }

    fn per_step(&self, since_ns: u64) -> f64 {
        (monotonic_ns() - since_ns) as f64 / self.plan.run.steps as f64
    }
}

//! The plant's answer to `--linearise`: its discrete map at a point, on the named numbers of its state.
//!
//! Called by the program in place of a run. No engine, instrument or fault is between the numbers and the model; a
//! fault that moved parameters before the point is in the parameters.

use hil_config::plan::Run;
use shared_types::checkpoint::{Checkpoints, Saves};
use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::local_map::{Columns, LocalMap, Question, changed, variables};
use shared_types::quality::SignalSet;
use shared_types::side::Side;
use shared_types::state::State;
use shared_types::time::{Interval, Step};

use crate::checkpoint::SavedPlant;
use crate::job::Job;
use crate::plant::{Model, PlantKind};

/// Answers a question about a plant; writes the plant's state at the point where the job saves one.
///
/// # Errors
/// If the state has no named numbers, the job cannot be run, or there is no linear model at the point.
pub(crate) fn answer(kind: &PlantKind, question: &Question<Job>) -> Result<LocalMap, Invalid> {
    let Question { job, step, .. } = question;
    let (plant, name) = (&kind.description, &kind.description.name);
    let mut model = (kind.start)(&job.plant.parameters)?;
    let saved: Option<SavedPlant> = { job.checkpoints.resume.as_ref() }
        .map(|resume| resume.read(name))
        .transpose()?;
    if let Some(saved) = &saved {
        saved.restore_model(model.as_mut())?;
    }
    let inputs = question.inputs.row(&plant.commands, "inputs")?;
    let Some(states) = plant.state.as_deref() else {
        let map = model.differentiated(&inputs, job.run.rate.period_s());
        return map.map_err(|reason| Invalid(format!("plant `{name}`: {reason}")));
    };
    let bytes = model.save()?;
    let numbers = changed(states, &model.numbers()?, &question.state)?;
    if let Some(mut saved) = saved.filter(|_| !job.checkpoints.steps.is_empty()) {
        model.set_numbers(&numbers)?;
        saved.model = model.save()?;
        write(name, *step, &job.checkpoints, &saved)?;
    }
    let columns = Columns {
        states,
        inputs: &plant.commands,
        outputs: &plant.measured,
    };
    let interval = interval(&job.run, job.plant.substeps, *step);
    let mut measured = vec![0.0; plant.measured.len()];
    let mut map = |point: &[f64]| {
        let (numbers, inputs) = point.split_at(states.len());
        let next = advanced(
            model.as_mut(),
            &bytes,
            numbers,
            inputs,
            &interval,
            &mut measured,
        );
        let mut results = next?;
        results.extend_from_slice(&measured);
        Ok(results)
    };
    let point = [numbers, inputs].concat();
    let with_kinks = (&point[..], question.passes_kinks);
    let answer = LocalMap::at(columns, interval.length_s, with_kinks, &mut map)?;
    let (numbers, inputs) = point.split_at(states.len());
    let mut truth = vec![0.0; plant.truth.len()];
    model.restore(&bytes)?;
    model.set_numbers(numbers)?;
    (model.read(&mut measured, &mut SignalSet::default())).map_err(failed)?;
    (model.truth(interval.start_s, inputs, &mut truth)).map_err(failed)?;
    Ok(LocalMap {
        truth: variables(&plant.truth, &truth),
        ..answer
    })
}

fn failed(failure: Failure) -> Invalid {
    Invalid(failure.to_string())
}

fn interval(run: &Run, substeps: u32, step: Step) -> Interval {
    Interval {
        start_s: run.rate.seconds(step),
        length_s: run.rate.period_s(),
        substeps,
    }
}

/// Measures a state, and returns its numbers one interval later. Every invalid signal counts as its value.
fn advanced(
    model: &mut dyn Model,
    bytes: &State,
    numbers: &[f64],
    inputs: &[f64],
    interval: &Interval,
    measured: &mut [f64],
) -> Result<Vec<f64>, Invalid> {
    model.restore(bytes)?;
    model.set_numbers(numbers)?;
    (model.read(measured, &mut SignalSet::default())).map_err(failed)?;
    model.advance(interval, inputs).map_err(failed)?;
    model.numbers()
}

fn write(
    name: &str,
    step: Step,
    checkpoints: &Checkpoints,
    saved: &SavedPlant,
) -> Result<(), Invalid> {
    let mut saves = Saves::new(Side::Plant, name, checkpoints.clone());
    saves.write(step, saved).map_err(Invalid)
}

#[cfg(test)]
mod tests {
    use hil_config::plan::{Clock, PlantPlan};
    use shared_types::describe::Settings;
    use shared_types::lockstep::OnLoss;
    use shared_types::pacer::OverrunPolicy;
    use shared_types::time::Rate;

    use super::*;
    use crate::models::spring_mass::SpringMass;

    /// Returns the map of the default spring-mass at 100 Hz, one period long and 16 substeps fine.
    fn at(state: &[(&str, f64)], force_n: f64) -> Result<LocalMap, Invalid> {
        let kind = PlantKind::of::<SpringMass>();
        let mut parameters = Settings::default();
        for field in &kind.description.parameters {
            parameters.set(&field.name, field.default.expect("a default"));
        }
        let run = Run {
            rate: Rate::new(100.0).expect("legal"),
            steps: 10,
            seed: 1,
            clock: Clock::Lockstep,
            overrun: OverrunPolicy::CatchUp,
            deadline: 1.0,
            on_controller_loss: OnLoss::Abort,
        };
        let plant = PlantPlan {
            model: "spring-mass".into(),
            substeps: 16,
            parameters,
            limits: Vec::new(),
            safe_command: Settings::default(),
            inputs: Settings::default(),
        };
        let (mut rows, mut inputs) = (Settings::default(), Settings::default());
        for (name, value) in state {
            rows.set(name, *value);
        }
        inputs.set("force_n", force_n);
        let question = Question {
            job: Job::new(1, run, plant, 1.0),
            step: Step(3),
            state: rows,
            inputs,
            passes_kinks: false,
            commands: Vec::new(),
        };
        answer(&kind, &question)
    }

    #[test]
    fn the_map_of_spring_mass_is_that_of_its_matrix_exponential() {
        // m = 1 kg, c = 2 N s/m, k = 100 N/m, T = 10 ms: decay 1 1/s, frequency sqrt(99) rad/s.
        let (t, w) = (0.01, libm::sqrt(99.0));
        let (e, c, s) = (libm::exp(-t), libm::cos(w * t), libm::sin(w * t) / w);
        let phi = [[e * (c + s), e * s], [-100.0 * e * s, e * (c - s)]];
        // x(k+1) = phi x + A^-1 (phi - 1) b u with A^-1 b = [-1/k, 0].
        let gamma = [(1.0 - phi[0][0]) / 100.0, -phi[1][0] / 100.0];
        let map = at(&[("position_m", 0.3), ("velocity_mps", -2.0)], 5.0).expect("linear");
        for (column, expected) in map.columns.iter().zip([
            [phi[0][0], phi[1][0], 1.0, 0.0],
            [phi[0][1], phi[1][1], 0.0, 1.0],
            [gamma[0], gamma[1], 0.0, 0.0],
        ]) {
            for (value, expected) in column.iter().zip(expected) {
                // RK4 with 16 substeps.
                assert!((value - expected).abs() < 1e-9, "{column:?} {expected:?}");
            }
        }
        let names = |all: &[shared_types::local_map::Variable]| {
            all.iter().map(|one| one.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(&map.states), ["position_m", "velocity_mps"]);
        assert_eq!(names(&map.inputs), ["force_n"]);
        assert!(
            map.accuracy.iter().all(|column| column.error < 1e-8),
            "{map:?}"
        );
    }

    #[test]
    fn an_unknown_row_is_refused_by_name() {
        let refused = at(&[("place_m", 0.3)], 5.0).expect_err("no such row");
        assert_eq!(refused.0, "the state has no row `place_m`");
    }
}

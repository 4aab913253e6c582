//! The closed loop of the linear models of a plant and a law, joined by the names of their signals. The command of a
//! step answers the sample of that step.

use nalgebra::DMatrix;
use shared_types::local_map::Variable;

use crate::model::LinearModel;

/// Prefix of the disturbances that are added to the commands of the plant.
const DISTURBANCE: &str = "disturbance.";

/// Joins a plant and a law. Inputs of the loop are the law's references, then a disturbance of each command of the
/// plant; outputs are the plant's outputs, then its commands.
///
/// # Errors
/// If a signal of the law is missing in the plant, or their periods differ.
pub(crate) fn joined(
    plant: &LinearModel,
    law: &LinearModel,
    measured: usize,
) -> Result<LinearModel, String> {
    if plant.period_s.to_bits() != law.period_s.to_bits() {
        return Err("the law runs at another rate than the plant (controller.rate_hz)".into());
    }
    if plant.d.iter().any(|by| *by != 0.0) {
        return Err("an output of the plant depends on a command without delay, which the law sees a step later; use --of plant and --of law".into());
    }
    let (n_p, n_l, m) = (plant.states.len(), law.states.len(), plant.inputs.len());
    let references = law.inputs.len() - measured;
    let sampled = prefixed("measured", &plant.outputs);
    let from_plant = selection(&law.inputs[..measured], &sampled)?;
    // Commands of the law among those of the plant; the scenario drives the others.
    let to_plant = selection(&law.outputs, &plant.inputs)?.transpose();
    let (b_m, b_r) = (
        law.b.columns(0, measured),
        law.b.columns(measured, references),
    );
    let (d_m, d_r) = (
        law.d.columns(0, measured),
        law.d.columns(measured, references),
    );
    // u = U_x [x_p; x_l] + U_r r + w, in the order of the plant's commands.
    let by_output = &to_plant * d_m * &from_plant;
    let by_state = hstack(&[&(&by_output * &plant.c), &(&to_plant * &law.c)]);
    let by_input = hstack(&[&(&to_plant * d_r), &DMatrix::identity(m, m)]);
    let by_plant = &from_plant * &plant.c;
    let own = hstack(&[&plant.a, &DMatrix::zeros(n_p, n_l)]);
    let a = vstack(&[
        &(own + &plant.b * &by_state),
        &hstack(&[&(b_m * by_plant), &law.a]),
    ]);
    let b = vstack(&[
        &(&plant.b * &by_input),
        &hstack(&[&b_r.clone_owned(), &DMatrix::zeros(n_l, m)]),
    ]);
    let c = vstack(&[
        &hstack(&[&plant.c, &DMatrix::zeros(plant.outputs.len(), n_l)]),
        &by_state,
    ]);
    let d = vstack(&[
        &DMatrix::zeros(plant.outputs.len(), references + m),
        &by_input,
    ]);
    let disturbance = |command: &Variable| Variable {
        name: format!("{DISTURBANCE}{}", command.name),
        unit: command.unit.clone(),
        value: 0.0,
    };
    let references = law.inputs[measured..].to_vec();
    let disturbances: Vec<Variable> = plant.inputs.iter().map(disturbance).collect();
    let accuracy =
        |model: &LinearModel, places: std::ops::Range<usize>| model.accuracy[places].to_vec();
    let of_law = n_l + measured..n_l + law.inputs.len();
    Ok(LinearModel {
        period_s: plant.period_s,
        states: [
            prefixed("plant", &plant.states),
            prefixed("law", &law.states),
        ]
        .concat(),
        inputs: [references, disturbances].concat(),
        outputs: [sampled, prefixed("command", &plant.inputs)].concat(),
        next: [&plant.next[..], &law.next].concat(),
        a,
        b,
        c,
        d,
        accuracy: [
            accuracy(plant, 0..n_p),
            accuracy(law, 0..n_l),
            accuracy(law, of_law),
            accuracy(plant, n_p..n_p + m),
        ]
        .concat(),
        left_out: [&plant.left_out[..], &law.left_out].concat(),
        continuous: None,
    })
}

/// Returns variables named with a prefix.
fn prefixed(prefix: &str, variables: &[Variable]) -> Vec<Variable> {
    let named = |variable: &Variable| Variable {
        name: format!("{prefix}.{}", variable.name),
        ..variable.clone()
    };
    variables.iter().map(named).collect()
}

/// Returns the matrix that selects `wanted` from `all` by name.
fn selection(wanted: &[Variable], all: &[Variable]) -> Result<DMatrix<f64>, String> {
    let mut matrix = DMatrix::zeros(wanted.len(), all.len());
    for (row, signal) in wanted.iter().enumerate() {
        let place = all.iter().position(|other| other.name == signal.name);
        let place = place.ok_or_else(|| format!("the plant has no signal `{}`", signal.name))?;
        matrix[(row, place)] = 1.0;
    }
    Ok(matrix)
}

fn hstack(parts: &[&DMatrix<f64>]) -> DMatrix<f64> {
    let rows = parts[0].nrows();
    let columns = parts.iter().map(|part| part.ncols()).sum();
    let mut whole = DMatrix::zeros(rows, columns);
    let mut at = 0;
    for part in parts {
        whole.view_mut((0, at), part.shape()).copy_from(*part);
        at += part.ncols();
    }
    whole
}

fn vstack(parts: &[&DMatrix<f64>]) -> DMatrix<f64> {
    let transposed: Vec<DMatrix<f64>> = parts.iter().map(|part| part.transpose()).collect();
    hstack(&transposed.iter().collect::<Vec<_>>()).transpose()
}

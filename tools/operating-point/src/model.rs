//! A linear model: the matrices of a map at a point. Nothing here asks a program.

use nalgebra::DMatrix;
use shared_types::local_map::{Accuracy, LocalMap, Variable};

/// Linear model `x(k+1) = A x(k) + B u(k)`, `y(k) = C x(k) + D u(k)` of differences from its point.
#[derive(Clone, Debug)]
pub(crate) struct LinearModel {
    pub(crate) period_s: f64,
    pub(crate) states: Vec<Variable>,
    pub(crate) inputs: Vec<Variable>,
    pub(crate) outputs: Vec<Variable>,
    /// State one period after the point.
    pub(crate) next: Vec<f64>,
    pub(crate) a: DMatrix<f64>,
    pub(crate) b: DMatrix<f64>,
    pub(crate) c: DMatrix<f64>,
    pub(crate) d: DMatrix<f64>,
    /// Accuracy of the derivatives by each state, then each input.
    pub(crate) accuracy: Vec<Accuracy>,
    /// Rows of the state on which nothing depends at this point.
    pub(crate) left_out: Vec<String>,
    /// Continuous A and B, if the model itself stated them.
    pub(crate) continuous: Option<[DMatrix<f64>; 2]>,
}

impl LinearModel {
    /// Creates the model of a map.
    pub(crate) fn of(map: LocalMap) -> Self {
        let (n, m, p) = (map.states.len(), map.inputs.len(), map.outputs.len());
        let columns = &map.columns;
        Self {
            a: DMatrix::from_fn(n, n, |row, column| columns[column][row]),
            b: DMatrix::from_fn(n, m, |row, column| columns[n + column][row]),
            c: DMatrix::from_fn(p, n, |row, column| columns[column][n + row]),
            d: DMatrix::from_fn(p, m, |row, column| columns[n + column][n + row]),
            period_s: map.period_s,
            states: map.states,
            inputs: map.inputs,
            outputs: map.outputs,
            next: map.next,
            accuracy: map.accuracy,
            left_out: Vec::new(),
            continuous: None,
        }
    }

    /// Removes the rows of the state on which neither a state nor an output depends.
    pub(crate) fn reduced(mut self) -> Self {
        let is_idle = |model: &Self, place: usize| {
            model.a.column(place).iter().all(|value| *value == 0.0)
                && model.c.column(place).iter().all(|value| *value == 0.0)
        };
        while let Some(place) = (0..self.states.len()).find(|place| is_idle(&self, *place)) {
            self.left_out.push(self.states.remove(place).name);
            self.next.remove(place);
            self.accuracy.remove(place);
            self.a = self.a.remove_row(place).remove_column(place);
            self.b = self.b.remove_row(place);
            self.c = self.c.remove_column(place);
        }
        self
    }
}

/// Returns the rows of a matrix.
pub(crate) fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let rows = matrix.row_iter();
    rows.map(|row| row.iter().copied().collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a model with three states: the second and third are the input, and nothing depends on the third.
    pub(crate) fn with_idle_state() -> LinearModel {
        let variable = |name: &str| Variable {
            name: name.into(),
            unit: "1".into(),
            value: 0.0,
        };
        let accuracy = Accuracy {
            step: 1.0,
            error: 0.0,
        };
        LinearModel::of(LocalMap {
            period_s: 0.1,
            states: ["x", "y", "z"].map(variable).into(),
            inputs: vec![variable("u")],
            outputs: vec![variable("o")],
            truth: Vec::new(),
            next: vec![1.0, 2.0, 3.0],
            columns: vec![
                vec![0.5, 0.0, 0.0, 1.0],
                vec![0.25, 0.0, 0.0, 0.0],
                vec![0.0, 0.0, 0.0, 0.0],
                vec![0.0, 1.0, 1.0, 0.0],
            ],
            accuracy: vec![accuracy; 4],
            is_continuous: false,
        })
    }

    #[test]
    fn rows_on_which_nothing_depends_are_left_out() {
        let model = with_idle_state().reduced();
        assert_eq!(model.left_out, ["z"]);
        assert_eq!(rows(&model.a), [[0.5, 0.25], [0.0, 0.0]]);
        assert_eq!(rows(&model.b), [[0.0], [1.0]]);
        assert_eq!(rows(&model.c), [[1.0, 0.0]]);
        assert_eq!((model.next, model.accuracy.len()), (vec![1.0, 2.0], 3));
    }
}

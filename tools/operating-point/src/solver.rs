//! The equilibrium of a map, as the least squares of its residuals: Newton's steps, damped where they do not help.
//! Knows no program: the map is a function.
//!
//! Unknown are the state x and the free inputs; the equations are `f(x, u) - x = 0` and the held numbers.

use hil_console::terminal::exit::Failure;
use nalgebra::{DMatrix, DVector};
use shared_types::extremes::larger;
use shared_types::local_map::LocalMap;

/// Largest number of steps.
const STEPS: u32 = 60;
/// Residual relative to the size of its number below which an equation holds.
const HOLDS: f64 = 1e-9;
/// Residual relative to the size of its number that no step improves.
const ROUNDING: f64 = 1e-15;
/// Singular value relative to the largest below which a direction is free.
const SINGULAR: f64 = 1e-10;
/// Size of an equation relative to the number in it, of which [`HOLDS`] is a few roundings of the number.
const ROUNDED: f64 = 4e-6;
/// Largest entry of a row or column that is taken for 0.
const NOTHING: f64 = 1e-12;
/// Passes that make rows and columns alike.
const PASSES: u32 = 20;
/// Damping of the first damped step, and the largest.
const DAMPING: (f64, f64) = (1e-8, 1e8);

/// Number that an equation holds at a value.
#[derive(Clone, Debug)]
pub(crate) struct Held {
    /// Name of the number.
    pub(crate) name: String,
    /// Place of the number.
    pub(crate) place: Place,
    /// Value.
    pub(crate) value: f64,
}

/// Place of a number in a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// Index of a state.
    State(usize),
    /// Index of an input.
    Input(usize),
    /// Index of an output.
    Output(usize),
}

/// Problem: the held numbers and the free inputs.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    /// States and outputs held at a value.
    pub(crate) held: Vec<Held>,
    /// Indices of the inputs that may move.
    pub(crate) free: Vec<usize>,
}

/// Residual of an equation.
#[derive(Clone, Debug)]
pub(crate) struct Residual {
    /// `true` for a held number, `false` for a state.
    pub(crate) is_held: bool,
    /// Name of the number.
    pub(crate) name: String,
    /// Unit of the number.
    pub(crate) unit: String,
    /// Difference from the equation, in that unit.
    pub(crate) value: f64,
    /// Difference relative to the size of the number.
    pub(crate) relative: f64,
}

/// Solution with the least residual.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    /// Map there.
    pub(crate) map: LocalMap,
    /// Residual of each state, then of each held number.
    pub(crate) residuals: Vec<Residual>,
    /// Number of evaluations of the map.
    pub(crate) evaluations: u32,
    /// Directions of the unknowns along which the residuals do not change: names of their main parts.
    pub(crate) undetermined: Vec<String>,
}

impl Solution {
    /// Returns `true` if every equation holds.
    pub(crate) fn holds(&self) -> bool {
        self.residuals.iter().all(|one| one.relative <= HOLDS)
    }

    /// Returns the equations that do not hold, the worst first.
    pub(crate) fn violated(&self) -> Vec<&Residual> {
        let violated = self.residuals.iter().filter(|one| one.relative > HOLDS);
        let mut violated: Vec<&Residual> = violated.collect();
        violated.sort_by(|a, b| b.relative.total_cmp(&a.relative));
        violated
    }
}

/// Map at states and inputs.
pub(crate) type Map<'a> = dyn FnMut(&[f64], &[f64]) -> Result<LocalMap, Failure> + 'a;

/// Evaluated unknowns.
struct Evaluated {
    map: LocalMap,
    residuals: DVector<f64>,
}

/// Finds the equilibrium closest to a map's point, or the point with the least residual.
///
/// # Errors
/// If the map cannot be evaluated at its own point, or its program fails.
pub(crate) fn solve(
    start: LocalMap,
    problem: &Problem,
    map: &mut Map<'_>,
) -> Result<Solution, Failure> {
    let mut best = evaluated(start, problem);
    let (mut evaluations, mut damping) = (1, 0.0);
    if best.map.states.is_empty() && problem.free.is_empty() {
        return Ok(solution(best, problem, evaluations));
    }
    for _ in 0..STEPS {
        let sizes = sizes(&best.map, problem);
        let error = scaled_norm(&best.residuals, &sizes.equations);
        if error <= ROUNDING {
            break;
        }
        let step = step(&best, problem, &sizes, damping);
        let (states, inputs) = moved(&best.map, problem, &step);
        let next = match map(&states, &inputs) {
            Ok(map) => Some(evaluated(map, problem)),
            // The program refuses these values.
            Err(Failure::Differ(_)) => None,
            Err(failure) => return Err(failure),
        };
        evaluations += 1;
        match next.filter(|next| scaled_norm(&next.residuals, &sizes.equations) < error) {
            Some(next) => {
                best = next;
                damping = if damping > DAMPING.0 {
                    damping / 10.0
                } else {
                    0.0
                };
            }
            // Newton's step does not improve an equilibrium.
            None if error <= HOLDS && damping == 0.0 => break,
            None => {
                damping = if damping == 0.0 {
                    DAMPING.0
                } else {
                    damping * 10.0
                };
                if damping > DAMPING.1 {
                    break;
                }
            }
        }
    }
    Ok(solution(best, problem, evaluations))
}

/// Returns the size of a number: its value, or 1 where it is 0.
fn size(value: f64) -> f64 {
    match value.abs() > 1e-6 {
        true => value.abs(),
        false => 1.0,
    }
}

/// Returns the residuals of the states of a map as shares of the sizes of their equations at another.
pub(crate) fn relative(map: &LocalMap, at: &LocalMap) -> Vec<f64> {
    const ALONE: Problem = Problem {
        held: Vec::new(),
        free: Vec::new(),
    };
    let Sizes { equations, .. } = sizes(at, &ALONE);
    let rows = map.states.iter().zip(&map.next).zip(equations);
    rows.map(|((state, next), size)| ((next - state.value) / size).abs())
        .collect()
}

/// Sizes of the equations and of the unknowns.
struct Sizes {
    equations: Vec<f64>,
    unknowns: Vec<f64>,
}

/// Returns the [sizes](size) of the unknowns, and of the equations, which are the largest
/// change of each while one state or input changes by its size. The rounding of the number itself is no residual.
fn sizes(map: &LocalMap, problem: &Problem) -> Sizes {
    let n = map.states.len();
    let all = map.states.iter().chain(&map.inputs);
    let all: Vec<f64> = all.map(|one| size(one.value)).collect();
    let columns: Vec<usize> = (0..all.len()).collect();
    let derivatives = derivatives(map, problem, &columns);
    let states = map.states.iter().map(|state| state.value);
    let own = states.chain(problem.held.iter().map(|held| held.value));
    let equations = own.enumerate().map(|(row, own)| {
        let changes = derivatives.row(row);
        let changes = changes.iter().zip(&all).map(|(by, size)| (by * size).abs());
        match changes.fold(ROUNDED * own.abs(), larger) {
            0.0 => 1.0,
            size => size,
        }
    });
    let free = problem.free.iter().map(|place| all[n + place]);
    Sizes {
        equations: equations.collect(),
        unknowns: all[..n].iter().copied().chain(free).collect(),
    }
}

fn evaluated(map: LocalMap, problem: &Problem) -> Evaluated {
    let states = map.next.iter().zip(&map.states);
    let states = states.map(|(next, state)| next - state.value);
    let held = problem
        .held
        .iter()
        .map(|held| value(&map, held.place) - held.value);
    let residuals: Vec<f64> = states.chain(held).collect();
    Evaluated {
        residuals: DVector::from_vec(residuals),
        map,
    }
}

fn value(map: &LocalMap, place: Place) -> f64 {
    match place {
        Place::State(place) => map.states[place].value,
        Place::Input(place) => map.inputs[place].value,
        Place::Output(place) => map.outputs[place].value,
    }
}

/// Returns the derivatives of the residuals by these columns of a map: its states, then its inputs.
fn derivatives(map: &LocalMap, problem: &Problem, columns: &[usize]) -> DMatrix<f64> {
    let n = map.states.len();
    DMatrix::from_fn(n + problem.held.len(), columns.len(), |row, place| {
        let column = columns[place];
        let derivative = |result: usize| map.columns[column][result];
        let is_own = |place: usize| f64::from(u8::from(place == column));
        match row.checked_sub(n).map(|held| problem.held[held].place) {
            None => derivative(row) - is_own(row),
            Some(Place::State(place)) => is_own(place),
            Some(Place::Input(place)) => is_own(n + place),
            Some(Place::Output(place)) => derivative(n + place),
        }
    })
}

/// Derivatives of the residuals by the unknowns, both as multiples of their scales.
struct Scaled {
    matrix: DMatrix<f64>,
    rows: Vec<f64>,
    columns: Vec<f64>,
}

/// Scales the derivatives by the sizes, then until the largest entries of rows and columns are alike (Ruiz, 2001).
/// Otherwise a number in a large unit would look undetermined.
fn scaled(best: &Evaluated, problem: &Problem, sizes: &Sizes) -> Scaled {
    let n = best.map.states.len();
    let free = problem.free.iter().map(|place| n + place);
    let unknowns: Vec<usize> = (0..n).chain(free).collect();
    let mut matrix = derivatives(&best.map, problem, &unknowns);
    let mut rows: Vec<f64> = sizes.equations.iter().map(|size| 1.0 / size).collect();
    let mut columns = sizes.unknowns.clone();
    scale(&mut matrix, &rows, &columns);
    for _ in 0..PASSES {
        let root = |largest: f64| match largest > NOTHING {
            true => 1.0 / largest.sqrt(),
            false => 1.0,
        };
        let by_row: Vec<f64> = matrix.row_iter().map(|row| root(row.amax())).collect();
        let by_column = matrix.column_iter().map(|column| root(column.amax()));
        let by_column: Vec<f64> = by_column.collect();
        scale(&mut matrix, &by_row, &by_column);
        for (own, by) in rows.iter_mut().zip(&by_row) {
            *own *= by;
        }
        for (own, by) in columns.iter_mut().zip(&by_column) {
            *own *= by;
        }
    }
    // With fewer equations than unknowns, rows of 0 keep a singular value for each unknown.
    let all = matrix.nrows().max(matrix.ncols());
    Scaled {
        matrix: matrix.resize_vertically(all, 0.0),
        rows,
        columns,
    }
}

fn scale(matrix: &mut DMatrix<f64>, rows: &[f64], columns: &[f64]) {
    for (row, by) in rows.iter().enumerate() {
        matrix.row_mut(row).scale_mut(*by);
    }
    for (column, by) in columns.iter().enumerate() {
        matrix.column_mut(column).scale_mut(*by);
    }
}

/// Returns the change of the unknowns: Newton's step of least length, or a damped one.
fn step(best: &Evaluated, problem: &Problem, sizes: &Sizes, damping: f64) -> Vec<f64> {
    let Scaled {
        matrix,
        rows,
        columns,
    } = scaled(best, problem, sizes);
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return vec![0.0; columns.len()];
    };
    let residuals = best.residuals.iter().zip(&rows);
    let mut residuals: Vec<f64> = residuals.map(|(value, by)| value * by).collect();
    residuals.resize(u.nrows(), 0.0);
    let parts = u.transpose() * DVector::from_vec(residuals);
    let largest = svd.singular_values.iter().copied().fold(0.0, larger);
    let mut change = DVector::zeros(columns.len());
    for (place, sigma) in svd.singular_values.iter().enumerate() {
        if *sigma <= SINGULAR * largest {
            continue;
        }
        let factor = sigma / (sigma * sigma + damping * largest * largest);
        change -= v_t.row(place).transpose() * (factor * parts[place]);
    }
    let change = change.iter().zip(&columns);
    change.map(|(part, by)| part * by).collect()
}

fn moved(map: &LocalMap, problem: &Problem, step: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = map.states.len();
    let states = map.states.iter().zip(step);
    let states = states.map(|(state, step)| state.value + step).collect();
    let mut inputs: Vec<f64> = map.inputs.iter().map(|input| input.value).collect();
    for (place, step) in problem.free.iter().zip(&step[n..]) {
        inputs[*place] += step;
    }
    (states, inputs)
}

fn scaled_norm(residuals: &DVector<f64>, sizes: &[f64]) -> f64 {
    let both = residuals.iter().zip(sizes);
    both.map(|(value, size)| (value / size).abs())
        .fold(0.0, larger)
}

fn solution(best: Evaluated, problem: &Problem, evaluations: u32) -> Solution {
    let sizes = sizes(&best.map, problem);
    let n = best.map.states.len();
    let names = best
        .map
        .states
        .iter()
        .map(|state| (&state.name, &state.unit));
    let unit = |held: &Held| match held.place {
        Place::State(place) => &best.map.states[place].unit,
        Place::Input(place) => &best.map.inputs[place].unit,
        Place::Output(place) => &best.map.outputs[place].unit,
    };
    let names = names.chain(problem.held.iter().map(|held| (&held.name, unit(held))));
    let values = best.residuals.iter().zip(&sizes.equations);
    let residuals = names
        .zip(values)
        .enumerate()
        .map(|(place, ((name, unit), (value, size)))| Residual {
            is_held: place >= n,
            name: name.clone(),
            unit: unit.clone(),
            value: *value,
            relative: (value / size).abs(),
        });
    let residuals = residuals.collect();
    let unknown = |place: usize| match place < n {
        true => best.map.states[place].name.clone(),
        false => best.map.inputs[problem.free[place - n]].name.clone(),
    };
    let Scaled { matrix, .. } = scaled(&best, problem, &sizes);
    let svd = (!matrix.is_empty()).then(|| matrix.svd(false, true));
    let mut undetermined = Vec::new();
    if let Some((svd, v_t)) = svd.as_ref().and_then(|svd| Some((svd, svd.v_t.as_ref()?))) {
        let largest = svd.singular_values.iter().copied().fold(0.0, larger);
        for (place, sigma) in svd.singular_values.iter().enumerate() {
            if *sigma <= SINGULAR * largest {
                let row = v_t.row(place);
                let main = (0..row.len()).filter(|column| row[*column].abs() > 0.3);
                undetermined.extend(main.map(unknown));
            }
        }
    }
    undetermined.sort();
    undetermined.dedup();
    Solution {
        residuals,
        undetermined,
        evaluations,
        map: best.map,
    }
}

#[cfg(test)]
mod tests {
    use shared_types::local_map::{Accuracy, Variable};

    use super::*;

    /// Returns a map of one state and one input, `f(x, u)` with both derivatives.
    fn one(f: fn(f64, f64) -> [f64; 3]) -> impl Fn(&[f64], &[f64]) -> Result<LocalMap, Failure> {
        move |x, u| {
            let variable = |name: &str, value| Variable {
                name: name.into(),
                unit: "m".into(),
                value,
            };
            let [next, by_x, by_u] = f(x[0], u[0]);
            let accuracy = Accuracy {
                step: 1.0,
                error: 0.0,
            };
            Ok(LocalMap {
                period_s: 1.0,
                states: vec![variable("x_m", x[0])],
                inputs: vec![variable("u_m", u[0])],
                outputs: vec![variable("y_m", 2.0 * x[0])],
                truth: Vec::new(),
                next: vec![next],
                columns: vec![vec![by_x, 2.0], vec![by_u, 0.0]],
                accuracy: vec![accuracy; 2],
                is_continuous: false,
            })
        }
    }

    fn solved(f: fn(f64, f64) -> [f64; 3], problem: &Problem) -> Solution {
        let map = one(f);
        let start = map(&[1.0], &[1.0]).expect("a map");
        solve(start, problem, &mut |x, u| map(x, u)).expect("solved")
    }

    const ALONE: Problem = Problem {
        held: Vec::new(),
        free: Vec::new(),
    };

    #[test]
    fn a_curved_map_has_its_fixed_point() {
        // x = cos x
        let solution = solved(|x, _| [libm::cos(x), -libm::sin(x), 0.0], &ALONE);
        let x = solution.map.states[0].value;
        assert!((x - 0.739_085_133_215_160_6).abs() < 1e-12, "{x}");
        assert!(solution.holds() && solution.undetermined.is_empty());
    }

    #[test]
    fn a_held_output_moves_a_free_input() {
        let problem = Problem {
            held: vec![Held {
                name: "y_m".into(),
                place: Place::Output(0),
                value: 6.0,
            }],
            free: vec![0],
        };
        // x = x/2 + u^3, 2 x = 6
        let solution = solved(|x, u| [0.5 * x + u * u * u, 0.5, 3.0 * u * u], &problem);
        let u = solution.map.inputs[0].value;
        assert!((u * u * u - 1.5).abs() < 1e-9, "{u}");
        assert!(solution.holds());
    }

    #[test]
    fn a_map_without_a_fixed_point_names_its_state() {
        // x = x + 1 + x^2
        let solution = solved(|x, _| [x + 1.0 + x * x, 1.0 + 2.0 * x, 0.0], &ALONE);
        assert!(!solution.holds());
        assert_eq!(solution.violated()[0].name, "x_m");
        assert!(
            (solution.residuals[0].value - 1.0).abs() < 1e-3,
            "{solution:?}"
        );
    }

    #[test]
    fn a_number_that_nothing_determines_is_named() {
        let solution = solved(|x, _| [x, 1.0, 0.0], &ALONE);
        assert!(solution.holds());
        assert_eq!(solution.undetermined, ["x_m"]);
    }
}

//! Variables with several names: aliases of FMI 3, and variables of FMI 2 with the same value reference.
//!
//! Variables with the same class, type, value reference, unit and size share one column, under the most public and
//! first name; the other names are its aliases.

use std::collections::{BTreeMap, BTreeSet};

use shared_types::spelling::spelled;

use super::{Column, Tables, unsupported};
use crate::fmi::description::{Causality, ModelDescription, UNREFERENCED, Variable, VariableType};

/// Class of variables that can replace each other in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    Parameter,
    Input,
    Signal,
}

impl Class {
    fn of(variable: &Variable) -> Option<Self> {
        if variable.reference == UNREFERENCED && variable.unusable.is_some() {
            return None;
        }
        match variable.causality {
            Causality::Parameter => Some(Self::Parameter),
            Causality::Input => Some(Self::Input),
            Causality::Output | Causality::Local | Causality::CalculatedParameter => {
                Some(Self::Signal)
            }
            Causality::StructuralParameter | Causality::Independent => None,
        }
    }
}

/// Identity of a value: variables with equal keys are the same value.
type Key<'a> = (VariableType, u32, Option<&'a str>, &'a [usize]);

/// Mapping from each variable of a model to the variable whose column it shares.
pub(super) struct Aliases<'a> {
    model: &'a ModelDescription,
    /// For each variable, the index of the variable with its column, possibly itself.
    columns: Vec<usize>,
    /// For each variable with a column, the indices of all others with its value.
    others: BTreeMap<usize, Vec<usize>>,
    /// Inputs and parameters whose value is set through another variable with a different unit or size.
    set_by: BTreeMap<usize, usize>,
}

impl<'a> Aliases<'a> {
    pub(super) fn of(model: &'a ModelDescription) -> Self {
        let mut best: BTreeMap<(Class, Key<'a>), usize> = BTreeMap::new();
        let classed = || {
            let variables = model.variables.iter().enumerate();
            variables.filter_map(|(place, one)| Some((place, one, Class::of(one)?)))
        };
        let rank = |place: usize| {
            let variable = &model.variables[place];
            (is_usable(variable), variable.causality == Causality::Output)
        };
        for (place, variable, class) in classed() {
            let column = best.entry((class, key(variable))).or_insert(place);
            if rank(place) > rank(*column) {
                *column = place;
            }
        }
        let mut columns: Vec<usize> = (0..model.variables.len()).collect();
        let mut others: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (place, variable, class) in classed() {
            columns[place] = best[&(class, key(variable))];
            // The internal name of an input or parameter is an alias as well.
            let set = [Class::Parameter, Class::Input]
                .into_iter()
                .filter(|_| is_inner(variable))
                .filter_map(|class| best.get(&(class, key(variable))));
            for &column in set.chain([&columns[place]]) {
                if column != place {
                    others.entry(column).or_default().push(place);
                }
            }
        }
        let mut setters = BTreeMap::new();
        let mut set_by = BTreeMap::new();
        for (place, variable, class) in classed() {
            if class != Class::Signal && columns[place] == place && rank(place).0 {
                let value = (class, variable.kind, variable.reference);
                let setter = *setters.entry(value).or_insert(place);
                if setter != place {
                    set_by.insert(place, setter);
                }
            }
        }
        Self {
            model,
            columns,
            others,
            set_by,
        }
    }

    /// Returns `true` if another variable has the column.
    pub(super) fn is_alias(&self, place: usize) -> bool {
        self.columns[place] != place
    }

    /// Returns `true` if the variable whose column this one shares can be used.
    pub(super) fn is_usable(&self, place: usize) -> bool {
        is_usable(&self.model.variables[self.columns[place]])
    }

    /// Returns the variable through which the value of this one is set.
    pub(super) fn set_by(&self, place: usize) -> Option<usize> {
        self.set_by.get(&place).copied()
    }

    /// Returns the names, in the model and here, of a local variable and of the variables that share its column. An
    /// alias of an output counts as a local variable, as written by tools of FMI 2.
    pub(super) fn names_of_inner(&self, place: usize) -> Vec<String> {
        let others = self.others.get(&place).into_iter().flatten();
        let mut names = Vec::new();
        for &place in std::iter::once(&place).chain(others) {
            let variable = &self.model.variables[place];
            let is_further = variable.causality == Causality::Output && self.is_alias(place);
            if !is_inner(variable) && !is_further {
                continue;
            }
            names.push(variable.name.clone());
            let elements = (0..variable.elements()).map(|element| variable.element_name(element));
            names.extend(elements.filter_map(|name| spelled(&name).ok()));
        }
        names
    }

    /// Adds the other names to each column, unless they are names of another column.
    pub(super) fn give_to(&self, tables: &mut Tables) {
        let Tables {
            parameters,
            inputs,
            outputs,
            locals,
            ..
        } = tables;
        self.give(&mut parameters.iter_mut().collect::<Vec<_>>());
        self.give(&mut inputs.iter_mut().collect::<Vec<_>>());
        self.give(&mut outputs.iter_mut().chain(locals).collect::<Vec<_>>());
    }

    fn give(&self, table: &mut [&mut Column]) {
        let mut names: BTreeSet<String> = (table.iter())
            .map(|column| column.field.name.clone())
            .collect();
        for column in table {
            for &other in self.others.get(&column.variable).into_iter().flatten() {
                let name = self.model.variables[other].element_name(column.element);
                let alias = spelled(&name).ok();
                let alias = alias.filter(|alias| names.insert(alias.clone()));
                column.field.aliases.extend(alias);
            }
        }
    }
}

fn is_usable(variable: &Variable) -> bool {
    unsupported(variable, variable.causality == Causality::Parameter).is_none()
}

fn is_inner(variable: &Variable) -> bool {
    matches!(
        variable.causality,
        Causality::Local | Causality::CalculatedParameter
    )
}

fn key(variable: &Variable) -> Key<'_> {
    (
        variable.kind,
        variable.reference,
        variable.unit.as_deref(),
        &variable.dimensions,
    )
}

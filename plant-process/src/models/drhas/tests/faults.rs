//! The named faults as a table: what they move exists, is open to faults and has room for the move.

use shared_types::describe::{MoveBy, Operation};
use shared_types::table::{Field, Table};

use super::super::*;

/// The parameters that a move of a fault reaches, one for each target.
fn reached(fault: &FaultDescription, parameter: &str) -> Vec<Field> {
    let names = match &fault.selector {
        Some(selector) => vec![
            format!("{selector}1.{parameter}"),
            format!("{selector}2.{parameter}"),
        ],
        None => vec![parameter.into()],
    };
    let fields = Parameters::fields();
    let found = |name: String| fields.iter().find(|f| f.name == name).expect(&name).clone();
    names.into_iter().map(found).collect()
}

#[test]
fn every_fault_moves_parameters_that_are_open_to_faults_and_have_room() {
    for fault in Drhas::faults() {
        assert!(!fault.moves.is_empty(), "{}", fault.kind);
        for moved in &fault.moves {
            let amounts = match &moved.by {
                MoveBy::Constant(constant) => vec![*constant],
                MoveBy::Size(key) => {
                    let size = fault.sizes.iter().find(|size| size.name == *key);
                    let size = size.unwrap_or_else(|| panic!("{}: no {key}", fault.kind));
                    assert!(size.min.is_finite() && size.max.is_finite());
                    let default = size.default.into_iter();
                    default.chain([size.min, size.max]).collect()
                }
            };
            for field in reached(&fault, &moved.parameter) {
                assert!(field.faultable, "{}", field.name);
                let healthy = field.default.unwrap();
                for &amount in &amounts {
                    let value = match moved.operation {
                        Operation::Add => healthy + amount,
                        Operation::Scale => healthy * amount,
                        Operation::Set => amount,
                    };
                    assert!(
                        field.admits(value),
                        "{}: {value} in {}",
                        fault.kind,
                        field.name
                    );
                }
            }
        }
    }
}

#[test]
fn every_size_moves_something_in_its_own_unit() {
    for fault in Drhas::faults() {
        for size in &fault.sizes {
            let moves: Vec<_> = (fault.moves.iter())
                .filter(|moved| moved.by == MoveBy::Size(size.name.clone()))
                .collect();
            assert!(!moves.is_empty(), "{}: {}", fault.kind, size.name);
            for moved in moves {
                for field in reached(&fault, &moved.parameter) {
                    let unit = match moved.operation {
                        Operation::Scale => "1",
                        Operation::Add | Operation::Set => &field.unit,
                    };
                    assert_eq!(size.unit, unit, "{}: {}", fault.kind, size.name);
                }
            }
        }
    }
}

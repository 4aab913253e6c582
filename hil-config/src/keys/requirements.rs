//! `[[requirements]]`.

use super::{Key, KeyKind, TEXT};

/// `[[requirements]]`.
pub(crate) const REQUIREMENT: &[Key] = keys! {
    name!: TEXT, "Name: letters, digits, - and _.";
    formula!: TEXT,
        "Condition that must hold at the beginning of the run: comparisons of expressions, joined by and, or, not, implies, always[a,b], eventually[a,b], until[a,b], historically[a,b], once[a,b], since[a,b], rise and fall; times such as 2s or 200ms.";
    description: TEXT, "Purpose of the requirement.";
    id: TEXT,
        "Identifier of this test in other documents: letters, digits, -, _ and .; no two requirements of a scenario share one.";
    verifies: KeyKind::Texts,
        "Identifiers of the requirements in other documents that this one verifies.";
    unit: TEXT,
        "Unit of the robustness. Default: the unit that all signals of the formula have by their names, else none.";
};

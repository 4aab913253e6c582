//! The laws that the controller can run, one folder or file per law.
//!
//! [`all`] is what the runner and `--describe` read; nothing else lists the laws. A law is pure
//! arithmetic on its configuration and the sample: it knows no clock, no file and no random number.
//!
//! | law | plant | file |
//! |---|---|---|
//! | `pid` | `drhas` | [`pid::drhas`] |
//! | `pid` | `spring-mass` | [`pid::spring_mass`] |
//! | `nrsc`, `ftsc` | `drhas` | [`backstepping`] |
//! | `hold` | any | [`hold`] |

pub mod backstepping;
pub mod drhas;
pub mod hold;
mod limit;
pub mod pid;

use crate::controller::LawKind;

/// Every law that can be chosen by name. Two laws may share a name if they are for different
/// plants.
#[must_use]
pub fn all() -> Vec<LawKind> {
    vec![
        LawKind::of::<pid::drhas::ActuatorPid>(),
        LawKind::of::<pid::spring_mass::ForcePid>(),
        LawKind::of::<backstepping::nrsc::Nrsc>(),
        LawKind::of::<backstepping::ftsc::Ftsc>(),
        hold::kind(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_and_a_plant_choose_one_law() {
        let laws = all();
        for plant in ["drhas", "spring-mass"] {
            let mut names: Vec<&str> = laws
                .iter()
                .map(|law| &law.description)
                .filter(|law| law.plants.is_empty() || law.plants.iter().any(|p| p == plant))
                .map(|law| law.name.as_str())
                .collect();
            let count = names.len();
            names.dedup();
            assert_eq!(names.len(), count, "{plant}: {names:?}");
        }
    }

    #[test]
    fn every_default_lies_in_its_own_range() {
        for law in all() {
            let description = law.description;
            for field in description.parameters.iter().chain(&description.model) {
                let default = field.default.expect("parameters have defaults");
                assert!(field.admits(default), "{}: {field:?}", description.name);
            }
        }
    }
}

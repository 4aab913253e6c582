//! The built-in laws, one folder or file per law.
//!
//! The runner and `--describe` use [`all`], the only list of the laws. A law is pure arithmetic on its configuration
//! and the sample: no clock, no file and no random number. Each law keeps its command continuous if its parameters jump
//! during a run.
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
mod transfer;

use crate::controller::LawKind;

/// Returns every law that can be selected by name. Two laws may share a name if they are for different plants.
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
    use std::collections::BTreeSet;

    use shared_types::describe::{LawDescription, Settings};
    use shared_types::random::RandomStream;
    use shared_types::table::Field;

    use super::*;
    use crate::controller::{Law, Row, Start};

    #[test]
    fn a_name_and_a_plant_select_one_law() {
        let laws = all();
        for plant in ["drhas", "spring-mass"] {
            let names: Vec<&str> = laws
                .iter()
                .map(|law| &law.description)
                .filter(|law| law.suits(plant))
                .map(|law| law.name.as_str())
                .collect();
            let different: BTreeSet<&&str> = names.iter().collect();
            assert_eq!(different.len(), names.len(), "{plant}: {names:?}");
        }
    }

    /// Takes a step with a random sample, occasionally invalid; returns command and internals.
    fn step(
        law: &mut dyn Law,
        description: &LawDescription,
        random: &mut RandomStream,
    ) -> Vec<u64> {
        let mut row = |fields: &[Field]| {
            let size = |unit: &str| match unit {
                "Pa" => 2e7,
                "m/s" | "rad/s" => 0.1,
                _ => 1e-2,
            };
            let value = |field: &Field| size(&field.unit) * random.uniform();
            fields.iter().map(value).collect::<Vec<f64>>()
        };
        let (measured, reference) = (row(&description.measured), row(&description.reference));
        let sample = Row {
            time_s: 0.0,
            measured: &measured,
            reference: &reference,
            valid: random.uniform() < 0.8,
            held_steps: 0,
        };
        let commands = description.commands.as_ref().map_or(2, Vec::len);
        let mut command = vec![0.0; commands];
        let mut internals = vec![0.0; description.internals.len()];
        (law.step(&sample, &mut command, &mut internals)).expect("answers");
        command
            .iter()
            .chain(&internals)
            .map(|value| value.to_bits())
            .collect()
    }

    #[test]
    fn every_law_resumes_from_any_sample_bit_by_bit() {
        for kind in all() {
            let description = &kind.description;
            let (name, mut parameters) = (&description.name, Settings::default());
            for field in &description.parameters {
                // Integrals and derivatives have memory; the paper's gains use none.
                let value = match field
                    .name
                    .split(['.', '_'])
                    .any(|part| part == "integral" || part == "derivative")
                {
                    true => Some(3.0),
                    false => field.default,
                };
                // A value that is not set is that of `hold`.
                parameters.set(&field.name, value.unwrap_or_default());
            }
            let mut model = Settings::default();
            for field in &description.model {
                model.set(&field.name, field.default.expect("a default"));
            }
            let start = || {
                let setup = Start {
                    parameters: &parameters,
                    model: &model,
                    period_s: 1e-3,
                    commands: &[],
                };
                (kind.start)(&setup).expect("starts")
            };
            assert!(description.saves, "{name}");
            for trial in 0..20 {
                let mut random = RandomStream::new(trial, name);
                let mut straight = start();
                for _ in 0..1 + (random.uniform() * 200.0) as u64 {
                    step(straight.as_mut(), description, &mut random);
                }
                let mut resumed = start();
                resumed
                    .restore(&straight.save().expect("saves"))
                    .expect("restores");
                let mut fresh = start();
                let (mut twin, mut other) = (random.clone(), random.clone());
                let mut remembers = false;
                for k in 0..100 {
                    let expected = step(straight.as_mut(), description, &mut random);
                    let actual = step(resumed.as_mut(), description, &mut twin);
                    assert_eq!(actual, expected, "{name}, trial {trial}, {k} samples later");
                    remembers |= step(fresh.as_mut(), description, &mut other) != expected;
                }
                assert_eq!(remembers, name != "hold", "{name}");
            }
        }
    }

    #[test]
    fn every_default_lies_in_its_own_range() {
        for law in all() {
            let description = law.description;
            for field in description.parameters.iter().chain(&description.model) {
                // Only the value that `hold` holds may be left unset.
                let Some(default) = field.default else {
                    assert_eq!((&*description.name, &*field.name), ("hold", "value"));
                    continue;
                };
                assert!(field.admits(default), "{}: {field:?}", description.name);
            }
        }
    }
}

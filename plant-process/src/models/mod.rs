//! The built-in plants.
//!
//! Each module is one plant: its tables, its equations and their tests. Your own plant has the same form; start from
//! [`spring_mass`].

pub mod drhas;
pub mod spring_mass;

use crate::plant::PlantKind;

/// Returns every plant that a scenario can name.
#[must_use]
pub fn all() -> Vec<PlantKind> {
    vec![
        PlantKind::of::<drhas::Drhas>(),
        PlantKind::of::<spring_mass::SpringMass>(),
    ]
}

#[cfg(test)]
mod tests {
    use shared_types::describe::Settings;
    use shared_types::random::RandomStream;
    use shared_types::time::Interval;

    use super::*;
    use crate::plant::Model;

    /// Returns the default parameters, except that the spools are slow and sticky: otherwise a spool would have no
    /// memory.
    fn parameters(kind: &PlantKind) -> Settings {
        let mut settings = Settings::default();
        for field in &kind.description.parameters {
            let value = match field.name.rsplit('.').next() {
                Some("valve_lag_s") => Some(2e-3),
                _ => field.default,
            };
            settings.set(&field.name, value.expect("a default"));
        }
        settings
    }

    /// Returns the parameters of a step: at some steps the first spool sticks a little, or the spring is soft.
    fn row(kind: &PlantKind, settings: &Settings, random: &mut RandomStream) -> Vec<f64> {
        let faulty = random.uniform() < 0.5;
        let fields = kind.description.parameters.iter();
        let value = |name: &str| match name {
            "actuator1.valve_stuck" if faulty => 0.3,
            "stiffness_n_per_m" if faulty => 40.0,
            name => settings.get(name).expect("set"),
        };
        fields.map(|field| value(&field.name)).collect()
    }

    /// Advances one step under a random command; returns the readings and the truth.
    fn step(
        kind: &PlantKind,
        model: &mut dyn Model,
        step: u64,
        random: &mut RandomStream,
    ) -> Vec<u64> {
        let description = &kind.description;
        let interval = Interval {
            start_s: step as f64 * 1e-4,
            length_s: 1e-4,
            substeps: 4,
        };
        let commands = description.commands.len();
        let command: Vec<f64> = (0..commands)
            .map(|_| 1e-2 * (random.uniform() - 0.5))
            .collect();
        model.advance(&interval, &command).expect("goes on");
        let mut measured = vec![0.0; description.measured.len()];
        let mut truth = vec![0.0; description.truth.len()];
        model.measure(&mut measured).expect("measured");
        let end_s = interval.start_s + interval.length_s;
        (model.truth(end_s, &command, &mut truth)).expect("told");
        measured
            .iter()
            .chain(&truth)
            .map(|value| value.to_bits())
            .collect()
    }

    #[test]
    fn every_plant_resumes_from_any_step_bit_by_bit() {
        for kind in all() {
            let settings = parameters(&kind);
            let name = &kind.description.name;
            assert!(kind.description.saves, "{name}");
            for trial in 0..20 {
                let mut random = RandomStream::new(trial, name);
                let mut straight = (kind.start)(&settings).expect("starts");
                let steps = (random.uniform() * 300.0) as u64;
                let mut present = row(&kind, &settings, &mut random);
                straight.retune(&present).expect("retuned");
                for k in 0..steps {
                    if random.uniform() < 0.05 {
                        present = row(&kind, &settings, &mut random);
                        straight.retune(&present).expect("retuned");
                    }
                    step(&kind, straight.as_mut(), k, &mut random);
                }
                let mut resumed = (kind.start)(&settings).expect("starts");
                resumed.retune(&present).expect("retuned");
                resumed
                    .restore(&straight.save().expect("saves"))
                    .expect("restores");
                let mut twin = random.clone();
                for k in steps..steps + 100 {
                    let actual = step(&kind, resumed.as_mut(), k, &mut twin);
                    let expected = step(&kind, straight.as_mut(), k, &mut random);
                    assert_eq!(
                        actual, expected,
                        "{name}, saved before step {steps}, at {k}"
                    );
                }
            }
        }
    }
}

//! Faults of the plant as a layer around it: each changes a faultable parameter over time.
//!
//! Called by the engine once at every step, before the plant is measured. The models know nothing
//! of it; they are given new parameters.

use hil_config::plan::{FaultEvent, Profile};
use shared_types::describe::{Invalid, PlantDescription, Settings};
use shared_types::record::{FaultEffectSize, FaultTaken};
use shared_types::time::{Rate, Step};

/// The faults of a run and the parameters that result.
#[derive(Debug)]
pub struct FaultLayer {
    rate: Rate,
    healthy: Vec<f64>,
    present: Vec<f64>,
    effects: Vec<Effect>,
}

#[derive(Debug)]
struct Effect {
    taken: FaultTaken,
    step: Step,
    parameter: usize,
    size: f64,
    profile: Profile,
    unit: String,
    max_effect: f64,
}

impl FaultLayer {
    /// The faults of a scenario on a plant with these healthy parameters.
    ///
    /// # Errors
    /// If a parameter is missing, unknown or not open to faults.
    pub fn new(
        plant: &PlantDescription,
        parameters: &Settings,
        rate: Rate,
        events: &[FaultEvent],
    ) -> Result<Self, Invalid> {
        let healthy = (plant.parameters.iter())
            .map(|field| {
                let value = parameters.get(&field.name);
                value.ok_or_else(|| Invalid(format!("parameter `{}` is missing", field.name)))
            })
            .collect::<Result<Vec<f64>, Invalid>>()?;
        let mut effects = Vec::new();
        for event in events {
            for effect in &event.effects {
                let parameter = (plant.parameters.iter())
                    .position(|field| field.faultable && field.name == effect.parameter)
                    .ok_or_else(|| {
                        Invalid(format!("`{}` is not open to faults", effect.parameter))
                    })?;
                effects.push(Effect {
                    taken: FaultTaken {
                        id: event.id,
                        step: effect.step.0,
                        kind: event.kind.clone(),
                        target: effect.target.clone(),
                        parameter: effect.parameter.clone(),
                        canonical: canonical(effect.size, &effect.profile),
                    },
                    step: effect.step,
                    parameter,
                    size: effect.size,
                    profile: effect.profile,
                    unit: plant.parameters[parameter].unit.clone(),
                    max_effect: 0.0,
                });
            }
        }
        Ok(Self {
            rate,
            present: healthy.clone(),
            healthy,
            effects,
        })
    }

    /// Brings the parameters to a step: `Some` of them all if one changed.
    pub fn advance(&mut self, step: Step) -> Option<&[f64]> {
        if self.effects.iter().all(|effect| step < effect.step) {
            return None;
        }
        self.present.copy_from_slice(&self.healthy);
        for effect in &mut self.effects {
            if step >= effect.step {
                // From the steps' difference, so that the course is the same whenever it begins.
                let since_s = self.rate.seconds(Step(step.0 - effect.step.0));
                let change = effect.size * profile(&effect.profile, since_s);
                self.present[effect.parameter] += change;
                if change.abs() > effect.max_effect {
                    effect.max_effect = change.abs();
                }
            }
        }
        Some(&self.present)
    }

    /// The effects that take hold at a step.
    pub fn taken_at(&self, step: Step) -> impl Iterator<Item = &FaultTaken> {
        let at_step = self
            .effects
            .iter()
            .filter(move |effect| effect.step == step);
        at_step.map(|effect| &effect.taken)
    }

    /// The largest effect of each so far.
    #[must_use]
    pub fn largest_effects(&self) -> Vec<FaultEffectSize> {
        let size = |effect: &Effect| FaultEffectSize {
            id: effect.taken.id,
            target: effect.taken.target.clone(),
            parameter: effect.taken.parameter.clone(),
            max_effect: effect.max_effect,
            unit: effect.unit.clone(),
        };
        self.effects.iter().map(size).collect()
    }
}

/// The share of a fault's size that acts so long after its begin.
///
/// Exponential: `beta = 1 - exp(-mu t)` (eq. 6), for t >= 0.
fn profile(profile: &Profile, since_s: f64) -> f64 {
    match *profile {
        Profile::Step => 1.0,
        Profile::Exponential { speed_per_s } => -libm::expm1(-speed_per_s * since_s),
    }
}

/// What decides a fault's course, as exact bits in one fixed form.
fn canonical(size: f64, profile: &Profile) -> String {
    let size = size.to_bits();
    match *profile {
        Profile::Step => format!("add={size:016x} step"),
        Profile::Exponential { speed_per_s } => {
            format!("add={size:016x} exponential={:016x}", speed_per_s.to_bits())
        }
    }
}

#[cfg(test)]
mod tests {
    use hil_config::plan::FaultEffect;
    use shared_types::table::Field;

    use super::*;

    fn layer(profile: Profile) -> FaultLayer {
        let field = |name: &str, faultable| Field {
            default: Some(1.0),
            faultable,
            ..Field::signal(name, "N", "x")
        };
        let plant = PlantDescription {
            name: "p".into(),
            summary: String::new(),
            parameters: vec![field("a_n", true), field("b_n", true), field("c_n", false)],
            truth: vec![],
            measured: vec![],
            commands: vec![],
            faults: vec![],
        };
        let mut parameters = Settings::default();
        for (name, value) in [("a_n", 1.0), ("b_n", 2.0), ("c_n", 3.0)] {
            parameters.set(name, value);
        }
        let effect = |parameter: &str, step, size| FaultEffect {
            target: "t".into(),
            parameter: parameter.into(),
            step: Step(step),
            size,
            profile,
        };
        let effects = vec![
            effect("a_n", 10, 4.0),
            effect("a_n", 20, -1.0),
            effect("b_n", 20, 0.0),
        ];
        let event = FaultEvent {
            id: 1,
            kind: "add".into(),
            at_s: 1.0,
            effects,
        };
        let rate = Rate::new(10.0).expect("legal");
        FaultLayer::new(&plant, &parameters, rate, &[event]).expect("legal")
    }

    #[test]
    fn parameters_change_at_the_step_and_effects_on_one_add_up() {
        let mut layer = layer(Profile::Step);
        assert_eq!(layer.advance(Step(9)), None);
        assert_eq!(layer.advance(Step(10)), Some(&[5.0, 2.0, 3.0][..]));
        assert_eq!(layer.advance(Step(20)), Some(&[4.0, 2.0, 3.0][..]));
        assert_eq!(layer.taken_at(Step(20)).count(), 2);
        let largest: Vec<f64> = layer
            .largest_effects()
            .iter()
            .map(|e| e.max_effect)
            .collect();
        assert_eq!(
            largest,
            [4.0, 1.0, 0.0],
            "an effect of size zero is seen as zero"
        );
    }

    #[test]
    fn the_exponential_profile_is_equation_6() {
        let mut layer = layer(Profile::Exponential { speed_per_s: 2.0 });
        assert_eq!(layer.advance(Step(10)), Some(&[1.0, 2.0, 3.0][..]));
        // 4 (1 - exp(-2 * 0.5)), to 16 digits by an independent calculator
        let half_second_on = layer.advance(Step(15)).expect("changed")[0];
        assert!((half_second_on - (1.0 + 2.528_482_235_314_231)).abs() < 1e-15);
    }

    #[test]
    fn a_parameter_not_open_to_faults_is_refused() {
        let description = PlantDescription {
            name: "p".into(),
            summary: String::new(),
            parameters: vec![Field::signal("c_n", "N", "x")],
            truth: vec![],
            measured: vec![],
            commands: vec![],
            faults: vec![],
        };
        let mut parameters = Settings::default();
        parameters.set("c_n", 3.0);
        let effect = FaultEffect {
            target: "t".into(),
            parameter: "c_n".into(),
            step: Step(0),
            size: 1.0,
            profile: Profile::Step,
        };
        let event = FaultEvent {
            id: 1,
            kind: "add".into(),
            at_s: 0.0,
            effects: vec![effect],
        };
        let rate = Rate::new(10.0).expect("legal");
        assert!(FaultLayer::new(&description, &parameters, rate, &[event]).is_err());
    }
}

//! Faults of the plant as a layer around it: each changes a faultable parameter over time.
//!
//! Called by the engine once at every step, before the plant is measured. The models know nothing
//! of it; they are given new parameters.

use hil_config::plan::{FaultAction, FaultEvent, Move, Profile, Trigger};
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
            for (number, effect) in (0..).zip(&event.effects) {
                let Trigger::Step { step, .. } = event.trigger else {
                    return Err(Invalid("a fault without a step".into()));
                };
                let FaultAction::Move { moves, .. } = &effect.action else {
                    return Err(Invalid(format!("no fault `{}`", event.kind)));
                };
                for Move { parameter, by, .. } in moves {
                    let index = (plant.parameters.iter())
                        .position(|field| field.faultable && field.name == *parameter)
                        .ok_or_else(|| Invalid(format!("`{parameter}` is not open to faults")))?;
                    let step = Step(step.0 + effect.skew_steps);
                    effects.push(Effect {
                        taken: FaultTaken {
                            id: event.id,
                            effect: number,
                            step: step.0,
                            kind: event.kind.clone(),
                            target: effect.target.clone(),
                            parameter: parameter.clone(),
                            canonical: canonical(*by, &effect.profile),
                            wall_only: false,
                        },
                        step,
                        parameter: index,
                        size: *by,
                        profile: effect.profile.clone(),
                        unit: plant.parameters[index].unit.clone(),
                        max_effect: 0.0,
                    });
                }
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
            effect: effect.taken.effect,
            kind: effect.taken.kind.clone(),
            step: Some(effect.step.0),
            ended_step: None,
            acted_steps: 0,
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
        _ => f64::NAN,
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
        _ => String::new(),
    }
}

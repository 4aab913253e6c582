//! `ftsc`: fault-tolerant synchronization control, which estimates the leakage and compensates it while the performance
//! indicator is above its bound (eqs. 52, 67).

use shared_types::describe::Invalid;
use shared_types::state::StateOf;

use super::adaptation::{AdaptationGains, LeakageEstimate};
use super::gains::{ComponentGains, Gains, Output, Performance, TrajectoryGains};
use super::law::{Backstepping, TUNING};
use super::model::Model;
use super::signals::{Internals, Measured, Reference};
use crate::controller::{Controller, Sample, Setup, Tuning};
use crate::laws::drhas::{Command, PLANT};

shared_types::table! {
    /// Parameters of `ftsc` (Table 2).
    pub struct Parameters {
        /// Trajectory generator.
        trajectory: TrajectoryGains,
        /// Component 1: the sum of the two actuators.
        force_sum: ComponentGains,
        /// Component 2: their difference, the force fight.
        force_difference: ComponentGains,
        /// Command of actuator 1.
        actuator1: Output,
        /// Command of actuator 2.
        actuator2: Output,
        /// Judgement of the performance indicator.
        performance: Performance,
        /// Leakage estimate of actuator 1.
        adaptation1: AdaptationGains,
        /// Leakage estimate of actuator 2.
        adaptation2: AdaptationGains,
    }
}

/// The law.
#[derive(Clone, Copy, Debug)]
pub struct Ftsc(Backstepping);

fn gains(own: &Parameters) -> Gains {
    Gains {
        trajectory: own.trajectory,
        components: [own.force_sum, own.force_difference],
        outputs: [own.actuator1, own.actuator2],
        performance: own.performance,
    }
}

impl Controller for Ftsc {
    const NAME: &'static str = "ftsc";
    const SUMMARY: &'static str =
        "Fault-tolerant synchronization control: NRSC with an online estimate of severe leakage.";
    const PLANTS: &'static [&'static str] = &[PLANT];
    type Parameters = Parameters;
    type Model = Model;
    type Measured = Measured;
    type Reference = Reference;
    type Command = Command;
    type Internals = Internals;

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::new(
            |law: &Self| law.0.state(),
            |law, state| law.0.restore(state),
        ))
    }

    fn tuning() -> Option<Tuning<Self>> {
        Some(Tuning {
            does: TUNING,
            take: |law, setup, transition| {
                let adaptation = Some([setup.parameters.adaptation1, setup.parameters.adaptation2]);
                (law.0).retune(&gains(&setup.parameters), adaptation, transition);
            },
        })
    }

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        let gains = gains(&setup.parameters);
        let estimate =
            LeakageEstimate::new([setup.parameters.adaptation1, setup.parameters.adaptation2])?;
        Backstepping::start(&gains, &setup.model, Some(estimate), setup.period_s).map(Self)
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Internals) {
        if sample.valid {
            self.0.step(&sample.measured, &sample.reference)
        } else {
            self.0.hold()
        }
    }
}

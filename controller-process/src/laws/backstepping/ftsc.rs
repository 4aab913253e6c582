//! `ftsc`: fault-tolerant synchronization control, which estimates the leakage and compensates it while the performance
//! indicator is above its bound (eqs. 52, 67).

use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table::Table;

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

shared_types::table! {
    /// Numbers that the law keeps from sample to sample. The bound of the Lyapunov function depends on the count of
    /// samples, which is no number of the state.
    pub struct StateRow {
        /// Velocity of piston 1 at the last sample.
        actuator1_last_velocity_mps: "m/s",
        /// Velocity of piston 2 at the last sample.
        actuator2_last_velocity_mps: "m/s",
        /// Estimate of the leakage coefficient of actuator 1.
        leakage_estimate1_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
        /// Estimate of the leakage coefficient of actuator 2.
        leakage_estimate2_m3ps_per_sqrt_pa: "m3/s/sqrt(Pa)",
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
        let state = StateOf::new(
            |law: &Self| law.0.state(),
            |law, state| law.0.restore(state),
        );
        Some(state.named(
            |law| {
                StateRow::from_row([law.0.last_velocities_mps(), law.0.estimates()].as_flattened())
            },
            |law, row: StateRow| {
                law.0.set_last_velocities_mps([
                    row.actuator1_last_velocity_mps,
                    row.actuator2_last_velocity_mps,
                ]);
                law.0.set_estimates([
                    row.leakage_estimate1_m3ps_per_sqrt_pa,
                    row.leakage_estimate2_m3ps_per_sqrt_pa,
                ]);
            },
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

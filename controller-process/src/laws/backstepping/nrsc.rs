//! `nrsc`: nonlinear robust synchronization control, the FTSC law without adaptation (Remark 10).

use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table::Table;

use super::gains::{ComponentGains, Gains, Output, Performance, TrajectoryGains};
use super::law::{Backstepping, TUNING};
use super::model::Model;
use super::signals::{Internals, Measured, Reference};
use crate::controller::{Controller, Sample, Setup, Tuning};
use crate::laws::drhas::{Command, PLANT};

shared_types::table! {
    /// Parameters of `nrsc` (Table 2).
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
    }
}

/// The law.
#[derive(Clone, Copy, Debug)]
pub struct Nrsc(Backstepping);

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
    }
}

impl Controller for Nrsc {
    const NAME: &'static str = "nrsc";
    const SUMMARY: &'static str =
        "Nonlinear robust synchronization control: tolerates slight leakage (paper, Remark 10).";
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
            |law| StateRow::from_row(&law.0.last_velocities_mps()),
            |law, row: StateRow| {
                law.0.set_last_velocities_mps([
                    row.actuator1_last_velocity_mps,
                    row.actuator2_last_velocity_mps,
                ]);
            },
        ))
    }

    fn tuning() -> Option<Tuning<Self>> {
        Some(Tuning {
            does: TUNING,
            take: |law, setup, transition| {
                let adaptation = None;
                (law.0).retune(&gains(&setup.parameters), adaptation, transition);
            },
        })
    }

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        let gains = gains(&setup.parameters);
        Backstepping::start(&gains, &setup.model, None, setup.period_s).map(Self)
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Internals) {
        if sample.valid {
            self.0.step(&sample.measured, &sample.reference)
        } else {
            self.0.hold()
        }
    }
}

//! `pid` for the teaching plant `spring-mass`: a force from the error of the position.
//!
//! With the default gains and the plant's default mass, damping and stiffness the closed loop has its
//! poles near -13 and -9.5 +- 8i rad/s, and no steady error.

use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table::{Empty, Table};

use super::{Gains, Pid, TUNING};
use crate::controller::{Controller, Sample, Setup, Tuning};
use crate::laws::limit::UNLIMITED;

shared_types::table! {
    /// Parameters of the law.
    pub struct Parameters {
        /// Proportional gain k_p.
        proportional_n_per_m: "N/m" = 300.0 in (-1e9)..=1e9 [tunable],
        /// Integral gain k_i.
        integral_n_per_m_s: "N/(m s)" = 2000.0 in (-1e9)..=1e9 [tunable],
        /// Derivative gain k_d. A jump of the reference passes through it as one large command.
        derivative_n_s_per_m: "N s/m" = 30.0 in (-1e9)..=1e9 [tunable],
        /// Largest magnitude of the force; infinite means no limit.
        command_limit_n: "N" = UNLIMITED in 0.0..=UNLIMITED [tunable],
    }
}

shared_types::table! {
    /// Signals that the law needs to measure.
    pub struct Measured {
        /// Position x.
        position_m: "m",
    }
}

shared_types::table! {
    /// Signals that the law follows.
    pub struct Reference {
        /// Wanted position.
        position_m: "m",
    }
}

shared_types::table! {
    /// Commands that the law gives.
    pub struct Command {
        /// Force F on the mass.
        force_n: "N",
    }
}

shared_types::table! {
    /// Numbers that the law keeps from sample to sample.
    pub struct StateRow {
        /// Integral of the error.
        error_integral_m_s: "m s",
        /// Error at the last sample.
        last_error_m: "m",
    }
}

/// The law.
#[derive(Clone, Copy, Debug)]
pub struct ForcePid {
    pid: Pid,
}

fn gains(parameters: &Parameters) -> Gains {
    Gains {
        proportional: parameters.proportional_n_per_m,
        integral: parameters.integral_n_per_m_s,
        derivative: parameters.derivative_n_s_per_m,
        limit: parameters.command_limit_n,
    }
}

impl Controller for ForcePid {
    const NAME: &'static str = "pid";
    const SUMMARY: &'static str = "A PID loop from the position's error to the force.";
    const PLANTS: &'static [&'static str] = &["spring-mass"];
    type Parameters = Parameters;
    type Model = Empty;
    type Measured = Measured;
    type Reference = Reference;
    type Command = Command;
    type Internals = Empty;

    fn state() -> Option<StateOf<Self>> {
        let state = StateOf::new(
            |law: &Self| law.pid.state(),
            |law, state| law.pid.restore(state),
        );
        Some(state.named(
            |law| StateRow::from_row(&law.pid.numbers()),
            |law,
             StateRow {
                 error_integral_m_s,
                 last_error_m,
             }| {
                law.pid.set_numbers([error_integral_m_s, last_error_m]);
            },
        ))
    }

    fn tuning() -> Option<Tuning<Self>> {
        Some(Tuning {
            does: TUNING,
            take: |law, setup, transition| law.pid.retune(gains(&setup.parameters), transition),
        })
    }

    fn start(setup: &Setup<Self>) -> Result<Self, Invalid> {
        Ok(Self {
            pid: Pid::new(gains(&setup.parameters), setup.period_s),
        })
    }

    fn step(&mut self, sample: &Sample<Self>) -> (Command, Empty) {
        let force_n = if sample.valid {
            let error_m = sample.reference.position_m - sample.measured.position_m;
            self.pid.update(error_m)
        } else {
            self.pid.hold()
        };
        (Command { force_n }, Empty {})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_force_is_the_sum_of_the_three_terms() {
        let setup = Setup {
            parameters: Parameters {
                proportional_n_per_m: 10.0,
                integral_n_per_m_s: 4.0,
                derivative_n_s_per_m: 2.0,
                command_limit_n: f64::INFINITY,
            },
            model: Empty {},
            period_s: 0.5,
        };
        let mut law = ForcePid::start(&setup).expect("starts");
        let mut step = |wanted_m, position_m| {
            let sample = Sample {
                held_steps: 0,
                time_s: 0.0,
                measured: Measured { position_m },
                reference: Reference {
                    position_m: wanted_m,
                },
                valid: true,
            };
            law.step(&sample).0.force_n
        };
        assert_eq!(step(3.0, 1.0), 20.0);
        // e = 1: 10 * 1 + 4 * 0.5 * (2 + 1) / 2 + 2 * (1 - 2) / 0.5
        assert_eq!(step(3.0, 2.0), 9.0);
    }
}

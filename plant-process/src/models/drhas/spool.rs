//! The spool of the servo valve: from the commanded current to the spool's position (eq. 1), with effects beyond the
//! paper: a null bias, stops, a lag, and sticking.
//!
//! Called by the substeps of the hydraulic system, which pass the position to [`valve`](super::valve). The current is
//! constant during a step, so that the lag has an exact solution: the spool is not among the integrated states. With
//! neutral parameters the position is `k_i u` at once. The stops are far beyond the range of normal operation; they
//! exist because a law that has lost its plant may request any current, and no equation of the valve holds for a spool
//! of a kilometre.

use serde::{Deserialize, Serialize};

use super::tables::ActuatorParameters;

/// Position of the spool, and the position at which it sticks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spool {
    /// Position x_v, positive for a flow that extends the rod.
    pub position_m: f64,
    /// Position x_j at which the spool got stuck, or at which it would stick now.
    pub stuck_m: f64,
}

/// Displacement of a free spool at rest.
///
/// `x_v = k_i u + b`, limited to `x_max` on either side (eq. 1 with the null bias `b` and the stops `x_max`; any
/// current).
#[inline]
#[must_use]
pub fn free_displacement_m(p: &ActuatorParameters, current_a: f64) -> f64 {
    let (k_i, b, u) = (p.valve_gain_m_per_a, p.valve_null_bias_m, current_a);
    let (x_v, x_max) = (k_i * u + b, p.valve_travel_m);
    if x_v > x_max {
        x_max
    } else if x_v < -x_max {
        -x_max
    } else {
        x_v
    }
}

/// Position on the way to a constant target.
///
/// `x_v(t) = w + (x_v(0) - w) exp(-t / T)`, the solution of `T x_v' = w - x_v`: the spool as a first-order system
/// (Merritt, Hydraulic Control Systems, 1967, on electrohydraulic servovalves). Exact for any duration; `T = 0` arrives
/// at once. Not inlined: inside the loop of a spool without lag it would cost more than the spool.
#[cold]
#[must_use]
pub fn lagging_position_m(lag_s: f64, from_m: f64, wanted_m: f64, duration_s: f64) -> f64 {
    if lag_s == 0.0 {
        return wanted_m;
    }
    wanted_m + (from_m - wanted_m) * libm::exp(-duration_s / lag_s)
}

impl Spool {
    /// Creates a spool at rest without current.
    #[must_use]
    pub fn at_null(p: &ActuatorParameters) -> Self {
        let position_m = free_displacement_m(p, 0.0);
        Self {
            position_m,
            stuck_m: position_m,
        }
    }

    /// Returns the target position of the spool under a constant current.
    ///
    /// `w = (1 - j) (k_i u + b) + j x_j`: a spool stuck to the degree `j` covers only the rest of its way, and a
    /// completely stuck spool stays where it stuck.
    #[inline]
    #[must_use]
    pub fn wanted_m(&self, p: &ActuatorParameters, current_a: f64) -> f64 {
        let (j, free_m) = (p.valve_stuck, free_displacement_m(p, current_a));
        if j == 0.0 {
            return free_m;
        }
        (1.0 - j) * free_m + j * self.stuck_m
    }

    /// Advances the spool, and returns its positions at the beginning, middle and end.
    ///
    /// Runge-Kutta needs smooth inputs: with a lag shorter than a substep the method overweights the beginning, and the
    /// spool acts up to a sixth of a substep (4 us of 25 us) too late.
    #[inline]
    pub fn travel(&mut self, p: &ActuatorParameters, wanted_m: f64, duration_s: f64) -> [f64; 3] {
        let lag_s = p.valve_lag_s;
        let way_m = if lag_s == 0.0 {
            [wanted_m; 3]
        } else {
            let on = |from_m| lagging_position_m(lag_s, from_m, wanted_m, 0.5 * duration_s);
            let middle_m = on(self.position_m);
            [self.position_m, middle_m, on(middle_m)]
        };
        self.position_m = way_m[2];
        if p.valve_stuck == 0.0 {
            self.stuck_m = way_m[2];
        }
        way_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spool_follows_the_current() {
        let p = ActuatorParameters::default();
        assert_eq!(free_displacement_m(&p, 2.0), 6.08e-3);
        assert_eq!(free_displacement_m(&p, -0.5), -1.52e-3);
    }

    #[test]
    fn a_null_bias_shifts_the_spool() {
        let p = ActuatorParameters {
            valve_null_bias_m: 1e-3,
            ..ActuatorParameters::default()
        };
        assert_eq!(Spool::at_null(&p).position_m, 1e-3);
        assert!((free_displacement_m(&p, 2.0) - 7.08e-3).abs() < 1e-18);
    }

    #[test]
    fn the_spool_ends_at_its_stops() {
        let p = ActuatorParameters {
            valve_travel_m: 5e-3,
            ..ActuatorParameters::default()
        };
        for (current_a, expected_m) in [(1.0, 3.04e-3), (2.0, 5e-3), (-1e30, -5e-3)] {
            assert_eq!(free_displacement_m(&p, current_a), expected_m);
        }
        // NaN must stay visible.
        assert!(free_displacement_m(&p, f64::NAN).is_nan());
    }

    #[test]
    fn without_lag_the_spool_arrives_at_once() {
        let p = ActuatorParameters::default();
        let mut spool = Spool::at_null(&p);
        assert_eq!(spool.travel(&p, 6e-3, 1e-5), [6e-3; 3]);
        assert_eq!(spool.position_m, 6e-3);
    }

    #[test]
    fn a_lagging_spool_halves_its_remaining_travel_every_ln_2_time_constants() {
        let p = ActuatorParameters {
            valve_lag_s: 0.01,
            ..ActuatorParameters::default()
        };
        let mut spool = Spool::at_null(&p);
        let two_half_lives_s = 0.02 * std::f64::consts::LN_2;
        let [begin_m, middle_m, end_m] = spool.travel(&p, 8e-3, two_half_lives_s);
        assert_eq!(begin_m, 0.0);
        assert!((middle_m - 4e-3).abs() < 1e-17, "{middle_m}");
        assert!((end_m - 6e-3).abs() < 1e-17, "{end_m}");
        assert_eq!(spool.position_m, end_m);
    }

    #[test]
    fn the_course_does_not_depend_on_its_subdivision() {
        let p = ActuatorParameters {
            valve_lag_s: 3e-4,
            ..ActuatorParameters::default()
        };
        let (mut whole, mut cut) = (Spool::at_null(&p), Spool::at_null(&p));
        whole.travel(&p, 5e-3, 1e-4);
        for _ in 0..16 {
            cut.travel(&p, 5e-3, 6.25e-6);
        }
        assert!((whole.position_m / cut.position_m - 1.0).abs() < 1e-14);
        assert!(whole.position_m > 1e-3);
    }

    #[test]
    fn a_stuck_spool_stays_until_freed_and_sticks_elsewhere_next_time() {
        let free = ActuatorParameters::default();
        let stuck = ActuatorParameters {
            valve_stuck: 1.0,
            ..free
        };
        let mut spool = Spool::at_null(&free);
        let mut positions_m = Vec::new();
        for (p, current_a) in [
            (&free, 1.0),
            (&stuck, 2.0),
            (&stuck, -2.0),
            (&free, -1.0),
            (&stuck, 2.0),
        ] {
            let wanted_m = spool.wanted_m(p, current_a);
            spool.travel(p, wanted_m, 1e-4);
            positions_m.push(spool.position_m);
        }
        let (there_m, elsewhere_m) = (3.04e-3, -3.04e-3);
        assert_eq!(
            positions_m,
            [there_m, there_m, there_m, elsewhere_m, elsewhere_m]
        );
    }

    #[test]
    fn a_lagging_spool_sticks_on_its_way() {
        let lagging = ActuatorParameters {
            valve_lag_s: 0.01,
            ..ActuatorParameters::default()
        };
        let stuck = ActuatorParameters {
            valve_stuck: 1.0,
            ..lagging
        };
        let mut spool = Spool::at_null(&lagging);
        spool.travel(&lagging, 8e-3, 0.01 * std::f64::consts::LN_2);
        let wanted_m = spool.wanted_m(&stuck, 5.0);
        assert_eq!(spool.travel(&stuck, wanted_m, 1.0), [wanted_m; 3]);
        assert!((wanted_m - 4e-3).abs() < 1e-17, "{wanted_m}");
    }

    #[test]
    fn a_half_stuck_spool_travels_half_the_distance_from_its_stuck_position() {
        let half = ActuatorParameters {
            valve_stuck: 0.5,
            ..ActuatorParameters::default()
        };
        let spool = Spool {
            position_m: 2e-3,
            stuck_m: 2e-3,
        };
        // Half of 3.04e-3 * 2 and half of 2e-3; repeated calls do not matter.
        for _ in 0..3 {
            let wanted_m = spool.wanted_m(&half, 2.0);
            assert!((wanted_m - 4.04e-3).abs() < 1e-18, "{wanted_m}");
        }
    }
}

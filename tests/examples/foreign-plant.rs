//! A plant process with the mass on a spring under names and units that no shipped law knows. Not a program of the
//! workspace: tests of `[[connect]]` run it.

#![expect(non_snake_case, reason = "the spelling of a foreign name")]

use std::process::ExitCode;

use plant_process::integrate::integrate;
use plant_process::plant::{Plant, PlantKind};
use shared_types::describe::Invalid;
use shared_types::state::StateOf;
use shared_types::table;
use shared_types::time::Interval;

table! {
    /// Parameters of the plants, in SI units.
    struct Parameters {
        /// Mass m.
        mass_kg: "kg" = 1.0 in 1e-6..=1e9,
        /// Damping c.
        damping_n_s_per_m: "N s/m" = 2.0 in 0.0..=1e9,
        /// Spring stiffness k.
        stiffness_n_per_m: "N/m" = 100.0 in 0.0..=1e12,
    }
}

/// Computes `x'' = (F - c x' - k x) / m` in a unit of length of which a metre has `per_m`, and a unit of force of which
/// a newton has `per_n`.
fn acceleration(p: &Parameters, [per_m, per_n]: [f64; 2], force: f64, [x, v]: [f64; 2]) -> f64 {
    let (c, k, m) = (p.damping_n_s_per_m, p.stiffness_n_per_m, p.mass_kg);
    (force / per_n - c * (v / per_m) - k * (x / per_m)) / m * per_m
}

macro_rules! plant {
    ($plant:ident, $name:literal, $module:ident, $length:literal, $speed:literal, $force:literal, $per:expr) => {
        mod $module {
            shared_types::table! {
                /// Way and speed.
                pub(super) struct Way {
                    /// Way s.
                    s: $length,
                    /// Derivative, as an FMU would call it `der(s)`.
                    der__s: $speed,
                }
            }
            shared_types::table! {
                /// Force that moves the slider.
                pub(super) struct Force {
                    /// Force f.
                    f: $force,
                }
            }
        }

        struct $plant(Parameters, [f64; 2]);

        impl Plant for $plant {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = "A mass on a spring under foreign names.";
            type Parameters = Parameters;
            type Truth = $module::Way;
            type Measured = $module::Way;
            type Command = $module::Force;

            fn state() -> Option<StateOf<Self>> {
                Some(StateOf::new(|plant: &Self| plant.1, |plant, x| plant.1 = x))
            }

            fn start(parameters: &Parameters) -> Result<Self, Invalid> {
                Ok(Self(*parameters, [0.0; 2]))
            }

            fn retune(&mut self, parameters: &Parameters) {
                self.0 = *parameters;
            }

            fn measure(&self) -> $module::Way {
                let [s, der__s] = self.1;
                $module::Way { s, der__s }
            }

            fn truth(&self, _: f64, _: &$module::Force) -> $module::Way {
                self.measure()
            }

            fn advance(&mut self, interval: &Interval, command: &$module::Force) {
                let p = &self.0;
                integrate(&mut self.1, interval, |_, x| {
                    [x[1], acceleration(p, $per, command.f, *x)]
                });
            }
        }
    };
}

plant!(Slider, "slider", slider, "mm", "mm/s", "kN", [1e3, 1e-3]);
// Powers of two change no bit of a fraction: exactly the numbers of a plant in metres and newtons.
plant!(
    Halves,
    "halves",
    halves,
    "half_m",
    "half_m/s",
    "quarter_N",
    [2.0, 4.0]
);

fn main() -> ExitCode {
    let plants = vec![PlantKind::of::<Slider>(), PlantKind::of::<Halves>()];
    plant_process::program::run("foreign-plant", "0.1.0", plants)
}

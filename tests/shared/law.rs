//! A law from a position to a force, for programs of tests.

/// Makes a law of a type: its name, summary and measurement, its state if it can be saved, its start, and its force in N for
/// a measurement.
macro_rules! law {
    ($law:ident, $name:literal, $summary:literal, $measured:ty, $state:expr, $start:expr, $force_n:expr) => {
        impl controller_process::controller::Controller for $law {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = $summary;
            type Parameters = shared_types::table::Empty;
            type Model = shared_types::table::Empty;
            type Measured = $measured;
            type Reference = shared_types::table::Empty;
            type Command = Force;
            type Internals = shared_types::table::Empty;

            fn start(
                _: &controller_process::controller::Setup<Self>,
            ) -> Result<Self, shared_types::describe::Invalid> {
                Ok($start)
            }

            fn state() -> Option<shared_types::state::StateOf<Self>> {
                $state
            }

            fn step(
                &mut self,
                sample: &controller_process::controller::Sample<Self>,
            ) -> (Force, shared_types::table::Empty) {
                let force_n: fn(&mut Self, &$measured) -> f64 = $force_n;
                let force_n = force_n(self, &sample.measured);
                (Force { force_n }, shared_types::table::Empty {})
            }
        }
    };
}

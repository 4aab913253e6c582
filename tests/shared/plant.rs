//! A plant of one position, for programs of tests.

/// Makes a plant of a type: its name, summary and parameters, its start, its position in m, and what it does in a step.
macro_rules! plant {
    ($plant:ident, $name:literal, $summary:literal, $parameters:ty, $start:expr, $position_m:expr, $advance:expr) => {
        impl plant_process::plant::Plant for $plant {
            const NAME: &'static str = $name;
            const SUMMARY: &'static str = $summary;
            type Parameters = $parameters;
            type Truth = Position;
            type Measured = Position;
            type Command = Force;

            fn start(parameters: &$parameters) -> Result<Self, shared_types::describe::Invalid> {
                let start: fn(&$parameters) -> Self = $start;
                Ok(start(parameters))
            }

            fn retune(&mut self, _: &$parameters) {}

            fn measure(&self) -> Position {
                let position_m: fn(&Self) -> f64 = $position_m;
                let position_m = position_m(self);
                Position { position_m }
            }

            fn truth(&self, _: f64, _: &Force) -> Position {
                self.measure()
            }

            fn advance(&mut self, _: &shared_types::time::Interval, _: &Force) {
                let advance: fn(&mut Self) = $advance;
                advance(self);
            }
        }
    };
}

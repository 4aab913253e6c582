//! Instruments: sensors and actuators, and the chains of stages that they consist of.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::table::Field;
use shared_types::time::Rate;

/// Sensor of a measured signal, or actuator of a command.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Instrument {
    /// Name of the signal.
    pub signal: String,
    /// Values of the keys that are set, in the signal's unit, s and Hz; `range` is `range_min` and
    /// `range_max`.
    pub values: Settings,
    /// Share of other measured signals, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cross: BTreeMap<String, f64>,
    /// Recorded inputs of stages, by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub taps: Vec<String>,
}

/// Stage of an instrument: a kind of fault on numbers, at full size since step 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Key of the instrument that asks for it.
    pub key: &'static str,
    /// Name of the kind.
    pub kind: String,
    /// Parameters of the kind.
    pub parameters: Settings,
    /// List of the kind, with its rows one after another.
    pub list: Vec<f64>,
}

impl Stage {
    fn new<const N: usize>(key: &'static str, kind: &str, parameters: [(&str, f64); N]) -> Self {
        let mut settings = Settings::default();
        for (name, value) in parameters {
            settings.set(name, value);
        }
        Self {
            key,
            kind: kind.into(),
            parameters: settings,
            list: Vec::new(),
        }
    }
}

impl Instrument {
    /// Returns the value of a key.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<f64> {
        self.values.get(key)
    }

    /// Returns the number of steps of the run in a period of the instrument.
    #[must_use]
    pub fn divisor(&self, rate: Rate) -> f64 {
        self.get("rate_hz")
            .map_or(1.0, |rate_hz| (rate.hz() / rate_hz).round())
    }

    /// Distance between two neighbouring values of a converter.
    #[must_use]
    pub fn resolution(&self) -> Option<f64> {
        self.get("resolution").or_else(|| {
            let (min, max) = self.range()?;
            Some((max - min) / libm::ldexp(1.0, self.get("bits")? as i32))
        })
    }

    /// Range, which a converter with a number of bits covers up to one step below its end.
    #[must_use]
    pub fn range(&self) -> Option<(f64, f64)> {
        Some((self.get("range_min")?, self.get("range_max")?))
    }

    /// Standard deviation of the noise of a given density, drawn at every step.
    ///
    /// `sigma = d sqrt(rate / 2)` for a one-sided amplitude density `d`: its square times the band from 0 to half the
    /// rate. The rate is that of the run if a lag follows, otherwise that of the sensor.
    #[must_use]
    pub fn density_sigma(&self, rate: Rate) -> Option<f64> {
        let divisor = match self.get("lag_hz") {
            Some(_) => 1.0,
            None => self.divisor(rate),
        };
        Some(self.get("noise_density")? * (rate.hz() / divisor / 2.0).sqrt())
    }

    /// The stages of a sensor, in the order in which a reading passes them; `fields` are all measured
    /// signals.
    #[must_use]
    pub fn sensor_stages(&self, rate: Rate, fields: &[Field]) -> Vec<Stage> {
        let mut stages = Vec::new();
        let get = |key| self.get(key);
        stages
            .extend(get("scale").map(|factor| Stage::new("scale", "scale", [("factor", factor)])));
        stages.extend(self.coupling(fields));
        stages.extend(get("bias").map(|bias| Stage::new("bias", "bias", [("bias", bias)])));
        stages.extend(get("bias_sigma").map(|sigma| {
            let time_constant_s = get("bias_tau_s").unwrap_or(f64::INFINITY);
            let both = [
                ("standard_deviation", sigma),
                ("time_constant_s", time_constant_s),
            ];
            Stage::new("bias_sigma", "gauss-markov", both)
        }));
        stages.extend(
            get("bias_walk")
                .map(|walk| Stage::new("bias_walk", "random-walk", [("walk_per_sqrt_s", walk)])),
        );
        let noise = |key| move |sigma| Stage::new(key, "noise", [("standard_deviation", sigma)]);
        stages.extend(self.density_sigma(rate).map(noise("noise_density")));
        stages.extend(self.lag());
        stages.extend(get("noise_sigma").map(noise("noise_sigma")));
        stages.extend(self.sampling(rate));
        stages.extend(self.delay(rate, "delay_s"));
        self.quantise(&mut stages);
        stages.extend(self.saturation());
        stages
    }

    /// The stages of an actuator, in the order in which a command passes them.
    #[must_use]
    pub fn actuator_stages(&self, rate: Rate) -> Vec<Stage> {
        let mut stages = Vec::new();
        stages.extend(self.delay(rate, "dead_time_s"));
        let one =
            |key: &'static str, kind: &str| Some(Stage::new(key, kind, [(key, self.get(key)?)]));
        stages.extend(one("rate_limit_per_s", "rate-limit"));
        stages.extend(self.lag());
        stages.extend(one("dead_band", "dead-band"));
        stages.extend(one("backlash", "backlash"));
        stages.extend(self.saturation());
        self.quantise(&mut stages);
        stages.extend(self.sampling(rate));
        stages
    }

    fn coupling(&self, fields: &[Field]) -> Option<Stage> {
        let place = |name: &String| fields.iter().position(|field| field.name == *name);
        let rows = self.cross.iter().filter_map(|(name, factor)| {
            let place = place(name)?;
            Some([(place + 1) as f64, *factor])
        });
        let list: Vec<f64> = rows.flatten().collect();
        (!list.is_empty()).then(|| Stage {
            list,
            ..Stage::new("cross", "cross-coupling", [])
        })
    }

    fn lag(&self) -> Option<Stage> {
        let key = "lag_hz";
        let lag_hz = (key, self.get(key)?);
        Some(match self.get("lag_damping") {
            None => Stage::new(key, "lag", [lag_hz]),
            Some(damping) => {
                Stage::new(key, "second-order-lag", [lag_hz, ("lag_damping", damping)])
            }
        })
    }

    fn sampling(&self, rate: Rate) -> Option<Stage> {
        let every_steps = self.divisor(rate);
        let phase_steps = self.get("phase_steps").unwrap_or(0.0);
        let both = [("every_steps", every_steps), ("phase_steps", phase_steps)];
        (every_steps > 1.0).then(|| Stage::new("rate_hz", "sample-hold", both))
    }

    /// A delay of whole steps.
    fn delay(&self, rate: Rate, key: &'static str) -> Option<Stage> {
        let steps = (self.get(key)? * rate.hz()).round();
        (steps > 0.0).then(|| Stage::new(key, "delay", [("steps", steps)]))
    }

    /// Rounds to the values of a converter, which begin at the lower end of its range.
    fn quantise(&self, stages: &mut Vec<Stage>) {
        let Some(step) = self.resolution() else {
            return;
        };
        let key = match self.get("bits") {
            Some(_) => "bits",
            None => "resolution",
        };
        let begin = self.range().map_or(0.0, |(min, _)| min);
        let is_multiple = (begin / step).fract() == 0.0;
        let shift = |by: f64| (!is_multiple).then(|| Stage::new(key, "bias", [("bias", by)]));
        stages.extend(shift(-begin));
        stages.push(Stage::new(key, "quantisation", [("step", step)]));
        stages.extend(shift(begin));
    }

    fn saturation(&self) -> Option<Stage> {
        let (min, max) = self.range()?;
        let last = match self.get("bits") {
            Some(_) => max - self.resolution().unwrap_or(0.0),
            None => max,
        };
        Some(Stage::new(
            "range",
            "saturation",
            [("min", min), ("max", last)],
        ))
    }
}

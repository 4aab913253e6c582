//! Effect of a scenario's sensors and actuators at its rate, as text or JSON.

use std::fmt::Write;

use hil_config::plan::{Instrument, Plan};
use plant_process::instruments::Figures;
use serde_json::{Value, json};
use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::number::{short, short_in};
use shared_types::table::Field;

/// Instrument with what follows from its keys.
struct Described<'a> {
    /// Full name of its signal.
    signal: String,
    unit: &'a str,
    instrument: &'a Instrument,
    /// Keys of its stages, in their order.
    stages: Vec<&'static str>,
    figures: Figures,
    /// `true` if the law receives the signal, or sends it.
    is_used: bool,
}

/// Plant and law of a plan, the law as seen on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Sides<'a> {
    /// Plant, without the commands that the scenario drives.
    pub plant: &'a PlantDescription,
    /// Law with its signals as the plan connects them.
    pub law: &'a LawDescription,
}

/// Describes each instrument.
fn described<'a>(plan: &'a Plan, Sides { plant, law }: Sides<'a>) -> Vec<Described<'a>> {
    // A law without commands of its own sends all those of the plant.
    let is_used = move |group: &str, field: &Field| {
        let fields = match group {
            "measured" => Some(&law.measured),
            _ => law.commands.as_ref(),
        };
        let has = |fields: &Vec<Field>| { fields.iter() }.any(|one| field.is_called(&one.name));
        fields.is_none_or(has)
    };
    let rate = plan.run.rate;
    let of = |group: &'static str, instruments: &'a [Instrument], fields: &'a [Field]| {
        instruments.iter().map(move |instrument| {
            let field = fields.iter().find(|field| field.name == instrument.signal);
            let stages = match group {
                "measured" => instrument.sensor_stages(rate, fields),
                _ => instrument.actuator_stages(rate),
            };
            let mut stages: Vec<_> = stages.iter().map(|stage| stage.key).collect();
            stages.dedup();
            Described {
                signal: format!("{group}.{}", instrument.signal),
                unit: field.map_or("1", |field| field.unit.as_str()),
                instrument,
                stages,
                figures: Figures::of(instrument, rate),
                is_used: field.is_none_or(|field| is_used(group, field)),
            }
        })
    };
    let sensors = of("measured", &plan.sensors, &plant.measured);
    sensors
        .chain(of("command", &plan.actuators, &plant.commands))
        .collect()
}

/// Describes the instruments of a plan, with their phase loss at these frequencies.
#[must_use]
pub fn text(plan: &Plan, sides: Sides<'_>, frequencies_hz: &[f64]) -> String {
    let mut text = String::new();
    let rate_hz = plan.run.rate.hz();
    for one in described(plan, sides) {
        let Described {
            signal,
            unit,
            instrument,
            stages,
            figures,
            is_used,
        } = one;
        if !text.is_empty() {
            text.push('\n');
        }
        let _ = writeln!(text, "{signal}");
        let samples = rate_hz / instrument.divisor(plan.run.rate);
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "  {name:<12}  {value}");
        };
        let Figures {
            noise_sigma,
            quantisation_sigma,
            dead_s,
            hold_s,
            lag_s,
            ..
        } = figures;
        let sigma = (noise_sigma * noise_sigma + quantisation_sigma * quantisation_sigma).sqrt();
        let parts = format!(
            "{} (noise {}, quantisation {})",
            short_in(sigma, unit),
            short(noise_sigma),
            short(quantisation_sigma)
        );
        line("stages", stages.join(", "));
        line("samples", format!("{} a second", short(samples)));
        line("one sigma", parts);
        if let Some(sigma) = instrument.get("bias_sigma") {
            let course = match instrument.get("bias_tau_s") {
                Some(tau_s) => format!("correlation time {} s", short(tau_s)),
                None => "drawn once a run".into(),
            };
            line(
                "bias",
                format!("one sigma {}, {course}", short_in(sigma, unit)),
            );
        }
        if let Some(walk) = instrument.get("bias_walk") {
            line(
                "walk",
                format!("one sigma {} after 1 s", short_in(walk, unit)),
            );
        }
        let total_s = dead_s + hold_s + lag_s;
        line(
            "delay",
            format!(
                "{} s (dead time {}, hold {}, lag {})",
                short(total_s),
                short(dead_s),
                short(hold_s),
                short(lag_s)
            ),
        );
        let losses = frequencies_hz.iter().map(|hz| {
            let loss_deg = figures.phase_loss_deg(*hz);
            format!("{} deg at {} Hz", short(loss_deg), short(*hz))
        });
        line("phase loss", losses.collect::<Vec<_>>().join(", "));
        if !is_used {
            let law = &sides.law.name;
            line("unused", format!("law `{law}` does not use this signal"));
        }
    }
    if text.is_empty() {
        text = format!("{} has neither sensors nor actuators\n", plan.name);
    }
    text
}

/// Describes the same as JSON.
#[must_use]
pub fn json(plan: &Plan, sides: Sides<'_>, frequencies_hz: &[f64]) -> Value {
    let one = |one: Described<'_>| {
        let Described {
            instrument,
            figures,
            ..
        } = &one;
        let losses = frequencies_hz
            .iter()
            .map(|hz| json!({"frequency_hz": hz, "phase_loss_deg": figures.phase_loss_deg(*hz)}));
        json!({
            "signal": one.signal,
            "unit": one.unit,
            "stages": one.stages,
            "is_used": one.is_used,
            "rate_hz": plan.run.rate.hz() / instrument.divisor(plan.run.rate),
            "noise_sigma": figures.noise_sigma,
            "quantisation_sigma": figures.quantisation_sigma,
            "bias_sigma": instrument.get("bias_sigma"),
            "bias_tau_s": instrument.get("bias_tau_s"),
            "bias_walk": instrument.get("bias_walk"),
            "dead_time_s": figures.dead_s,
            "hold_s": figures.hold_s,
            "lag_s": figures.lag_s,
            "phase": losses.collect::<Vec<_>>(),
        })
    };
    let all = described(plan, sides).into_iter().map(one);
    json!({"instruments": all.collect::<Vec<_>>()})
}

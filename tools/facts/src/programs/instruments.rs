//! Effect of a scenario's sensors and actuators at its rate, as text or JSON.

use std::fmt::Write;

use hil_config::plan::{Instrument, Plan};
use plant_process::instruments::Figures;
use serde_json::{Value, json};
use shared_types::describe::{Invalid, PlantDescription};
use shared_types::number::{short, short_in};
use shared_types::table::Field;

/// Figures of each instrument with its signal's full name and unit.
fn figures<'a>(
    plan: &'a Plan,
    plant: &'a PlantDescription,
) -> Result<Vec<(String, &'a str, &'a Instrument, Figures)>, Invalid> {
    let of = |group: &'static str, instruments: &'a [Instrument], fields: &'a [Field]| {
        instruments.iter().map(move |instrument| {
            let field = fields.iter().find(|field| field.name == instrument.signal);
            let unit = field.map_or("1", |field| field.unit.as_str());
            let figures = Figures::of(instrument, plan.run.rate)?;
            Ok((
                format!("{group}.{}", instrument.signal),
                unit,
                instrument,
                figures,
            ))
        })
    };
    let sensors = of("measured", &plan.sensors, &plant.measured);
    sensors
        .chain(of("command", &plan.actuators, &plant.commands))
        .collect()
}

/// Describes the instruments of a plan, with their phase loss at these frequencies.
///
/// # Errors
/// If the keys of an instrument are inconsistent.
pub fn text(
    plan: &Plan,
    plant: &PlantDescription,
    frequencies_hz: &[f64],
) -> Result<String, Invalid> {
    let mut text = String::new();
    let rate_hz = plan.run.rate.hz();
    for (signal, unit, instrument, figures) in figures(plan, plant)? {
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
        line("samples", format!("{} a second", short(samples)));
        line("one sigma", parts);
        if let Some(sigma) = instrument.get("bias_sigma") {
            let course = match instrument.get("bias_tau_s") {
                Some(tau_s) => format!("walks with {} s", short(tau_s)),
                None => "drawn once a run".into(),
            };
            line(
                "bias",
                format!("one sigma {}, {course}", short_in(sigma, unit)),
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
    }
    if text.is_empty() {
        text = format!("{} has neither sensors nor actuators\n", plan.name);
    }
    Ok(text)
}

/// Describes the same as JSON.
///
/// # Errors
/// If the keys of an instrument are inconsistent.
pub fn json(
    plan: &Plan,
    plant: &PlantDescription,
    frequencies_hz: &[f64],
) -> Result<Value, Invalid> {
    let one = |(signal, unit, instrument, figures): (String, &str, &Instrument, Figures)| {
        let losses = frequencies_hz
            .iter()
            .map(|hz| json!({"frequency_hz": hz, "phase_loss_deg": figures.phase_loss_deg(*hz)}));
        json!({
            "signal": signal,
            "unit": unit,
            "rate_hz": plan.run.rate.hz() / instrument.divisor(plan.run.rate),
            "noise_sigma": figures.noise_sigma,
            "quantisation_sigma": figures.quantisation_sigma,
            "bias_sigma": instrument.get("bias_sigma"),
            "bias_tau_s": instrument.get("bias_tau_s"),
            "dead_time_s": figures.dead_s,
            "hold_s": figures.hold_s,
            "lag_s": figures.lag_s,
            "phase": losses.collect::<Vec<_>>(),
        })
    };
    let all = figures(plan, plant)?.into_iter().map(one);
    Ok(json!({"instruments": all.collect::<Vec<_>>()}))
}

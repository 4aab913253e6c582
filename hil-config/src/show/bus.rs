//! `[bus]`, with what follows from its frames as comments.

use std::fmt::Write;
use std::path::Path;

use hil_codec::number::Number;
use shared_types::describe::PlantDescription;
use shared_types::number::{short, short_in};
use shared_types::table::Field;
use shared_types::time::Rate;

use super::{Written, inline, key, section, string};
use crate::bus::{self, BusFrame};
use crate::keys::BUS;
use crate::plan::{BusPlan, Plan, Stimulus};
use crate::port::PortTables;
use crate::quantity::toml_float;

pub(super) fn bus(
    text: &mut String,
    plan: &Plan,
    one: &BusPlan,
    plant: &PlantDescription,
) -> Written {
    let rate = plan.run.rate;
    writeln!(text, "\n[bus]")?;
    let reference: Vec<Field> = plan.stimuli.iter().flat_map(Stimulus::fields).collect();
    let plant = plan.plant.commanded(plant, &plan.stimuli);
    let tables = PortTables {
        measured: &plant.measured,
        reference: &reference,
        commands: &plant.commands,
    };
    let port = bus::read(one, Path::new("bus.toml"), &tables).ok();
    let frames = port.and_then(|port| bus::frames(&port, one, rate).ok());
    for frame in frames.iter().flatten() {
        facts(text, frame, rate)?;
    }
    section(text, BUS, |name| match name {
        "text" => Some(string(&one.text)),
        "redundancy" => Some(one.networks.to_string()),
        "skew_limit_s" => {
            let steps = one.skew_limit_steps?;
            Some(toml_float(steps as f64 * rate.period_s()))
        }
        _ => None,
    })?;
    if !one.dbc.is_empty() {
        let texts = one.dbc.iter();
        let texts = texts.map(|(name, text)| format!("{} = {}", key(name), string(text)));
        writeln!(text, "dbc = {}", inline(texts))?;
    }
    Ok(())
}

/// Writes period, ages and resolution of a frame.
fn facts(text: &mut String, one: &BusFrame, rate: Rate) -> Written {
    let BusFrame {
        frame,
        carries,
        period_steps,
        ..
    } = one;
    let steps = |steps: u64| match steps {
        1 => "1 step".to_owned(),
        steps => format!("{steps} steps"),
    };
    let (name, carries, period) = (&frame.name, carries.word(), steps(*period_steps));
    let period_s = short_in(*period_steps as f64 * rate.period_s(), "s");
    let longest = steps(period_steps - 1);
    let stale = match one.stale_steps {
        Some(stale_steps) => format!("stale above {}", steps(stale_steps.into())),
        None => "never stale".into(),
    };
    writeln!(
        text,
        "# frame {name}, {carries}: every {period} ({period_s}), values up to {longest} old, {stale}"
    )?;
    for (signal, number) in frame.signals() {
        writeln!(text, "#   {signal}: {}", of_number(number, &signal.unit))?;
    }
    Ok(())
}

fn of_number(number: &Number, unit: &str) -> String {
    let (low, high) = number.range();
    let range = match low > f64::from(f32::MIN) {
        true => format!(", {} to {}", short(low), short_in(high, unit)),
        false => String::new(),
    };
    match number.resolution() {
        Some(step) => format!("steps of {}{range}", short_in(step, unit)),
        None => format!("a float of {} bits{range}", number.width()),
    }
}

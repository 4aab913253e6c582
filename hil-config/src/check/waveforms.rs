//! Square waves, pulses, binary sequences, sums of sines and sequences of waveforms.

use shared_types::number::exact as number;

use super::run::Grid;
use crate::keys::MOST_PARTS;
use crate::plan::Waveform;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::stimulus::{Multisine, Prbs, Pulse, Sequence, Square, schroeder};

/// Largest distance from a whole number of steps that counts as rounding.
const ROUNDING: f64 = 1e-9;

pub(super) fn square(reader: &mut Reader, section: &Section<'_>) -> Option<Waveform> {
    let mut number = |name| reader.number(section, name);
    let (amplitude, frequency_hz) = (number("amplitude"), number("frequency_hz"));
    let (duty, phase_rad, offset) = (number("duty"), number("phase_rad"), number("offset"));
    Some(Waveform::Square(Square {
        amplitude: amplitude?,
        frequency_hz: frequency_hz?,
        duty: duty?,
        phase_rad: phase_rad?,
        offset: offset?,
    }))
}

/// Returns a pulse whose beginning, already checked, lies in the run.
pub(super) fn pulse(
    reader: &mut Reader,
    section: &Section<'_>,
    at_s: Option<f64>,
) -> Option<Waveform> {
    let mut value = |name| reader.number(section, name);
    let (width_s, low, high) = (value("width_s"), value("low"), value("high"));
    let period_s = reader.optional_number(section, "period_s")?;
    let width_s = width_s?;
    if let Some(period_s) = period_s
        && period_s <= width_s
    {
        let path = section.path_of("period_s");
        let (period, width) = (number(period_s), number(width_s));
        let message =
            format!("`{path}` is {period}, but a pulse lasts {width} and would never end");
        reader
            .report_at(section, "period_s", ProblemKind::Mismatch, message)
            .expected(format!("a number above {width} in s"));
        return None;
    }
    Some(Waveform::Pulse(Pulse {
        at_s: at_s?,
        width_s,
        period_s,
        low: low?,
        high: high?,
    }))
}

pub(super) fn prbs(
    reader: &mut Reader,
    section: &Section<'_>,
    grid: Option<Grid>,
) -> Option<Waveform> {
    let mut value = |name| reader.number(section, name);
    let (amplitude, bit_s, offset) = (value("amplitude"), value("bit_s"), value("offset"));
    let order = reader.integer(section, "order");
    let seed = match section.table.get("seed") {
        Some(_) => reader.integer(section, "seed").map(Some),
        None => Some(None),
    };
    let (order, seed) = (order?, seed?);
    let most = (1_i64 << order) - 1;
    if let Some(seed) = seed.filter(|seed| *seed > most) {
        let path = section.path_of("seed");
        let message = format!("`{path}` is {seed}, which has more than {order} bits");
        reader
            .report_at(section, "seed", ProblemKind::OutOfRange, message)
            .expected(format!(
                "a whole number from 1 to {most}, or another `order`"
            ));
        return None;
    }
    let (bit_s, grid) = (bit_s?, grid?);
    let steps = bit_s * grid.rate.hz();
    let whole = steps.round();
    if whole < 1.0 || (steps - whole).abs() > ROUNDING * whole {
        let path = section.path_of("bit_s");
        let message = format!(
            "`{path}` is {} s, which is {} steps of the run: bits would differ in length",
            number(bit_s),
            number(steps)
        );
        let below = if steps < 1.0 { 1.0 } else { steps.floor() };
        let [below_s, above_s] = [below, steps.ceil()].map(|steps| number(steps / grid.rate.hz()));
        let nearest = match below_s == above_s {
            true => format!("the nearest is {below_s} s"),
            false => format!("the nearest are {below_s} and {above_s} s"),
        };
        reader
            .report_at(section, "bit_s", ProblemKind::Mismatch, message)
            .expected("a whole number of steps")
            .help(nearest);
        return None;
    }
    Some(Waveform::Prbs(Prbs {
        amplitude: amplitude?,
        bit_s,
        order: u32::try_from(order).ok()?,
        seed: u32::try_from(seed.unwrap_or(most)).ok()?,
        offset: offset?,
    }))
}

pub(super) fn multisine(
    reader: &mut Reader,
    section: &Section<'_>,
    grid: Option<Grid>,
) -> Option<Waveform> {
    let offset = reader.number(section, "offset");
    let frequencies_hz = frequencies(reader, section);
    let amplitudes = match (has(section, "amplitude"), has(section, "amplitudes")) {
        (true, false) => reader.number(section, "amplitude").map(Amplitudes::Equal),
        (false, true) => list(reader, section, "amplitudes").map(Amplitudes::Each),
        _ => {
            let message = "a multisine needs exactly one definition of its amplitudes";
            once(
                reader,
                section,
                message,
                "either `amplitude` or `amplitudes`",
            );
            None
        }
    };
    let phases = match (has(section, "phases"), has(section, "phases_rad")) {
        (true, true) => {
            let message = "a multisine takes at most one definition of its phases";
            once(
                reader,
                section,
                message,
                "`phases`, `phases_rad` or neither",
            );
            None
        }
        (_, true) => list(reader, section, "phases_rad").map(Phases::Each),
        _ => reader.text(section, "phases").map(|name| match name {
            "zero" => Phases::Zero,
            _ => Phases::Schroeder,
        }),
    };
    let frequencies_hz = frequencies_hz?;
    let count = frequencies_hz.len();
    let amplitudes = match amplitudes? {
        Amplitudes::Equal(amplitude) => vec![amplitude; count],
        Amplitudes::Each(amplitudes) => {
            as_many(reader, section, "amplitudes", amplitudes.len(), count)?;
            amplitudes
        }
    };
    let phases_rad = match phases? {
        Phases::Zero => vec![0.0; count],
        Phases::Schroeder => schroeder(&amplitudes),
        Phases::Each(phases_rad) => {
            as_many(reader, section, "phases_rad", phases_rad.len(), count)?;
            phases_rad
        }
    };
    let half_hz = grid?.rate.hz() / 2.0;
    if let Some(bad) = { frequencies_hz.iter() }.find(|hz| !(0.0..=half_hz).contains(*hz)) {
        let key = match has(section, "frequencies_hz") {
            true => "frequencies_hz",
            false => "end_hz",
        };
        let path = section.path_of(key);
        let message = format!("`{path}` has a tone of {} Hz", number(*bad));
        reader
            .report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(format!(
                "frequencies from 0 to {} Hz, half of run.rate_hz",
                number(half_hz)
            ));
        return None;
    }
    Some(Waveform::Multisine(Multisine {
        frequencies_hz,
        amplitudes,
        phases_rad,
        offset: offset?,
    }))
}

enum Amplitudes {
    Equal(f64),
    Each(Vec<f64>),
}

enum Phases {
    Zero,
    Schroeder,
    Each(Vec<f64>),
}

/// Returns the frequencies of a list or a band.
fn frequencies(reader: &mut Reader, section: &Section<'_>) -> Option<Vec<f64>> {
    let band = ["start_hz", "end_hz", "tones"].map(|key| has(section, key));
    match (has(section, "frequencies_hz"), band) {
        (true, [false, false, false]) => list(reader, section, "frequencies_hz"),
        (false, [true, true, true]) => {
            let (start_hz, end_hz) = (
                reader.number(section, "start_hz"),
                reader.number(section, "end_hz"),
            );
            let (tones, spacing) = (
                reader.integer(section, "tones"),
                reader.text(section, "spacing"),
            );
            let (start_hz, end_hz, spacing) = (start_hz?, end_hz?, spacing?);
            let is_logarithmic = spacing == "logarithmic";
            if end_hz <= start_hz || is_logarithmic && start_hz == 0.0 {
                let path = section.path_of("start_hz");
                let message = format!(
                    "`{path}` is {}, and the band ends at {} Hz",
                    number(start_hz),
                    number(end_hz)
                );
                reader
                    .report_at(section, "start_hz", ProblemKind::OutOfRange, message)
                    .expected("a band from a lower to a higher frequency, above 0 if logarithmic");
                return None;
            }
            let last = tones? - 1;
            let tone = |place: i64| {
                let share = place as f64 / last as f64;
                match is_logarithmic {
                    _ if place == last => end_hz,
                    true => start_hz * libm::pow(end_hz / start_hz, share),
                    false => start_hz + (end_hz - start_hz) * share,
                }
            };
            Some((0..=last).map(tone).collect())
        }
        _ => {
            let expected = "either `frequencies_hz`, or `start_hz`, `end_hz` and `tones`";
            once(
                reader,
                section,
                "a multisine needs exactly one definition of its frequencies",
                expected,
            );
            None
        }
    }
}

/// Returns the waveforms of a sequence one after the other; `waveform` reads one that ends with its part.
pub(super) fn sequence(
    reader: &mut Reader,
    section: &Section<'_>,
    grid: Option<Grid>,
    mut waveform: impl FnMut(&mut Reader, &Section<'_>, Option<Grid>) -> Option<Waveform>,
) -> Option<Waveform> {
    let parts = reader.list(section, "parts");
    if parts.is_empty() || parts.len() > MOST_PARTS {
        if section.table.get("parts").is_some() {
            let path = section.path_of("parts");
            let message = format!("`{path}` has {} parts", parts.len());
            reader
                .report_at(section, "parts", ProblemKind::OutOfRange, message)
                .expected(format!("1 to {MOST_PARTS} parts"));
        }
        return None;
    }
    let waveforms: Vec<_> = { parts.iter() }
        .map(|part| {
            let length_s = reader.number(part, "length_s");
            let own = grid.zip(length_s).map(|(grid, length_s)| Grid {
                rate: grid.rate,
                steps: grid.rate.step_at_or_after(length_s).0,
            });
            let waveform = waveform(reader, part, own);
            length_s.zip(waveform)
        })
        .collect();
    let waveforms: Vec<(f64, Waveform)> = waveforms.into_iter().collect::<Option<_>>()?;
    let grid = grid?;
    let sequence = Sequence::new(waveforms, grid.rate, grid.steps);
    for (place, part) in parts.iter().enumerate() {
        let begin_s = sequence.begin_s(place);
        if begin_s >= grid.end_s() {
            let message = format!(
                "`{}` begins at {} s, and the run ends at {} s",
                part.path,
                number(begin_s),
                number(grid.end_s())
            );
            let path = part.path.clone();
            reader
                .report(ProblemKind::OutOfRange, path, part.place, message)
                .help("leave out the part, or raise run.duration_s");
            return None;
        }
    }
    Some(Waveform::Sequence(sequence))
}

fn has(section: &Section<'_>, key: &str) -> bool {
    section.table.get(key).is_some()
}

fn list(reader: &mut Reader, section: &Section<'_>, key: &str) -> Option<Vec<f64>> {
    let node = &section.table.get(key)?.node;
    let path = section.path_of(key);
    let values = reader.numbers(&path, node)?;
    if values.is_empty() || values.len() > crate::keys::MOST_TONES as usize {
        let message = format!("`{path}` has {} numbers", values.len());
        reader
            .report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(format!("1 to {} numbers", crate::keys::MOST_TONES));
        return None;
    }
    Some(values)
}

fn as_many(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    own: usize,
    count: usize,
) -> Option<()> {
    if own == count {
        return Some(());
    }
    let path = section.path_of(key);
    let message = format!("`{path}` has {own} numbers for {count} frequencies");
    reader
        .report_at(section, key, ProblemKind::Mismatch, message)
        .expected("as many numbers as frequencies");
    None
}

fn once(reader: &mut Reader, section: &Section<'_>, message: &str, expected: &str) {
    reader
        .report_at(section, "kind", ProblemKind::Mismatch, message)
        .expected(expected);
}

//! Charts over frequency: spectra, and responses as Bode and Nichols plots. Never estimates a response.

use std::collections::BTreeMap;

use hil_config::Response;
use hil_config::plan::{Plot, Scale, SpectrumPlan};
use shared_types::extremes::larger;
use shared_types::number::short_in;

use super::{Loops, Part, curve_labels, quantity};
use crate::figures::axis::{Extent, Quantity};
use crate::figures::chart::{Chart, Curve, Panel};
use crate::figures::reading::Values;
use crate::figures::spectrum::spectrum;
use crate::figures::table::Table;
use crate::figures::thinning::{columns, over_logarithm};
use crate::figures::unit::printed;
use crate::plots::words::{capital, lower};

/// Greatest number of lines in the table of a spectrum.
const MOST_LINES: usize = 12;
/// Height of a line, as a part of the highest, below which it is rounding.
const ROUNDING: f64 = 1e-9;

pub(super) fn spectra(
    settings: &SpectrumPlan,
    plot: &Plot,
    parts: &[Part<'_>],
) -> Result<(Chart, Table), String> {
    let first = &parts[0];
    let mut y = quantity(first, first.reads, plot.scale == Scale::Log);
    if settings.is_density {
        y.unit = match printed(&y.unit).as_str() {
            "" => "1/√Hz".into(),
            unit => format!("{unit}/√Hz"),
        };
    }
    let what = match settings.is_density {
        true => "Spectral density",
        false => "Amplitude",
    };
    y.title = match y.title.as_str() {
        "" => what.into(),
        title => format!("{what} of {}", lower(title)),
    };
    let mut table = Table::new(&["line", "frequency [Hz]", "height"], &y.unit);
    let (mut curves, mut notes) = (Vec::new(), Vec::new());
    for part in parts {
        for (read, label) in part.reads.iter().zip(curve_labels(part, part.reads)) {
            let Values::All(values) = &read.values else {
                continue;
            };
            let spectrum = spectrum(values, part.run.rate.hz(), settings)
                .map_err(|reason| format!("{}: {reason}", read.name))?;
            let resolution = short_in(spectrum.resolution_hz, "Hz");
            let segments = match spectrum.segments {
                1 => String::new(),
                segments => format!(", {segments} segments"),
            };
            let note = format!(
                "{} window, lines {resolution} apart{segments}",
                capital(settings.window.name())
            );
            if !notes.contains(&note) {
                notes.push(note);
            }
            let lines = &spectrum.lines[1..];
            let highest = lines.iter().map(|line| line[1]).fold(0.0, larger);
            let mut peaks: Vec<&[f64; 2]> = (lines.windows(3))
                .filter(|three| three[0][1] < three[1][1] && three[1][1] >= three[2][1])
                .map(|three| &three[1])
                .filter(|peak| peak[1] >= ROUNDING * highest)
                .collect();
            peaks.sort_by(|a, b| b[1].total_cmp(&a[1]));
            let name = if label.is_empty() { &read.name } else { &label };
            for [frequency_hz, height] in peaks.into_iter().take(MOST_LINES) {
                table.row(name, &[*frequency_hz, *height]);
            }
            curves.push(Curve {
                label,
                parts: vec![over_logarithm(lines)],
                is_free: false,
            });
        }
    }
    let ends = curves.iter().flat_map(|curve| curve.parts.iter().flatten());
    let mut extent = Extent::EMPTY;
    ends.for_each(|[frequency_hz, _]| extent.include(*frequency_hz));
    let chart = Chart {
        x: frequency_quantity(),
        span: Some(extent.0),
        panels: vec![Panel {
            y,
            curves,
            ..Panel::default()
        }],
        notes,
        ..Chart::default()
    };
    Ok((chart, table))
}

fn frequency_quantity() -> Quantity {
    Quantity {
        title: "Frequency".into(),
        unit: "Hz".into(),
        is_log: true,
    }
}

/// Returns the responses of a metric in all runs, or the open loops, each with its label.
pub(super) fn responses(
    metric: Option<&str>,
    parts: &[Part<'_>],
    loops: Option<&Loops>,
) -> Result<Vec<(String, Vec<Response>)>, String> {
    let all: Vec<(String, Vec<Response>)> = match metric {
        None => loops
            .ok_or("it shows open loops; give the file that `hil margins SCENARIO -o FILE` writes with --margins FILE")?
            .to_vec(),
        Some(metric) => {
            let of = |part: &Part<'_>| {
                let responses: &BTreeMap<_, _> = &part.run.responses;
                Some((part.label.to_owned(), responses.get(metric)?.clone()))
            };
            parts.iter().filter_map(of).collect()
        }
    };
    if all.iter().all(|(_, responses)| responses.is_empty()) {
        return Err("the response has no point".into());
    }
    let is_single = all.len() == 1;
    let labelled = all.into_iter().map(|(label, responses)| match is_single {
        true => (String::new(), responses),
        false => (label, responses),
    });
    Ok(labelled.collect())
}

fn gain_db(response: &Response) -> f64 {
    20.0 * libm::log10(response.gain)
}

/// Greatest number of rows for each curve in the table of a response.
const MOST_ROWS: usize = 40;

/// Returns the rows of a table: all of a few, or as evenly as they lie over a logarithmic axis, with both ends.
///
/// A linear sweep has most of its responses at the high end, where one is like the next.
fn tabulated(responses: &[Response]) -> Vec<&Response> {
    let (Some(first), Some(last)) = (responses.first(), responses.last()) else {
        return Vec::new();
    };
    if responses.len() <= MOST_ROWS {
        return responses.iter().collect();
    }
    let ends = [first.frequency_hz, last.frequency_hz];
    let column = columns(ends, (MOST_ROWS - 2) as f64);
    let parts = responses.chunk_by(|a, b| column(a.frequency_hz) == column(b.frequency_hz));
    let mut rows: Vec<_> = parts.map(|part| &part[0]).collect();
    if !rows.last().is_some_and(|row| std::ptr::eq(*row, last)) {
        rows.push(last);
    }
    rows
}

fn response_table(all: &Loops) -> Table {
    let mut table = Table::new(
        &["response", "frequency [Hz]", "gain [dB]", "phase [°]"],
        "",
    );
    for (label, responses) in all {
        let label = match label.as_str() {
            "" => "response",
            label => label,
        };
        for response in tabulated(responses) {
            let phase_deg = response.phase_rad.to_degrees();
            table.row(
                label,
                &[response.frequency_hz, gain_db(response), phase_deg],
            );
        }
    }
    table
}

fn response_curves(
    all: &Loops,
    point: impl Fn(&Response) -> [f64; 2],
    is_free: bool,
) -> Vec<Curve> {
    let curves = all.iter().map(|(label, responses)| Curve {
        label: label.clone(),
        parts: vec![responses.iter().map(&point).collect()],
        is_free,
    });
    curves.collect()
}

fn in_unit(title: &str, unit: &str) -> Quantity {
    Quantity {
        title: title.into(),
        unit: unit.into(),
        is_log: false,
    }
}

/// Least lengths of axes of gain and phase: shorter ones would show rounding as if it were a response.
const LEAST_DB: f64 = 6.0;
const LEAST_DEG: f64 = 20.0;

pub(super) fn bode(all: &Loops) -> (Chart, Table) {
    let gain = |one: &Response| [one.frequency_hz, gain_db(one)];
    let phase = |one: &Response| [one.frequency_hz, one.phase_rad.to_degrees()];
    let mut extent = Extent::EMPTY;
    let all_points = all.iter().flat_map(|(_, responses)| responses);
    all_points.for_each(|one| extent.include(one.frequency_hz));
    let chart = Chart {
        x: frequency_quantity(),
        span: Some(extent.0),
        panels: vec![
            Panel {
                y: in_unit("Gain", "dB"),
                curves: response_curves(all, gain, false),
                least_length: LEAST_DB,
                ..Panel::default()
            },
            Panel {
                y: in_unit("Phase", "deg"),
                curves: response_curves(all, phase, false),
                least_length: LEAST_DEG,
                ..Panel::default()
            },
        ],
        ..Chart::default()
    };
    (chart, response_table(all))
}

/// Returns the gain over the phase; for an open loop the point -1 has a cross.
pub(super) fn nichols(all: &Loops, is_open: bool) -> (Chart, Table) {
    let point = |one: &Response| [one.phase_rad.to_degrees(), gain_db(one)];
    let chart = Chart {
        x: in_unit("Phase", "deg"),
        panels: vec![Panel {
            y: in_unit("Gain", "dB"),
            curves: response_curves(all, point, true),
            cross: is_open.then_some([-180.0, 0.0]),
            least_length: LEAST_DB,
            ..Panel::default()
        }],
        least_length: LEAST_DEG,
        ..Chart::default()
    };
    (chart, response_table(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_a_linear_sweep_keeps_its_low_frequencies_and_both_ends() {
        let at = |k: u32| Response {
            frequency_hz: 0.2 + 0.1 * f64::from(k),
            gain: 1.0,
            phase_rad: 0.0,
        };
        let responses: Vec<_> = (0..400).map(at).collect();
        let rows = tabulated(&responses);
        assert!(rows.len() <= MOST_ROWS, "{}", rows.len());
        // The step of the axis between two rows is 38th root of (40.1 / 0.2), 1.15.
        for (place, k) in [0, 1, 2, 3].into_iter().enumerate() {
            assert_eq!(*rows[place], responses[k]);
        }
        assert_eq!(rows.last(), Some(&&responses[399]));
        let is_even = |pair: &[&Response]| {
            let [low, high] = [pair[0].frequency_hz, pair[1].frequency_hz];
            high / low < 1.15 * 1.15 || high - low < 0.1001
        };
        assert!(rows.windows(2).all(is_even));
        assert_eq!(tabulated(&responses[..30]).len(), 30);
    }
}

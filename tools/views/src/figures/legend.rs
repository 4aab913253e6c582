//! Legend of a chart: a row of samples with their texts above the frame, and labels of vertical marks.

use shared_types::number::short;

use super::axis::Axis;
use super::chart::{Chart, LEADING, LIMIT, Level, TEXT_SIZE, stroke};
use super::font::Font;
use super::scene::{Anchor, Scene, Stroke};
use super::unit::ScaledUnit;

/// Length of a sample, and distances to its text and to the next sample, in points.
const SAMPLE: f64 = 17.0;
const GAP: f64 = 3.0;
const BETWEEN: f64 = 9.0;

/// Legend, laid out in rows.
pub(super) struct Legend {
    /// Sample, text, left end and row of each entry.
    entries: Vec<(Option<Stroke>, String, f64, usize)>,
}

impl Legend {
    /// Lays out the legend of a chart between two edges; `far` are limits that are not drawn.
    pub(super) fn of(
        chart: &Chart,
        axes: &[Axis],
        far: &[&Level],
        font: &Font,
        [left, right]: [f64; 2],
    ) -> Self {
        let mut texts: Vec<(Option<Stroke>, String)> = Vec::new();
        // Panels share their curves.
        let curves = chart
            .panels
            .iter()
            .flat_map(|panel| &panel.curves)
            .enumerate();
        let first = chart.panels.first().map_or(0, |panel| panel.curves.len());
        for (place, curve) in curves
            .take(first)
            .filter(|(_, curve)| !curve.label.is_empty())
        {
            texts.push((Some(stroke(place)), curve.label.clone()));
        }
        for ((value, is_far), names) in limits(chart, axes, far) {
            let text = format!("{value}: {}", names.join(", "));
            texts.push(match is_far {
                false => (Some(LIMIT), text),
                true => (None, format!("beyond the axis {text}")),
            });
        }
        texts.extend(chart.notes.iter().map(|note| (None, note.clone())));
        let (mut entries, mut x, mut row) = (Vec::new(), left, 0);
        for (sample, text) in texts {
            let before = sample.map_or(0.0, |_| SAMPLE + GAP);
            let width = before + font.width(&text, TEXT_SIZE);
            if x > left && x + width > right {
                (x, row) = (left, row + 1);
            }
            let lines = font.lines(&text, TEXT_SIZE, right - left - before);
            let more = lines.len().saturating_sub(1);
            for (nth, line) in lines.into_iter().enumerate() {
                // Further lines begin below the text of the first.
                let (sample, x) = match nth {
                    0 => (sample, x),
                    _ => (None, left + before),
                };
                entries.push((sample, line, x, row + nth));
            }
            (x, row) = match more {
                0 => (x + width + BETWEEN, row),
                // Nothing stands beside a text of several lines.
                _ => (left, row + more + 1),
            };
        }
        Self { entries }
    }

    /// Draws the legend below a height; returns the height at which it ends.
    pub(super) fn draw(&self, scene: &mut Scene, top: f64) -> f64 {
        let mut end = top;
        for (sample, text, x, row) in &self.entries {
            let base = top + (*row as f64 + 1.0) * LEADING - 2.5;
            end = base + 2.5;
            let mut start = *x;
            if let Some(sample) = sample {
                let y = base - 0.35 * TEXT_SIZE;
                scene.line(&[[start, y], [start + SAMPLE, y]], *sample);
                start += SAMPLE + GAP;
            }
            scene.text(text, [start, base], TEXT_SIZE, Anchor::Start);
        }
        end
    }
}

/// Returns each limit once, by its value and whether it is beyond the axis, with the requirements that have it.
fn limits(chart: &Chart, axes: &[Axis], far: &[&Level]) -> Vec<((String, bool), Vec<String>)> {
    let mut limits: Vec<((String, bool), Vec<String>)> = Vec::new();
    for (panel, axis) in chart.panels.iter().zip(axes) {
        for level in &panel.levels {
            let Some(name) = &level.requirement else {
                continue;
            };
            let is_mirrored =
                |one: &Level| one.value == -level.value && one.requirement.as_ref() == Some(name);
            let has_mirror = level.value != 0.0 && panel.levels.iter().any(is_mirrored);
            let value = limit_text(level.value, &axis.scale);
            let value = match has_mirror {
                true => format!("±{}", value.trim_start_matches('−')),
                false => value,
            };
            let has_it = |((one, _), names): &((String, bool), Vec<String>)| {
                *one == value && names.contains(name)
            };
            if limits.iter().any(has_it) {
                continue;
            }
            let limit = (value, far.contains(&level));
            match limits.iter_mut().find(|(one, _)| *one == limit) {
                Some((_, names)) => names.push(name.clone()),
                None => limits.push((limit, vec![name.clone()])),
            }
        }
    }
    limits
}

/// Formats the value of a limit in the unit of its axis.
fn limit_text(value: f64, scale: &ScaledUnit) -> String {
    let number = short(value * scale.factor()).replace('-', "−");
    format!("{number} {}", scale.text).trim_end().to_owned()
}

/// Returns the left end and the row of each mark's label: the lowest row in which it overlaps no other.
pub(super) fn mark_rows(
    marks: &[(f64, &str)],
    font: &Font,
    [left, right]: [f64; 2],
) -> Vec<(f64, usize)> {
    let mut ends: Vec<f64> = Vec::new();
    let mut sorted: Vec<usize> = (0..marks.len()).collect();
    sorted.sort_by(|a, b| marks[*a].0.total_cmp(&marks[*b].0));
    let mut rows = vec![(left, 0); marks.len()];
    for place in sorted {
        let (x, label) = marks[place];
        let width = font.width(label, TEXT_SIZE);
        let start = x - 0.5 * width;
        let start = if start + width > right {
            right - width
        } else {
            start
        };
        let start = if start < left { left } else { start };
        let free = ends.iter().position(|end| *end + 4.0 < start);
        let row = free.unwrap_or(ends.len());
        match ends.get_mut(row) {
            Some(end) => *end = start + width,
            None => ends.push(start + width),
        }
        rows[place] = (start, row);
    }
    rows
}

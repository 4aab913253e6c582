//! Plot: signals of one unit over simulated time.
//!
//! Each column of dots spans the minimum to the maximum of its time interval.

use std::collections::BTreeSet;

use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;
use ratatui::widgets::canvas::{self, Canvas};
use shared_types::number::{short, short_in};

use super::{bold, fitting, time};
use crate::monitor::display::Display;
use crate::monitor::history::Range;
use crate::monitor::model::Model;
use crate::monitor::plots::Plot;

/// Width of the scale beside a plot.
const SCALE: u16 = 11;
/// Minimum width at which the scale is drawn.
const WITH_SCALE: u16 = 50;
/// Minimum width of a truncated title.
const LEAST_TITLE: usize = 12;
/// Colours of a plot's signals, readable on light and dark backgrounds.
const COLOURS: [Color; 4] = [Color::Reset, Color::Cyan, Color::Magenta, Color::Green];

/// Draws a plot.
pub(super) fn draw(
    frame: &mut Frame<'_>,
    area: Rect,
    model: &Model,
    plot: &Plot,
    number: usize,
    display: &Display,
) {
    let [title, area] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(area);
    if area.height == 0 {
        return;
    }
    let scale = if area.width >= WITH_SCALE { SCALE } else { 0 };
    let [beside, area] =
        Layout::horizontal([Constraint::Length(scale), Constraint::Min(0)]).areas(area);
    let dots = if display.abilities.unicode { 2 } else { 1 };
    let columns = usize::from(area.width) * dots;
    let last = model.seen().unwrap_or(0);
    let steps = ((display.window_s * model.rate().hz()) as u64).max(2);
    let signals: Vec<Vec<Option<Range>>> = (plot.signals.iter())
        .filter_map(|&signal| model.history(signal))
        .map(|history| history.columns(last, steps, columns))
        .collect();
    let all = signals.iter().flatten().flatten().copied();
    let all = all.reduce(Range::and);

    let width = title.width;
    let title_line = title_line(width, model, plot, display, (number, scale == 0), all);
    frame.render_widget(Paragraph::new(title_line), title);
    let Some(all) = all else { return };
    let axis = Scale::of(all);
    if scale > 0 {
        let lines = axis.lines(usize::from(beside.height));
        let labels = Paragraph::new(lines).alignment(Alignment::Right);
        frame.render_widget(labels, beside);
    }
    let marks = fault_marks(model, last, steps, columns);
    let marker = if display.abilities.unicode {
        Marker::Braille
    } else {
        Marker::Custom('*')
    };
    let y = axis.bounds(all);
    let canvas = Canvas::default()
        .marker(marker)
        .x_bounds([0.0, (columns.saturating_sub(1)) as f64])
        .y_bounds(y)
        .paint(|context| {
            for mark in &marks {
                let colour = colour(display, Color::Red);
                draw_mark(context, *mark, y, colour);
            }
            context.layer();
            // The first signal is drawn last, so that it is on top.
            for (at, ranges) in signals.iter().enumerate().rev() {
                let colour = colour(display, COLOURS[at % COLOURS.len()]);
                // Without colours, gaps tell the signals apart.
                let is_dashed = !display.abilities.colour && at > 0;
                // Steps wider than a column are connected.
                let reach = columns.div_ceil(steps as usize);
                draw_signal(context, ranges, colour, reach, is_dashed);
                context.layer();
            }
        });
    frame.render_widget(canvas, area);
}

fn colour(display: &Display, colour: Color) -> Color {
    if display.abilities.colour {
        colour
    } else {
        Color::Reset
    }
}

fn title_line<'a>(
    width: u16,
    model: &Model,
    plot: &'a Plot,
    display: &Display,
    (number, has_no_scale): (usize, bool),
    all: Option<Range>,
) -> Line<'a> {
    let line = |labels: &[String]| {
        let mut parts = vec![];
        for (at, (label, &signal)) in labels.iter().zip(&plot.signals).enumerate() {
            let is_last = at + 1 == plot.signals.len();
            let unit = if is_last { plot.unit.as_str() } else { "" };
            let value = short_in(model.value(signal), unit);
            let gap = if label.is_empty() { "" } else { " " };
            let colour = colour(display, COLOURS[at % COLOURS.len()]);
            parts.push(Span::styled(format!("{label}{gap}{value}"), colour));
        }
        if let (true, Some(all)) = (has_no_scale, all) {
            parts.push(Span::from(Scale::of(all).in_words()));
        }
        parts.push(Span::styled(
            format!("{}/{}", number + 1, model.plots().len()),
            Modifier::DIM,
        ));
        // Values take precedence over the end of a long title.
        let values = fitting(width, parts.clone()).width() + 2;
        (parts, usize::from(width).saturating_sub(values))
    };
    let (mut parts, mut room) = line(&plot.labels);
    if room < LEAST_TITLE
        && let Some(labels) = numbers_of(&plot.labels)
    {
        (parts, room) = line(&labels);
    }
    let title = match plot.title.chars().count() {
        length if length <= room => plot.title.clone(),
        _ if room < LEAST_TITLE => String::new(),
        _ => plot
            .title
            .chars()
            .take(room - 2)
            .chain("..".chars())
            .collect(),
    };
    parts.insert(0, bold(title));
    fitting(width, parts)
}

/// Returns the numbers in labels, if these tell them apart, too.
fn numbers_of(labels: &[String]) -> Option<Vec<String>> {
    let is_letter = |c: char| !c.is_ascii_digit();
    let numbers = |label: &String| -> Vec<String> {
        let words = label.split(' ').map(|word| word.replace(is_letter, ""));
        words.filter(|number| !number.is_empty()).collect()
    };
    let short: Vec<String> = labels
        .iter()
        .map(|label| numbers(label).join(" "))
        .collect();
    let different: BTreeSet<&String> = short.iter().collect();
    (different.len() == labels.len()).then_some(short)
}

/// Format of the range in the scale beside a plot.
#[derive(Clone, Debug, PartialEq)]
enum Scale {
    /// Constant; values that differ only in the last bits count as equal.
    Flat(f64),
    /// Centre and half-width of a range whose ends agree in five digits.
    Around(f64, f64),
    /// Minimum and maximum.
    Ends(f64, f64),
}

impl Scale {
    fn of(Range { min, max }: Range) -> Self {
        // The report uses the same threshold.
        const SAME: f64 = 1e-9;
        let (middle, half) = (0.5 * min + 0.5 * max, 0.5 * max - 0.5 * min);
        if half <= 0.5 * SAME * middle.abs() {
            Self::Flat(middle)
        } else if short(min) == short(max) {
            Self::Around(middle, half)
        } else {
            Self::Ends(min, max)
        }
    }

    /// Returns the drawn range; a flat line is centred in a range wide enough to keep noise in one row of dots at
    /// any height.
    fn bounds(&self, Range { min, max }: Range) -> [f64; 2] {
        match self {
            Self::Flat(value) => {
                let size = value.abs();
                let pad = if size > 0.0 { 0.01 * size } else { 1.0 };
                [value - pad, value + 1.01 * pad]
            }
            Self::Around(..) | Self::Ends(..) => [min, max],
        }
    }

    /// Returns the lines of the scale, from the top.
    fn lines(&self, height: usize) -> Vec<Line<'static>> {
        let line = |text: String| Line::from(format!("{text} "));
        let mut lines = vec![Line::default(); height];
        let (last, middle) = (height - 1, height / 2);
        match *self {
            Self::Flat(value) => lines[middle] = line(short(value)),
            Self::Around(value, half) => {
                lines[last] = line(format!("-{}", short(half)));
                lines[0] = line(format!("+{}", short(half)));
                lines[middle] = line(short(value));
            }
            Self::Ends(least, greatest) => {
                lines[last] = line(short(least));
                lines[0] = line(short(greatest));
            }
        }
        lines
    }

    fn in_words(&self) -> String {
        match *self {
            Self::Flat(value) => short(value),
            Self::Around(value, half) => format!("{} +- {}", short(value), short(half)),
            Self::Ends(least, greatest) => format!("{} to {}", short(least), short(greatest)),
        }
    }
}

fn draw_signal(
    context: &mut canvas::Context<'_>,
    ranges: &[Option<Range>],
    colour: Color,
    reach: usize,
    is_dashed: bool,
) {
    let mut before: Option<(usize, Range)> = None;
    for (column, range) in ranges.iter().enumerate() {
        let Some(range) = *range else { continue };
        let is_gap = is_dashed && column % 8 >= 4;
        if !is_gap {
            let x = column as f64;
            let line = |x1, y1, y2| canvas::Line::new(x1, y1, x, y2, colour);
            context.draw(&line(x, range.min, range.max));
            if let Some((last, last_range)) = before
                && column - last <= reach
            {
                // Connects the nearer ends of two ranges that do not overlap.
                let ends = if last_range.max < range.min {
                    Some((last_range.max, range.min))
                } else if last_range.min > range.max {
                    Some((last_range.min, range.max))
                } else if column - last > 1 {
                    Some((last_range.max, range.max))
                } else {
                    None
                };
                if let Some((from, to)) = ends {
                    context.draw(&line(last as f64, from, to));
                }
            }
        }
        before = Some((column, range));
    }
}

/// Returns the columns at which faults became active.
fn fault_marks(model: &Model, last: u64, steps: u64, columns: usize) -> Vec<usize> {
    let first = (last + 1).saturating_sub(steps);
    let effects = model.faults().iter().flat_map(|fault| &fault.effects);
    let begins = effects.filter_map(|effect| effect.step);
    let mut marks: Vec<usize> = begins
        .filter(|step| (first..=last).contains(step))
        .map(|step| {
            let place = steps - 1 - (last - step);
            (u128::from(place) * columns as u128 / u128::from(steps)) as usize
        })
        .collect();
    marks.sort_unstable();
    marks.dedup();
    marks
}

/// Draws a dotted vertical line.
fn draw_mark(context: &mut canvas::Context<'_>, column: usize, y: [f64; 2], colour: Color) {
    let points: Vec<(f64, f64)> = (0..=12)
        .map(|at| (column as f64, y[0] + (y[1] - y[0]) * f64::from(at) / 12.0))
        .collect();
    context.draw(&canvas::Points {
        coords: &points,
        color: colour,
    });
}

/// Draws the time axis shared by the plots above it, and the number of hidden plots.
pub(super) fn draw_axis(
    frame: &mut Frame<'_>,
    area: Rect,
    model: &Model,
    display: &Display,
    places: usize,
) {
    let scale = if area.width >= WITH_SCALE { SCALE } else { 0 };
    let [_, area] = Layout::horizontal([Constraint::Length(scale), Constraint::Min(0)]).areas(area);
    let Some(last) = model.seen() else { return };
    let end_s = model.seconds(last);
    let begin_s = end_s - display.window_s;
    let end = format!("{} s", time(end_s, model));
    let begin = if begin_s < 0.0 {
        String::new()
    } else {
        format!("{} s", time(begin_s, model))
    };
    let hidden = model.plots().len().saturating_sub(places);
    let middle = match hidden {
        0 => format!("window {} s", display.window_s),
        hidden => format!("window {} s, {hidden} more plots", display.window_s),
    };
    // Centred text needs as much room on its left as on its right.
    let beside = if begin.len() > end.len() {
        begin.len()
    } else {
        end.len()
    };
    let fits = |middle: &str| middle.len() + 2 * (beside + 1) <= usize::from(area.width);
    let middle = if fits(&middle) {
        middle
    } else {
        format!("{} s", display.window_s)
    };
    let texts = if fits(&middle) {
        vec![(begin, Alignment::Left), (middle, Alignment::Center)]
    } else {
        Vec::new()
    };
    for (text, alignment) in texts.into_iter().chain([(end, Alignment::Right)]) {
        let line = Line::styled(text, Modifier::DIM);
        frame.render_widget(Paragraph::new(line).alignment(alignment), area);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale(min: f64, max: f64) -> (Vec<String>, [f64; 2]) {
        let all = Range { min, max };
        let scale = Scale::of(all);
        let lines = scale.lines(5).iter().map(|line| line.to_string()).collect();
        (lines, scale.bounds(all))
    }

    #[test]
    fn a_flat_signal_has_one_centred_label() {
        let (lines, bounds) = scale(0.0, 0.0);
        assert_eq!(lines, ["", "", "0 ", "", ""]);
        assert_eq!(bounds, [-1.0, 1.01]);
        let (lines, bounds) = scale(50.0, 50.0);
        assert_eq!(lines[2], "50 ");
        assert_eq!(bounds, [49.5, 50.505]);
    }

    #[test]
    fn noise_of_one_bit_is_a_flat_line() {
        let next = f64::from_bits(28e6_f64.to_bits() + 1);
        for (min, max) in [(28e6, next), (-next, -28e6)] {
            let (lines, [low, high]) = scale(min, max);
            assert_eq!(lines.iter().filter(|line| !line.is_empty()).count(), 1);
            // Less than a hundredth of a dot.
            assert!((max - min) / (high - low) < 1e-4);
        }
    }

    #[test]
    fn nearly_equal_ends_are_labelled_by_their_distance_from_the_centre() {
        let (lines, bounds) = scale(0.171_36, 0.171_360_02);
        assert_eq!(lines, ["+1e-8 ", "", "0.17136 ", "", "-1e-8 "]);
        assert_eq!(bounds, [0.171_36, 0.171_360_02]);
    }

    #[test]
    fn a_range_is_labelled_with_its_ends() {
        let (lines, bounds) = scale(-1.0, 2.5);
        assert_eq!(lines, ["2.5 ", "", "", "", "-1 "]);
        assert_eq!(bounds, [-1.0, 2.5]);
        assert_eq!(scale(f64::MIN, f64::MAX).1, [f64::MIN, f64::MAX]);
    }
}

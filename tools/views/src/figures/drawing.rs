//! Drawing of a chart as a scene: frames, ticks, titles, curves, limits and marks at their places.
//!
//! Texts have the sizes that journals ask for, and no label lies on a curve: the legend is above the frame. Knows no
//! file format.

use std::collections::BTreeSet;

use shared_types::extremes::larger;

use super::axis::{Axis, Extent};
use super::chart::{Chart, Curve, LEADING, LIMIT, Level, Panel, TEXT_SIZE, TITLE_SIZE, stroke};
use super::font::Font;
use super::legend::{Legend, mark_rows};
use super::scene::{Anchor, BLACK, Item, Line, Rect, Scene, Stroke, Text};

const FRAME: Stroke = Stroke {
    colour: BLACK,
    width: 0.5,
    dash: &[],
};
const LEVEL: Stroke = Stroke {
    colour: [0x77; 3],
    width: 0.5,
    dash: &[],
};
const MARK: Stroke = Stroke {
    colour: [0x55; 3],
    width: 0.5,
    dash: &[3.0, 1.5],
};
/// Lengths in points.
const TICK: f64 = 2.5;
const EDGE: f64 = 2.0;
/// Width of a frame below which the legend begins at the edge of the figure.
const NARROW: f64 = 120.0;
/// Height of a single panel, and of each of two, as a part of the width.
const HEIGHTS: [f64; 2] = [0.5, 0.32];
/// Distance of two panels.
const BETWEEN: f64 = 8.0;
/// Distance in points from which two places differ, for curves that pass a place many times.
const NEAR: f64 = 0.2;

impl Chart {
    /// Draws the chart at this width in points.
    pub(super) fn draw(&self, width: f64) -> Scene {
        let font = Font::new();
        let height = HEIGHTS[usize::from(self.panels.len() > 1)] * width;
        let extents: Vec<_> = self
            .panels
            .iter()
            .map(|panel| panel.extent(self.span))
            .collect();
        let axes: Vec<Axis> = (self.panels.iter().zip(&extents))
            .map(|(panel, (extent, _))| Axis::new(&panel.y, *extent, height / 15.0, false))
            .collect();
        let titles: Vec<Vec<String>> = (axes.iter())
            .map(|axis| font.lines(&axis.title, TITLE_SIZE, height + 4.0))
            .collect();
        let widths = axes.iter().flat_map(|axis| &axis.ticks);
        let tick_width = (widths.map(|tick| font.width(&tick.text, TEXT_SIZE))).fold(0.0, larger);
        let lines = titles.iter().map(Vec::len).max().unwrap_or(0) as f64;
        let left = EDGE + lines * LEADING + 2.0 + tick_width + TICK + 1.5;
        let x = self.x_axis(&font, width - left - EDGE);
        let overhang = (x.ticks.last()).map_or(0.0, |tick| {
            let half = 0.5 * font.width(&tick.text, TEXT_SIZE);
            half - (1.0 - x.part(tick.value)) * (width - left - EDGE)
        });
        let right = width - EDGE - larger(overhang, 1.0);
        let far: Vec<&Level> = extents.into_iter().flat_map(|(_, far)| far).collect();
        // Beside a narrow frame, texts would be broken into single words.
        let legend_left = if right - left < NARROW { EDGE } else { left };
        let legend = Legend::of(self, &axes, &far, &font, [legend_left, right]);
        let place_x = |value: f64| left + x.part(value) * (right - left);
        let marks: Vec<(f64, &str)> = (self.marks.iter())
            .filter(|(at, _)| (0.0..=1.0).contains(&x.part(*at)))
            .map(|(at, label)| (place_x(*at), label.as_str()))
            .collect();
        // A label may be wider than the frame.
        let rows = mark_rows(&marks, &font, [EDGE, width - EDGE]);
        let row_count = rows.iter().map(|(_, row)| row + 1).max().unwrap_or(0) as f64;
        let mut scene = Scene {
            title: self.title.clone(),
            ..Scene::default()
        };
        let mut top = EDGE + 0.5;
        top = legend.draw(&mut scene, top);
        for ((place, label), (start, row)) in marks.iter().zip(&rows) {
            let base = top + (row_count - *row as f64) * LEADING - 2.5;
            scene.text(label, [*start, base], TEXT_SIZE, Anchor::Start);
            // From the label to the frame.
            scene.line(
                &[
                    [*place, base + 1.5],
                    [*place, top + row_count * LEADING + 1.0],
                ],
                MARK,
            );
        }
        top += row_count * LEADING + 1.0;
        for (number, (panel, axis)) in self.panels.iter().zip(&axes).enumerate() {
            let bottom = top + height;
            let rect = Rect {
                left,
                top,
                right,
                bottom,
            };
            scene.panels.push(rect);
            let frame = Frame {
                rect,
                x: &x,
                y: axis,
                number,
            };
            let is_last = number + 1 == self.panels.len();
            frame.axes(
                &mut scene,
                &titles[number],
                left - TICK - 1.5 - tick_width - 4.0,
                is_last,
            );
            for (place, _) in &marks {
                scene.line(&[[*place, top], [*place, bottom]], MARK);
            }
            frame.levels(&mut scene, panel, &far);
            for (place, curve) in panel.curves.iter().enumerate() {
                frame.curve(&mut scene, curve, stroke(place));
            }
            frame.border(&mut scene, panel.cross);
            top = bottom + if is_last { 0.0 } else { BETWEEN };
        }
        let base = top + TICK + TEXT_SIZE + 1.0 + LEADING;
        scene.text(
            &x.title,
            [0.5 * (left + right), base],
            TITLE_SIZE,
            Anchor::Middle,
        );
        scene.size = [width, base + 3.0];
        scene
    }

    /// Returns the horizontal axis, with as many ticks as its labels leave room for.
    fn x_axis(&self, font: &Font, width: f64) -> Axis {
        let mut extent = Extent::EMPTY;
        match self.span {
            Some([from, until]) => {
                extent.include(from);
                extent.include(until);
            }
            None => {
                let curves = self.panels.iter().flat_map(|panel| &panel.curves);
                let points = curves.flat_map(|curve| curve.parts.iter().flatten());
                let crosses = self.panels.iter().filter_map(|panel| panel.cross.as_ref());
                for [x, _] in points.chain(crosses) {
                    extent.include(*x);
                }
            }
        }
        extent.lengthen(self.least_length);
        let mut most = width / 36.0;
        loop {
            let axis = Axis::new(&self.x, extent, most, self.span.is_some());
            let is_clear = axis.ticks.windows(2).all(|pair| {
                let texts = pair.iter().map(|tick| font.width(&tick.text, TEXT_SIZE));
                let distance = (axis.part(pair[1].value) - axis.part(pair[0].value)) * width;
                0.5 * texts.sum::<f64>() + 4.0 < distance
            });
            if is_clear || most < 1.5 {
                return axis;
            }
            most *= 0.75;
        }
    }
}

/// Panel at its place.
struct Frame<'a> {
    rect: Rect,
    x: &'a Axis,
    y: &'a Axis,
    number: usize,
}

impl Frame<'_> {
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let Rect {
            left,
            top,
            right,
            bottom,
        } = self.rect;
        // Far outside, a distance is only a direction.
        let part = |part: f64| part.clamp(-50.0, 50.0);
        [
            left + part(self.x.part(x)) * (right - left),
            bottom - part(self.y.part(y)) * (bottom - top),
        ]
    }

    fn axes(&self, scene: &mut Scene, title: &[String], title_right: f64, is_last: bool) {
        let Rect {
            left,
            top,
            right,
            bottom,
        } = self.rect;
        let inside = |value: f64| self.y.part(value);
        for tick in &self.y.ticks {
            let y = bottom - inside(tick.value) * (bottom - top);
            scene.line(&[[left - TICK, y], [left, y]], FRAME);
            let base = y + 0.36 * TEXT_SIZE;
            scene.text(
                &tick.text,
                [left - TICK - 1.5, base],
                TEXT_SIZE,
                Anchor::End,
            );
        }
        for value in &self.y.small_ticks {
            let y = bottom - inside(*value) * (bottom - top);
            scene.line(&[[left - 0.5 * TICK, y], [left, y]], FRAME);
        }
        for tick in &self.x.ticks {
            let x = left + self.x.part(tick.value) * (right - left);
            scene.line(&[[x, bottom], [x, bottom + TICK]], FRAME);
            if is_last {
                let base = bottom + TICK + TEXT_SIZE;
                scene.text(&tick.text, [x, base], TEXT_SIZE, Anchor::Middle);
            }
        }
        for value in &self.x.small_ticks {
            let x = left + self.x.part(*value) * (right - left);
            scene.line(&[[x, bottom], [x, bottom + 0.5 * TICK]], FRAME);
        }
        for (number, line) in title.iter().rev().enumerate() {
            scene.items.push(Item::Text(Text {
                text: line.clone(),
                at: [title_right - number as f64 * LEADING, 0.5 * (top + bottom)],
                size: TITLE_SIZE,
                anchor: Anchor::Middle,
                is_upright: true,
            }));
        }
    }

    fn levels(&self, scene: &mut Scene, panel: &Panel, far: &[&Level]) {
        for level in panel.levels.iter().filter(|level| !far.contains(level)) {
            let stroke = if level.requirement.is_some() {
                LIMIT
            } else {
                LEVEL
            };
            let ends = level.span.map(|x| self.place([x, level.value]));
            self.push(scene, vec![ends.to_vec()], stroke);
        }
    }

    fn curve(&self, scene: &mut Scene, curve: &Curve, stroke: Stroke) {
        let mut parts: Vec<Vec<[f64; 2]>> = Vec::new();
        for part in &curve.parts {
            let mut line: Vec<[f64; 2]> = Vec::new();
            for point in part.iter().map(|point| self.place(*point)) {
                if point.iter().any(|one| one.is_nan()) {
                    parts.push(std::mem::take(&mut line));
                    continue;
                }
                extend(&mut line, point);
            }
            parts.push(line);
        }
        if curve.is_free {
            parts = unrepeated(&parts);
        }
        // A lone value is a dot.
        for part in parts.iter_mut().filter(|part| part.len() == 1) {
            part.push([part[0][0] + 0.3, part[0][1]]);
        }
        parts.retain(|part| !part.is_empty());
        self.push(scene, parts, stroke);
    }

    fn border(&self, scene: &mut Scene, cross: Option<[f64; 2]>) {
        let Rect {
            left,
            top,
            right,
            bottom,
        } = self.rect;
        if let Some(point) = cross {
            let [x, y] = self.place(point);
            scene.line(
                &[[x - 2.5, y], [x + 2.5, y]],
                Stroke {
                    width: 0.9,
                    ..FRAME
                },
            );
            scene.line(
                &[[x, y - 2.5], [x, y + 2.5]],
                Stroke {
                    width: 0.9,
                    ..FRAME
                },
            );
        }
        let corners = [
            [left, top],
            [right, top],
            [right, bottom],
            [left, bottom],
            [left, top],
        ];
        scene.line(&corners, FRAME);
    }

    fn push(&self, scene: &mut Scene, parts: Vec<Vec<[f64; 2]>>, stroke: Stroke) {
        scene.items.push(Item::Line(Line {
            parts,
            stroke,
            clip: Some(self.number),
        }));
    }
}

/// Adds a point to a line, unless it looks the same without the point.
fn extend(line: &mut Vec<[f64; 2]>, point: [f64; 2]) {
    const SAME: f64 = 0.005;
    let is_same = |a: f64, b: f64| (a - b).abs() < SAME;
    if let [.., [x, y]] = line[..]
        && is_same(x, point[0])
        && is_same(y, point[1])
    {
        return;
    }
    if let [.., [x0, y0], [x1, y1]] = line[..] {
        let is_level = is_same(y0, y1) && is_same(y1, point[1]) && x0 <= x1 && x1 <= point[0];
        if is_level {
            line.pop();
        }
    }
    line.push(point);
}

/// Returns the parts without what is drawn already: a cycle that repeats is drawn once.
fn unrepeated(parts: &[Vec<[f64; 2]>]) -> Vec<Vec<[f64; 2]>> {
    let cell = |[x, y]: [f64; 2]| [libm::round(x / NEAR) as i32, libm::round(y / NEAR) as i32];
    let mut drawn = BTreeSet::new();
    let mut result = Vec::new();
    for part in parts {
        let Some(first) = part.first() else { continue };
        let (mut line, mut last) = (vec![*first], cell(*first));
        for point in &part[1..] {
            let now = cell(*point);
            if now == last {
                continue;
            }
            let key = if now < last { [now, last] } else { [last, now] };
            if drawn.insert(key) {
                line.push(*point);
            } else {
                if line.len() > 1 {
                    result.push(std::mem::take(&mut line));
                }
                line = vec![*point];
            }
            last = now;
        }
        if line.len() > 1 || result.is_empty() {
            result.push(line);
        }
    }
    result
}

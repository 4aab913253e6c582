"use strict";
// What is drawn in a plot over time, of a recorded run as of one that goes on: curves through the least and the greatest
// value of each stretch, levels and limits, and the names of events.

const make = (name, content, attributes = {}) => {
  const element = document.createElement(name);
  if (content !== undefined) element.append(content);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
};
const write = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

// What is told is seen for a while, and heard by a screen reader.
const tell = (text) => {
  byId("status").textContent = text;
};
const watchStatus = () => {
  const box = byId("status");
  let later = 0;
  box.className = "toast";
  new MutationObserver(() => {
    box.toggleAttribute("data-shown", box.textContent !== "");
    clearTimeout(later);
    later = setTimeout(() => box.removeAttribute("data-shown"), 4000);
  }).observe(box, { childList: true, characterData: true, subtree: true });
};

// ---- Curves ----

// Place of a value from below, before an axis of its kind scales it.
const raw = (value) => value;
const rawLog = (value) => Math.log10(Math.max(value, 1e-300));
// Heights on the canvas of values on an axis; what is far beyond it, infinite even, is at its edge.
const heightsOf = (u, forward = raw) => {
  const { top, height } = u.bbox;
  const floor = forward(u.scales.y.min);
  const room = forward(u.scales.y.max) - floor;
  const scale = height / room;
  return (value) => top + height - (Math.min(Math.max(forward(value), floor - room), floor + 2 * room) - floor) * scale;
};
// Corners of the course that is written: abscissa and ordinate in turns, from left to right, neither of them a number
// where it breaks.
let corners = new Float64Array(0);
// Writes the first of them to a path, without those within a quarter of a pixel of the line past them, of which smooth
// curves have many.
const writeCorners = (path, count) => {
  let isBegun = false;
  let hasLast = false;
  let fromX = NaN;
  let fromY = NaN;
  let lastX = NaN;
  let lastY = NaN;
  // Slopes of the lines from the last corner written that pass all corners since.
  let flattest = -Infinity;
  let steepest = Infinity;
  for (let nth = 0; nth < count; nth += 2) {
    const x = corners[nth];
    const y = corners[nth + 1];
    if (x !== x) {
      if (hasLast) path.lineTo(lastX, lastY);
      isBegun = false;
      hasLast = false;
      continue;
    }
    if (!isBegun) {
      path.moveTo(x, y);
      isBegun = true;
      fromX = x;
      fromY = y;
      continue;
    }
    const slope = (y - fromY) / (x - fromX);
    if (hasLast && !(slope >= flattest && slope <= steepest)) {
      path.lineTo(lastX, lastY);
      hasLast = false;
      fromX = lastX;
      fromY = lastY;
    }
    const up = (y + 0.25 - fromY) / (x - fromX);
    const down = (y - 0.25 - fromY) / (x - fromX);
    steepest = !hasLast || up < steepest ? up : steepest;
    flattest = !hasLast || down > flattest ? down : flattest;
    hasLast = true;
    lastX = x;
    lastY = y;
  }
  if (hasLast) path.lineTo(lastX, lastY);
};
// A curve through the least and the greatest value of each stretch from one to another, the nearer one first. A stretch
// is at `slot` in the numbers, from a time `begin` to `end`; behind a gap it `isApart` from the one before.
const courseOf = (u, { least, greatest }, { from, to, slot, begin, end, isApart = (nth, before) => nth > before + 1, isLog = false, forward = isLog ? rawLog : raw, raised = 0 }) => {
  const { left, width } = u.bbox;
  const { min, max } = u.scales.x;
  const perSecond = width / (max - min);
  const x = (time) => left + (time - min) * perSecond;
  const y = heightsOf(u, forward);
  if (corners.length < 6 * (to - from + 1)) corners = new Float64Array(12 * (to - from + 1));
  let count = 0;
  let before = -1;
  let last = 0;
  for (let nth = from; nth <= to; nth++) {
    const place = slot(nth);
    let low = least[place] + raised;
    let high = greatest[place] + raised;
    if (low !== low) continue;
    if (isLog) [low, high] = magnitudes(low, high);
    const isDown = before >= 0 && !isApart(nth, before);
    const isRising = Math.abs(last - low) <= Math.abs(last - high);
    const first = isRising ? low : high;
    const second = isRising ? high : low;
    const at = x(begin(nth));
    if (!isDown) {
      corners[count++] = NaN;
      corners[count++] = NaN;
    }
    corners[count++] = at;
    corners[count++] = y(first);
    if (first !== second || !isDown) {
      corners[count++] = first === second ? at + 0.01 : x(end(nth));
      corners[count++] = y(second);
    }
    before = nth;
    last = second;
  }
  const stroke = new Path2D();
  writeCorners(stroke, count);
  return stroke;
};
// The area between the least and the greatest value of each stretch, wider by a margin on both sides; parts are as those
// of a curve.
const areaOf = (u, { least, greatest }, { from, to, slot, begin, end, isLog = false, forward = isLog ? rawLog : raw, raised = 0, margin = 0 }) => {
  const area = new Path2D();
  const { left, width } = u.bbox;
  const { min, max } = u.scales.x;
  const x = (time) => left + ((time - min) * width) / (max - min);
  const y = heightsOf(u, forward);
  let above = [];
  let below = [];
  const close = () => {
    const corners = above.concat(below.reverse());
    corners.forEach((corner, nth) => (nth ? area.lineTo(...corner) : area.moveTo(...corner)));
    if (corners.length) area.closePath();
    above = [];
    below = [];
  };
  for (let nth = from; nth <= to; nth++) {
    let low = least[slot(nth)] + raised - margin;
    let high = greatest[slot(nth)] + raised + margin;
    if (low !== low) {
      close();
      continue;
    }
    if (isLog) [low, high] = magnitudes(low, high);
    for (const time of new Set([begin(nth), end(nth)])) {
      above.push([x(time), y(high)]);
      below.push([x(time), y(low)]);
    }
  }
  close();
  return area;
};
// Shades areas, each with its colour.
const shadeAreas = (u, areas) => within(u, (ctx, _, ratio) => {
  ctx.lineWidth = 2 * ratio;
  for (const [area, colour] of areas) {
    ctx.fillStyle = ctx.strokeStyle = colour;
    ctx.globalAlpha = 0.16;
    ctx.fill(area);
    ctx.globalAlpha = 0.35;
    ctx.stroke(area);
  }
  ctx.globalAlpha = 1;
});
// Begin and width of a mark for each interval of time in order, at least so wide; what lies within the mark before has
// none of its own.
const marksOf = (u, times, least) => {
  const { left, width } = u.bbox;
  const { min, max } = u.scales.x;
  const x = (time) => left + ((time - min) * width) / (max - min);
  const marks = [];
  let edge = left;
  for (const [from_s, until_s] of times) {
    const from = Math.max(x(from_s), left);
    const to = Math.min(Math.max(x(until_s), from + least), left + width);
    if (to <= edge) continue;
    const begin = Math.max(from, edge);
    marks.push([begin, to - begin]);
    edge = to;
  }
  return marks;
};
// The least and the greatest number of stretches, for a logarithmic scale of their sizes; infinite ones do not count.
const reachOf = ({ least, greatest }, { from, to, slot, isLog = false }, [min, max] = [Infinity, -Infinity]) => {
  for (let nth = from; nth <= to; nth++) {
    let low = least[slot(nth)];
    let high = greatest[slot(nth)];
    if (low !== low) continue;
    if (isLog) [low, high] = magnitudes(low, high);
    if (low < min && Number.isFinite(low) && (low > 0 || !isLog)) min = low;
    if (high > max && Number.isFinite(high)) max = high;
  }
  return [min, max];
};
// Series of uPlot for curves, whose `path` gets the plot, the curve, its place and the ends of what is in sight. The first
// are wider, so that those of one course are seen beneath each other.
const seriesOf = (curves, ink, path) => [{}, ...curves.map((one, place) => ({
  show: one.isShown, stroke: () => ink().series[one.colour % 8], width: 1.25 + Math.min(2, 0.9 * (curves.length - 1 - place)), dash: one.dash, points: { show: false },
  paths: (u, _, from, to) => ({ stroke: path(u, one, place, from, to), fill: null, clip: null, band: null, gaps: null, flags: 0 }),
}))];
// The name of a curve below its plot, with its line and a place for its value; a press hides or shows the curve.
const legendButton = (one, width, content, toggled) => {
  one.shownValue = make("span", "", { class: "value" });
  const button = make("button", lineOf(width, one.dash, one.colour % 8), { type: "button", "aria-pressed": String(one.isShown) });
  button.append(...content, " ", one.shownValue);
  button.addEventListener("click", () => {
    one.isShown = !one.isShown;
    button.setAttribute("aria-pressed", String(one.isShown));
    toggled(one.isShown);
  });
  return button;
};

// ---- Levels ----

// Level lines, and limits of requirements over the times in which they hold.
const drawLevels = (u, spec, isLog, ink) => within(u, (ctx, { left, width }, ratio) => {
  ctx.lineWidth = 1.25 * ratio;
  const rule = (level, from, to) => {
    if (isLog && level <= 0) return;
    const y = u.valToPos(level, "y", true);
    ctx.beginPath();
    ctx.moveTo(from, y);
    ctx.lineTo(Math.max(to, from + 4 * ratio), y);
    ctx.stroke();
  };
  ctx.strokeStyle = ink.text;
  ctx.setLineDash([2 * ratio, 4 * ratio]);
  for (const level of spec.lines) rule(level, left, left + width);
  ctx.strokeStyle = ink.limit;
  ctx.setLineDash([6 * ratio, 3 * ratio]);
  for (const limit of spec.limits) {
    const [from, to] = [limit.from_s, limit.until_s].map((time) => u.valToPos(time, "x", true));
    if (to >= left && from <= left + width) rule(limit.level, Math.max(from, left), Math.min(to, left + width));
  }
});

// ---- Events ----

// Times in which faults act, and other events, each a line at its begin.
const drawEvents = (u, events, ink) => within(u, (ctx, { left, top, width, height }, ratio) => {
  for (const { from_s, until_s, isFault } of events) {
    const from = u.valToPos(from_s, "x", true);
    const to = until_s === null ? left + width : u.valToPos(until_s, "x", true);
    if (to < left || from > left + width) continue;
    if (isFault) {
      ctx.fillStyle = ink.fault;
      ctx.fillRect(from, top, Math.max(to - from, ratio), height);
    }
    ctx.fillStyle = isFault ? ink.edge : ink.text;
    ctx.fillRect(from, top, ratio, height);
  }
});
// Places for the names of events between two edges, each in the first row in which it overlaps none. What finds no row
// is counted by the name in the last row that is in its way.
const placeNames = (ctx, events, [left, right], rows, at) => {
  const gap = 6 * devicePixelRatio;
  const placed = [];
  for (const event of events) {
    const plain = ctx.measureText(event.label).width;
    const more = ctx.measureText(" +99").width;
    const from = Math.max(at(event), left);
    const boxOf = (row) => {
      const wide = row === rows - 1 ? plain + more : plain;
      const x = Math.max(left, Math.min(from, right - wide));
      return { row, left: x, right: x + wide + gap, wide: plain };
    };
    const inWay = (box) => placed.find((one) => one.row === box.row && one.right > box.left && one.left < box.right);
    const box = Array.from({ length: rows }, (_, row) => boxOf(row)).find((box) => !inWay(box));
    if (box) placed.push({ ...box, label: event.label, event, more: 0 });
    else if (rows) inWay(boxOf(rows - 1)).more += 1;
  }
  for (const one of placed.filter((one) => one.more)) {
    one.label += ` +${one.more}`;
    one.wide = ctx.measureText(one.label).width;
  }
  return placed;
};

"use strict";
// What all pages with plots share: numbers as tables and terminals write them, axes, colours and themes.
const root = document.documentElement;
const byId = (id) => document.getElementById(id);

// ---- Numbers ----

// The nearest number of so many significant digits; of two that are equally near, the one whose last digit is even.
const rounded = (value, digits) => {
  const [exact, power] = Math.abs(value).toExponential(100).split("e");
  const text = exact.replace(".", "");
  const isTie = /^50*$/.test(text.slice(digits)) && "02468".includes(text[digits - 1]);
  return isTie ? Math.sign(value) * `${text[0]}.${text.slice(1, digits)}e${power}` : +value.toPrecision(digits);
};
// As `shared_types::number::short`: no needless zeros; between a hundred thousand and a million no digit in front of the
// point is lost.
const number = (value, digits = 5) => {
  if (value === null || value === undefined) return "-";
  if (Number.isNaN(value)) return "nan";
  if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
  const magnitude = Math.abs(value);
  const short = rounded(value, magnitude >= 1e5 && magnitude < 1e6 ? Math.max(digits, 6) : digits);
  const size = Math.abs(short);
  return short !== 0 && (size < 1e-3 || size >= 1e6) ? short.toExponential().replace("e+", "e") : String(short);
};
// As a field of nine letters holds it: with seven digits, or as many as fit.
const typed = (value) => {
  for (const digits of [7, 6]) if (number(value, digits).length <= 9) return number(value, digits);
  return number(value);
};
// As `shown_ns` of the terminal: three digits.
const nanoseconds = (ns) => {
  if (!Number.isFinite(ns)) return number(ns) + " ns";
  if (ns < 0) return "-" + nanoseconds(-ns);
  if (ns < 1e3) return number(ns) + " ns";
  const [size, unit] = ns < 1e6 ? [1e3, "us"] : ns < 1e9 ? [1e6, "ms"] : [1e9, "s"];
  const value = ns / size;
  const places = value < 9.995 ? 2 : value < 99.95 ? 1 : 0;
  return `${rounded(value, String(Math.floor(value)).length + places).toFixed(places)} ${unit}`;
};
const seconds = (time) => String(+time.toFixed(6));
const isNothing = (value) => value === null || value === undefined;
const shown = (value, unit) => (isNothing(value) ? "-" : unit === "ns" ? nanoseconds(value) : number(value) + (unit && unit !== "1" ? " " + unit : ""));
const unitOf = (unit) => (unit && unit !== "1" ? ` [${unit}]` : "");

// ---- Axes ----

// Decimals that it takes to write a step exactly.
const decimals = (step) => {
  let digits = 0;
  while (digits < 9 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6 * step * 10 ** digits) digits++;
  return digits;
};
const tickNanoseconds = (ns) => nanoseconds(ns).replace(/\.0+ /, " ");
// Ticks with as many digits as tell them apart.
const ticks = (splits, step, unit) => {
  const most = Math.max(...splits.map((one) => Math.abs(one ?? 0)));
  return splits.map((value) => {
    if (isNothing(value)) return "";
    if (unit === "ns") return tickNanoseconds(value);
    if (value === 0) return "0";
    if (most >= 1e-2 && most < 1e6) return value.toFixed(decimals(step || 1));
    const power = Math.floor(Math.log10(Math.abs(value)));
    return value.toExponential(decimals((step || most) / 10 ** power)).replace("e+", "e");
  });
};
// Powers of ten, every so many of them.
const powers = (min, max, most = 7) => {
  const first = Math.ceil(Math.log10(min) - 1e-9);
  const last = Math.floor(Math.log10(max) + 1e-9);
  const step = Math.max(1, Math.ceil((last - first) / most));
  return Array.from({ length: Math.max(0, Math.floor((last - first) / step) + 1) }, (_, i) => 10 ** (first + i * step));
};
const logTicks = (splits, unit) => splits.map((value) => (unit === "ns" ? tickNanoseconds(value) : value >= 1e-3 && value < 1e5 ? String(+value.toPrecision(1)) : value.toExponential(0).replace("e+", "e")));
// An axis of uPlot: its ink is read anew at each drawing.
const axisOf = (ink, size, font = "12px system-ui, sans-serif") => ({ stroke: () => ink().text, grid: { stroke: () => ink().grid, width: 1 }, ticks: { stroke: () => ink().grid, width: 1 }, font, size });
const timeLabels = { values: (u, splits, _i, _s, step) => ticks(splits, step, "").map((text, i) => (i === splits.length - 1 ? text + " s" : text)) };
const logLabels = (unit, most) => ({ splits: (u, _i, min, max) => powers(min, max, most), filter: (u, splits) => splits, values: (u, splits) => logTicks(splits, unit) });
const labelsOf = (spec, most) => (spec.log ? logLabels(spec.unit, most) : { values: (u, splits, _i, _s, step) => ticks(splits, step, spec.unit) });
// Width of the value axes of a page's plots: one for all of them, so that times stand beneath each other, as wide as
// the widest label that any plot has had. It never shrinks: plots that breathe are hard to read. `redraw` follows a
// change; the page's style has the width as `--axis`.
const commonAxis = (least, redraw) => {
  let width = least;
  return (plot, values, place) => {
    if (!values) return width;
    const { ctx, axes } = plot;
    const { font, gap, ticks } = axes[place];
    ctx.font = font[0];
    const widest = Math.max(0, ...values.map((text) => ctx.measureText(text ?? "").width)) / devicePixelRatio;
    const needed = Math.ceil(ticks.size + gap + widest) + 1;
    if (needed > width) {
      width = needed;
      root.style.setProperty("--axis", `${width}px`);
      queueMicrotask(redraw);
    }
    return width;
  };
};

// ---- Ranges ----

// The least and the greatest size of the numbers in a range, for a logarithmic scale.
const magnitudes = (low, high) => (low > 0 ? [low, high] : high < 0 ? [-high, -low] : [0, Math.max(-low, high)]);
// Levels of a plot: its lines, and the limits that hold in the time that is seen.
const levelsOf = (spec, [from_s, until_s]) => spec.lines.concat(spec.limits.filter((one) => one.from_s <= until_s && one.until_s >= from_s).map((one) => one.level));
// A logarithmic scale for numbers of these sizes and the levels near them.
const logRange = (min, max, levels) => {
  for (const level of levels) if (level > 0 && level < max * 100 && level > min / 100) [min, max] = [Math.min(min, level), Math.max(max, level)];
  min = Math.max(min, max * 1e-24);
  return [10 ** Math.floor(Math.log10(min) - 0.05), 10 ** Math.ceil(Math.log10(max) + 0.05)];
};
// The range of numbers and of the levels near them.
const withLevels = (min, max, levels) => {
  const height = max - min;
  for (const level of levels) if (level < max + 4 * height && level > min - 4 * height) [min, max] = [Math.min(min, level), Math.max(max, level)];
  return [min, max];
};

// ---- Colours ----

const readInk = () => {
  const style = getComputedStyle(root);
  const of = (name) => style.getPropertyValue(name).trim();
  return {
    text: of("--soft"), grid: of("--grid"), fault: of("--fault"), edge: of("--fault-edge"), limit: of("--limit"), paper: of("--paper"), cursor: of("--cursor"), found: of("--found"), ghost: of("--ghost"),
    series: Array.from({ length: 8 }, (_, i) => of("--c" + i)),
  };
};
const wantsDark = matchMedia("(prefers-color-scheme: dark)");
const showTheme = (isDark) => {
  root.dataset.theme = isDark ? "dark" : "light";
  const text = isDark ? "Light" : "Dark";
  if (byId("theme").textContent !== text) byId("theme").textContent = text;
  byId("theme").setAttribute("aria-pressed", String(isDark));
};
// The line of a curve, for the name below its plot.
const lineOf = (width, dash, colour) => {
  const svg = "http://www.w3.org/2000/svg";
  const line = document.createElementNS(svg, "svg");
  line.setAttribute("width", width);
  line.setAttribute("height", "8");
  const stroke = document.createElementNS(svg, "line");
  for (const [name, value] of Object.entries({ x1: 0, y1: 4, x2: width, y2: 4, "stroke-width": 2, "stroke-dasharray": dash.join(" ") })) stroke.setAttribute(name, value);
  stroke.style.stroke = `var(--c${colour})`;
  line.append(stroke);
  return line;
};
// Draws in the area of a plot alone.
const within = (u, does) => {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  does(ctx, bbox, devicePixelRatio);
  ctx.restore();
};

// ---- Data ----

const bytesOf = (text) => {
  const raw = atob(text);
  return Uint8Array.from({ length: raw.length }, (_, place) => raw.charCodeAt(place));
};
// Marks tables that scroll; in the next frame, as the words above one change its height.
const watchScroll = () => {
  const scrolls = new ResizeObserver((entries) => requestAnimationFrame(() => {
    for (const { target } of entries) target.toggleAttribute("data-scrolls", target.scrollWidth > target.clientWidth + 1);
  }));
  for (const box of document.querySelectorAll(".scroll")) scrolls.observe(box);
};

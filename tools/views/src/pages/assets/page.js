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
const isNothing = (value) => value === null || value === undefined || Number.isNaN(value);
const shown = (value, unit) => (isNothing(value) ? "-" : unit === "ns" ? nanoseconds(value) : number(value) + (unit && unit !== "1" ? " " + unit : ""));
const unitOf = (unit) => (unit && unit !== "1" ? ` [${unit}]` : "");

// ---- Units ----

// Symbols that take a prefix, and whether they take those above one too.
const PREFIXED = { Pa: true, N: true, A: true, V: true, W: true, J: true, Hz: true, Ohm: true, m: true, F: false, H: false, rad: false, s: false };
const PREFIXES = ["p", "n", "µ", "m", "", "k", "M", "G", "T"];
// As `ShownUnit` of hil-views: the unit in which a plot shows values up to a magnitude, and its power of ten.
const shownUnit = (unit, largest) => {
  const plain = { power: 0, unit: unit && unit !== "1" ? unit : "" };
  if (unit === "ns" || unit === "steps" || !(largest > 0) || !Number.isFinite(largest)) return plain;
  const power = 3 * Math.floor(Math.log10(largest) / 3 + 1e-12);
  const isLarge = PREFIXED[/^[A-Za-z]+(?=$|[ /])/.exec(unit)?.[0]];
  const isUsual = isLarge === undefined ? largest >= 1e-3 && largest < 1e6 : largest >= 0.1 && (!isLarge || largest < 1e4);
  if (isUsual || power === 0) return plain;
  const prefix = isLarge === undefined ? undefined : PREFIXES[power / 3 + 4];
  return { power, unit: prefix === undefined ? `1e${power} ${plain.unit}`.trim() : prefix + unit };
};
// A value in the unit of its plot.
const shownIn = (value, { unit, shown: of }, digits) => {
  if (isNothing(value)) return "-";
  if (unit === "ns") return nanoseconds(value);
  const { power, unit: symbol } = of || shownUnit(unit, 1);
  return number(power ? value / 10 ** power : value, digits) + (symbol ? " " + symbol : "");
};
// The values between two in the unit of their plot, or "" without any.
const reachShown = (low, high, spec) => {
  if (isNothing(low)) return "";
  const [from, to] = [shownIn(low, spec), shownIn(high, spec)];
  const unit = from.indexOf(" ");
  return from === to ? from : `${spec.unit === "ns" || unit < 0 ? from : from.slice(0, unit)} to ${to}`;
};
// How a linear axis writes its numbers: in the unit of its plot or, where they ripple on a large value, as what is
// added to a round number.
const formOf = (spec, min, max) => {
  const { power, unit } = spec.shown || shownUnit(spec.unit, 1);
  const height = max - min;
  const plain = { offset: 0, power, unit, note: "" };
  // A page that does not name the unit of an axis does not say to what its numbers are added either.
  if (!spec.shown || spec.log || spec.unit === "ns" || !(height > 0) || height >= 2e-3 * Math.max(Math.abs(min), Math.abs(max))) return plain;
  const step = 10 ** Math.ceil(Math.log10(height));
  const offset = Math.round((min + max) / 2 / step) * step;
  const ripple = shownUnit(spec.unit, Math.max(Math.abs(min - offset), Math.abs(max - offset)));
  return { offset, ...ripple, note: `Axis: ${shownIn(offset, spec, 12)} plus the number${ripple.unit ? " in " + ripple.unit : ""}` };
};

// ---- Axes ----

// Decimals that it takes to write a step exactly.
const decimals = (step) => {
  let digits = 0;
  while (digits < 9 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6 * step * 10 ** digits) digits++;
  return digits;
};
const tickNanoseconds = (ns) => nanoseconds(ns).replace(/\.0+ /, " ").replace("us", "µs");
// Ticks in the form of their axis, with as many digits as tell them apart.
const ticks = (splits, step, { offset = 0, power = 0 } = {}) => {
  const size = 10 ** power;
  const values = splits.map((value) => (isNothing(value) ? null : (value - offset) / size));
  const apart = (step || 1) / size;
  const most = Math.max(...values.map((one) => Math.abs(one ?? 0)));
  return values.map((value) => {
    if (value === null) return "";
    if (Math.abs(value) < 1e-6 * apart) return "0";
    if (most >= 1e-2 && most < 1e6) return value.toFixed(decimals(apart));
    const digits = Math.floor(Math.log10(Math.abs(value)));
    return value.toExponential(decimals(apart / 10 ** digits)).replace("e+", "e");
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
const timeLabels = { values: (u, splits, _i, _s, step) => ticks(splits, step), label: "Time [s]", labelSize: 16, labelGap: 0, labelFont: "12px system-ui, sans-serif" };
const logLabels = (unit, most) => ({ splits: (u, _i, min, max) => powers(min, max, most), filter: (u, splits) => splits, values: (u, splits) => logTicks(splits, unit) });
const linearLabels = (spec) => ({ values: (u, splits, _i, _s, step) => (spec.unit === "ns" ? splits.map(tickNanoseconds) : ticks(splits, step, formOf(spec, u.scales.y.min, u.scales.y.max))) });
const labelsOf = (spec, most) => (spec.log ? logLabels(spec.unit, most) : linearLabels(spec));

// ---- Axes for a spike ----

// The next of 1, 2, 5, 10 and so on from a number upwards.
const roundUp = (value) => {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((one) => one * power >= value * (1 - 1e-9));
};
// A symmetric logarithmic scale for uPlot: linear up to a magnitude, beyond it as much room for each power of ten.
const symmetricScale = (linear) => ({
  distr: 100,
  fwd: (value) => (Math.abs(value) <= linear ? value / linear : Math.sign(value) * (1 + Math.log10(Math.abs(value) / linear))),
  bwd: (value) => (Math.abs(value) <= 1 ? value * linear : Math.sign(value) * linear * 10 ** (Math.abs(value) - 1)),
});
// Ticks of such a scale: 0, then powers of ten, then what finds room between them.
const symmetricSplits = (min, max, { fwd }, height) => {
  const most = Math.max(Math.abs(min), Math.abs(max));
  const top = Math.floor(Math.log10(most));
  const kept = [0].filter((value) => value >= min && value <= max);
  const perPixel = (fwd(max) - fwd(min)) / Math.max(height, 1);
  for (const factor of [1, 5, 2]) {
    for (let power = top; power > top - 6; power--) {
      for (const value of [factor * 10 ** power, -factor * 10 ** power]) {
        const hasRoom = kept.every((one) => Math.abs(fwd(one) - fwd(value)) > 20 * perPixel);
        if (value >= min && value <= max && hasRoom) kept.push(value);
      }
    }
  }
  return kept.sort((a, b) => a - b);
};
// The magnitude up to which such a scale suits curves, or 0 if a linear one does. It suits a spike: the largest
// magnitude is 10 to 1000 times that below which all curves keep for two thirds of the time, and for less than 5 % of
// the time they exceed a fifth of it. `sizes` are magnitudes, `lengths` the times for which they last.
const spikeOf = (sizes, lengths) => {
  const order = Array.from(sizes.keys()).filter((place) => sizes[place] === sizes[place]).sort((a, b) => sizes[a] - sizes[b]);
  const whole = order.reduce((sum, place) => sum + lengths[place], 0);
  const largest = sizes[order.at(-1)];
  let [time, usual, above] = [0, undefined, 0];
  for (const place of order) {
    time += lengths[place];
    if (usual === undefined && time >= (2 / 3) * whole) usual = sizes[place];
    if (sizes[place] > largest / 5) above += lengths[place];
  }
  const ratio = largest / usual;
  return ratio >= 10 && ratio <= 1000 && above < 0.05 * whole ? roundUp(usual) : 0;
};
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
// Dashes of curves, so that colour alone tells none from another.
const DASHES = [[], [2, 3], [10, 3, 2, 3], [1, 5], [14, 3], [5, 2], [5, 2, 1, 2, 1, 2], [3, 6]];
// Dashes of what is wanted of others, as of references.
const WANTED = [[8, 4], [14, 4]];
// The line of a curve, for the name below its plot.
const lineOf = (width, dash, colour) => {
  const svg = "http://www.w3.org/2000/svg";
  const line = document.createElementNS(svg, "svg");
  line.setAttribute("width", width);
  line.setAttribute("height", "8");
  const stroke = document.createElementNS(svg, "line");
  for (const [name, value] of Object.entries({ x1: 0, y1: 4, x2: width, y2: 4, "stroke-width": 2, "stroke-dasharray": dash.join(" ") })) stroke.setAttribute(name, value);
  stroke.style.stroke = colour === "limit" ? "var(--limit)" : `var(--c${colour})`;
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
  ctx.setLineDash([]); // not that of the last curve
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
    for (const { target } of entries) {
      const box = target.closest(".scroll");
      box.toggleAttribute("data-scrolls", box.scrollWidth > box.clientWidth + 1);
    }
  }));
  for (const box of document.querySelectorAll(".scroll")) for (const one of [box, ...box.children]) scrolls.observe(one);
};

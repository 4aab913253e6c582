// The panel of a session or of a recorded run. Points of a session come as the least and the greatest value of equal
// stretches of time and are kept for one window; everything else comes as JSON. Texts of a run are only ever set as
// text. This file, `closer.js`, `arrange.js`, `branches.js` and `connection.js` are the parts of one function.
const secret = location.hash.slice(1);

// A name that may break behind its parts.
const parted = (name) => {
  const box = document.createDocumentFragment();
  for (const part of name.split(/(?<=[._])/)) box.append(part, document.createElement("wbr"));
  return box;
};

// ---- Choices that outlast a reload ----

// Kept by the tab, by the name of the session: a theme, a width, names of curves. A browser may refuse its storage,
// and its content may be anything.
const recall = (name) => {
  try {
    return JSON.parse(sessionStorage.getItem("hil panel " + name));
  } catch {
    return null;
  }
};
const retain = (name, value) => {
  try {
    sessionStorage.setItem("hil panel " + name, JSON.stringify(value));
  } catch {
    // The choice lasts until the next load.
  }
};
// Curves that a name below their plot hides, by plot and signal.
let hidden = null;
const retainChoices = () => retain("session " + about.session, { window_s: view.window_s, hidden: [...hidden] });

// ---- Points ----

// More stretches than a window has.
const KEPT = 1024;
let about = null;
let state = null;
let signals = [];
let view = { number: 0, window_s: 5, length: 1, first: 0, last: -1, newest: -1, base: 0, size: KEPT, of: (signal) => signal };

const forget = () => {
  Object.assign(view, { first: 0, last: -1, newest: -1 });
  for (const one of signals) {
    one.least.fill(NaN);
    one.greatest.fill(NaN);
  }
};
// Script time since the last frame.
let spent = 0;
const timed = (does) => {
  const start = performance.now();
  does();
  spent += performance.now() - start;
};
const take = (buffer) => {
  const words = new DataView(buffer);
  if (words.getUint8(0) === 2) return (words.getUint8(1) & 1 ? ghost : lens).take(buffer);
  if (words.getUint8(0) !== 1) return;
  const points = words.getUint32(8, true);
  ask({ ask: "seen", number: points });
  const [newest, first, count, length, signalCount] = [0, 1, 2, 3, 4].map((i) => words.getFloat64(16 + 8 * i, true));
  if (words.getUint32(4, true) !== view.number || signalCount !== signals.length) return;
  const values = new Float64Array(buffer, 56, signalCount);
  const ranges = new Float32Array(buffer, 56 + 8 * signalCount, 2 * signalCount * count);
  const isNew = view.last < 0 || length !== view.length || first > view.last + KEPT;
  if (isNew) {
    forget();
    view.first = first;
  }
  signals.forEach((one, place) => {
    one.value = values[place];
    for (let lost = view.last + 1; !isNew && lost < first; lost++) one.least[lost % KEPT] = one.greatest[lost % KEPT] = NaN;
    for (let i = 0; i < count; i++) {
      const slot = (first + i) % KEPT;
      one.least[slot] = ranges[2 * (place * count + i)];
      one.greatest[slot] = ranges[2 * (place * count + i) + 1];
    }
  });
  Object.assign(view, { length, last: first + count - 1, newest });
  view.first = Math.max(view.first, view.last - KEPT + 1);
  root.dataset.points = String(points);
  root.dataset.newest = String(newest);
  drawSoon();
};

// ---- Colours ----

let ink = {};
const plots = [];
const valueAxis = commonAxis(62, () => plots.forEach((one) => one.plot?.redraw(true, true)));
const setTheme = (isDark) => {
  showTheme(isDark);
  ink = readInk();
  drawSoon();
};

// ---- Plots ----

const period = () => 1 / about.rate_hz;
// The part of the run at which a page looks closer; `null` while it follows the newest records.
let closer = null;
// The time that is shown: the newest at its right end, from the beginning of the run on.
const followed = () => {
  const end = Math.max(view.newest, 0) * period();
  const from = Math.max(0, end - view.window_s);
  return [from, from + view.window_s];
};
const span = () => closer ?? followed();
// Numbers of the part in sight: points of the session as they come, or what was read of the run.
const lens = lensOf({ ask: (message) => ask(message), changed: () => came(lens) });
const ghost = lensOf({ ask: (message) => ask(message), changed: () => came(ghost), over: true });
const came = (from) => {
  root.dataset[from === lens ? "read" : "ghost"] = `${from.length} ${from.first * from.length} ${from.newest}`;
  drawSoon();
};
const inView = () => (closer ? lens : view);
// Where a baseline lets a signal be: its tolerance about the other run or, without one, about a range.
const bandOf = ({ place }) => about.band?.signals[place] ?? null;
// The place of a stretch among the numbers of a part.
const slotOf = ({ base, size }) => (nth) => (nth - base) % size;
// The stretches in it.
const stretches = ([from, to], part) => {
  const length = part.length * period();
  return [Math.max(part.first, Math.floor(from / length)), Math.min(part.last, Math.ceil(to / length))];
};
const axis = timeAxis({
  whole: () => [0, Math.max(about.recorded ? about.duration_s : view.newest * period(), 4 * period())],
  least: () => 4 * period(),
  shown: span,
  show: (part) => lookAt(part),
});
// Looks at a part of the run; at its whole length a recorded run shows the same as one that was never zoomed.
const lookAt = (part) => {
  closer = part;
  showRange();
  readPart();
  drawSoon();
};
const follow = () => {
  closer = about.recorded ? [0, about.duration_s] : null;
  showRange();
  if (closer) readPart();
  else look();
  drawSoon();
};
const inSightOf = () => [...new Set(plots.filter((one) => one.isVisible).flatMap((one) => one.spec.signals))];
// Asks for the part in sight, and a stretch beyond each end of it, with room for a stretch a pixel.
const readPart = () => {
  const [from, to] = span();
  const room = Math.min(Math.max(Math.round(plots[0]?.box.clientWidth || 600), 200), 1600);
  const beyond = Math.ceil((to - from) / period() / room);
  const steps = [Math.max(0, Math.floor(from / period()) - beyond), Math.max(0, Math.ceil(to / period()) + beyond)];
  if (closer) lens.look(...steps, room, inSightOf());
  if (!about.over) return;
  // A part that moves on is asked for with as much again on both sides.
  const wide = closer ? 0 : steps[1] - steps[0];
  const isInside = !closer && ghost.last >= ghost.first && ghost.first * ghost.length <= steps[0] && ghost.newest >= Math.min(steps[1], about.steps) && inSightOf().every((place) => ghost.of({ place }));
  if (!isInside) ghost.look(Math.max(0, steps[0] - wide), steps[1] + wide, closer ? room : 3 * room > 2000 ? 2000 : 3 * room, inSightOf());
};
let readAgain = 0;

class Plot {
  constructor(spec, parent) {
    this.spec = spec;
    this.isLog = spec.log;
    this.range = null;
    // The largest magnitude that was drawn: the unit that suits it stays, whatever is in sight.
    this.largest = 0;
    const counts = { wanted: 0, others: 0 };
    this.series = spec.signals.map((place, nth) => {
      const { name } = signals[place];
      const kind = /^(reference|stimulus)\./.test(name) ? "wanted" : "others";
      const dashes = kind === "wanted" ? WANTED : DASHES;
      return { signal: signals[place], isShown: !hidden.has(spec.title + " " + name), colour: nth % 8, label: spec.words[nth], dash: dashes[counts[kind]++ % dashes.length] };
    });
    this.unitBox = make("span", unitOf(spec.unit), { class: "unit" });
    this.noteBox = make("span", "", { class: "hint" });
    // The name that commands understand, unless heading or legend have it.
    const isNamed = spec.title === spec.heading || this.series.some(({ signal }) => signal.name === spec.title);
    const heading = make("span", parted(spec.heading));
    heading.append(" ", this.unitBox, ...(isNamed ? [] : [" ", make("code", parted(spec.title), { class: "name" })]));
    const caption = make("figcaption", heading);
    this.figure = make("figure", caption, { class: "plot", tabindex: 0, "aria-label": "Plot: " + spec.heading });
    const scale = make("button", "Log", { type: "button", class: "scale", "aria-pressed": String(this.isLog), title: "Logarithmic axis of magnitudes", "aria-label": "Log axis: " + spec.heading });
    scale.addEventListener("click", () => this.setScale(!this.isLog));
    this.scaleButton = scale;
    caption.append(scale);
    this.box = make("div", undefined, { class: "canvas" });
    this.box.append(this.noteBox);
    this.legendBox = make("div", undefined, { class: "legend" });
    this.figure.append(this.box, this.legendBox);
    parent.append(this.figure);
    this.legend();
    this.isVisible = true;
  }

  create() {
    const { spec } = this;
    const font = "11px system-ui, sans-serif";
    this.plot = new uPlot({
      width: Math.max(200, this.box.clientWidth), height: 190, legend: { show: false },
      cursor: { sync: { key: "panel", setSeries: false }, drag: { x: false, y: false }, points: { show: false }, y: false },
      scales: { x: { time: false, range: () => span() }, y: { distr: this.isLog ? 3 : 1, range: () => this.range || [0, 1] } },
      axes: [
        { ...axisOf(() => ink, 30, font), ...timeLabels },
        { ...axisOf(() => ink, valueAxis, font), ...labelsOf(spec, 6) },
      ],
      series: seriesOf(this.series, () => ink, (u, { signal }) => this.course(u, this.part, signal, this.from, this.to)),
      hooks: { drawClear: [(u) => drawEvents(u, inSight, ink), (u) => this.ghost(u)], draw: [(u) => drawLevels(u, this.spec, this.isLog, ink), (u) => this.names(u), (u) => cursors.draw(u, ink)], setCursor: [() => this.read()] },
    }, [[], ...this.series.map(() => [])], this.box);
    hearPointer(this.plot, axis, span, (time) => cursors.place(time), () => cursors.back());
  }

  setScale(isLog) {
    this.isLog = this.spec.log = isLog;
    this.range = null;
    this.scaleButton.setAttribute("aria-pressed", String(isLog));
    this.plot?.destroy();
    this.plot = null;
    drawSoon();
  }

  draw(times, blank, shownSpan, from, to, part) {
    if (!this.isVisible) return;
    if (!this.plot) this.create();
    this.part = part;
    this.fit(shownSpan, from, to);
    this.nameUnit();
    this.from = from;
    this.to = to;
    this.plot.setData([times, ...this.series.map(() => blank)], false);
    this.plot.setScale("x", { min: shownSpan[0], max: shownSpan[1] });
  }

  // Writes the unit of the axis, and to what its numbers are added where they ripple on a large value.
  nameUnit() {
    const { spec } = this;
    spec.shown = shownUnit(spec.unit, this.isLog ? 1 : this.largest);
    write(this.unitBox, unitOf(spec.shown.unit));
    write(this.noteBox, formOf(spec, ...this.range).note);
  }

  // Follows what is to be seen: at once when it grows, when it has shrunk by much else.
  fit(shownSpan, from, to) {
    const { spec } = this;
    let min = Infinity;
    let max = -Infinity;
    const near = [];
    const reach = (part, signal, from, to) => {
      const numbers = part.of(signal);
      if (numbers) [min, max] = reachOf(numbers, { from, to, slot: slotOf(part), isLog: this.isLog }, [min, max]);
    };
    for (const { signal, isShown } of this.series) {
      if (!isShown) continue;
      reach(this.part, signal, from, to);
      if (!about.over && !about.band) continue;
      const [before, after] = [min, max];
      [min, max] = [Infinity, -Infinity];
      if (about.over) reach(ghost, signal, ...stretches(shownSpan, ghost));
      const [margin, least, greatest] = bandOf(signal) ?? [0];
      // A range of the whole run is followed as a level is: where it is near.
      if (!isNothing(least)) near.push(least - margin, greatest + margin);
      [min, max] = [Math.min(before, this.isLog ? min : min - margin), Math.max(after, max + margin)];
    }
    if (min > max) {
      this.range = this.range || (this.isLog ? [0.1, 1] : [0, 1]);
      return;
    }
    const levels = levelsOf(spec, shownSpan).concat(near);
    if (this.isLog) {
      this.range = logRange(min, max, levels);
      return;
    }
    const size = Math.max(Math.abs(min), Math.abs(max));
    this.largest = Math.max(this.largest, size);
    // Points are single numbers: what differs by less is one value, whose ticks are to differ in digits that are shown.
    if (max - min < 1e-6 * size) [min, max] = [min - 0.01 * size, max + 0.01 * size];
    [min, max] = withLevels(min, max, levels);
    const room = (max - min || Math.abs(max) || 1) * 0.08;
    const [low, high] = this.range || [Infinity, -Infinity];
    const holds = low <= min && high >= max && max - min > 0.55 * (high - low);
    if (!holds) this.range = [min - room, max + room];
  }

  // The stretches of a part, for a curve or an area.
  places(part, from, to) {
    const begin = (nth) => nth * part.length * period();
    const end = (nth) => Math.min((nth + 1) * part.length - 1, part.newest) * period();
    return { from, to, slot: slotOf(part), begin, end, isLog: this.isLog };
  }

  course(u, part, signal, from, to) {
    const numbers = part.of(signal);
    return numbers ? courseOf(u, numbers, this.places(part, from, to)) : new Path2D();
  }

  // The band of a baseline, behind the curves, each signal's in the colour of its curve.
  band(u) {
    const [from, to] = about.over ? stretches(span(), ghost) : [0, 0];
    const whole = { from, to, slot: () => 0, begin: () => 0, end: () => about.duration_s, isLog: this.isLog };
    shadeAreas(u, this.series.flatMap(({ signal, isShown, colour }) => {
      const [margin, least, greatest] = bandOf(signal) ?? [];
      const numbers = about.over ? ghost.of(signal) : isNothing(least) ? null : { least: [least], greatest: [greatest] };
      if (margin === undefined || !isShown || !numbers) return [];
      return [[areaOf(u, numbers, { ...(about.over ? this.places(ghost, from, to) : whole), margin }), ink.series[colour]]];
    }));
  }

  // The other run, behind the curves.
  ghost(u) {
    if (about.band) return this.band(u);
    if (!about.over) return;
    within(u, (ctx, _, ratio) => {
      ctx.globalAlpha = 0.75;
      ctx.strokeStyle = ink.ghost;
      ctx.lineWidth = 3.5 * ratio;
      const [from, to] = stretches(span(), ghost);
      for (const { signal, isShown } of this.series) if (isShown) ctx.stroke(this.course(u, ghost, signal, from, to));
      ctx.globalAlpha = 1;
    });
  }

  // Their names, over the curves, and the times at which a formula holds, along the lower edge.
  names(u) {
    within(u, (ctx, { left, top, width, height }, ratio) => {
      ctx.fillStyle = ink.found;
      const times = marked.map(([first, last]) => [first * period(), (last + 1) * period()]);
      for (const [from, wide] of marksOf(u, times, 2 * ratio)) {
        ctx.fillRect(from, top + height - 6 * ratio, wide, 6 * ratio);
        ctx.globalAlpha = 0.12;
        ctx.fillRect(from, top, wide, height);
        ctx.globalAlpha = 1;
      }
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      ctx.textBaseline = "top";
      ctx.textAlign = "left";
      const line = 13 * ratio;
      const labelled = inSight.filter((one) => one.isLabelled);
      const at = ({ from_s }) => Math.max(u.valToPos(from_s, "x", true), left) + 4 * ratio;
      for (const { event: { isFault }, label, left: x, row, wide } of placeNames(ctx, labelled, [left + 2 * ratio, left + width - 2 * ratio], 4, at)) {
        const y = top + 3 * ratio + row * line;
        ctx.globalAlpha = 0.55; // curves below stay in sight
        ctx.fillStyle = ink.paper;
        ctx.fillRect(x - ratio, y - ratio, wide + 2 * ratio, line);
        ctx.globalAlpha = 1;
        ctx.fillStyle = isFault ? ink.edge : ink.text;
        ctx.fillText(label, x, y);
      }
    });
  }

  legend() {
    for (const [index, one] of this.series.entries()) {
      // What the heading says already is not said again.
      const label = one.label === this.spec.heading ? [] : [parted(one.label), " "];
      const button = legendButton(one, 28, [...label, make("code", parted(one.signal.name), { class: "name" })], (isShown) => {
        const name = this.spec.title + " " + one.signal.name;
        if (isShown) hidden.delete(name);
        else hidden.add(name);
        retainChoices();
        if (this.plot) this.plot.setSeries(index + 1, { show: isShown });
        drawSoon();
      });
      button.title = one.signal.name;
      this.legendBox.append(button);
    }
  }

  // The values at the cursor, or else the newest ones.
  read() {
    const { part, from, to } = this;
    const isOver = this.plot?.cursor.left >= 0 && from <= to;
    // Of the stretch in which a cursor put here would stand: uPlot's own index is that of the nearest beginning.
    const step = isOver ? Math.round(this.plot.posToVal(this.plot.cursor.left, "x") / period()) : null;
    for (const { signal, shownValue } of this.series) {
      if (step === null) {
        write(shownValue, shownIn(valueAtHand(signal), this.spec));
        continue;
      }
      const slot = slotOf(part)(Math.min(Math.max(Math.floor(step / part.length), from), to));
      const numbers = part.of(signal);
      write(shownValue, reachShown(numbers?.least[slot], numbers?.greatest[slot], this.spec) || "-");
    }
  }
}

// Faults, and events with a label, with their times.
let shades = [];
let notes = [];
let inSight = [];
// Intervals in which the formula of a search holds, in sight.
let marked = [];
const shade = () => {
  shades = [];
  for (const fault of state.faults) {
    const begun = fault.effects.filter((one) => one.step !== null && one.step !== undefined);
    if (!begun.length) continue;
    const ends = begun.map((one) => one.ended_step);
    shades.push({
      label: `fault ${fault.id} ${fault.kind}`, isFault: true,
      from_s: Math.min(...begun.map((one) => one.step)) * period(),
      until_s: ends.every((one) => one !== null && one !== undefined) ? Math.max(...ends) * period() : null,
    });
  }
};
// Of changes of one value that are close to each other, as of a slider that moved, the last has a label.
const lookAround = ([from, to]) => {
  const inIt = (one) => one.from_s <= to && (one.until_s === null || one.until_s >= from);
  inSight = shades.filter(inIt).concat(notes.filter(inIt));
  const next = new Map();
  for (const one of inSight.toReversed()) {
    one.isLabelled = !one.key || !(next.get(one.key) - one.from_s < 0.12 * (to - from));
    if (one.key) next.set(one.key, one.from_s);
  }
};

let isDrawing = false;
let readAt = 0;
const drawSoon = () => {
  if (isDrawing || !about) return;
  isDrawing = true;
  requestAnimationFrame(draw);
};
let frames = 0;
const draw = () => {
  isDrawing = false;
  const start = performance.now();
  const shownSpan = span();
  const part = inView();
  const [from, to] = stretches(shownSpan, part);
  const count = Math.max(0, to - from + 1);
  const length = part.length * period();
  if (!closer && about.over) readPart();
  // A part that reaches beyond what has been seen fills while the run goes on.
  if (closer && !about.recorded && lens.newest < view.newest && shownSpan[1] / period() > lens.newest && start > readAgain) {
    readAgain = start + 300;
    lens.again();
  }
  const times = new Float64Array(count);
  for (let i = 0; i < count; i++) times[i] = (from + i) * length;
  const blank = new Float64Array(count);
  lookAround(shownSpan);
  marked = occurrencesIn(shownSpan);
  for (const plot of plots) plot.draw(times, blank, shownSpan, from, to, part);
  if (start - readAt > 100) {
    readAt = start;
    for (const plot of plots) if (plot.isVisible) plot.read();
    for (const { signal, box } of readings) write(box, shown(valueAtHand(signal), signal.unit));
    readLater();
  }
  // Behind what the plots put off to the end of this turn.
  queueMicrotask(() => {
    if (++frames % 300 === 0) performance.clearMeasures("frame");
    performance.measure("frame", { start, duration: performance.now() - start + spent });
    spent = 0;
    root.dataset.frames = String(frames);
  });
};
// The last value of a run that stands still.
let later = 0;
const readLater = () => {
  clearTimeout(later);
  later = setTimeout(() => {
    for (const plot of plots) if (plot.isVisible) plot.read();
    for (const { signal, box } of readings) write(box, shown(valueAtHand(signal), signal.unit));
  }, 150);
};

// ---- The session ----

let readings = [];
const windows = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 300, 1800];
const describe = (told) => {
  about = told;
  document.title = `${told.scenario}: hil panel`;
  write(byId("scenario"), told.scenario);
  byId("scenario").title = told.description;
  const pace = told.pace === null ? "" : ` at ${number(told.pace)}`;
  write(byId("session"), told.recorded ? `${told.session}, ${told.plant}, ${told.clock}` : `session ${told.session}, ${told.plant}, ${told.clock}${pace}`);
  root.dataset.kind = told.recorded ? "recorded" : "session";
  for (const element of document.querySelectorAll(".of-session")) element.hidden = Boolean(told.recorded);
  byId("over").hidden = !told.over || Boolean(told.band);
  write(byId("over"), told.over ? `behind the curves: ${told.over}` : "");
  byId("band").hidden = !told.band;
  write(byId("band"), told.band?.label ?? "");
  signals = told.signals.map((one, place) => ({ ...one, place, value: null, least: new Float32Array(KEPT).fill(NaN), greatest: new Float32Array(KEPT).fill(NaN) }));
  const choices = [...new Set([...windows.filter((one) => one < told.duration_s && one > 3 * period()), Math.min(told.window_s, told.duration_s), told.duration_s])].sort((a, b) => a - b);
  byId("window").replaceChildren(...choices.map((one) => make("option", one === told.duration_s ? "whole run" : `${seconds(one)} s`, { value: String(one) })));
  const chosen = recall("session " + told.session);
  hidden ??= new Set(Array.isArray(chosen?.hidden) ? chosen.hidden : []);
  // Another connection keeps what the page has.
  const isFirst = view.number === 0;
  if (isFirst) view.window_s = choices.includes(chosen?.window_s) ? chosen.window_s : told.window_s;
  view.window_s = Math.min(view.window_s, told.duration_s);
  byId("window").value = String(view.window_s);
  for (const { figure } of plots.splice(0)) {
    seen.unobserve(figure);
    sized.unobserve(figure);
  }
  byId("plots").replaceChildren();
  for (const spec of arrangedOf(told)) addPlot(spec);
  const [{ signals: [example] = [] } = {}] = told.plots;
  byId("where").placeholder = example === undefined ? "" : `abs(${signals[example].name}) > 0.1`;
  const first = told.readings ?? [...new Set(told.plots.flatMap((plot) => plot.signals))].slice(0, 8);
  readings = first.map((place) => ({ signal: signals[place], box: make("dd", "") }));
  byId("readings").replaceChildren(...readings.map(({ signal, box }) => {
    const row = make("div", make("dt", parted(signal.name)));
    row.append(box);
    return row;
  }));
  disarm();
  byId("buttons").replaceChildren(...told.buttons.map((one, nth) => {
    const button = make("button", make("kbd", String(nth + 1)), { type: "button", title: one.words });
    button.append(" " + one.label);
    button.addEventListener("click", () => act({ kind: "inject", words: one.words }));
    return button;
  }));
  wasUsable = null;
  look();
  if (told.recorded && !closer) {
    closer = [0, Math.min(told.window_s, told.duration_s)];
    // What is shown first is shown as quickly as the rest.
    for (const plot of plots) plot.isVisible = plot.figure.getBoundingClientRect().top < innerHeight + 100;
  }
  lens.again();
  ghost.again();
  if (sought && !told.recorded) search(sought);
  if (closer) readPart();
  showRange();
  cursorsChanged();
  for (const text of told.notes ?? []) say(text, "bad");
  showArrangement();
  showBranch();
};
const addPlot = (spec, at = plots.length) => {
  const plot = new Plot(spec, byId("plots"));
  byId("plots").insertBefore(plot.figure, plots[at]?.figure ?? null);
  plots.splice(at, 0, plot);
  plot.figure.panelPlot = plot;
  seen.observe(plot.figure);
  sized.observe(plot.figure);
  return plot;
};
const seen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) target.panelPlot.isVisible = isIntersecting;
  if (!entries.some((one) => one.isIntersecting)) return;
  if (closer) readPart();
  drawSoon();
}, { rootMargin: "100px" });
const sized = new ResizeObserver((entries) => {
  for (const { target } of entries) {
    const { plot, box } = target.panelPlot;
    if (plot && Math.abs(plot.width - box.clientWidth) > 1) plot.setSize({ width: Math.max(200, box.clientWidth), height: 190 });
    if (plot && closer) readPart();
  }
});

// Asks for the points of the window, from the beginning.
const look = () => {
  view.number = (view.number + 1) >>> 0;
  if (about.recorded) return;
  forget();
  ask({ ask: "view", number: view.number, window_s: view.window_s });
  drawSoon();
};
const setWindow = (window_s) => {
  closer = null;
  showRange();
  view.window_s = window_s;
  byId("window").value = String(window_s);
  retainChoices();
  look();
};

const tones = { pass: "good", running: "good", fail: "bad", aborted: "bad", undecided: "", paused: "" };
const badge = (element, text, tone) => {
  write(element, text);
  element.dataset.tone = tone ?? "";
};
const outcomeOf = (one) => (one.vacuous ? "vacuous" : one.verdict);
const verdictOf = (ending) => ending.verdict_in_words ?? ending.outcome ?? "ended";
let shownRequirements = "";
const show = (told) => {
  const before = state;
  state = told;
  root.dataset.state = told.state;
  const { ending } = told;
  if (ending) badge(byId("state"), `${about?.recorded ? "recorded" : "ended"}: ${verdictOf(ending)}`, tones[verdictOf(ending)] ?? "");
  else badge(byId("state"), told.hil_is_stopped ? "hil is stopped" : told.state, told.hil_is_stopped ? "bad" : tones[told.state]);
  const time = told.time_s === null ? "" : `${seconds(told.time_s)} of ${seconds(told.steps / told.rate_hz)} s, step ${told.step}`;
  write(byId("time"), time);
  byId("progress").value = told.step === null ? 0 : told.step / told.steps;
  const trip = told.round_trip_ns ? `, ${nanoseconds(told.round_trip_ns.p50)} round trip` : "";
  const lost = told.lost > 0 ? `, ${told.lost} records not seen` : "";
  write(byId("speed"), ending ? "" : (told.realtime_factor ? `${number(told.realtime_factor, 3)}x real time${trip}` : "") + lost);
  write(byId("pause"), told.state === "paused" ? "Resume" : "Pause");
  write(byId("readings-title"), about?.recorded ? "Readings at cursor A" : ending ? "Final readings" : "Readings");
  enable();
  if (about) {
    shade();
    showBranch();
  }
  requirements(told.requirements);
  faults(told.faults);
  if (told.told && told.told !== before?.told) say(told.told, tones[verdictOf(ending)]);
  if (told.told) trouble(told.told, false);
  drawSoon();
};
const requirements = (list) => {
  const text = JSON.stringify(list);
  if (text === shownRequirements) return;
  shownRequirements = text;
  byId("requirements-box").hidden = !list?.length;
  const rows = (list ?? []).map((one) => {
    const outcome = outcomeOf(one);
    const verdict = make("span", outcome === "undecided" ? "open" : outcome, { class: "badge", "data-tone": tones[outcome] ?? "" });
    const name = make("td", parted(one.name));
    if (one.vacuous) name.append(make("div", `${one.vacuous} never called for its conclusion`, { class: "hint" }));
    const margin = one.robustness !== null ? shown(one.robustness, one.unit)
      : one.at_most !== null ? "≤ " + shown(one.at_most, one.unit)
        : one.at_least !== null ? "≥ " + shown(one.at_least, one.unit) : "-";
    const row = make("tr");
    row.append(make("td", verdict), name, make("td", margin, { class: "n" }));
    return row;
  });
  byId("requirements").replaceChildren(...rows);
};
const faultRows = new Map();
const faults = (list) => {
  for (const fault of list) {
    let row = faultRows.get(fault.id);
    if (!row) {
      const says = make("div");
      says.append(make("strong", `${fault.id} ${fault.kind}`), " ", make("span", "", { class: "badge" }), make("div", "", { class: "hint" }));
      const end = make("button", "End", { type: "button", "aria-label": `End fault ${fault.id}` });
      end.addEventListener("click", () => act({ kind: "clear", fault: fault.id }));
      row = make("li");
      row.append(says, end);
      faultRows.set(fault.id, row);
      wasUsable = null;
    }
    row.dataset.state = fault.state;
    badge(row.querySelector(".badge"), fault.state, fault.state === "active" ? "bad" : "");
    const effects = fault.effects.map((one) => {
      const since = one.step === null || one.step === undefined ? "" : ` since ${seconds(one.step / state.rate_hz)} s, at most ${shown(one.max_effect, one.unit)}`;
      return one.target + since;
    });
    write(row.querySelector(".hint"), effects.join("; ") + (fault.waits_for ? `; waits for ${fault.waits_for}` : ""));
    row.querySelector("button").hidden = fault.state === "ended" || Boolean(state.ending);
  }
  // The newest of those that act or wait first; those that ended last.
  const order = list.slice().sort((a, b) => (a.state === "ended") - (b.state === "ended") || b.id - a.id);
  const rows = order.map((fault) => faultRows.get(fault.id));
  const box = byId("faults");
  if (rows.some((row, place) => box.children[place] !== row) || box.children.length !== rows.length) box.replaceChildren(...rows);
  byId("no-faults").hidden = list.length > 0;
  byId("clear-all").hidden = Boolean(state.ending) || list.filter((one) => one.state !== "ended").length < 2;
};

// ---- The log ----

// Every event of the run in its order, and between them the answers that this page got. Most rows that are shown.
const ROWS = 1000;
let events = 0;
let left = 0;
let edition = null;
const row = (text, data) => {
  const one = make("li", text);
  Object.assign(one.dataset, data);
  byId("log").prepend(one);
  byId("no-log").hidden = true;
  return one;
};
const trim = () => {
  const box = byId("log");
  for (; box.children.length > ROWS; box.lastChild.remove()) left += Number(box.lastChild.dataset.count ?? 0);
  byId("more-log").hidden = !left;
  write(byId("more-log"), `${left} earlier events are in the recording and in its report.`);
};
// The answer to a change comes before its event, which takes its place.
const say = (text, tone, about = "") => {
  const before = byId("log").firstChild;
  if (about && before && !before.dataset.event && before.dataset.about === about) before.remove();
  row(text, { tone: tone ?? "", about });
  trim();
};
const happen = ({ step, text, label, key }) => {
  const box = byId("log");
  while (key && box.firstChild && !box.firstChild.dataset.event && box.firstChild.dataset.about === key) box.firstChild.remove();
  // Changes of one value that follow each other, as of a slider that moves, are one row, which counts them.
  const before = key && box.firstChild?.dataset.event && box.firstChild.dataset.about === key ? box.firstChild : null;
  const count = before ? Number(before.dataset.count) + 1 : 1;
  const since = before ? before.dataset.since : step;
  before?.remove();
  row(count > 1 ? `${text} (${count} changes since step ${since})` : text, { event: "event", about: key ?? "", count, since });
  if (label === undefined) return;
  const short = label.replace(/^(plant\.parameters|controller\.[^.\s]+)\./, "").slice(0, 60);
  notes.push({ label: short, key, isFault: false, from_s: step * period(), until_s: step * period() });
};
const hear = (told) => {
  if (told.edition !== edition) {
    for (const one of byId("log").querySelectorAll("li[data-event]")) one.remove();
    [edition, events, left, notes] = [told.edition, 0, 0, []];
  }
  const more = told.events.slice(Math.max(0, events - told.from));
  more.forEach(happen);
  events += more.length;
  trim();
  drawSoon();
};

// ---- Deeds ----

let actions = 0;
const act = (action) => {
  if (about?.recorded) return 0;
  ask({ ask: "do", number: ++actions, action });
  return actions;
};
const answered = ({ number, is_done, text }) => {
  const knob = asked.get(number);
  asked.delete(number);
  say(text, is_done ? "" : "bad", knob?.told.key);
  knob?.answered(is_done);
  write(byId("status"), text);
  root.dataset.answers = String(Number(root.dataset.answers ?? 0) + 1);
};
const pause = () => act({ kind: state?.state === "paused" ? "resume" : "pause" });
const step = (steps) => act({ kind: "step", steps });
byId("pause").addEventListener("click", pause);
byId("step").addEventListener("click", () => step(1));
byId("steps").addEventListener("click", () => step(100));
byId("mark-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const text = byId("mark").value.trim();
  if (!text) return byId("mark").focus();
  act({ kind: "mark", text });
  byId("mark").value = "";
});
byId("clear-all").addEventListener("click", () => act({ kind: "clear", fault: null }));
byId("window").addEventListener("change", () => setWindow(Number(byId("window").value)));
byId("theme").addEventListener("click", () => {
  setTheme(root.dataset.theme !== "dark");
  retain("theme", root.dataset.theme);
});

// ---- Values that can be changed ----

// Positions of a slider, and the least time between two changes while it moves.
const POSITIONS = 200;
const BETWEEN_MS = 150;
const real = (value) => (typeof value === "number" ? value : Number(String(value).trim().replace("inf", "Infinity")));
const wire = (value) => (Number.isFinite(value) ? value : String(value).replace("Infinity", "inf"));
const largestSeen = (isMeant) => {
  let most = 0;
  for (const one of signals) {
    if (!isMeant(one.name)) continue;
    for (let i = view.first; i <= view.last; i++) most = Math.max(most, Math.abs(one.least[i % KEPT]) || 0, Math.abs(one.greatest[i % KEPT]) || 0);
  }
  return most;
};
const knobs = new Map();
const asked = new Map();

// A value with a slider and a field. While one change is on its way only the newest wish waits behind it.
class Knob {
  constructor(told, nth) {
    this.told = told;
    this.wish = null;
    this.isAsking = false;
    this.isHeld = false;
    this.sentAt = 0;
    this.isReference = /^(reference|input)\./.test(told.key);
    const id = "knob-" + nth;
    this.row = make("div", undefined, { class: "knob", title: told.description });
    const label = make("label", undefined, { for: id });
    this.back = make("button", this.isReference ? "Stimulus" : "Reset", { type: "button", class: "back", "aria-label": (this.isReference ? "Stimulus again: " : "Reset ") + told.key });
    label.append(this.back, parted(told.key.replace(/^plant\.parameters\./, "plant.").replace(/^controller\./, "")), unitOf(told.unit));
    this.slider = make("input", undefined, { type: "range", min: 0, max: POSITIONS, step: 1, "aria-label": told.key });
    this.field = make("input", undefined, { id, inputmode: "decimal", autocomplete: "off" });
    this.row.append(label, this.slider, this.field);
    this.span = this.reach();
    this.slider.addEventListener("pointerdown", () => (this.isHeld = true));
    this.slider.addEventListener("input", () => this.ask(this.at(Number(this.slider.value))));
    this.slider.addEventListener("change", () => (this.isHeld = false));
    this.field.addEventListener("change", () => {
      const text = this.field.value.trim();
      const value = real(text);
      // Digits that give no finite number are too many for one.
      const isNumber = !Number.isNaN(value) && (Number.isFinite(value) || !/\d/.test(text));
      if (text !== "" && isNumber) return this.ask(value);
      if (text !== "") write(byId("status"), `\`${text}\` is no number`);
      this.show(true);
    });
    this.back.addEventListener("click", () => {
      this.wish = null;
      this.send(this.isReference ? { clear: [told.key] } : { set: [{ key: told.key, value: told.original }] });
    });
    this.show();
  }

  // The ends of the slider: twice the largest value there is to be seen, within the range.
  reach() {
    const [min, max] = [real(this.told.min), real(this.told.max)];
    const values = [this.told.original, this.told.value, this.told.target].map(real).filter(Number.isFinite);
    let size = Math.max(...values.map(Math.abs), largestSeen((name) => name === this.told.key), 0);
    if (!size) size = max - min <= 1e3 ? Math.max(Math.abs(min), Math.abs(max)) / 2 : 0.5;
    const isSigned = this.isReference || values.some((one) => one < 0) || (min < 0 && values.every((one) => one === 0));
    return [Math.max(min, isSigned ? -2 * size : 0), Math.min(max, 2 * size)];
  }

  at(position) {
    const [low, high] = this.span;
    if (position <= 0) return low;
    if (position >= POSITIONS) return high;
    const grain = 10 ** Math.floor(Math.log10((high - low) / POSITIONS));
    return rounded(Math.round((low + ((high - low) * position) / POSITIONS) / grain) * grain, 12);
  }

  now() {
    return this.wish ?? real(this.told.target);
  }

  // Leaves a field in which somebody types as it is, unless its text was refused.
  show(isRefused = false) {
    const value = this.now();
    if (Number.isFinite(value) && (value < this.span[0] || value > this.span[1])) this.span = this.reach();
    const [low, high] = this.span;
    const share = (Math.min(Math.max(value, low), high) - low) / (high - low || 1);
    this.slider.value = String(Math.round((share || 0) * POSITIONS));
    this.slider.setAttribute("aria-valuetext", shown(value, this.told.unit));
    this.field.placeholder = "not set";
    if (isRefused || document.activeElement !== this.field) this.field.value = Number.isNaN(value) ? "" : typed(value);
    this.row.dataset.changed = String(this.told.is_changed);
    this.back.hidden = !this.told.is_changed || Number.isNaN(real(this.told.original));
  }

  hear(told) {
    this.told = told;
    if (!this.isHeld && !this.isAsking && this.wish === null) this.show();
  }

  ask(value) {
    this.wish = value;
    this.slider.setAttribute("aria-valuetext", shown(value, this.told.unit));
    if (document.activeElement !== this.field) this.field.value = String(value);
    this.push();
  }

  push() {
    if (this.isAsking || this.wish === null) return;
    const wait = this.sentAt + BETWEEN_MS - performance.now();
    clearTimeout(this.timer);
    if (wait > 0) {
      this.timer = setTimeout(() => this.push(), wait);
      return;
    }
    const value = this.wish;
    this.wish = null;
    this.before = this.told;
    this.told = this.asked = { ...this.told, target: value, is_changed: true };
    const ramp_s = Number(byId("tune-ramp").value);
    const set = [{ key: this.told.key, value: wire(value) }];
    this.send(byId("tune-ramp").value.trim() && ramp_s > 0 ? { set, ramp_s } : { set });
  }

  send(change) {
    this.isAsking = isOpen();
    this.sentAt = performance.now();
    asked.set(act({ kind: "set", change }), this);
  }

  answered(isDone) {
    this.isAsking = false;
    if (!isDone) {
      this.wish = null;
      const isStill = real(this.field.value) === real(this.asked?.target ?? NaN);
      if (this.told === this.asked) this.told = this.before;
      this.show(isStill);
    }
    this.asked = null;
    this.push();
  }
}

const listTunable = (told) => {
  byId("tune-box").hidden = told.values.length === 0;
  write(byId("law-does"), told.law_does);
  const keys = told.values.map((one) => one.key);
  if (keys.length !== knobs.size || keys.some((key) => !knobs.has(key))) {
    knobs.clear();
    told.values.forEach((one, nth) => knobs.set(one.key, new Knob(one, nth)));
    byId("knobs").replaceChildren(...[...knobs.values()].map((knob) => knob.row));
    wasUsable = null;
  }
  for (const one of told.values) knobs.get(one.key).hear(one);
};

// ---- A fault of its own ----

const classes = { plant: "Plant", signal: "Signals", communication: "Link", timing: "Timing" };
let kinds = [];
const listFaults = (told) => {
  kinds = told.faults;
  byId("inject-box").hidden = false;
  const groups = Object.entries(classes).map(([name, title]) => {
    const group = make("optgroup", undefined, { label: title });
    group.append(...kinds.filter((one) => one.class === name).map((one) => make("option", one.kind, { value: one.kind })));
    return group;
  });
  byId("kind").replaceChildren(...groups.filter((group) => group.children.length));
  const usual = kinds.find((one) => one.kind === "bias") ?? kinds[0];
  if (usual) byId("kind").value = usual.kind;
  chooseKind();
};
const kindNow = () => kinds.find((one) => one.kind === byId("kind").value);
// A number to begin with: the field's own, a tenth of what the target has been, a hundredth of what it may be.
const usual = (field, target) => {
  if (field.default !== null && field.default !== undefined) return field.default;
  if (field.unit === "target") {
    const name = target.replace(/^[^.]*\./, "");
    const most = largestSeen((one) => one.replace(/^[^.]*\./, "") === name);
    return most > 0 ? rounded(most / 10, 1) : 0.1;
  }
  const bound = (value) => (Number.isFinite(value) ? value : null);
  const [min, max] = [bound(field.min), bound(field.max)];
  if (field.name.includes("factor")) return 0.5;
  if (field.unit === "Hz") return 1;
  if (field.unit === "s") return 0.1;
  if (min !== null && min > 0) return min;
  if (max === null) return 1;
  return max === 1 ? 0.1 : rounded(max / 100, 1);
};
const chooseKind = () => {
  const kind = kindNow();
  if (!kind) return;
  write(byId("kind-says"), kind.summary);
  byId("target-field").hidden = kind.targets.length < 2;
  byId("target").replaceChildren(...kind.targets.map((one) => make("option", one, { value: one })));
  const field = (name, text, value, says, isNeeded) => {
    const box = make("div", undefined, { class: "field" });
    const input = make("input", undefined, { id: "p-" + name, name, value, autocomplete: "off", title: says, ...(isNeeded ? { required: "" } : {}) });
    box.append(make("label", text, { for: "p-" + name }), input);
    input.addEventListener("input", spell);
    return box;
  };
  const target = kind.targets[0] ?? "";
  const fields = kind.parameters.map((one) => {
    const unit = one.unit === "target" || one.unit === "1" || !one.unit ? "" : ` [${one.unit}]`;
    return field(one.name, one.name.replaceAll("_", " ") + unit, number(usual(one, target)), one.description, false);
  });
  if (kind.list) fields.push(field(kind.list.key, kind.list.key.replaceAll("_", " "), "", kind.list.description, false));
  byId("parameters").replaceChildren(...fields);
  spell();
};
const quoted = (text) => (/^[\w.,:+\/-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
const words = () => {
  const kind = kindNow();
  if (!kind) return "";
  const target = kind.targets.length > 1 ? [byId("target").value] : [];
  const given = [...byId("parameters").querySelectorAll("input")].filter((one) => one.value.trim() !== "").map((one) => [one.name, one.value.trim()]);
  for (const name of ["duration", "ramp", "when"]) if (byId(name).value.trim()) given.push([name, byId(name).value.trim()]);
  return [kind.kind, ...target, ...given.map(([name, value]) => `--${name}=${quoted(value)}`)].join(" ");
};
const spell = () => write(byId("words"), words());
byId("kind").addEventListener("change", chooseKind);
byId("target").addEventListener("change", () => {
  const kind = kindNow();
  for (const one of kind.parameters) if (one.unit === "target") byId("p-" + one.name).value = number(usual(one, byId("target").value));
  spell();
});
for (const name of ["duration", "ramp", "when"]) byId(name).addEventListener("input", spell);
byId("inject").addEventListener("submit", (event) => {
  event.preventDefault();
  act({ kind: "inject", words: words() });
});

// ---- Places ----

// Groups that a reader has folded stay so in this tab.
const unfold = (name) => (byId("fold-" + name).open = true);
for (const group of document.querySelectorAll(".fold")) {
  group.open = recall(group.id) !== false;
  group.addEventListener("toggle", () => group.open !== (recall(group.id) !== false) && retain(group.id, group.open));
}

// The address keeps its secret.
for (const link of document.querySelectorAll('a[href^="#"]')) {
  link.addEventListener("click", (event) => {
    event.preventDefault();
    const place = byId(link.hash.slice(1));
    place.tabIndex = -1;
    place.scrollIntoView();
    place.focus({ preventScroll: true });
  });
}

// ---- Keys ----

// A digit asks before it injects, as in `hil monitor`: it may have been meant for a field that lacks the focus. So may
// the same digit again and Enter, with which numbers end; neither confirms.
const ARMED_MS = 5000;
let armed = null;
let disarming = 0;
const arm = (button) => {
  armed = button;
  byId("armed").hidden = false;
  byId("armed-words").replaceChildren(button.title);
  const [verb, does] = button.words ?? ["Inject", "injects it"];
  write(byId("armed-verb"), verb);
  write(byId("armed-does"), does);
  clearTimeout(disarming);
  disarming = setTimeout(leave, ARMED_MS);
};
const disarm = () => {
  clearTimeout(disarming);
  byId("armed").hidden = true;
  armed = null;
};
const leave = () => {
  if (!armed) return;
  const text = armed.words?.[2] ?? "not injected";
  disarm();
  write(byId("status"), text);
};
addEventListener("pointerdown", leave);
addEventListener("blur", leave);
addEventListener("keydown", (event) => {
  if (armed && !/^(Shift|Control|Alt|Meta|CapsLock|AltGraph)$/.test(event.key)) {
    const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey;
    if (isPlain && event.key !== "Tab") event.preventDefault();
    if (event.repeat) return;
    const button = armed;
    if (!isPlain || button.disabled || !/^y$/i.test(event.key)) return leave();
    disarm();
    return button.click();
  }
  if ((event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "k") {
    event.preventDefault();
    return palette.open();
  }
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !about) return;
  const { target } = event;
  if (target.closest("input, select, textarea")) {
    if (event.key === "Escape") target.blur();
    return;
  }
  const widths = [...byId("window").options].map((one) => Number(one.value));
  const wider = (by) => {
    const next = widths[widths.indexOf(view.window_s) + by];
    if (next) setWindow(next);
  };
  const ofSession = {
    " ": () => !target.closest("button, summary, a") && (pause(), true),
    s: () => step(1), S: () => step(100), m: () => (byId("mark").focus(), true), t: () => (unfold("tune"), byId("knobs").querySelector("input")?.focus(), true), f: () => (unfold("inject"), byId("kind").focus(), true),
  };
  const keys = {
    ...(about.recorded ? {} : ofSession),
    ...keysOfLooking(event),
    ...(closer ? {} : { "+": () => wider(-1), "=": () => wider(-1), "-": () => wider(1) }),
  };
  const button = /^[1-9]$/.test(event.key) ? byId("buttons").children[Number(event.key) - 1] : null;
  const does = button ? () => !button.disabled && !event.repeat && (arm(button), true) : keys[event.key];
  if (does && does() !== false) event.preventDefault();
});

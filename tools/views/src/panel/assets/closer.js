// Looking closer at a run: the range in sight, two cursors and what they measure, the times at which a formula holds,
// the list of everything, and the checkpoint from which a run can go on.

// ---- The range ----

// The time in a field: `null` of an empty one, NaN of a text that is no number, of which the page tells.
const typedTime = (id) => {
  const text = byId(id).value.trim();
  const time = text === "" ? null : Number(text);
  if (time === null || Number.isFinite(time)) return time;
  write(byId("status"), `\`${text}\` is no number of seconds`);
  return NaN;
};
const showRange = () => {
  const [from, to] = span();
  byId("range").hidden = !closer;
  byId("follow").hidden = !closer || Boolean(about.recorded);
  byId("whole").hidden = !about.recorded;
  byId("look").hidden = Boolean(closer) || Boolean(about.recorded);
  byId("window").closest("label").hidden = Boolean(about.recorded);
  for (const [id, time] of [["from", from], ["to", to]]) if (document.activeElement !== byId(id)) byId(id).value = seconds(time);
  root.dataset.range = closer ? `${from} ${to}` : "";
};
for (const [place, id] of ["from", "to"].entries()) {
  byId(id).addEventListener("change", () => {
    // The other end is the one in sight, with all its digits.
    const part = [...span()];
    const before = seconds(part[place]);
    const time = typedTime(id);
    const [begin, end] = axis.whole();
    part[place] = Math.min(Math.max(time, begin), end);
    if (time === null || !(part[1] - part[0] >= axis.least() * (1 - 1e-9))) {
      if (time !== null && !Number.isNaN(time)) write(byId("status"), part[1] > part[0] ? "a range has at least 4 steps" : "a range ends after it begins");
      byId(id).value = before;
      return;
    }
    axis.between(...part);
    byId(id).blur();
  });
  byId(id).addEventListener("blur", () => about && showRange());
}
byId("whole").addEventListener("click", () => axis.all());
byId("follow").addEventListener("click", () => follow());
byId("look").addEventListener("click", () => lookAt(span()));

// ---- Cursors ----

const cursors = cursorsOf({ period: () => period(), changed: () => cursorsChanged() });
// What was measured last, of the run and of the one behind it.
let figures = new Map();
let others = new Map();
let basis = 1;
let measuring = 0;
// The newest value of a signal or, in a recorded run, the one at cursor A.
const valueAtHand = (signal) => {
  if (!about.recorded) return signal.value;
  const [a, b] = cursors.steps;
  return (a === null ? null : figures.get(signal.place)?.at[b !== null && b < a ? 1 : 0]) ?? null;
};
// Signals of the plots in sight first, then those of the others.
const measuredSignals = () => {
  const order = [...plots].sort((a, b) => b.isVisible - a.isVisible);
  return [...new Set(order.flatMap((one) => one.spec.signals))].slice(0, 64);
};
const measure = () => {
  const ends = cursors.ends();
  if (!ends) return;
  const message = { ask: "measure", number: ++measuring, from: ends[0], to: ends[1], signals: measuredSignals() };
  ask(message);
  if (about.over) ask({ ...message, over: true });
};
const cursorsChanged = () => {
  const ends = cursors.ends();
  byId("measure").hidden = !ends;
  document.body.classList.toggle("measures", Boolean(ends));
  if (!ends) {
    [figures, others] = [new Map(), new Map()];
    delete root.dataset.measured;
  }
  for (const [place, id] of ["cursor-a", "cursor-b"].entries()) {
    const step = cursors.steps[place];
    if (document.activeElement !== byId(id)) byId(id).value = step === null ? "" : seconds(step * period());
  }
  const [a, b] = cursors.steps;
  const gap = a === null || b === null ? null : (b - a) * period();
  write(byId("gap"), gap === null ? "" : `B - A: ${seconds(gap)} s${gap ? `, 1/(B - A): ${number(1 / gap)} Hz` : ""}`);
  measure();
  showBranch();
  for (const plot of plots) plot.plot?.redraw(false, false);
  drawSoon();
};
for (const [place, id] of ["cursor-a", "cursor-b"].entries()) {
  byId(id).addEventListener("change", () => {
    const time = typedTime(id);
    if (time === null) return cursors.put(place, null);
    if (time >= 0) return cursors.put(place, Math.round(time / period()));
    const step = cursors.steps[place];
    byId(id).value = step === null ? "" : seconds(step * period());
  });
}
byId("clear-cursors").addEventListener("click", () => cursors.clear());

const takeFigures = (answer) => {
  if (answer.number !== measuring || !cursors.ends()) return;
  const list = new Map(answer.signals.map((one) => [one.signal, one]));
  if (answer.over) others = list;
  else [figures, basis] = [list, answer.length];
  showFigures();
  drawSoon();
  readLater();
  root.dataset.measured = `${answer.from} ${answer.to}`;
};
const isBetween = () => cursors.steps.every((one) => one !== null);
// The columns of the table behind signal and unit: heading, and value of a signal's figures.
const columnsOfFigures = () => {
  const [a, b] = cursors.steps;
  const first = a === null || (b !== null && b < a) ? 1 : 0;
  const at = (one, which) => one?.at[which === "a" ? first : 1 - first] ?? null;
  const single = a === null ? "B" : "A";
  const less = (x, y) => (isNothing(x) || isNothing(y) ? null : x - y);
  const both = [
    ["at A", (one) => at(one, "a")], ["at B", (one) => at(one, "b")], ["B - A", (one) => less(at(one, "b"), at(one, "a"))],
    ["mean", (one) => one.mean], ["RMS", (one) => one.rms], ["peak to peak", (one) => less(one.greatest, one.least)],
  ];
  const columns = isBetween() ? both : [[`at ${single}`, (one) => one.at[0]]];
  if (!about.over) return columns;
  const other = (one) => others.get(one.signal);
  const differences = isBetween()
    ? [["A less other", (one) => less(at(one, "a"), at(other(one), "a"))], ["B less other", (one) => less(at(one, "b"), at(other(one), "b"))]]
    : [[`other at ${single}`, (one) => other(one)?.at[0] ?? null], ["difference", (one) => less(one.at[0], other(one)?.at[0])]];
  return columns.concat(differences);
};
// The reason why no requirement can be copied of a signal, or "".
const whyNoRequirement = (name, one) => {
  if (name.startsWith("parameter.")) return "a requirement is on signals, not on parameters";
  if (!/^[A-Za-z_]/.test(name) || /_(ns|steps)$/.test(name)) return "a requirement cannot name this signal";
  if (isNothing(one.least)) return "it has no value between the cursors";
  return !about.recorded && basis > 1 ? "it needs every step, which the panel has not kept: hil panel RUN" : "";
};
const showFigures = () => {
  const columns = columnsOfFigures();
  const head = make("tr");
  head.append(make("th", "signal", { scope: "col" }), make("th", "unit", { scope: "col" }), ...columns.map(([title]) => make("th", title, { scope: "col", class: "n" })), make("th", make("span", "copy", { class: "visually-hidden" }), { scope: "col" }));
  byId("figures-head").replaceChildren(head);
  const ends = cursors.ends();
  const steps = ends[1] - ends[0] + 1;
  byId("figures").replaceChildren(...[...figures.values()].map((one) => {
    const { name, unit } = signals[one.signal];
    const row = make("tr");
    // A time in ns is written with a unit that suits it.
    const own = unit === "ns" ? unit : "";
    row.append(make("th", name, { scope: "row" }), make("td", own || unit === "1" ? "" : unit, { class: "unit" }), ...columns.map(([, value]) => make("td", shown(value(one), own), { class: "n" })));
    const copy = make("button", "requirement", { type: "button", "aria-label": `Copy a requirement on ${name}` });
    copy.title = whyNoRequirement(name, one);
    copy.disabled = copy.title !== "";
    copy.addEventListener("click", () => copyAndTell(asRequirement(name, ends.map((step) => step * period()), one, steps), `a requirement on ${name}`));
    const last = make("td");
    last.append(copy);
    row.append(last);
    return row;
  }));
  const from = basis === 1 ? `from every step (${steps})` : `from the least and the greatest values of ${basis} steps each, which is what the panel has kept; mean and RMS need every step: hil panel RUN`;
  write(byId("basis"), from);
};
const copyAndTell = async (text, title) => {
  const isDone = await copyText(text, byId("copied"));
  write(byId("status"), isDone ? `copied ${title}` : `the browser keeps its clipboard; ${title} is selected`);
};
byId("copy-figures").addEventListener("click", () => {
  const columns = columnsOfFigures();
  const [a, b] = cursors.steps;
  const at = (name, step) => (step === null ? [] : [`${name} ${seconds(step * period())} s (step ${step})`]);
  const title = [about.scenario, ...at("A", a), ...at("B", b)].join(", ");
  const rows = [...figures.values()].map((one) => [signals[one.signal].name, signals[one.signal].unit || "1", ...columns.map(([, value]) => value(one))]);
  copyAndTell(figuresAsText({ title, head: ["signal", "unit", ...columns.map(([name]) => name)], rows }), "the table");
});

// ---- Times at which a formula holds ----

let occurrences = { intervals: [] };
let searching = 0;
const search = (formula) => {
  byId("where").value = formula;
  if (!formula.trim()) return listOccurrences({ number: searching, intervals: [], count: 0, formula: "" });
  write(byId("where-says"), "searching");
  byId("where-box").hidden = false;
  ask({ ask: "where", number: ++searching, formula });
};
byId("where-form").addEventListener("submit", (event) => {
  event.preventDefault();
  search(byId("where").value);
});
const lookAtSteps = (first, last) => {
  const width = Math.max((last - first) * period() * 3, 40 * period());
  const middle = ((first + last) / 2) * period();
  axis.go(middle - width / 2, middle + width / 2);
};
const listOccurrences = (answer) => {
  if (answer.number !== searching) return;
  occurrences = answer.error ? { intervals: [] } : answer;
  byId("where-box").hidden = !answer.error && !answer.formula;
  const time = (step) => seconds(step * period());
  const share = answer.judged ? (100 * answer.steps) / answer.judged : 0;
  const rest = answer.count > answer.intervals?.length ? `; the first ${answer.intervals.length} are listed` : "";
  write(byId("where-says"), answer.error ?? (answer.count ? `${answer.count} interval${answer.count === 1 ? "" : "s"}, ${number(share, 3)} % of ${answer.judged} steps${rest}` : `nowhere in ${answer.judged} steps`));
  byId("where-says").dataset.tone = answer.error ? "bad" : "";
  byId("intervals").replaceChildren(...occurrences.intervals.map(([first, last]) => {
    const row = make("li");
    const button = make("button", first === last ? `${time(first)} s` : `${time(first)} s to ${time(last)} s`, { type: "button" });
    button.addEventListener("click", () => lookAtSteps(first, last));
    row.append(button, make("span", `${last - first + 1} step${last === first ? "" : "s"}`, { class: "hint" }));
    return row;
  }));
  root.dataset.found = answer.error ? "error" : String(answer.count);
  for (const plot of plots) plot.plot?.redraw(false, false);
};

// ---- Everything by its name ----

const plotSignal = (place) => {
  const { name, unit } = signals[place];
  const spec = () => ({ title: name, unit, labels: [""], signals: [place], log: false, lines: [], limits: [] });
  added.push(spec);
  goTo(addPlot(spec(), true));
  readPart();
};
const goTo = (plot) => {
  plot.figure.scrollIntoView({ block: "center" });
  plot.figure.focus({ preventScroll: true });
};
const focusIn = (element) => {
  for (let box = element.closest("details"); box; box = box.parentElement.closest("details")) box.open = true;
  element.scrollIntoView({ block: "center" });
  element.focus({ preventScroll: true });
};
const goToTime = (time) => {
  const step = Math.round(time / period());
  cursors.put(0, step);
  const [from, to] = span();
  const width = Math.min(to - from, (about.recorded ? about.duration_s : view.window_s) / 4);
  axis.go(time - width / 2, time + width / 2);
};
const injectKind = (kind) => {
  byId("kind").value = kind.kind;
  chooseKind();
  focusIn(byId("kind"));
  arm({ title: words(), get disabled() { return byId("inject").querySelector("button[type=submit]").disabled; }, click: () => act({ kind: "inject", words: words() }) });
};
const entries = () => {
  const list = [];
  const add = (kind, name, detail, does, rank) => list.push({ kind, name, detail, does, rank });
  for (const plot of plots) add("plot", plot.spec.title, plot.spec.unit, () => goTo(plot));
  for (const one of signals) {
    const home = plots.find((plot) => plot.spec.signals.includes(one.place));
    add("signal", one.name, one.unit, () => (about.recorded ? plotSignal(one.place) : home && goTo(home)));
  }
  if (!about.recorded) {
    for (const button of byId("buttons").children) add("fault", button.title, "prepared", () => button.disabled || arm(button), "prepared");
    for (const kind of kinds) add("fault", kind.kind, kind.summary, () => injectKind(kind));
    for (const knob of knobs.values()) add("value", knob.told.key, shown(knob.now(), knob.told.unit), () => focusIn(knob.field));
  }
  for (const one of shades) add("fault", one.label, `${seconds(one.from_s)} s`, () => goToTime(one.from_s), "mark");
  for (const one of notes) add("mark", one.label, `${seconds(one.from_s)} s`, () => goToTime(one.from_s));
  for (const one of state?.requirements ?? []) {
    const time = one.at_s ?? one.decided_at_s;
    add("requirement", one.name, one.verdict, () => (isNothing(time) ? focusIn(byId("requirements-box")) : goToTime(time)));
  }
  add("action", "Whole run", "Home", () => axis.all());
  if (!about.recorded) add("action", "Follow the newest records", "End", () => follow());
  add("action", "Clear the cursors", "c", () => cursors.clear());
  add("action", "Light or dark", "", () => byId("theme").click());
  if (about.recorded) add("action", "Search for a formula", "w", () => focusIn(byId("where")));
  return list;
};
const palette = paletteOf(entries);
byId("find").addEventListener("click", () => palette.open());

// ---- On from a checkpoint ----

const showBranch = () => {
  const list = about.checkpoints ?? [];
  byId("branch-box").hidden = !list.length;
  if (!list.length) return;
  const step = cursors.steps[0];
  const before = step === null ? list : list.filter((one) => one.step <= step);
  const one = before.at(-1);
  byId("branch-command").parentElement.hidden = byId("copy-branch").hidden = !one;
  if (!one) return write(byId("branch-says"), `No checkpoint lies before cursor A; the first is at ${seconds(list[0].time_s)} s.`);
  const gap = step === null ? "the last checkpoint; cursor A chooses another" : step === one.step ? "exactly at cursor A" : `${seconds((step - one.step) * period())} s before cursor A`;
  write(byId("branch-says"), `From step ${one.step} (${seconds(one.time_s)} s): ${gap}.`);
  write(byId("branch-command"), `hil run --from ${quoted(one.folder)}`);
};
byId("copy-branch").addEventListener("click", () => copyAndTell(byId("branch-command").textContent + "\n", "the command"));

// ---- Keys ----

// The time under the pointer or, without one, in the middle.
const timeAtHand = () => {
  const hovered = plots.find((one) => one.plot && one.plot.cursor.left >= 0)?.plot;
  const [from, to] = span();
  return hovered ? hovered.posToVal(hovered.cursor.left, "x") : (from + to) / 2;
};
const keysOfLooking = (event) => {
  const step = event.shiftKey ? 0.5 : 0.1;
  const put = (place) => () => cursors.put(place, Math.max(0, Math.round(timeAtHand() / period())));
  // Along the steps of the recording, with a cursor that is there.
  const move = (place, by) => () => cursors.steps[place] === null || cursors.put(place, Math.max(0, cursors.steps[place] + by));
  const keys = {
    ArrowLeft: () => axis.pan(-step), ArrowRight: () => axis.pan(step), Home: () => axis.all(), 0: () => axis.all(),
    a: put(0), b: put(1), c: () => cursors.clear(), ",": move(0, -1), ".": move(0, 1), "<": move(1, -1), ">": move(1, 1), w: () => about.recorded && (byId("where").focus(), true),
  };
  if (!about.recorded) keys.End = () => closer && follow();
  return keys;
};

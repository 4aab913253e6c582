// Looking closer at a run: the range in sight, two cursors and what they measure, the times at which a formula holds
// and the list of everything.

// ---- The range ----

const showSpan = rangeFields(axis, span);
const showRange = () => {
  const [from, to] = span();
  byId("range").hidden = !closer;
  byId("follow").hidden = !closer || Boolean(about.recorded);
  byId("whole").hidden = !about.recorded;
  byId("look").hidden = Boolean(closer) || Boolean(about.recorded);
  byId("window").closest("label").hidden = Boolean(about.recorded);
  showSpan();
  root.dataset.range = closer ? `${from} ${to}` : "";
};
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
  if (!cursors.ends()) {
    [figures, others] = [new Map(), new Map()];
    delete root.dataset.measured;
  }
  drawer.show();
  measure();
  showBranch();
  for (const plot of plots) plot.plot?.redraw(false, false);
  drawSoon();
};
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
// Values of the other run, beside those of this one.
const columnsOfOther = (names, at) => {
  if (!about.over) return [];
  const other = (row) => others.get(row.signal);
  const [name] = names;
  if (names.length === 1) return [[`other at ${name}`, (row) => at(other(row), name)], ["difference", (row) => less(at(row, name), at(other(row), name))]];
  return names.map((name) => [`${name} less other`, (row) => less(at(row, name), at(other(row), name))]);
};
const drawer = drawerOf({ cursors, period, scenario: () => about.scenario, more: columnsOfOther });
// The reason why no requirement can be copied of a signal, or "".
const whyNoRequirement = (name, one) => {
  if (whyUnnamed(name)) return whyUnnamed(name);
  if (isNothing(one.least)) return "it has no value between the cursors";
  return !about.recorded && basis > 1 ? "it needs every step, which the panel has not kept: hil panel RUN" : "";
};
const showFigures = () => {
  const [first, last] = cursors.ends();
  const from = basis === 1 ? `from every step (${last - first + 1})` : `from the least and the greatest values of ${basis} steps each, which is what the panel has kept; mean and RMS need every step: hil panel RUN`;
  drawer.list([...figures.values()].map((one) => {
    const { name, unit } = signals[one.signal];
    return { ...one, name, unit, why: whyNoRequirement(name, one) };
  }), from);
};

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
  for (const plot of plots) add("plot", plot.spec.heading, plot.spec.title === plot.spec.heading ? plot.spec.unit : plot.spec.title, () => goTo(plot));
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
    add("requirement", one.name, outcomeOf(one), () => (isNothing(time) ? focusIn(byId("requirements-box")) : goToTime(time)));
  }
  add("action", "Whole run", "Home", () => axis.all());
  if (!about.recorded) add("action", "Follow the newest records", "End", () => follow());
  add("action", "Clear the cursors", "c", () => cursors.clear());
  if (!byId("branch").disabled) add("action", "Branch from here", "", armBranch);
  add("action", "Arrange the plots", "e", () => byId("arrange").click());
  add("action", "Light or dark", "", () => byId("theme").click());
  if (about.recorded) add("action", "Search for a formula", "w", () => focusIn(byId("where")));
  return list;
};
const palette = paletteOf(entries);
byId("find").addEventListener("click", () => palette.open());

// ---- Keys ----

const keysOfLooking = (event) => {
  const keys = { ...keysOfAxis(axis, event), ...keysOfCursors(cursors, () => timeAtHand(plots, span())), w: () => about.recorded && (byId("where").focus(), true), e: () => (toggleArranging(), true) };
  if (!about.recorded) keys.End = () => closer && follow();
  return keys;
};

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
  if (about.band) return bandColumns(names, at);
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
// The band of a signal at the cursors.
const bandBehind = (place) => {
  const [margin, ...range] = bandOf({ place }) ?? [];
  if (margin === undefined) return null;
  return about.over ? { margin, at: others.get(place)?.at ?? [] } : { margin, at: [range, range], isRange: true };
};
const showFigures = () => {
  const [first, last] = cursors.ends();
  const from = basis === 1 ? `from every step (${last - first + 1})` : `from the least and the greatest values of ${basis} steps each, which is what the panel has kept; mean and RMS need every step: hil panel RUN`;
  drawer.list([...figures.values()].map((one) => {
    const { name, unit } = signals[one.signal];
    return { ...one, name, unit, why: whyNoRequirement(name, one), band: bandBehind(one.signal) };
  }), from);
};

// ---- Times at which a formula holds ----

// Intervals of the last search, the first of which has the number `base`: those of a session come bit by bit.
let occurrences = { intervals: [], base: 0 };
let searching = 0;
// Whether its first answer has been listed.
let isAnswered = true;
// The formula that a session goes on to search for, also behind a broken connection.
let sought = "";
const search = (formula) => {
  byId("where").value = formula;
  sought = formula.trim() ? formula : "";
  searching += 1;
  isAnswered = !sought;
  if (!sought) listOccurrences({ number: searching, intervals: [], count: 0, formula: "" });
  if (!sought && about.recorded) return;
  if (sought) {
    write(byId("where-says"), "searching");
    byId("where-says").dataset.tone = "";
    byId("where-box").hidden = false;
  }
  ask({ ask: "where", number: searching, formula: sought });
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
// From which step on the answer of a session holds, and what it leaves open.
const basisOf = ({ begin, first, is_past_open, delay, lost, count, intervals, base }) => {
  if (begin === undefined) return count > intervals.length ? [`the first ${intervals.length} are listed`] : [];
  const of = (many, word) => `${many} ${word}${many === 1 ? "" : "s"}`;
  const kept = first === 0 ? "" : begin > first ? `: it looks back to ${first}, the first one kept` : ", the first one kept";
  return [
    `from step ${begin}${kept}`,
    ...(is_past_open && first > 0 ? ["past operators without bounds begin there"] : []),
    ...(delay ? [`each step is judged ${of(delay, "step")} later`] : []),
    ...(lost ? [`${of(lost, "step")} not seen, without values`] : []),
    ...(base ? [`the last ${intervals.length} are listed`] : []),
  ];
};
// What was found before, and what has come.
const joined = (answer) => {
  const { from = 0, most = Infinity } = answer;
  const isNext = from >= occurrences.base && from <= occurrences.base + occurrences.intervals.length;
  const kept = from && isNext ? occurrences.intervals.slice(0, from - occurrences.base) : [];
  const all = [...kept, ...(answer.intervals ?? [])];
  const base = from - kept.length + Math.max(0, all.length - most);
  return { ...answer, base, intervals: all.slice(-most), since: answer.is_open ? all.at(-1)[0] : null };
};
// A row that goes on keeps its place, under a mouse and under the focus.
const listIntervals = ({ intervals, since }) => {
  const box = byId("intervals");
  const time = (step) => seconds(step * period());
  const isAtEnd = box.scrollTop + box.clientHeight >= box.scrollHeight - 4;
  const begins = new Map([...box.children].map((row) => [row.begin, row]));
  const rows = intervals.map(([first, last]) => {
    let row = begins.get(first);
    if (!row) {
      row = Object.assign(make("li"), { begin: first });
      const button = make("button", "", { type: "button" });
      button.addEventListener("click", () => lookAtSteps(first, row.end));
      row.append(button, make("span", "", { class: "hint" }));
    }
    if (row.end !== last || row.isOpen !== (first === since)) {
      Object.assign(row, { end: last, isOpen: first === since });
      write(row.firstChild, row.isOpen ? `since ${time(first)} s` : first === last ? `${time(first)} s` : `${time(first)} s to ${time(last)} s`);
      write(row.lastChild, `${last - first + 1} step${last === first ? "" : "s"}`);
    }
    return row;
  });
  const stay = new Set(rows);
  for (const row of [...box.children]) if (!stay.has(row)) row.remove();
  for (const [nth, row] of rows.entries()) if (box.children[nth] !== row) box.insertBefore(row, box.children[nth] ?? null);
  // Of a session the newest ones are followed; of a recorded run the first one matters.
  if (about.recorded) box.scrollTop = 0;
  else if (isAtEnd) box.scrollTop = box.scrollHeight;
};
const isInSight = (element) => {
  const { left, top, bottom } = element.getBoundingClientRect();
  return [top + 2, bottom - 2].every((y) => element.contains(document.elementFromPoint(left + 2, y)));
};
const listOccurrences = (answer) => {
  if (answer.number !== searching) return;
  occurrences = joined(answer);
  byId("where-box").hidden = !answer.error && !answer.formula;
  const share = answer.judged ? (100 * answer.steps) / answer.judged : 0;
  const summary = answer.count ? `${answer.count} interval${answer.count === 1 ? "" : "s"}, ${number(share, 3)} % of ${answer.judged} steps` : `nowhere in ${answer.judged} steps`;
  write(byId("where-says"), answer.error ?? [summary, ...basisOf(occurrences)].join("; "));
  byId("where-says").dataset.tone = answer.error ? "bad" : "";
  listIntervals(occurrences);
  // Where the answer is out of sight, as below the table of the cursors, its words come to the reader.
  if (!isAnswered && !isInSight(byId("where-says"))) tell(byId("where-says").textContent);
  isAnswered = true;
  root.dataset.found = answer.error ? "error" : String(answer.count);
  root.dataset.judged = String(answer.judged ?? "");
  drawSoon();
};
// The intervals in a part of the run.
const occurrencesIn = ([from, to]) => occurrences.intervals.filter(([first, last]) => (last + 1) * period() >= from && first * period() <= to);

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
  if (about.over && !about.band) add("action", "Where the runs first differ", "hil compare RUN RUN", () => tell(`hil compare ${about.session} ${about.over} names the first step, signal and values that differ`));
  if (about.recorded) add("action", "Figures for a document", "hil report RUN --figures DIR", () => tell(`hil report ${about.session} --figures DIR writes each plot of the scenario as SVG and PDF`));
  add("action", "Search where a formula holds", "w", () => focusIn(byId("where")));
  return list;
};
const palette = paletteOf(entries);
byId("find").addEventListener("click", () => palette.open());

// ---- Keys ----

const keysOfLooking = (event) => {
  const keys = { ...keysOfAxis(axis, event), ...keysOfCursors(cursors, () => timeAtHand(plots, span())), w: () => (byId("where").focus(), true), e: () => (toggleArranging(), true) };
  if (!about.recorded) keys.End = () => closer && follow();
  return keys;
};

// Plots as a reader arranges them: their order, their signals and titles; and `[[plots]]` of the scenario made of them.

// As arranged, by the names of signals, so that it outlasts another connection; `null` for the plots that the panel chose.
let arrangement = null;
// What the plots were before each change.
const MOST_CHANGES = 50;
const past = [];
let isArranging = false;
// Words for each signal that a plot had.
const wordsOf = new Map();

const isOfLoop = (plot) => plot.spec.section === "Loop";
const movable = () => plots.filter((plot) => !isOfLoop(plot));
const written = (spec) => ({ ...spec, signals: spec.signals.map((place) => signals[place].name) });
// Limits of the requirements on signals, each once.
const limitsOn = (places) => [...new Map(places.flatMap((place) => signals[place].limits ?? []).map((one) => [JSON.stringify(one), one])).values()];
const specOf = (places, more = {}) => ({ title: "", section: "", heading: "", was: null, unit: signals[places[0]].unit, log: false, lines: [], ...more, signals: places, words: places.map((place) => wordsOf.get(place) ?? signals[place].name), limits: limitsOn(places) });
const isArrangement = (list) => Array.isArray(list) && list.every((one) => Array.isArray(one?.signals) && Array.isArray(one.lines) && [one.title, one.heading, one.unit].every((text) => typeof text === "string"));
// The plots of a description, or those into which they were arranged.
const arrangedOf = (told) => {
  told.plots.forEach((spec) => {
    spec.was = spec.section === "Figures" ? spec.title : null;
    spec.signals.forEach((place, nth) => wordsOf.set(place, spec.words[nth]));
  });
  const recalled = recall("plots " + told.session);
  arrangement ??= isArrangement(recalled) ? recalled : null;
  if (!arrangement) return told.plots;
  const place = new Map(signals.map((one) => [one.name, one.place]));
  const specs = arrangement.map((spec) => [spec, spec.signals.filter((name) => place.has(name)).map((name) => place.get(name))]);
  return specs.filter(([, places]) => places.length).map(([spec, places]) => specOf(places, spec));
};
const choose = (list) => {
  arrangement = list;
  retain("plots " + about.session, arrangement);
  readPart();
  measure();
  drawSoon();
  showArrangement();
};
// Carries out a change that can be undone, and says what it was.
const change = (text, does) => {
  past.push(arrangement ?? plots.map((plot) => written(plot.spec)));
  if (past.length > MOST_CHANGES) past.shift();
  does();
  choose(plots.map((plot) => written(plot.spec)));
  tell(text);
};
const takeAway = (plot) => {
  plots.splice(plots.indexOf(plot), 1);
  seen.unobserve(plot.figure);
  sized.unobserve(plot.figure);
  plot.plot?.destroy();
  plot.figure.remove();
};
const arrangeAnew = (list) => {
  arrangement = list;
  retain("plots " + about.session, list);
  for (const plot of [...plots]) takeAway(plot);
  for (const spec of arrangedOf(about)) addPlot(spec);
  choose(list);
};

// ---- Changes ----

const move = (plot, by) => {
  const count = movable().length;
  const from = plots.indexOf(plot);
  const to = from + by;
  if (isOfLoop(plot) || to < 0 || to >= count) return;
  const focused = document.activeElement;
  change(`${plot.spec.heading}: place ${to + 1} of ${count}`, () => {
    plots.splice(from, 1);
    plots.splice(to, 0, plot);
    byId("plots").insertBefore(plot.figure, plots[to + 1]?.figure ?? null);
  });
  // What is moved in the page loses the focus.
  if (plot.figure.contains(focused)) (focused.disabled ? plot.figure : focused).focus({ preventScroll: true });
  plot.figure.scrollIntoView({ block: "nearest" });
};
const remove = (plot) => {
  const at = plots.indexOf(plot);
  change(`removed ${plot.spec.heading}`, () => takeAway(plot));
  const next = plots[Math.min(at, plots.length - 1)];
  (next?.figure ?? byId("undo")).focus();
};
// Puts a plot of these signals in the place of another; the focus goes to the control of this name.
const become = (plot, spec, text, name) => {
  const at = plots.indexOf(plot);
  let next = null;
  change(text, () => {
    takeAway(plot);
    next = addPlot(spec, at);
  });
  (next.figure.querySelector(name) ?? next.figure).focus();
};
const plotSignal = (place) => {
  const { name } = signals[place];
  let plot = null;
  change(`a plot of ${name}`, () => (plot = addPlot(specOf([place], { title: name, heading: name }), 0)));
  goTo(plot);
};

// ---- Controls ----

const showTools = (plot) => {
  plot.figure.querySelector(".arrange")?.remove();
  if (!isArranging || isOfLoop(plot)) return;
  const { spec } = plot;
  const tools = make("div", undefined, { class: "arrange row", role: "group", "aria-label": `Arrange: ${spec.heading}` });
  const press = (text, name, does, more = {}) => {
    const button = make("button", text, { type: "button", title: name, "aria-label": `${name}: ${spec.heading}`, ...more });
    button.addEventListener("click", does);
    tools.append(button);
  };
  const at = plots.indexOf(plot);
  press("↑", "Move up", () => move(plot, -1), at === 0 ? { disabled: "" } : {});
  press("↓", "Move down", () => move(plot, 1), at === movable().length - 1 ? { disabled: "" } : {});
  const title = make("input", undefined, { type: "text", class: "title-field", value: spec.heading, maxlength: 400, autocomplete: "off", "aria-label": `Title: ${spec.heading}` });
  title.addEventListener("change", () => {
    const text = title.value.trim();
    if (text && text !== spec.heading) become(plot, specOf(spec.signals, { ...spec, title: text, heading: text }), `called ${text}`, ".title-field");
    else title.value = spec.heading;
  });
  tools.append(title);
  const others = signals.filter((one) => one.unit === spec.unit && !spec.signals.includes(one.place));
  if (others.length) {
    const more = make("select", make("option", "Add a signal", { value: "" }), { class: "add-field", "aria-label": `Add a signal to ${spec.heading}` });
    more.append(...others.map((one) => make("option", one.name, { value: one.place })));
    more.addEventListener("change", () => {
      const place = Number(more.value);
      become(plot, specOf([...spec.signals, place], spec), `${signals[place].name} is in ${spec.heading}`, ".add-field");
    });
    tools.append(more);
  }
  if (spec.signals.length > 1) {
    for (const place of spec.signals) {
      const { name } = signals[place];
      press(`− ${name}`, `Take ${name} away`, () => become(plot, specOf(spec.signals.filter((one) => one !== place), spec), `${name} is no longer in ${spec.heading}`, ".add-field"));
    }
  }
  press("Remove", "Remove the plot", () => remove(plot));
  plot.figure.querySelector("figcaption").after(tools);
};
const showArrangement = () => {
  byId("arrange").setAttribute("aria-pressed", String(isArranging));
  byId("arrange-box").hidden = !isArranging;
  byId("undo").disabled = !past.length;
  byId("reset").disabled = !arrangement;
  byId("kept").hidden = true;
  // The focus outlasts the controls that are made anew: it is in the same place of them.
  const focused = document.activeElement;
  const own = focused?.closest(".arrange");
  const place = own ? [...own.children].indexOf(focused) : -1;
  const plot = own?.closest("figure")?.panelPlot;
  for (const one of plots) showTools(one);
  if (place >= 0 && plots.includes(plot)) {
    const again = plot.figure.querySelector(".arrange")?.children[place];
    (again && !again.disabled ? again : plot.figure).focus({ preventScroll: true });
  }
  byId("new-plot").replaceChildren(make("option", "Choose a signal", { value: "" }), ...signals.map((one) => make("option", one.name, { value: one.place })));
};
const toggleArranging = () => {
  isArranging = !isArranging;
  showArrangement();
  if (isArranging) tell("Arranging: each plot has its controls");
};
byId("arrange").addEventListener("click", toggleArranging);
byId("new-plot").addEventListener("change", () => byId("new-plot").value !== "" && plotSignal(Number(byId("new-plot").value)));
byId("undo").addEventListener("click", () => {
  if (!past.length) return;
  arrangeAnew(past.pop());
  tell("undone");
});
byId("reset").addEventListener("click", () => {
  past.push(plots.map((plot) => written(plot.spec)));
  arrangeAnew(null);
  tell("the plots are those of the run");
});
byId("plots").addEventListener("keydown", (event) => {
  const plot = event.target.closest("figure")?.panelPlot;
  if (!isArranging || !plot || armed) return;
  const by = { ArrowUp: -1, ArrowDown: 1 }[event.key];
  if (event.altKey && by) move(plot, by);
  else if (event.key === "Delete" && event.target === plot.figure && !isOfLoop(plot)) remove(plot);
  else return;
  event.preventDefault();
});

// ---- Kept with the scenario ----

let keeping = 0;
let sent = [];
// Each plot by its heading or, where two share one, with its name as well.
const titled = () => {
  const list = movable();
  const isShared = ({ spec }) => list.filter((one) => one.spec.heading === spec.heading).length > 1;
  return list.map((plot) => ({ plot, title: isShared(plot) && plot.spec.title !== plot.spec.heading ? `${plot.spec.heading} (${plot.spec.title})` : plot.spec.heading }));
};
const keep = (isWriting) => {
  sent = titled();
  ask({ ask: "keep", number: ++keeping, write: isWriting, plots: sent.map(({ plot: { spec }, title }) => ({ title: title.slice(0, 400), was: spec.was, signals: spec.signals, log: spec.log })) });
};
const armWriting = () => arm({ title: byId("kept").dataset.file, words: ["Write the plots to", "replaces those of the scenario", "not written"], get disabled() { return byId("write-plots").disabled; }, click: () => keep(true) });
const listKept = (told) => {
  if (told.number !== keeping) return;
  byId("kept").hidden = false;
  byId("kept").dataset.file = told.file ?? "";
  const why = told.error ?? told.refused;
  write(byId("kept-says"), told.is_written ? `Written to ${told.file}: reports, panels and monitors of new runs begin with these plots.` : why ? `Not written: ${why}.` : `For ${told.file}.`);
  byId("kept-says").dataset.tone = why ? "bad" : "";
  byId("left-out").replaceChildren(...(told.left_out ?? []).map((text) => make("li", `Left out: ${text}.`)));
  write(byId("kept-toml"), told.toml ?? "");
  byId("kept-toml").parentElement.hidden = byId("copy-plots").hidden = !told.toml;
  byId("write-plots").hidden = Boolean(why) || told.is_written;
  if (told.is_written) for (const { plot, title } of sent) plot.spec.was = title;
  tell(byId("kept-says").textContent);
  root.dataset.kept = told.error ? "error" : told.is_written ? "written" : told.refused ? "refused" : "shown";
};
byId("keep").addEventListener("click", () => keep(false));
byId("write-plots").addEventListener("click", armWriting);
byId("copy-plots").addEventListener("click", () => drawer.copy(byId("kept-toml").textContent, "the plots"));

"use strict";
// Two cursors over the axis of time, A and B: lines in every plot, and what is measured at them and between them.

// The cursors of a page: `period` gives the length of a step, on which they stand; `changed` follows each change. Where
// not every step can be stood on, `next` gives the one that is some places behind the nearest such step.
const cursorsOf = ({ period, changed, next = (step, by) => Math.max(0, step + by) }) => {
  // The step of each, and those before the last click and the one before that.
  let steps = [null, null];
  let before = [steps, steps];
  const set = (now) => {
    steps = now.map((step) => (step === null ? null : next(step, 0)));
    changed();
  };
  const stepAt = (time) => Math.max(0, Math.round(time / period()));
  return {
    get steps() {
      return steps;
    },
    // First A, then B, then the nearer of both.
    place(time) {
      before = [before[1], steps];
      const step = stepAt(time);
      if (steps[0] === null) return set([step, steps[1]]);
      if (steps[1] === null) return set([steps[0], step]);
      const isFirst = Math.abs(steps[0] - step) <= Math.abs(steps[1] - step);
      set(isFirst ? [step, steps[1]] : [steps[0], step]);
    },
    put(which, step) {
      set(steps.map((one, place) => (place === which ? step : one)));
    },
    // At a time; nowhere without one.
    at(which, time) {
      this.put(which, time === null ? null : stepAt(time));
    },
    // Along the steps, a cursor that is there.
    move(which, by) {
      if (steps[which] !== null) this.put(which, next(steps[which], by));
    },
    clear() {
      set([null, null]);
    },
    // As before a double click.
    back() {
      set(before[0]);
    },
    // The first and the last step between them; of one cursor its own.
    ends() {
      const set = steps.filter((one) => one !== null);
      return set.length ? [Math.min(...set), Math.max(...set)] : null;
    },
    draw(u, ink) {
      if (!this.ends()) return;
      within(u, (ctx, { left, top, width, height }, ratio) => {
        ctx.font = `bold ${11 * ratio}px system-ui, sans-serif`;
        ctx.textBaseline = "bottom";
        ctx.textAlign = "left";
        for (const [place, step] of steps.entries()) {
          if (step === null) continue;
          const x = u.valToPos(step * period(), "x", true);
          if (x < left - 1 || x > left + width + 1) continue;
          ctx.fillStyle = ink.cursor;
          ctx.fillRect(x - ratio / 2, top, 1.5 * ratio, height);
          const name = "AB"[place];
          const wide = ctx.measureText(name).width + 6 * ratio;
          const at = x + wide > left + width ? x - wide : x;
          ctx.fillRect(at, top + height - 15 * ratio, wide, 15 * ratio);
          ctx.fillStyle = ink.paper;
          ctx.fillText(name, at + 3 * ratio, top + height - 2 * ratio);
        }
      });
    },
  };
};

// Keys of the cursors; `hand` gives the time at which one is put down.
const keysOfCursors = (cursors, hand) => ({
  a: () => cursors.at(0, hand()), b: () => cursors.at(1, hand()), c: () => cursors.clear(),
  ",": () => cursors.move(0, -1), ".": () => cursors.move(0, 1), "<": () => cursors.move(1, -1), ">": () => cursors.move(1, 1),
});
// The time under the pointer over one of some plots or, without one, in the middle.
const timeAtHand = (plots, [from, to]) => {
  const hovered = plots.find((one) => one.plot && one.plot.cursor.left >= 0)?.plot;
  return hovered ? hovered.posToVal(hovered.cursor.left, "x") : (from + to) / 2;
};

// ---- The drawer ----

// A figure: a number, nothing or, of a value that is only known to lie between two numbers, both.
const ends = (figure) => (Array.isArray(figure) ? figure : [figure, figure]);
const less = (figure, other) => {
  if (isNothing(figure) || isNothing(other)) return null;
  const [[low, high], [from, to]] = [ends(figure), ends(other)];
  return low === high && from === to ? low - from : [low - to, high - from];
};
// The band of a baseline at cursors, and by how much a value there is outside of it: above it, or negative below it. A row
// with a band has its `margin` and, `at` both cursors, what that is about: values of the same step or, where `isRange`,
// the ends of a range.
const bandColumns = (names, at) => {
  const bandAt = ({ band }, name) => {
    const [low, high] = ends(band ? at(band, name) : null);
    return isNothing(low) ? null : [low - band.margin, high + band.margin];
  };
  const outside = (row, name) => {
    const figure = at(row, name);
    if (isNothing(figure) || bandAt(row, name) === null) return null;
    const { margin, isRange } = row.band;
    const by = (above, below) => (above > margin ? above - margin : below < -margin ? below + margin : 0);
    const [low, high] = ends(at(row.band, name));
    const [least, greatest] = ends(figure);
    // Of two values that are only known to lie between numbers, the difference is too.
    const outer = isRange ? [by(least - high, least - low), by(greatest - high, greatest - low)] : [by(least - high, least - high), by(greatest - low, greatest - low)];
    return outer[0] === outer[1] ? outer[0] : outer;
  };
  return names.flatMap((name) => [[`band at ${name}`, (row) => bandAt(row, name)], [`outside at ${name}`, (row) => outside(row, name)]]);
};
const figureShown = (figure, unit) => [...new Set(ends(figure).map((end) => shown(end, unit)))].join(" to ");
const plain = (figure, digits) => (Array.isArray(figure) ? figure.map((end) => plain(end, digits)).join(" to ") : isNothing(figure) ? "-" : String(rounded(figure, digits)));

// The table of the values at the cursors and of what is between them, with its copies. A row has `name` and `unit` of a
// signal, its `title` in the table, values `at` the first and at the last cursor, `mean`, `rms`, `least`, `greatest`, a
// `height` that is not their difference, the `count` of values and a reason `why` no requirement can be copied of it.
// `scenario` gives the title of a copy, `more` further columns, `span` the first and the last step between the cursors,
// `digits` how many of a number are copied.
const drawerOf = ({ cursors, period, scenario, more = () => [], span = () => cursors.ends(), digits = 17 }) => {
  const ids = ["cursor-a", "cursor-b"];
  let rows = [];
  const showStep = (place) => {
    const step = cursors.steps[place];
    if (document.activeElement !== byId(ids[place])) byId(ids[place]).value = step === null ? "" : seconds(step * period());
  };
  const show = () => {
    const [a, b] = cursors.steps;
    const isOpen = cursors.ends() !== null;
    byId("measure").hidden = !isOpen;
    document.body.classList.toggle("measures", isOpen);
    ids.forEach((_, place) => showStep(place));
    const gap = a === null || b === null ? null : (b - a) * period();
    write(byId("gap"), gap === null ? "" : `B - A: ${seconds(gap)} s${gap ? `, 1/(B - A): ${number(1 / gap)} Hz` : ""}`);
  };
  // The columns behind signal and unit: heading, and the figure of a row.
  const columns = () => {
    const [a, b] = cursors.steps;
    const first = a === null || (b !== null && b < a) ? 1 : 0;
    const at = (row, which) => row?.at[which === "A" ? first : 1 - first] ?? null;
    if (a === null || b === null) return [[`at ${a === null ? "B" : "A"}`, (row) => row.at[0]], ...more(["AB"[a === null ? 1 : 0]], (row) => row?.at[0] ?? null)];
    return [
      ["at A", (row) => at(row, "A")], ["at B", (row) => at(row, "B")], ["B - A", (row) => less(at(row, "B"), at(row, "A"))],
      ["mean", (row) => row.mean], ["RMS", (row) => row.rms], ["peak to peak", (row) => row.height ?? less(row.greatest, row.least)],
      ["least", (row) => row.least], ["greatest", (row) => row.greatest], ...more(["A", "B"], at),
    ];
  };
  const copy = async (text, title) => tell((await copyText(text, byId("copied"))) ? `copied ${title}` : `the browser keeps its clipboard; ${title} is selected`);
  const list = (measured, basis) => {
    rows = measured;
    const all = columns();
    const head = make("tr");
    head.append(make("th", "signal", { scope: "col" }), make("th", "unit", { scope: "col" }), ...all.map(([title]) => make("th", title, { scope: "col", class: "n" })), make("th", make("span", "copy", { class: "visually-hidden" }), { scope: "col" }));
    byId("figures-head").replaceChildren(head);
    byId("figures").replaceChildren(...rows.map((row) => {
      const { name, unit, title = name, why } = row;
      const line = make("tr");
      // A time in ns is written with a unit that suits it.
      const own = unit === "ns" ? unit : "";
      line.append(make("th", title, { scope: "row" }), make("td", own || unit === "1" ? "" : unit, { class: "unit" }), ...all.map(([, value]) => make("td", figureShown(value(row), own), { class: "n" })));
      const button = make("button", "requirement", { type: "button", title: why, "aria-label": `Copy a requirement on ${title}` });
      button.disabled = why !== "";
      button.addEventListener("click", () => {
        const [from, to] = span();
        copy(asRequirement(name, [from * period(), to * period()], row, to - from + 1), `a requirement on ${name}`);
      });
      const last = make("td");
      last.append(button);
      line.append(last);
      return line;
    }));
    write(byId("basis"), basis);
  };
  ids.forEach((id, place) => byId(id).addEventListener("change", () => {
    const time = typedTime(id);
    if (time === null || time >= 0) cursors.at(place, time);
    else byId(id).value = cursors.steps[place] === null ? "" : seconds(cursors.steps[place] * period());
  }));
  byId("clear-cursors").addEventListener("click", () => cursors.clear());
  byId("copy-figures").addEventListener("click", () => {
    const at = cursors.steps.flatMap((step, place) => (step === null ? [] : [`${"AB"[place]} ${seconds(step * period())} s (step ${step})`]));
    const all = columns();
    const cells = rows.map((row) => [row.title ?? row.name, row.unit || "1", ...all.map(([, value]) => plain(value(row), digits))]);
    copy(figuresAsText({ title: [scenario(), ...at].join(", "), head: ["signal", "unit", ...all.map(([title]) => title)], rows: cells }), "the table");
  });
  return { show, list, copy };
};
// The reason why a requirement cannot name a signal, or "".
const whyUnnamed = (name) => {
  if (name.startsWith("parameter.")) return "a requirement is on signals, not on parameters";
  return !/^[A-Za-z_]/.test(name) || /_(ns|steps)$/.test(name) ? "a requirement cannot name this signal" : "";
};

// ---- What is copied ----

// A table as text, with tabs between its columns.
const figuresAsText = ({ title, head, rows }) => [title, ...[head, ...rows].map((row) => row.join("\t"))].join("\n") + "\n";

// The skeleton of a requirement: the signal stays in the range that it had between the cursors, which are times in s.
const asRequirement = (name, [from_s, to_s], { least, greatest, count }, steps) => {
  const time = (value) => String(Math.round(value * 1e9) / 1e9);
  const size = (value) => String(value).replace("e+", "e");
  // A name has at most 64 characters; the times stay whole.
  const between = `_${time(from_s)}s_to_${time(to_s)}s`;
  const title = (name.slice(0, 64 - between.length) + between).replace(/[^A-Za-z0-9_-]/g, "_");
  const missing = count < steps ? `# ${steps - count} of ${steps} steps have no value, and count against it\n` : "";
  return `${missing}[[requirements]]\nname = "${title}"\nformula = "always[${time(from_s)}s,${time(to_s)}s](${name} >= ${size(least)} and ${name} <= ${size(greatest)})"\n`;
};

// Puts a text on the clipboard, or shows and selects it in its box where the browser refuses that.
const copyText = async (text, box) => {
  box.textContent = text;
  try {
    await navigator.clipboard.writeText(text);
    box.hidden = true;
    return true;
  } catch {
    box.hidden = false;
    const range = document.createRange();
    range.selectNodeContents(box);
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    return false;
  }
};

"use strict";
// Zoom and pan over the axis of time that all plots of a page share: by mouse, wheel, touch, keys and typed numbers.
// A wheel alone scrolls the page; with Ctrl, as a pinch on a touchpad comes, it zooms, with Shift or sideways it pans.

// `whole` gives the ends of the axis, `least` the narrowest part, `shown` the part in sight; `show` shows another.
const timeAxis = ({ whole, least, shown, show }) => {
  const go = (from, to) => {
    const [begin, end] = whole();
    if (from >= begin && to <= end && to - from >= least()) return show([from, to]);
    const width = Math.min(Math.max(to - from, least()), end - begin);
    const middle = (from + to) / 2;
    const start = Math.min(Math.max(middle - width / 2, begin), end - width);
    show([start, start + width]);
  };
  // Between two times: an end outside of the axis is moved onto it, and the other stays.
  const between = (from, to) => {
    const [begin, end] = whole();
    go(Math.min(Math.max(from, begin), end), Math.min(Math.max(to, begin), end));
  };
  const zoom = (factor, at) => {
    const [from, to] = shown();
    const fixed = at ?? (from + to) / 2;
    go(fixed - (fixed - from) * factor, fixed + (to - fixed) * factor);
  };
  const pan = (part) => {
    const [from, to] = shown();
    go(from + part * (to - from), to + part * (to - from));
  };
  const all = () => go(...whole());
  return { whole, least, go, between, zoom, pan, all };
};

// A number of pixels below which a pressed pointer has not moved.
const STILL_PX = 4;

// Hears the pointer over a plot of uPlot. `click` gets the time of a click or a tap, `back` is told that two of them
// were a double click, which shows the whole axis.
const hearPointer = (u, axis, shown, click, back) => {
  const { over } = u;
  const pointers = new Map();
  let begun = null;
  const band = document.createElement("div");
  band.className = "band";
  band.hidden = true;
  over.append(band);
  // Places are parts of the plot's width, which changes with the labels of its axis.
  const partAt = (event) => {
    const { left, width } = over.getBoundingClientRect();
    return (event.clientX - left) / width;
  };
  const timeAt = (part, [from, to] = shown()) => from + part * (to - from);
  const apart = ([a, b]) => Math.max(1e-3, Math.abs(a - b));
  const middle = ([a, b]) => (a + b) / 2;
  const places = () => [...pointers.values()];

  over.addEventListener("wheel", (event) => {
    const isSideways = event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY);
    if (!event.ctrlKey && !isSideways) return;
    event.preventDefault();
    const by = event.deltaX || event.deltaY;
    if (event.ctrlKey) axis.zoom(Math.exp(Math.min(Math.max(event.deltaY, -120), 120) / 400), timeAt(partAt(event)));
    else axis.pan(Math.min(Math.max(by, -120), 120) / 1000);
  }, { passive: false });
  over.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    over.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, partAt(event));
    const isPan = event.pointerType === "touch" || event.shiftKey;
    begun = { at: places(), span: shown(), isPan, hasMoved: pointers.size > 1 };
  });
  over.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    pointers.set(event.pointerId, partAt(event));
    const now = places();
    const [from, to] = begun.span;
    if (now.length === 2 && begun.at.length === 2) {
      const width = ((to - from) * apart(begun.at)) / apart(now);
      const start = timeAt(middle(begun.at), begun.span) - middle(now) * width;
      axis.go(start, start + width);
      return;
    }
    const moved = now[0] - begun.at[0];
    begun.hasMoved ||= Math.abs(moved) * over.clientWidth >= STILL_PX;
    if (!begun.hasMoved) return;
    if (begun.isPan) axis.go(from - moved * (to - from), to - moved * (to - from));
    else {
      const [start, end] = [begun.at[0], Math.min(Math.max(now[0], 0), 1)].sort((a, b) => a - b);
      band.hidden = false;
      band.style.left = `${100 * start}%`;
      band.style.width = `${100 * (end - start)}%`;
    }
  });
  const end = (event, isDone) => {
    if (!pointers.has(event.pointerId)) return;
    const part = pointers.get(event.pointerId);
    const { at, hasMoved, isPan, span } = begun;
    pointers.delete(event.pointerId);
    band.hidden = true;
    if (pointers.size) begun = { at: places(), span: shown(), isPan: true, hasMoved: true };
    else if (isDone && !hasMoved) click(timeAt(part));
    else if (isDone && !isPan) axis.between(...[timeAt(at[0], span), timeAt(part, span)].sort((a, b) => a - b));
  };
  over.addEventListener("pointerup", (event) => end(event, true));
  over.addEventListener("pointercancel", (event) => end(event, false));
  over.addEventListener("dblclick", () => {
    back();
    axis.all();
  });
};

// ---- The range in numbers ----

// The time in a field: `null` of an empty one, NaN of a text that is no number, of which it tells.
const typedTime = (id) => {
  const text = byId(id).value.trim();
  const time = text === "" ? null : Number(text);
  if (time === null || Number.isFinite(time)) return time;
  tell(`\`${text}\` is no number of seconds`);
  return NaN;
};
// The two fields of the part in sight and the button that shows all of it. Gives what writes the part into them.
const rangeFields = (axis, shown) => {
  const ids = ["from", "to"];
  const showRange = () => shown().forEach((time, place) => {
    if (document.activeElement !== byId(ids[place])) byId(ids[place]).value = seconds(time);
  });
  for (const [place, id] of ids.entries()) {
    byId(id).addEventListener("change", () => {
      // The other end is the one in sight, with all its digits.
      const part = [...shown()];
      const before = seconds(part[place]);
      const time = typedTime(id);
      const [begin, end] = axis.whole();
      part[place] = Math.min(Math.max(time, begin), end);
      if (time === null || !(part[1] - part[0] >= axis.least() * (1 - 1e-9))) {
        if (time !== null && !Number.isNaN(time)) tell(part[1] > part[0] ? "a range has at least 4 steps" : "a range ends after it begins");
        byId(id).value = before;
        return;
      }
      axis.between(...part);
      byId(id).blur();
    });
    byId(id).addEventListener("blur", showRange);
  }
  byId("whole").addEventListener("click", () => axis.all());
  return showRange;
};
// Keys along the axis.
const keysOfAxis = (axis, event) => {
  const step = event.shiftKey ? 0.5 : 0.1;
  return {
    ArrowLeft: () => axis.pan(-step), ArrowRight: () => axis.pan(step), Home: () => axis.all(), 0: () => axis.all(),
    "+": () => axis.zoom(0.5), "=": () => axis.zoom(0.5), "-": () => axis.zoom(2),
  };
};

"use strict";
// Draws the cases of a campaign and selects among them. All values are columns in typed arrays, one place for each
// case; where a case stands in a plot is computed once for a size, so a selection only counts and colours again.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const make = (tag, words, inside, properties = {}) => {
    const node = Object.assign(document.createElement(tag), words === undefined ? properties : { textContent: words, ...properties });
    if (inside) inside.append(node);
    return node;
  };

  // ---- Theme, tables that scroll, commands ----
  showTheme(wantsDark.matches);
  byId("theme").addEventListener("click", () => showTheme(root.dataset.theme !== "dark"));
  watchScroll();
  const addCopy = (code) => {
    const button = make("button", "Copy", null, { type: "button", className: "copy", onclick: async () => {
      // Some browsers refuse the clipboard to a file; the command is selected for the user's own keys then.
      getSelection().selectAllChildren(code);
      const isCopied = await navigator.clipboard.writeText(code.textContent).then(() => true, () => false);
      button.textContent = isCopied ? "Copied" : "Selected";
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    } });
    code.after(" ", button);
  };
  document.querySelectorAll("code.command").forEach(addCopy);

  // ---- Columns ----
  const classOf = bytesOf(data.class);
  const rows = classOf.length;
  if (rows === 0) return void make("p", "There is no case to draw yet.", byId("plots"));
  byId("tools").hidden = false;
  const caseOf = data.cases ? new Float64Array(bytesOf(data.cases).buffer) : Float64Array.from({ length: rows }, (_, row) => row);
  const variants = data.variants.length;
  const variantOf = Uint16Array.from(caseOf, (number) => number % variants);
  const [MOST_BINS, NO_BIN, FEW] = [200, 255, 12]; // so few different values are a list
  const BINS = Math.min(Math.max(Math.ceil(2 * Math.cbrt(rows / variants)), 16), 60);

  // Range and bins of a column. Few values far away must not press all others together, so the range ends three times
  // the distance of the quartiles beyond them, of the variant that goes farthest; what is beyond counts at the edge.
  const prepare = (column) => {
    const values = column.codes === undefined ? new Float32Array(bytesOf(column.numbers).buffer) : bytesOf(column.codes);
    const sorted = values.filter(Number.isFinite).sort();
    let [lo, hi, bins, spread, list] = [sorted[0] ?? 0, sorted.at(-1) ?? 1, BINS, 0, null];
    const isMargin = column.role === "margin";
    if (column.texts) {
      [lo, hi, bins, spread] = [-0.5, column.texts.length - 0.5, Math.min(column.texts.length, MOST_BINS), 0.3];
    } else if (!(hi > lo)) {
      const wide = Math.abs(lo) || 1;
      [lo, hi] = isMargin ? [Math.min(lo * 1.1, -0.1 * wide), Math.max(lo * 1.1, 0.1 * wide)] : [lo - wide / 2, lo + wide / 2];
    } else if (column.role === "varied" && (list = listOf(sorted))) {
      const least = list.slice(1).reduce((least, value, n) => Math.min(least, value - list[n]), Infinity);
      [lo, hi, spread] = [lo - least / 2, hi + least / 2, 0.3 * least];
      if (Math.round((hi - lo) / least) <= BINS) bins = Math.round((hi - lo) / least);
    } else {
      const groups = column.role === "varied" ? [sorted] : data.variants.map((_, variant) => values.filter((value, row) => variantOf[row] === variant && Number.isFinite(value)).sort());
      let [from, to] = [Infinity, -Infinity];
      // Where most are the same, of quantiles farther out.
      for (const p of [0.25, 0.05, 0.01]) {
        if (to > from) break;
        for (const group of groups.filter((one) => one.length)) {
          const [least, low, high, greatest] = [0, p, 1 - p, 1].map((one) => group[Math.round(one * (group.length - 1))]);
          from = Math.min(from, Math.max(least, low - 3 * (high - low)));
          to = Math.max(to, Math.min(greatest, high + 3 * (high - low)));
        }
      }
      if (to > from) [lo, hi] = [from, to];
      if (isMargin) [lo, hi] = [Math.min(lo, -0.02 * (hi - lo)), Math.max(hi, 0.02 * (hi - lo))];
    }
    const scale = bins / (hi - lo);
    // A comparison with what is not there is false.
    const binOf = Uint8Array.from(values, (value) => (value >= lo ? (value >= hi ? bins - 1 : Math.floor((value - lo) * scale)) : value < lo ? 0 : NO_BIN));
    const all = new Uint32Array(bins);
    for (let i = 0; i < rows; i++) if (binOf[i] !== NO_BIN) all[binOf[i]] += 1;
    // Varied values stay in the unit in which a study names them.
    const display = column.role === "varied" ? shownUnit(column.unit, 1) : shownUnit(column.unit, Math.max(Math.abs(lo), Math.abs(hi)));
    return { ...column, values, lo, hi, bins, spread, binOf, all, list, shown: display, size: 10 ** display.power, isUndrawn: all.every((count) => count === 0), label: column.name + unitOf(display.unit), range: null };
  };
  // Different values of sorted ones, if there are few.
  const listOf = (sorted) => {
    const found = [...new Set(sorted)];
    return found.length <= FEW ? found : null;
  };
  const columns = data.columns.map(prepare);
  const [varied, margins] = ["varied", "margin"].map((role) => columns.filter((column) => column.role === role));
  const outcomes = columns.filter((column) => column.role !== "varied");

  // ---- Numbers ----
  // Less than all is never written as 100 %.
  const percent = (count, of) => (of ? (count < of ? Math.min(rounded((100 * count) / of, 4), 99.99) : 100) + " %" : "none");
  // NaN stands for a case without a value.
  const valueShown = (column, value) => (column.texts ? column.texts[Math.round(value)] ?? "" : Number.isNaN(value) ? "-" : number(value / column.size));
  // Round steps, as many as there is space for.
  const roundValues = (lo, hi, most) => {
    const rough = (hi - lo) / Math.max(most, 1);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((one) => one * power >= rough * 0.999);
    const found = [];
    for (let n = Math.ceil(lo / step); n * step <= hi * (1 + 1e-12) && found.length < 50; n++) found.push(rounded(n * step, 12));
    return found;
  };
  // Rising values, written as the ticks of every page.
  const labelled = (values, power = 0) => {
    const step = values.slice(1).reduce((least, value, before) => Math.min(least, value - values[before]), Infinity);
    const texts = ticks(values, Number.isFinite(step) ? step : Math.abs(values[0]), { power });
    return values.map((value, place) => [value, texts[place]]);
  };
  const ticksOf = (column, most) => {
    if (!column.texts) return labelled(column.list || roundValues(column.lo, column.hi, most), column.shown?.power);
    const every = Math.ceil(column.texts.length / Math.max(most, 1));
    return column.texts.map((text, place) => [place, text.length > 9 ? text.slice(0, 8) + "…" : text]).filter(([place]) => place % every === 0);
  };

  // ---- Selection ----
  const selected = new Uint8Array(rows);
  const isShown = new Array(variants).fill(true);
  const classes = data.classes.length;
  const counts = new Uint32Array(variants * classes);
  const isAny = () => isShown.includes(false) || columns.some((column) => column.range);
  const select = () => {
    selected.fill(1);
    if (isShown.includes(false)) for (let i = 0; i < rows; i++) if (!isShown[variantOf[i]]) selected[i] = 0;
    for (const { range, values } of columns) {
      if (!range) continue;
      const [from, to] = range;
      for (let i = 0; i < rows; i++) if (!(values[i] >= from && values[i] <= to)) selected[i] = 0;
    }
    counts.fill(0);
    for (let i = 0; i < rows; i++) counts[variantOf[i] * classes + classOf[i]] += selected[i];
  };
  const rangeShown = (column) => {
    const [from, to] = column.range.map((value) => value / column.size);
    const unit = column.shown.unit && " " + column.shown.unit;
    if (column.texts) return column.texts.filter((_, place) => place >= from && place <= to).join(", ") || "none";
    return (from === -Infinity ? `up to ${number(to)}` : to === Infinity ? `from ${number(from)}` : `${number(from)} to ${number(to)}`) + unit;
  };
  // Variants differ by the dashes of their lines, classes by the shapes of their points, both by colour too.
  const SHAPES = { pass: "■", fail: "✕", diverged: "✚", undecided: "□", lost: "◆", vacuous: "▲", "not-possible": "▬" };
  const addSwatch = (label, name) => { make("span", SHAPES[name], label, { className: "shape", ariaHidden: "true" }).dataset.class = name; };
  const legend = variants > 1 ? data.variants.map((name, place) => {
    const label = make("label", undefined, byId("legend"));
    const box = make("input", undefined, label, { type: "checkbox", checked: true, onchange: () => { isShown[place] = box.checked; later(); } });
    label.append(lineOf(24, DASHES[place % 8], place % 8), name + " ");
    return { box, share: make("span", "", label) };
  }) : [];
  const classLegend = data.classes.map((name) => {
    const label = make("span", undefined, byId("legend"));
    addSwatch(label, name);
    return { label, share: make("span", "", label) };
  });

  // Says in words what is selected.
  const tell = () => {
    const perClass = data.classes.map((_, place) => data.variants.reduce((sum, _, variant) => sum + counts[variant * classes + place], 0));
    const of = perClass.reduce((sum, count) => sum + count);
    const words = isAny() ? `of ${of} selected, ${percent(perClass[0], of)} ${data.words[0]}` : `of all ${rows} cases, ${percent(perClass[0], rows)} ${data.words[0]}`;
    byId("count").textContent = words;
    byId("clear").disabled = !isAny();
    legend.forEach(({ box, share }, variant) => {
      const mine = counts.subarray(variant * classes, (variant + 1) * classes).reduce((sum, count) => sum + count);
      box.checked = isShown[variant];
      share.textContent = `${percent(counts[variant * classes], mine)} of ${mine} ${data.words[0]}`;
    });
    classLegend.forEach(({ label, share }, place) => {
      label.hidden = !classOf.includes(place);
      share.textContent = `${data.words[place]} ${perClass[place]}`;
    });
    byId("chips").replaceChildren(...columns.filter((column) => column.range).map((column) => {
      const onclick = () => { column.range = null; later(); };
      return make("button", `${column.name} ${rangeShown(column)} ×`, null, { type: "button", title: "Remove this range", onclick });
    }));
    clearTimeout(tell.timer);
    // Words for those who do not see, once the hand rests.
    tell.timer = setTimeout(() => { byId("status").textContent = words; }, 400);
  };
  byId("clear").addEventListener("click", () => {
    isShown.fill(true);
    for (const column of columns) column.range = null;
    later();
  });

  // ---- Plots ----
  const RIGHT = 10, TOP = 8, BOTTOM = 22;
  // Width left of every plot: that of the widest label beside one, so that plots above each other have one axis below.
  let leftWidth = 50;
  const plots = [];
  let colours = {};
  const readColours = () => {
    const style = getComputedStyle(root);
    const of = (name) => style.getPropertyValue("--" + name).trim();
    const hex = (name) => of(name).match(/[0-9a-f]{2}/gi).map((pair) => parseInt(pair, 16));
    // Pixels as one number each, in the byte order of this machine.
    const pixels = (names) => new Uint32Array(Uint8Array.from(names.flatMap((name) => [...hex(name), 255])).buffer);
    const runs = data.variants.map((_, place) => "c" + (place % 8));
    colours = {
      ink: of("ink"), soft: of("soft"), grid: of("grid"), link: of("link"), pale: of("pale"), paper: of("paper"), pass: of("class-pass"), fail: of("class-fail"),
      runs: runs.map(of), palePixel: pixels(["pale"])[0],
      pixels: { class: pixels(data.classes.map((name) => "class-" + name)), variant: pixels(runs) },
    };
  };
  // Rare classes are drawn over frequent ones: pass, not possible, vacuous, undecided, lost, fail, diverged.
  const rank = [0, 5, 6, 3, 4, 2, 1];
  const byClass = Uint32Array.from({ length: rows }, (_, row) => row).sort((a, b) => rank[classOf[a]] - rank[classOf[b]] || a - b);
  const natural = byClass.slice().sort();
  const seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const plot = plots.find((one) => one.figure === target);
      plot.isSeen = isIntersecting;
      if (isIntersecting && plot.isStale) redraw(plot);
    }
  }, { rootMargin: "150px" });
  const addPlot = (inside, label, height, x, y, draw, isBrushed = true) => {
    const figure = make("figure", undefined, inside, { className: "plot" });
    make("figcaption", label, figure);
    const canvas = make("canvas", undefined, figure, { role: "img", ariaLabel: label, style: `height: ${height}px` });
    const plot = { figure, canvas, height, x, y, draw, isStale: true, isSeen: false, at: null };
    plots.push(plot);
    seen.observe(figure);
    if (isBrushed) brushes(plot);
    return plot;
  };
  // Gives the canvas the pixels of its place; without a change of size this does nothing.
  const fit = (plot) => {
    const [ratio, width] = [Math.min(devicePixelRatio || 1, 2), Math.max(plot.canvas.clientWidth, 120)];
    if (plot.width === width && plot.ratio === ratio && plot.left === leftWidth) return;
    Object.assign(plot, { width, ratio, left: leftWidth, at: null, inner: width - leftWidth - RIGHT, tall: plot.height - TOP - (plot.x.title ? BOTTOM + 14 : BOTTOM) });
    Object.assign(plot.canvas, { width: Math.round(width * ratio), height: Math.round(plot.height * ratio) });
    plot.context = plot.canvas.getContext("2d");
  };
  const redraw = (plot) => {
    fit(plot);
    const { context, ratio } = plot;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, plot.width, plot.height);
    context.font = "11px system-ui, sans-serif";
    if (plot.x.isUndrawn || plot.y?.isUndrawn) nothing(plot, context);
    else plot.draw(plot, context);
    plot.isStale = false;
    if (plot.left === leftWidth) return;
    // A label was wider than the place for it.
    root.style.setProperty("--axis", `${leftWidth}px`);
    for (const one of plots) one.isStale = true;
    requestAnimationFrame(() => drawSeen());
  };
  // What is not in view is drawn one after another, so that the page answers meanwhile, and a print or a picture of
  // all of it is whole.
  const drawNext = () => {
    const next = plots.find((plot) => plot.isStale && !plot.isSeen);
    if (!next) {
      root.dataset.drawn = "true";
      return;
    }
    redraw(next);
    drawNext.timer = setTimeout(drawNext, 5);
  };
  const inside = ({ lo, hi }, value) => Math.min(Math.max((value - lo) / (hi - lo), 0), 1);
  const across = (plot, value) => plot.left + plot.inner * inside(plot.x, value);
  const upwards = (plot, value) => TOP + plot.tall * (1 - inside(plot.y, value));
  const line = (context, colour, x1, y1, x2, y2) => {
    context.strokeStyle = colour;
    context.stroke(new Path2D(`M${x1} ${y1}L${x2} ${y2}`));
  };
  const axisBelow = (plot, context) => {
    const bottom = TOP + plot.tall;
    Object.assign(context, { fillStyle: colours.soft, textBaseline: "top", textAlign: "center", lineWidth: 1 });
    for (const [value, text] of ticksOf(plot.x, plot.inner / 55)) {
      const x = across(plot, value);
      line(context, colours.grid, x, TOP, x, bottom);
      context.fillText(text, Math.min(x, plot.width - context.measureText(text).width / 2 - 1), bottom + 5);
    }
    if (plot.x.title) context.fillText(plot.x.title, plot.left + plot.inner / 2, bottom + 19);
    line(context, colours.soft, plot.left, bottom + 0.5, plot.left + plot.inner, bottom + 0.5);
  };
  const axisLeft = (plot, context, marks) => {
    Object.assign(context, { fillStyle: colours.soft, textBaseline: "middle", textAlign: "right" });
    for (const [y, text] of marks) {
      leftWidth = Math.max(leftWidth, Math.ceil(context.measureText(text).width) + 6);
      line(context, colours.grid, plot.left, y, plot.left + plot.inner, y);
      context.fillText(text, plot.left - 5, Math.max(y, TOP + 2));
    }
  };
  const zero = (context, ...ends) => {
    context.setLineDash([5, 3]);
    line(context, colours.ink, ...ends);
    context.setLineDash([]);
  };
  // Frames the selected range.
  const frame = (plot, context) => {
    const [ofX, ofY] = [plot.x.range, plot.y?.range];
    if (!ofX && !ofY) return;
    const [left, right] = ofX ? ofX.map((value) => across(plot, value)) : [plot.left, plot.left + plot.inner];
    const [bottom, top] = ofY ? ofY.map((value) => upwards(plot, value)) : [TOP + plot.tall, TOP];
    Object.assign(context, { fillStyle: colours.link, strokeStyle: colours.link, globalAlpha: 0.12 });
    context.fillRect(left, top, right - left, bottom - top);
    context.globalAlpha = 1;
    context.strokeRect(left + 0.5, top + 0.5, Math.max(right - left - 1, 1), Math.max(bottom - top - 1, 1));
  };

  // ---- Histograms ----
  let heights = "root";
  const raised = { root: Math.sqrt, linear: (count) => count, log: Math.log1p };
  const marksOf = (plot, most) => {
    const candidates = heights === "linear" ? roundValues(0, most, plot.tall / 30) : [0, most, ...[1e6, 1e5, 1e4, 1e3, 100, 10, 1].filter((one) => one < most)];
    const marks = [];
    for (const count of candidates) {
      const y = TOP + plot.tall * (1 - raised[heights](count) / raised[heights](most));
      if (marks.every(([other]) => Math.abs(other - y) > 13)) marks.push([y, String(count)]);
    }
    return marks;
  };
  const nothing = (plot, context) => {
    Object.assign(context, { fillStyle: colours.soft, textAlign: "center" });
    context.fillText("no case has a value", plot.width / 2, plot.height / 2);
  };

  // Stripes of the colour of failed cases.
  const hatch = (context) => {
    if (hatch.colour !== colours.fail) {
      const tile = Object.assign(document.createElement("canvas"), { width: 6, height: 6 });
      const ink = tile.getContext("2d");
      Object.assign(ink, { fillStyle: colours.fail, strokeStyle: colours.paper, lineWidth: 1 });
      ink.fillRect(0, 0, 6, 6);
      ink.globalAlpha = 0.45;
      ink.stroke(new Path2D("M-1 7L7 -1M-1 1L1 -1M5 7L7 5"));
      Object.assign(hatch, { colour: colours.fail, tile });
    }
    return context.createPattern(hatch.tile, "repeat");
  };
  // Of a varied value: all cases pale, the selected ones that pass beneath those that do not.
  const drawVaried = (plot, context) => {
    const { x: column } = plot;
    const { binOf, bins, all, chosen = (column.chosen = new Uint32Array(bins)), passes = (column.passes = new Uint32Array(bins)) } = column;
    chosen.fill(0);
    passes.fill(0);
    for (let i = 0; i < rows; i++) {
      if (selected[i] === 0 || binOf[i] === NO_BIN) continue;
      chosen[binOf[i]] += 1;
      if (classOf[i] === 0) passes[binOf[i]] += 1;
    }
    const most = all.reduce((a, b) => Math.max(a, b), 1);
    const wide = plot.inner / bins;
    const high = (count) => (plot.tall * raised[heights](count)) / raised[heights](most);
    axisBelow(plot, context);
    axisLeft(plot, context, marksOf(plot, most));
    for (let bin = 0; bin < bins; bin++) {
      const bar = (colour, tall) => {
        context.fillStyle = colour;
        context.fillRect(plot.left + bin * wide, TOP + plot.tall - tall, wide - (wide > 5 ? 1 : 0), tall);
      };
      bar(colours.pale, high(all[bin]));
      if (chosen[bin] === 0) continue;
      bar(hatch(context), high(chosen[bin]));
      // The height of the stack is the count's; within it the parts are shares, whatever the heights are.
      bar(colours.pass, (high(chosen[bin]) * passes[bin]) / chosen[bin]);
    }
    frame(plot, context);
  };

  // Of a margin or metric: an outline for each variant over each other.
  const drawOutcome = (plot, context) => {
    const { x: column } = plot;
    const { binOf, bins, perVariant = (column.perVariant = new Uint32Array(bins * variants)) } = column;
    perVariant.fill(0);
    for (let i = 0; i < rows; i++) if (selected[i] === 1 && binOf[i] !== NO_BIN) perVariant[variantOf[i] * bins + binOf[i]] += 1;
    const most = perVariant.reduce((a, b) => Math.max(a, b), 1);
    const wide = plot.inner / bins;
    const bottom = TOP + plot.tall;
    axisBelow(plot, context);
    axisLeft(plot, context, marksOf(plot, most));
    for (let variant = 0; variant < variants; variant++) {
      const mine = perVariant.subarray(variant * bins, (variant + 1) * bins);
      if (mine.every((count) => count === 0)) continue;
      const outline = new Path2D(`M${plot.left} ${bottom}`);
      for (let bin = 0; bin < bins; bin++) {
        const top = bottom - (plot.tall * raised[heights](mine[bin])) / raised[heights](most);
        outline.lineTo(plot.left + bin * wide, top);
        outline.lineTo(plot.left + (bin + 1) * wide, top);
      }
      outline.lineTo(plot.left + plot.inner, bottom);
      Object.assign(context, { fillStyle: colours.runs[variant], strokeStyle: colours.runs[variant], lineWidth: 1.5, globalAlpha: 0.15 });
      context.fill(outline);
      context.globalAlpha = 1;
      context.setLineDash(DASHES[variant % 8]);
      context.stroke(outline);
      context.setLineDash([]);
    }
    if (column.lo <= 0 && column.hi >= 0 && column.role === "margin") zero(context, across(plot, 0), TOP, across(plot, 0), bottom);
    frame(plot, context);
  };

  // ---- Plots of points ----
  let [colourBy, marked] = ["class", undefined]; // marked: the case that is shown in words
  // Pixels that points are drawn into, by size; plots of one size share them.
  const buffers = new Map();
  const bufferOf = (wide, tall, key = wide + "x" + tall) => buffers.get(key) || buffers.set(key, new ImageData(wide, tall)).get(key);
  // Sides of points of each colour, in pixels: less where they are many, so that rare ones are seen among them.
  const LARGEST = 6;
  const sizesOf = (plot, area) => {
    const [codes, palette] = [colourBy === "class" ? classOf : variantOf, colours.pixels[colourBy]];
    const many = new Uint32Array(palette.length);
    for (let i = 0; i < rows; i++) if (plot.variant === undefined || variantOf[i] === plot.variant) many[codes[i]] += 1;
    return Array.from(many, (count) => Math.round(Math.min(Math.max(Math.sqrt((0.1 * area) / count), plot.ratio), LARGEST * plot.ratio)));
  };
  // Where each case is drawn, as the place of its first pixel; -1 where it has no value.
  const place = (plot, wide, tall, size) => {
    const { x, y, variant } = plot;
    plot.at = new Int32Array(rows);
    const [toX, toY] = [(wide - size) / (x.hi - x.lo), (tall - size) / (y.hi - y.lo)];
    for (let i = 0; i < rows; i++) {
      // Values of a list are spread a little, always the same way: else their points hide each other.
      const left = (x.values[i] + x.spread * (2 * ((i * 0.6180339887498949) % 1) - 1) - x.lo) * toX;
      const up = (y.values[i] + y.spread * (2 * ((i * 0.7548776662466927) % 1) - 1) - y.lo) * toY;
      const column = Math.round(Math.min(Math.max(left, 0), wide - size));
      const row = Math.round(tall - size - Math.min(Math.max(up, 0), tall - size));
      plot.at[i] = Number.isNaN(left) || Number.isNaN(up) || (variant !== undefined && variantOf[i] !== variant) ? -1 : row * wide + column;
    }
  };
  // Shapes by the order of classes, or of variants: a square, a cross, a plus, a frame, a diamond, a triangle, a bar; each
  // covers a place of a point's box or not.
  const covers = [
    (x, y, size) => Math.min(x, y) >= size * 0.12 && Math.max(x, y) < size * 0.88,
    (x, y, size, wide) => Math.abs(x - y) < wide || Math.abs(x + y + 1 - size) < wide,
    (x, y, size, wide) => Math.abs(x + 0.5 - size / 2) <= wide / 1.5 || Math.abs(y + 0.5 - size / 2) <= wide / 1.5,
    (x, y, size, wide) => Math.min(x, y, size - 1 - x, size - 1 - y) < wide,
    (x, y, size) => Math.abs(x + 0.5 - size / 2) + Math.abs(y + 0.5 - size / 2) <= size / 2,
    (x, y, size) => Math.abs(x + 0.5 - size / 2) <= (y + 1) / 2,
    (x, y, size, wide) => Math.abs(y + 0.5 - size / 2) <= wide,
  ];
  const SHAPE_OF_CLASS = { pass: 0, fail: 1, diverged: 2, undecided: 3, lost: 4, vacuous: 5, "not-possible": 6 };
  // The places of a shape from its first pixel, for a row of pixels so wide; small points are squares.
  const stamps = new Map();
  const stampOf = (nth, size, wide, ratio, key = [nth, size, wide].join()) => {
    if (stamps.has(key)) return stamps.get(key);
    const offsets = [];
    for (let y = 0; y < size; y++) for (let x = 0; x < size; x++) if (size < 4 || covers[nth](x, y, size, Math.max(1, 0.8 * ratio))) offsets.push(y * wide + x);
    return stamps.set(key, offsets).get(key);
  };
  const paint = (pixels, offsets, at, colour) => {
    for (const offset of offsets) pixels[at + offset] = colour;
  };
  const drawPoints = (plot, context) => {
    const { x, y, ratio } = plot;
    const [wide, tall, largest] = [Math.round(plot.inner * ratio), Math.round(plot.tall * ratio), Math.round(LARGEST * ratio)];
    if (!plot.at) place(plot, wide, tall, largest);
    const { at } = plot;
    const image = bufferOf(wide, tall);
    const pixels = new Uint32Array(image.data.buffer).fill(0);
    const [order, codes] = colourBy === "class" ? [byClass, classOf] : [natural, variantOf];
    const palette = colours.pixels[colourBy];
    const sizes = sizesOf(plot, wide * tall);
    const shifts = sizes.map((size) => Math.floor((largest - size) / 2) * (wide + 1));
    const of = sizes.map((size, code) => stampOf(colourBy === "class" ? SHAPE_OF_CLASS[data.classes[code]] : code % covers.length, size, wide, ratio));
    if (isAny()) for (let i = 0; i < rows; i++) if (selected[i] === 0 && at[i] >= 0) paint(pixels, of[codes[i]], at[i] + shifts[codes[i]], colours.palePixel);
    for (let n = 0; n < rows; n++) {
      const i = order[n];
      if (selected[i] === 1 && at[i] >= 0) paint(pixels, of[codes[i]], at[i] + shifts[codes[i]], palette[codes[i]]);
    }
    context.putImageData(image, Math.round(plot.left * ratio), Math.round(TOP * ratio));
    axisBelow(plot, context);
    axisLeft(plot, context, ticksOf(y, plot.tall / 30).map(([value, text]) => [upwards(plot, value), text]));
    if (y.role === "margin" && y.lo <= 0 && y.hi >= 0) zero(context, plot.left, upwards(plot, 0), plot.left + plot.inner, upwards(plot, 0));
    if (marked !== undefined && at[marked] >= 0) {
      const ring = new Path2D();
      ring.arc(plot.left + ((at[marked] % wide) + largest / 2) / ratio, TOP + (Math.floor(at[marked] / wide) + largest / 2) / ratio, 6, 0, 7);
      Object.assign(context, { strokeStyle: colours.ink, lineWidth: 2 });
      context.stroke(ring);
    }
    frame(plot, context);
  };
  const nearest = (plot, x, y) => {
    const [wide, size] = [Math.round(plot.inner * plot.ratio), Math.round(LARGEST * plot.ratio)];
    const [left, top] = [(x - plot.left) * plot.ratio - size / 2, (y - TOP) * plot.ratio - size / 2];
    let [found, best] = [-1, (12 * plot.ratio) ** 2];
    for (const i of colourBy === "class" ? byClass : natural) {
      if (selected[i] === 0 || plot.at[i] < 0) continue;
      const far = ((plot.at[i] % wide) - left) ** 2 + (Math.floor(plot.at[i] / wide) - top) ** 2;
      // Of points at one place the one drawn last, which is the one that is seen.
      if (far <= best) [found, best] = [i, far];
    }
    return found;
  };

  // ---- Curves over time ----
  const CURVES = 8; // from the least to the greatest: an outer pair, two bands, the median's two
  const SHADES = [0.12, 0.25, 0.4]; // of the bands, from the outside
  // The curves of each signal, for each variant.
  const timed = (envelopes) => envelopes.signals.map(([name, unit], place) => {
    const read = (text) => new Float32Array(bytesOf(text).buffer);
    const perVariant = envelopes.variants.map((signals) => read(signals[place]));
    const worst = envelopes.worst.map((one) => ({ ...one, curve: read(one.signals[place]) }));
    const largest = perVariant.reduce((most, curves) => curves.reduce((most, value) => (Number.isFinite(value) ? Math.max(most, Math.abs(value)) : most), most), 0);
    const display = shownUnit(unit, largest);
    const label = envelopes.words[place] + unitOf(display.unit);
    return { label, name, power: display.power, spec: { unit, shown: display }, perVariant, worst, all: scaleOf(perVariant, envelopes.bins), each: perVariant.map((one) => scaleOf([one], envelopes.bins)) };
  });
  // A range that a few far values do not stretch.
  const scaleOf = (curves, bins) => {
    const ends = (from, to) => {
      const values = curves.flatMap((all) => [from, to].flatMap((curve) => [...all.subarray(curve * bins, (curve + 1) * bins)])).filter(Number.isFinite);
      return values.reduce(([lo, hi], value) => [Math.min(lo, value), Math.max(hi, value)], [Infinity, -Infinity]);
    };
    const [all, most] = [ends(0, CURVES - 1), ends(1, CURVES - 2)];
    const far = 1.5 * (most[1] - most[0]);
    let [lo, hi] = most[1] >= most[0] ? [Math.max(all[0], most[0] - far), Math.min(all[1], most[1] + far)] : all;
    if (lo === hi) [lo, hi] = [lo - (Math.abs(lo) || 1) / 2, hi + (Math.abs(hi) || 1) / 2];
    const space = 0.04 * (hi - lo);
    return { lo: lo - space, hi: hi + space, range: null, isUndrawn: !Number.isFinite(lo) };
  };
  const drawTimed = (plot, context) => {
    if (!plot.curves.some(Number.isFinite)) return nothing(plot, context);
    const { bins } = data.envelopes;
    const colour = colours.runs[plot.variant];
    const at = (bin) => plot.left + (plot.inner * (bin + 0.5)) / bins;
    const up = (value) => TOP + plot.tall * (1 - (value - plot.y.lo) / (plot.y.hi - plot.y.lo));
    axisBelow(plot, context);
    axisLeft(plot, context, labelled(roundValues(plot.y.lo, plot.y.hi, plot.tall / 30), plot.power).map(([value, text]) => [up(value), text]));
    context.save();
    context.beginPath();
    context.rect(plot.left, TOP, plot.inner, plot.tall);
    context.clip();
    // Between two curves, in as many pieces as there are gaps in time.
    const between = (low, high, alpha, isFilled) => {
      Object.assign(context, { fillStyle: colour, strokeStyle: isFilled ? colour : colours.ink, lineWidth: 1.5 });
      for (let from = 0; from < bins; from++) {
        if (!Number.isFinite(low[from])) continue;
        let to = from;
        while (to < bins && Number.isFinite(low[to])) to++;
        const [there, back] = [new Path2D(), new Path2D()];
        for (let bin = from; bin < to; bin++) there.lineTo(at(bin), up(high[bin]));
        for (let bin = to - 1; bin >= from; bin--) back.lineTo(at(bin), up(low[bin]));
        const area = new Path2D(there);
        for (let bin = to - 1; bin >= from; bin--) area.lineTo(at(bin), up(low[bin]));
        area.closePath();
        context.globalAlpha = alpha;
        if (isFilled) context.fill(area);
        context.globalAlpha = 1;
        // A band of no height is a line all the same.
        if (!isFilled || alpha === 1) [there, back].forEach((edge) => context.stroke(edge));
        from = to;
      }
    };
    const curve = (all, place) => all.subarray(place * bins, (place + 1) * bins);
    SHADES.forEach((shade, n) => between(curve(plot.curves, n), curve(plot.curves, CURVES - 1 - n), shade, true));
    between(curve(plot.curves, 3), curve(plot.curves, 4), 1, true);
    const worst = plot.worst.find((one) => one.variant === plot.variant && one.requirement === byId("worst").value);
    if (worst) between(curve(worst.curve, 0), curve(worst.curve, 1), 0, false);
    context.restore();
    plot.line.textContent = worst ? `, line: case ${worst.case}` : "";
  };
  // The range of all cases and the median under the pointer.
  const readTimed = (plot, x) => {
    const { bins, bin_s } = data.envelopes;
    const bin = Math.min(Math.max(Math.floor(((x - plot.left) / plot.inner) * bins), 0), bins - 1);
    const between = (low, high) => reachShown(plot.curves[low * bins + bin], plot.curves[high * bins + bin], plot.spec);
    const all = between(0, CURVES - 1);
    return all ? `${seconds((bin + 0.5) * bin_s)} s: ${all}, median ${between(3, 4)}` : "";
  };
  const addTimed = (envelopes) => {
    const names = [...new Set(envelopes.worst.map((one) => one.requirement))];
    for (const name of ["", ...names]) make("option", name || "nothing", byId("worst"), { value: name });
    byId("worst").value = names[0] ?? "";
    byId("worst").addEventListener("change", () => drawSeen(true));
    byId("same").parentElement.hidden = variants === 1;
    byId("same").addEventListener("change", ({ target }) => {
      for (const plot of plots) if (plot.scales) plot.y = plot.scales[target.checked ? 0 : 1];
      drawSeen(true);
    });
    const x = { lo: 0, hi: envelopes.bins * envelopes.bin_s, title: "Time [s]", range: null, isUndrawn: false };
    // Variants of a signal stand beside each other.
    const all = byId("timed");
    const below = variants > 1 ? null : make("div", undefined, all, { className: "plots" });
    for (const { label, name, power, spec, perVariant, worst, all: shared, each } of timed(envelopes)) {
      if (!below) make("code", name, make("h4", label + " ", all), { className: "name" });
      const beside = below || make("div", undefined, all, { className: "plots" });
      perVariant.forEach((curves, variant) => {
        const plot = addPlot(beside, below ? label : data.variants[variant], 170, x, shared, drawTimed, false);
        plot.canvas.ariaLabel = `${label} over time in s: ${data.variants[variant]}`;
        const line = make("span", "", plot.figure.firstChild);
        const reading = make("div", "", plot.figure, { className: "legend" });
        plot.canvas.addEventListener("pointermove", ({ offsetX }) => { reading.textContent = readTimed(plot, offsetX); });
        plot.canvas.addEventListener("pointerleave", () => { reading.textContent = ""; });
        if (below) make("code", name, plot.figure.firstChild, { className: "name" }).before(" ");
        Object.assign(plot, { curves, power, spec, worst, line, variant, scales: [shared, each[variant]] });
      });
    }
  };

  // ---- One case ----
  const showCase = (row) => {
    const box = byId("case");
    box.hidden = false;
    box.replaceChildren();
    const head = make("p", `Case ${caseOf[row]}: ${data.variants[variantOf[row]]}, `, box);
    make("span", data.words[classOf[row]], head, { className: "badge" }).dataset.verdict = data.classes[classOf[row]];
    byId("status").textContent = head.textContent;
    make("button", "Close", head, { type: "button", onclick: () => { box.hidden = true; mark(undefined); } });
    addCopy(make("code", data.command + caseOf[row], make("p", undefined, box), { className: "command" }));
    const list = make("dl", undefined, box);
    for (const column of columns) {
      const pair = make("div", undefined, list);
      make("dt", column.role === "margin" ? "margin of " + column.label : column.label, pair);
      make("dd", valueShown(column, column.values[row]), pair);
    }
    byId("number").value = caseOf[row];
    mark(row);
  };
  const mark = (row) => { marked = row; drawSeen(true); };
  byId("find").addEventListener("submit", (event) => {
    event.preventDefault();
    const row = caseOf.indexOf(byId("number").valueAsNumber);
    if (row >= 0) return showCase(row);
    byId("case").hidden = false;
    byId("case").textContent = `There is no case ${byId("number").value} on this page.`;
  });

  // ---- Brushes ----
  // A range of a column between two places in a plot, in numbers as short as the plot can tell apart.
  const between = (column, from, to, length) => {
    const [low, high] = from < to ? [from, to] : [to, from];
    const step = 10 ** Math.floor(Math.log10((column.hi - column.lo) / 500));
    const value = (share) => rounded(Math.round((column.lo + (column.hi - column.lo) * share) / step) * step, 12);
    const range = [low <= 1 ? -Infinity : value(low / length), high >= length - 1 ? Infinity : value(high / length)];
    return range.some(Number.isFinite) ? range : null;
  };
  const brushes = (plot) => {
    const { canvas } = plot;
    let start = null;
    canvas.addEventListener("pointerdown", ({ button, pointerId, offsetX, offsetY }) => {
      if (button !== 0) return;
      start = { fromX: offsetX, fromY: offsetY, range: plot.x.range, isDrag: false };
      canvas.setPointerCapture(pointerId);
    });
    canvas.addEventListener("pointermove", ({ offsetX: x, offsetY: y, pointerType }) => {
      if (!start) return;
      const { fromX, fromY } = start;
      if (!start.isDrag && Math.abs(x - fromX) < 4 && Math.abs(y - fromY) < 4) return;
      start.isDrag = true;
      plot.x.range = between(plot.x, fromX - plot.left, x - plot.left, plot.inner);
      // With a finger, which scrolls the page upwards and downwards, only across.
      if (plot.y && pointerType !== "touch") plot.y.range = between(plot.y, TOP + plot.tall - fromY, TOP + plot.tall - y, plot.tall);
      later();
    });
    canvas.addEventListener("pointerup", ({ offsetX, offsetY }) => {
      const isClick = start && !start.isDrag;
      start = null;
      if (!isClick) return;
      const row = plot.at ? nearest(plot, offsetX, offsetY) : -1;
      if (row >= 0) return showCase(row);
      if (!plot.y) plot.x.range = null;
      later();
    });
    // A finger that scrolls after all.
    canvas.addEventListener("pointercancel", () => {
      if (start) plot.x.range = start.range;
      start = null;
      later();
    });
  };
  // The range of a varied value as numbers, for whoever has no pointer or wants it exact.
  const rangeFields = (plot) => {
    const column = plot.x;
    const line = make("div", undefined, plot.figure, { className: "range" });
    if (column.texts) {
      const onchange = () => { column.range = choice.value === "" ? null : [+choice.value - 0.4, +choice.value + 0.4]; later(); };
      const choice = make("select", undefined, line, { ariaLabel: column.name, onchange });
      for (const [place, text] of [["", "any"], ...column.texts.entries()]) make("option", text, choice, { value: place });
      plot.tellRange = () => { if (!column.range) choice.value = ""; };
      return;
    }
    const fields = ["from", "to"].map((word) => {
      const onchange = () => {
        const range = fields.map((one, end) => (one.value === "" ? [-Infinity, Infinity][end] : one.valueAsNumber));
        column.range = range.some(Number.isFinite) ? range : null;
        later();
      };
      return make("input", undefined, line, { type: "number", step: "any", placeholder: word, ariaLabel: `${column.name} ${word}`, onchange });
    });
    plot.tellRange = () => fields.forEach((field, end) => {
      const value = column.range ? column.range[end] : Infinity;
      if (field !== document.activeElement) field.value = Number.isFinite(value) ? value : "";
    });
  };

  // ---- All of it ----
  // Draws what is in view and is not as it should be, or everything in view.
  const drawSeen = (isAll) => {
    if (isAll) for (const plot of plots) plot.isStale = true;
    plots.filter((plot) => plot.isSeen && plot.isStale).forEach(redraw);
    clearTimeout(drawNext.timer);
    drawNext.timer = setTimeout(drawNext, 250);
  };
  let isDue = false;
  const later = () => {
    if (isDue) return;
    isDue = true;
    requestAnimationFrame(() => {
      isDue = false;
      const start = performance.now();
      select();
      tell();
      for (const plot of plots) plot.tellRange?.();
      drawSeen(true);
      // For the browser's own tools, which show how long a selection takes.
      performance.clearMeasures("select");
      performance.measure("select", { start });
    });
  };
  const drawAgain = () => {
    readColours();
    drawSeen(true);
  };
  for (const column of varied) rangeFields(addPlot(byId("varied"), column.label, 150, column, null, drawVaried));
  for (const column of outcomes) addPlot(byId("outcomes"), (column.role === "margin" ? "margin of " : "") + column.label, 170, column, null, drawOutcome);
  if (data.envelopes) addTimed(data.envelopes);
  byId("map").hidden = varied.length < 2;
  if (varied.length > 1) {
    const [across, up] = [byId("across"), byId("up")];
    for (const choice of [across, up]) varied.forEach(({ name }, value) => make("option", name, choice, { value }));
    [across.value, up.value] = data.axes;
    // A map for each variant: all have the same draws, so in one map they would hide each other.
    const maps = data.variants.map((name, variant) => Object.assign(addPlot(byId("mapped"), "", 300, varied[data.axes[0]], varied[data.axes[1]], drawPoints), { name, variant }));
    const choose = () => {
      for (const map of maps) {
        Object.assign(map, { x: varied[across.value], y: varied[up.value], at: null, isStale: true });
        const label = `${map.name}: ${map.y.label} over ${map.x.label}`;
        map.figure.firstChild.textContent = label;
        map.canvas.ariaLabel = label;
      }
      drawSeen();
    };
    for (const choice of [across, up]) choice.addEventListener("change", choose);
    choose();
  }
  for (const margin of margins) {
    make("h3", `Margin of ${margin.label} over varied values`, byId("scatters"));
    const below = make("div", undefined, byId("scatters"), { className: "plots" });
    for (const column of varied) addPlot(below, column.label, 200, column, margin, drawPoints);
  }
  byId("colour").addEventListener("change", ({ target }) => { colourBy = target.value; drawAgain(); });
  byId("heights").addEventListener("change", ({ target }) => { heights = target.value; drawAgain(); });
  byId("theme").addEventListener("click", drawAgain);
  let width = 0;
  new ResizeObserver(([{ contentRect }]) => {
    if (contentRect.width !== width) requestAnimationFrame(drawAgain);
    width = contentRect.width;
  }).observe(byId("plots"));
  // Paper is light, and has plots that were not looked at.
  addEventListener("beforeprint", () => { showTheme(false); drawAgain(); plots.forEach(redraw); });
  readColours();
  later();
})();

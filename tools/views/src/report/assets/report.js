"use strict";
// Draws the plots of a report. Signals are envelopes over one grid of simulated time: the least and the
// greatest value of each bucket, which may be a single step. Both are drawn, so no spike is ever hidden.
(() => {
  const data = JSON.parse(byId("data").textContent);

  // ---- Numbers ----

  const start = new Float64Array(bytesOf(data.grid).buffer);
  const buckets = start.length;

  const cache = new Map();
  const numbersOf = (text, isDouble) => new (isDouble ? Float64Array : Float32Array)(bytesOf(text).buffer);
  // Numbers of equal neighbours, written as pairs of number and how often it follows.
  const countsOf = (pairs) => Uint32Array.from(pairs.flatMap(([count, times]) => new Array(times).fill(count)));
  // Records in each bucket, of each run and of a baseline, which is called by its name.
  const BASELINE = "baseline";
  const counts = new Map([...data.runs.entries(), ...(data.band ? [[BASELINE, data.band]] : [])].map(([run, one]) => [run, countsOf(one.counts)]));
  // Means of the buckets, and means of the squares, from where they are between the least and the greatest value.
  const PARTS = 65534;
  const withMeans = (values, text) => {
    const { least, greatest } = values;
    const parts = new Uint16Array(bytesOf(text ?? "").buffer);
    const mean = Float64Array.from(least);
    const square = mean.map((value) => value * value);
    for (let i = 0, at = 0; i < buckets; i++) {
      const height = greatest[i] - least[i];
      if (!(height > 0)) continue;
      const [part, spread] = [parts[at++], parts[at++]];
      mean[i] = part > PARTS ? NaN : least[i] + (height * part) / PARTS;
      square[i] = mean[i] ** 2 + ((height / 2) * (spread / PARTS)) ** 2;
    }
    return { ...values, mean, square };
  };
  // The envelope of a run's signal, or undefined if the run has none.
  const signalOf = (run, name) => {
    const key = run + " " + name;
    if (cache.has(key)) return cache.get(key);
    const written = (run === BASELINE ? data.band : data.runs[run]).signals[name];
    let found;
    if (written && written.same !== undefined) {
      found = signalOf(run, written.same);
    } else if (written) {
      const { is_double, value } = written;
      const own = written.missing ? countsOf(written.missing).map((missing, i) => counts.get(run)[i] - missing) : counts.get(run);
      const least = value !== undefined ? new Float64Array(buckets).fill(value) : numbersOf(written.least, is_double);
      // A bucket of one value has it as both.
      const wide = written.greatest ? numbersOf(written.greatest, is_double).values() : undefined;
      const greatest = wide ? least.map((only, i) => (own[i] > 1 ? wide.next().value : only)) : least;
      found = { least, greatest, sums: written.sums, is_double: is_double !== false, counts: own };
    }
    cache.set(key, found);
    return found;
  };
  // Where a baseline lets a signal be: its tolerance about the baseline's own values or, without them, about a range.
  const bandOf = (name) => {
    const [margin, least, greatest] = data.band?.margins[name] ?? [];
    if (margin === undefined) return null;
    const isRange = least !== undefined;
    const values = !isRange ? signalOf(BASELINE, name) : isNothing(least) ? null : { least: [least], greatest: [greatest] };
    return values ? { margin, values, isRange } : null;
  };
  const unitOfSignal = (name) => {
    const run = data.runs.find((one) => one.signals[name]);
    return run ? run.signals[name].unit : "";
  };

  // The bucket that holds a time.
  const slot = (bucket) => bucket;
  const bucketOf = (time) => {
    let low = 0;
    let high = buckets - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (start[middle] <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  };

  // ---- Colours ----

  let ink = {};
  // What is wanted has long dashes in every plot; other signals differ by their dashes too, not by colour alone.
  const setTheme = (isDark) => {
    showTheme(isDark);
    ink = readInk();
    for (const plot of plots) plot.redraw();
  };

  // ---- Plots over time ----

  const plots = [];
  // With it the paths are laid anew, where the width has changed.
  const valueAxis = commonAxis(70, () => plots.forEach((one) => one.plot?.redraw(true, true)));
  const whole = [start[0], Math.max(data.end_s, start[0] + 1e-9)];
  let view = whole.slice();

  const period = Math.min(...data.runs.map((run) => run.period_s));
  // The same time in every plot; those out of sight follow when they are seen.
  const axis = timeAxis({ whole: () => whole, least: () => 4 * period, shown: () => view, show: (part) => {
    view = part;
    showRange();
    root.dataset.range = part.join(" ");
    for (const plot of plots) plot.follow();
  } });
  const showRange = rangeFields(axis, () => view);
  // The buckets in sight.
  const inView = () => ({ from: bucketOf(view[0]), to: bucketOf(view[1]), slot });

  const isOverlaid = data.runs.length > 1;
  const HEIGHT = 230;
  // Faults, handovers, changes and marks; those of several runs once.
  const eventOf = new Map(data.runs.flatMap((run) => [...run.faults.map((one) => ({ ...one, isFault: true, kind: "fault" })), ...run.changes.map((one) => ({ ...one, kind: "controller" })), ...run.marks.map((one) => ({ ...one, kind: "mark" }))]).map((one) => [`${one.label} ${one.from_s} ${one.until_s}`, one]));
  const events = [...eventOf.values()];
  // Rows above a plot for their names.
  const namedRows = Math.min(3, new Set(events.map((one) => one.label)).size);
  // Each limit once, by its size, with the requirements that have it.
  const limitsOf = (spec) => {
    const found = new Map();
    const levels = new Set(spec.limits.map((limit) => limit.level));
    for (const { level, requirement } of spec.limits) {
      const isMirrored = level !== 0 && levels.has(-level);
      const text = (isMirrored ? "±" : "") + shownIn(isMirrored ? Math.abs(level) : level, spec);
      found.set(text, (found.get(text) || new Set()).add(requirement));
    }
    return found;
  };

  class TimePlot {
    constructor(figure, spec) {
      this.figure = figure;
      this.spec = spec;
      this.isVisible = false;
      this.isStale = false;
      this.series = [];
      const counts = { wanted: 0, others: 0 };
      spec.signals.forEach((name, place) => {
        const kind = /^(reference|stimulus)\./.test(name) ? "wanted" : "others";
        const nth = counts[kind]++;
        data.runs.forEach((run, number) => {
          if (spec.runs && !spec.runs.includes(number)) return;
          const values = signalOf(number, name);
          if (!values) return;
          this.series.push({
            name, run: number, values, isShown: true, period: run.period_s,
            colour: isOverlaid ? number : place, dash: kind === "wanted" ? WANTED[nth % 2] : DASHES[(nth * (isOverlaid ? 4 : 1) + (isOverlaid ? number : 0)) % 8],
            label: (isOverlaid ? run.label + ": " : "") + spec.words[place],
          });
        });
      });
      // How values are drawn: `linear`, `symmetric` (logarithmic beyond a magnitude) or each curve with an `offset`.
      this.form = undefined;
    }

    // The magnitude up to which a spike leaves the axis linear, or 0: from the sizes of all curves and how long they last.
    spike() {
      if (this.spec.log) return 0;
      const all = this.series.map((one) => one.values);
      const sizes = Float64Array.from(start, (_, i) => all.reduce((most, { least, greatest }) => (least[i] === least[i] ? Math.max(most === most ? most : 0, Math.abs(least[i]), Math.abs(greatest[i])) : most), NaN));
      const lengths = Float64Array.from(start, (time, i) => Math.max((start[i + 1] ?? data.end_s) - time, 1e-12));
      return spikeOf(sizes, lengths);
    }

    create() {
      if (this.plot) return;
      const box = this.figure.querySelector(".canvas");
      const { spec } = this;
      if (this.form === undefined) {
        this.linear = this.spike();
        this.form = this.linear ? "symmetric" : "linear";
      }
      this.symmetric = this.form === "symmetric" ? symmetricScale((this.linear ||= this.threshold())) : null;
      const points = this.series.map((one) => Array.from(one.values.greatest, (value) => (value === value ? (spec.log ? Math.abs(value) || null : value) : null)));
      this.plot = new uPlot({
        width: Math.max(280, box.clientWidth),
        height: HEIGHT,
        padding: [namedRows ? 13 * namedRows + 4 : null, null, null, null],
        legend: { show: false },
        cursor: { sync: { key: "report", setSeries: false, filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } }, drag: { x: false, y: false }, points: { show: false }, y: false },
        scales: {
          x: { time: false, range: () => view },
          y: { distr: spec.log ? 3 : 1, ...this.symmetric, range: () => this.range() },
        },
        axes: [
          { ...axisOf(() => ink, 28), ...timeLabels },
          { ...axisOf(() => ink, valueAxis), ...(this.symmetric ? this.symmetricLabels() : labelsOf(spec)) },
        ],
        series: seriesOf(this.series, () => ink, (u, one, place, from, to) => this.course(u, one, from, to, this.raised(place))),
        hooks: {
          drawClear: [(u) => drawEvents(u, events, ink), (u) => this.names(u), (u) => this.band(u)],
          draw: [(u) => this.where(u), (u) => this.judge(u), (u) => cursors.draw(u, ink)],
          setCursor: [() => this.read()],
          setScale: [(u, key) => key === "y" && this.tell()],
        },
      }, [Array.from(start), ...points], box);
      hearPointer(this.plot, axis, () => view, (time) => cursors.place(time), () => cursors.back());
      this.tools();
      this.legend();
      this.tell();
      this.figure.dataset.drawn = "true";
      root.dataset.plots = String(document.querySelectorAll("[data-drawn]").length);
    }

    symmetricLabels() {
      const { power } = this.spec.shown;
      return {
        splits: (u, _i, min, max) => symmetricSplits(min, max, this.symmetric, u.bbox.height / devicePixelRatio),
        filter: (u, splits) => splits,
        values: (u, splits) => splits.map((value) => number(value / 10 ** power)),
      };
    }

    // Draws anew with another axis.
    again() {
      this.plot.destroy();
      this.plot = null;
      this.create();
    }

    // Choices of this plot, of which one holds: a linear axis, one for a spike, or curves apart from each other.
    tools() {
      if (this.note) return;
      const box = this.figure.querySelector(".tools");
      const { spec } = this;
      this.note = make("span", "", { class: "hint" });
      box.append(this.note);
      const buttons = new Map();
      const toggle = (form, text, title) => {
        const button = make("button", text, { type: "button", title, "aria-pressed": String(this.form === form) });
        button.addEventListener("click", () => {
          this.form = this.form === form ? "linear" : form;
          for (const [name, one] of buttons) one.setAttribute("aria-pressed", String(this.form === name));
          this.again();
        });
        buttons.set(form, button);
        box.append(button);
      };
      if (!spec.log) toggle("symmetric", "symmetric log", "Linear for usual values and logarithmic beyond them, so that a spike leaves room for the rest");
      if (!spec.log && this.series.length > 1) toggle("offset", "offset", "Draws the curves above each other, on a linear axis");
    }

    // Where a logarithmic part begins that the user asks for: a tenth of what is seen.
    threshold() {
      const sizes = this.series.flatMap(({ values }) => [...values.least, ...values.greatest]).map(Math.abs).filter(Number.isFinite);
      return roundUp(sizes.reduce((most, one) => Math.max(most, one), 0) / 10 || 1);
    }

    // Says how the axis is to be read, where it is not plain.
    tell() {
      if (!this.note || !this.plot) return;
      const { y } = this.plot.scales;
      const form = formOf(this.spec, y.min, y.max);
      const text = this.form === "offset" ? `Curves ${shownIn(this.apart, this.spec)} apart; limits are not shown`
        : this.symmetric ? `Linear to ±${shownIn(this.linear, this.spec)}, logarithmic beyond` : form.note;
      if (this.note.textContent !== text) this.note.textContent = text;
    }

    // How much a curve is raised.
    raised(nth) {
      return this.form === "offset" ? this.series.slice(0, nth).filter((one) => one.isShown).length * this.apart : 0;
    }

    // The range of what is to be seen, levels included where they are near.
    range() {
      const { spec } = this;
      if (this.form === "offset") return this.rangeApart();
      const reaches = this.series.filter((one) => one.isShown).map((one) => this.reach(one));
      let min = Math.min(...reaches.map(([low]) => low));
      let max = Math.max(...reaches.map(([, high]) => high));
      // A range of the whole run is followed as a level is: where it is near.
      const ranges = this.series.map(({ name, isShown }) => (isShown ? bandOf(name) : null)).filter((one) => one?.isRange);
      const levels = levelsOf(spec, view).concat(ranges.flatMap(({ margin, values }) => [values.least[0] - margin, values.greatest[0] + margin]));
      if (min > max) return spec.log ? [0.1, 1] : [0, 1];
      if (this.symmetric) {
        const { fwd, bwd } = this.symmetric;
        const near = levels.filter((level) => Math.abs(level) < 5 * Math.max(Math.abs(min), Math.abs(max), this.linear));
        const [low, high] = [Math.min(min, ...near), Math.max(max, ...near)].map(fwd);
        const room = (high - low || 1) * 0.06;
        return [bwd(low - room), bwd(high + room)];
      }
      if (spec.log) return logRange(min, max, levels);
      // What differs by the last bits alone is no plot of them.
      const size = Math.max(Math.abs(min), Math.abs(max));
      if (max - min < 1e-9 * size) [min, max] = [min - 1e-9 * size, max + 1e-9 * size];
      [min, max] = withLevels(min, max, levels);
      const room = (max - min || Math.abs(max) || 1) * 0.06;
      return [min - room, max + 2 * room];
    }

    // The ends of a curve in sight, and of the band along it.
    reach({ name, values }) {
      const part = { ...inView(), isLog: this.spec.log };
      const band = bandOf(name);
      const own = reachOf(values, part);
      if (!band || band.isRange) return own;
      const [low, high] = reachOf(band.values, part);
      const margin = this.spec.log ? 0 : band.margin;
      return [Math.min(own[0], low - margin), Math.max(own[1], high + margin)];
    }

    // With curves above each other, by more than the highest of them.
    rangeApart() {
      const ends = this.series.map(({ name, values, isShown }) => {
        const [min, max] = isShown ? this.reach({ name, values }) : [0, 0];
        return min > max ? [0, 0] : [min, max];
      });
      const highest = Math.max(...ends.map(([min, max]) => max - min));
      this.apart = roundUp(0.6 * highest || 1);
      const low = Math.min(...ends.map(([min], nth) => min + this.raised(nth)));
      const high = Math.max(...ends.map(([, max], nth) => max + this.raised(nth)));
      const room = (high - low || 1) * 0.06;
      return [low - room, high + room];
    }

    // The buckets of a part, for a curve or an area.
    places(period, from, to, raised) {
      const begin = (nth) => start[nth];
      // At the bucket's last step: what only rises or falls in it is drawn as it was.
      const end = (nth) => Math.max((start[nth + 1] ?? 0) - period, start[nth]);
      return { from: Math.max(0, from - 1), to: Math.min(buckets - 1, to + 1), slot, begin, end, isLog: this.spec.log, forward: this.symmetric?.fwd, raised };
    }

    course(u, { values, period }, from, to, raised) {
      // A run of a lower rate has no step in many a bucket; that is no gap.
      const isApart = (nth, before) => start[nth] - start[before] > Math.max(1.5 * period, 1.01 * (start[nth] - start[nth - 1]) + period);
      return courseOf(u, values, { ...this.places(period, from, to, raised), isApart });
    }

    // The band of a baseline, behind the curves: once for each signal, unless its curves are apart.
    band(u) {
      const drawn = new Set();
      shadeAreas(u, this.series.flatMap(({ name, isShown, colour, period }, nth) => {
        const band = isShown ? bandOf(name) : null;
        if (!band || (drawn.has(name) && this.form !== "offset")) return [];
        drawn.add(name);
        const { from, to } = inView();
        const part = { ...this.places(period, from, to, this.raised(nth)), margin: band.margin };
        if (band.isRange) Object.assign(part, { from: 0, to: 0, slot: () => 0, begin: () => whole[0], end: () => whole[1] });
        return [[areaOf(u, band.values, part), isOverlaid ? ink.text : ink.series[colour % 8]]];
      }));
    }

    // Names of events, above the plot.
    names(u) {
      const { ctx, bbox } = u;
      const ratio = devicePixelRatio;
      ctx.save();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      Object.assign(ctx, { textBaseline: "bottom", textAlign: "left", fillStyle: ink.text });
      const right = bbox.left + bbox.width;
      const at = (one) => u.valToPos(one.from_s, "x", true);
      const seen = events.filter((one) => at(one) <= right && u.valToPos(one.until_s ?? whole[1], "x", true) >= bbox.left);
      for (const { label, left, row } of placeNames(ctx, seen, [bbox.left, u.ctx.canvas.width - 2 * ratio], namedRows, at)) ctx.fillText(label, left, bbox.top - (2 + 13 * row) * ratio);
      ctx.restore();
    }

    // Where the formulas of the command line hold, along the lower edge: a row for each, in each run.
    where(u) {
      const rows = data.where.flatMap(({ runs }) => runs.map((intervals, run) => ({ intervals, run })));
      within(u, (ctx, { top, height }, ratio) => {
        const high = Math.min(6, 60 / rows.length) * ratio;
        rows.forEach(({ intervals, run }, row) => {
          ctx.fillStyle = isOverlaid ? ink.series[run % 8] : ink.found;
          for (const [from, wide] of marksOf(u, intervals, 2 * ratio)) ctx.fillRect(from, top + height - high * (row + 1), wide, 0.8 * high);
        });
      });
    }

    // Level lines, limits of requirements, and where their margins come from.
    judge(u) {
      const { spec } = this;
      if (this.form === "offset") return;
      drawLevels(u, spec, spec.log, ink);
      within(u, (ctx, { left, top, width, height }, ratio) => {
        ctx.lineWidth = 1.25 * ratio;
        const y = (value) => u.valToPos(value, "y", true);
        const x = (value) => u.valToPos(value, "x", true);
        for (const mark of spec.marks) {
          const at = x(mark.at_s);
          if (at < left || at > left + width) continue;
          ctx.strokeStyle = ctx.fillStyle = isOverlaid ? ink.series[mark.run % 8] : mark.holds ? ink.text : ink.limit;
          if (!mark.decisive) {
            ctx.setLineDash([2 * ratio, 3 * ratio]);
            ctx.beginPath();
            ctx.moveTo(at, top);
            ctx.lineTo(at, top + height);
            ctx.stroke();
            ctx.setLineDash([]);
            continue;
          }
          const [value, level] = spec.log ? mark.decisive.map(Math.abs) : mark.decisive;
          const size = 3 * ratio;
          ctx.beginPath();
          ctx.moveTo(at, y(value));
          ctx.lineTo(at, y(level));
          ctx.moveTo(at - size, y(level));
          ctx.lineTo(at + size, y(level));
          ctx.stroke();
          ctx.beginPath();
          ctx.arc(at, y(value), size, 0, 7);
          ctx.fill();
        }
      });
    }

    legend() {
      const box = this.figure.querySelector(".legend");
      box.textContent = "";
      this.time = make("span", "", { class: "value" });
      this.series.forEach((one, index) => box.append(legendButton(one, 24, [one.label, ...(one.label === one.name ? [] : [" ", make("code", one.name)])], (isShown) => {
        this.plot.setSeries(index + 1, { show: isShown });
        this.redraw();
      })));
      for (const [level, names] of limitsOf(this.spec)) {
        const limit = make("span", lineOf(24, [6, 3], "limit"), { class: "limit" });
        limit.append(`limit ${level}: `, [...names].join(", "));
        box.append(limit);
      }
      if (this.series.some(({ name }) => bandOf(name))) box.append(make("span", `shaded: baseline ${data.band.name}`));
      for (const name of this.spec.missing) box.append(`${name}: no value`);
      box.append(this.time);
    }

    // The values under the pointer or, without one, at cursor A.
    read() {
      const u = this.plot;
      if (!this.time) return;
      // Of the bucket in which a cursor put here would stand: uPlot's own index is that of the nearest beginning.
      const step = u.cursor.left >= 0 ? Math.round(u.posToVal(u.cursor.left, "x") / period) : cursors.steps[0];
      const isThere = step !== null;
      const bucket = isThere ? bucketOfStep(step) : null;
      write(this.time, isThere ? `at ${seconds(start[bucket])} s` : "");
      for (const one of this.series) write(one.shownValue, isThere ? reachShown(one.values.least[bucket], one.values.greatest[bucket], this.spec) : "");
    }

    follow() {
      if (!this.plot) return;
      if (!this.isVisible) {
        this.isStale = true;
        return;
      }
      this.isStale = false;
      this.plot.setScale("x", { min: view[0], max: view[1] });
    }

    redraw() {
      if (this.plot) this.plot.setScale("x", { min: view[0], max: view[1] });
    }

    resize(width) {
      if (this.plot && Math.abs(this.plot.width - width) > 1) this.plot.setSize({ width: Math.max(280, width), height: HEIGHT });
    }
  }

  // ---- Histograms ----

  const legs = { round_trip: "Round trip", controller: "Controller", exchange: "Exchange: round trip less controller", plant: "Plant", release: "Late by" };
  class Histogram {
    constructor(figure, leg) {
      this.figure = figure;
      this.leg = leg;
    }

    create() {
      if (this.plot) return;
      const runs = data.runs.map((run, number) => ({ number, found: run.histograms.find((one) => one.leg === this.leg) })).filter((one) => one.found);
      const edges = [...new Set(runs.flatMap((one) => one.found.from_ns))].map((ns) => Math.max(ns, 0.5)).sort((a, b) => a - b);
      const counts = runs.map(({ found }) => {
        const of = new Map(found.from_ns.map((ns, i) => [Math.max(ns, 0.5), found.count[i]]));
        return edges.map((ns) => of.get(ns) || null);
      });
      const box = this.figure.querySelector(".canvas");
      const most = Math.max(1, ...counts.flat().map((one) => one || 0));
      this.plot = new uPlot({
        width: Math.max(280, box.clientWidth), height: 220, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false, distr: 3, range: () => [edges[0] / 1.1, edges[edges.length - 1] * 1.1] }, y: { distr: 3, range: () => [0.5, most * 2] } },
        axes: [["ns", 28, "Duration"], ["", valueAxis]].map(([unit, size, label]) => ({ ...axisOf(() => ink, size), ...(label && { ...timeLabels, label }), ...logLabels(unit) })),
        series: seriesOf(runs.map(({ number }) => ({ isShown: true, colour: number, dash: [] })), () => ink, (u, _, place) => steps(u, edges, counts[place])),
      }, [edges, ...counts], box);
      this.figure.dataset.drawn = "true";
      root.dataset.plots = String(document.querySelectorAll("[data-drawn]").length);
      const legend = this.figure.querySelector(".legend");
      if (isOverlaid) runs.forEach(({ number }) => legend.append(swatch(number), data.runs[number].label + " "));
    }

    follow() {}

    redraw() {
      if (this.plot) this.plot.redraw();
    }

    resize(width) {
      if (this.plot && Math.abs(this.plot.width - width) > 1) this.plot.setSize({ width: Math.max(280, width), height: 220 });
    }
  }
  // A bar from each class's begin to the next, none where nothing was.
  const steps = (u, edges, counts) => {
    const stroke = new Path2D();
    const y = (value) => u.valToPos(value, "y", true);
    const floor = y(0.5);
    for (let i = 0; i + 1 < edges.length; i++) {
      if (!counts[i]) continue;
      const from = u.valToPos(edges[i], "x", true);
      const to = u.valToPos(edges[i + 1], "x", true);
      stroke.rect(from, y(counts[i]), to - from, floor - y(counts[i]));
    }
    return stroke;
  };
  const swatch = (run) => make("span", undefined, { class: "swatch", "data-run": run });
  const figureOf = (title, parent) => {
    const figure = make("figure", make("figcaption", title), { class: "plot", tabindex: 0, "aria-label": "Plot: " + title });
    for (const name of ["tools", "canvas", "legend"]) figure.append(make("div", undefined, { class: name }));
    parent.append(figure);
    return figure;
  };

  const largestOf = ({ least, greatest }) => {
    let largest = 0;
    for (const values of [least, greatest]) for (const value of values) if (Number.isFinite(value) && Math.abs(value) > largest) largest = Math.abs(value);
    return largest;
  };

  // ---- Cursors ----

  // A cursor stands on the first step of a bucket, of which near faults and margins each has a single step.
  const bucketOfStep = (step) => bucketOf((step + 0.25) * period);
  const stepOfBucket = (bucket) => Math.round(start[Math.min(Math.max(bucket, 0), buckets - 1)] / period);
  const cursors = cursorsOf({ period: () => period, changed: () => measure(), next: (step, by) => stepOfBucket(bucketOfStep(step) + by) });
  // The last step of a bucket.
  const lastOf = (bucket) => Math.round((bucket + 1 < buckets ? start[bucket + 1] / period - 1 : data.end_s / period));
  const bucketsBetween = () => cursors.ends().map(bucketOfStep);
  const span = () => [cursors.ends()[0], lastOf(bucketsBetween()[1])];
  // Of several runs, how far each is from the first.
  let firsts = new Map();
  const fromFirst = (names, at) => (isOverlaid ? names.map((name) => [`${name} less ${data.runs[0].label}`, (row) => (row.run ? less(at(row, name), at(firsts.get(row.name), name)) : null)]) : []);
  const besides = (names, at) => [...(data.band ? bandColumns(names, at) : []), ...fromFirst(names, at)];
  const drawer = drawerOf({ cursors, period: () => period, scenario: () => document.title, more: besides, span, digits: 9 });
  // The value in a bucket, or between which values it is; of a run of a lower rate its last one.
  const valueIn = ({ least, greatest, is_double }, bucket, run) => {
    while (bucket > 0 && !(least[bucket] === least[bucket]) && start[bucket - 1] > start[bucket] - data.runs[run].period_s) bucket--;
    const [low, high] = [least, greatest].map((values) => rounded(values[bucket], is_double ? 17 : 7));
    return low !== low ? null : low === high ? low : [low, high];
  };
  // What the buckets know of a signal from the one of a cursor to the one of the other: nothing in it is estimated.
  const figuresOf = (name, run) => {
    const values = signalOf(run, name);
    if (!values) return null;
    if (!values.mean) Object.assign(values, withMeans(values, values.sums));
    const [first, last] = bucketsBetween();
    let [count, sum, squares] = [0, 0, 0];
    for (let i = first; i <= last; i++) {
      const many = values.counts[i];
      if (!many) continue;
      count += many;
      sum += many * values.mean[i];
      squares += many * values.square[i];
    }
    const reach = reachOf(values, { from: first, to: last, slot });
    // Single precision may have rounded them inwards, of which a requirement must not fail.
    const room = values.is_double ? 0 : 2 ** -23;
    const [least, greatest] = count ? reach.map((end, nth) => rounded(end + (nth ? room : -room) * Math.abs(end), 9)) : [null, null];
    const [mean, rms] = count ? [sum / count, Math.sqrt(squares / count)].map((value) => rounded(value, 7)) : [null, null];
    const why = whyUnnamed(name) || (count ? "" : "it has no value between the cursors");
    const title = isOverlaid ? `${data.runs[run].label}: ${name}` : name;
    const band = bandOf(name);
    if (band) band.at = [first, last].map((bucket) => (band.isRange ? [band.values.least[0], band.values.greatest[0]] : valueIn(band.values, bucket, run)));
    return { name, title, run, unit: unitOfSignal(name), at: [valueIn(values, first, run), valueIn(values, last, run)], mean, rms, least, greatest, height: count ? reach[1] - reach[0] : null, count, why, band };
  };
  // Which of it is exact.
  const basis = () => {
    const [first, last] = bucketsBetween();
    const [from, to] = span();
    const parts = first === last ? [] : [`mean, RMS and peak to peak from every step from ${seconds(from * period)} s to ${seconds(to * period)} s (${to - from + 1})`];
    const wide = [...new Set([first, last])].filter((bucket) => lastOf(bucket) > stepOfBucket(bucket)).map((bucket) => `the ${lastOf(bucket) - stepOfBucket(bucket) + 1} steps from ${seconds(start[bucket])} s`);
    if (wide.length) parts.push(`the report has the least and the greatest of ${wide.join(" and of ")}, of which hil panel RUN has each`);
    return (parts.join("; ") || "the values of this step") + "; seven digits";
  };
  // Signals of the plots in sight first, then those of the others.
  const measure = () => {
    drawer.show();
    for (const plot of plots) plot.plot?.redraw(false, false);
    for (const plot of plots) plot.read?.();
    if (!cursors.ends()) return void delete root.dataset.measured;
    const order = plots.filter((one) => one.series).sort((a, b) => b.isVisible - a.isVisible);
    const names = [...new Set(order.flatMap((one) => one.spec.signals))].slice(0, 64);
    const rows = names.flatMap((name) => data.runs.map((_, run) => figuresOf(name, run)).filter((one) => one));
    firsts = new Map(rows.filter((row) => row.run === 0).map((row) => [row.name, row]));
    drawer.list(rows, basis());
    root.dataset.measured = span().join(" ");
  };

  // ---- Everything by its name ----

  const goTo = (figure) => {
    if (!figure) return;
    figure.scrollIntoView({ block: "center" });
    figure.focus({ preventScroll: true });
  };
  const lookAt = (time, before, behind) => axis.go(time - before * (whole[1] - whole[0]), time + behind * (whole[1] - whole[0]));
  const goToRequirement = ({ requirement, run, at }) => {
    lookAt(Number(at), 0.01, 0.01);
    goTo(byId("plot-" + data.plots.findIndex((plot) => plot.marks.some((mark) => mark.requirement === requirement && mark.run === Number(run)))));
  };
  const addSignals = (signals, unit) => {
    const largest = signals.flatMap((name) => data.runs.map((_, run) => signalOf(run, name))).reduce((most, one) => (one ? Math.max(most, largestOf(one)) : most), 0);
    const display = shownUnit(unit, largest);
    const figure = figureOf(signals.join(", ") + unitOf(display.unit), byId("added"));
    add(figure, new TimePlot(figure, { title: "", unit, shown: display, words: signals, log: unit === "ns", signals, missing: [], lines: [], limits: [], marks: [] }));
    if (cursors.ends()) measure();
    return figure;
  };
  const entries = () => {
    const list = [];
    const add = (kind, name, detail, does) => list.push({ kind, name, detail, does });
    for (const [figure, plot] of byFigure) add("plot", figure.querySelector("figcaption").textContent.trim(), plot.spec?.title ?? "", () => goTo(figure));
    for (const choice of choices) add("signal", choice.value, unitOfSignal(choice.value), () => goTo(addSignals([choice.value], unitOfSignal(choice.value))));
    for (const one of events) list.push({ kind: one.kind, rank: "mark", name: one.label, detail: `${seconds(one.from_s)} s`, does: () => lookAt(one.from_s, 0.01, 0.05) });
    const judged = new Map([...document.querySelectorAll("[data-requirement]")].map(({ dataset }) => [dataset.requirement + dataset.run, dataset]));
    for (const one of judged.values()) add("requirement", one.requirement, isOverlaid ? data.runs[one.run].label : `${seconds(Number(one.at))} s`, () => goToRequirement(one));
    for (const heading of document.querySelectorAll("main section[id] > h2")) add("section", heading.textContent, "", () => heading.scrollIntoView());
    add("action", "Whole run", "Home", () => axis.all());
    add("action", "Clear the cursors", "c", () => cursors.clear());
    for (const { formula, count } of data.where) {
      add("where", formula, `${count} interval${count === 1 ? "" : "s"}`, () => byId("where").scrollIntoView());
    }
    add("action", "Where does a formula hold", "hil report RUN --where 'FORMULA'", () => tell("hil report RUN --where 'FORMULA' lists where a formula holds; hil panel RUN searches for others"));
    if (isOverlaid) add("action", "Where the runs first differ", "hil compare RUN RUN", () => tell("hil compare RUN RUN names the first step, signal and values that differ"));
    add("action", "Figures for a document", "hil report RUN --figures DIR", () => tell("hil report RUN --figures DIR writes each plot of the scenario as SVG and PDF"));
    add("action", "Light or dark", "", () => byId("theme").click());
    return list;
  };
  const palette = paletteOf(entries);
  // Keys of the plots, while one of them has the focus or the pointer.
  const hearKey = (event) => {
    const { target, key } = event;
    if ((event.ctrlKey || event.metaKey) && !event.altKey && key.toLowerCase() === "k") {
      event.preventDefault();
      return palette.open();
    }
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || target.closest?.("input, select, textarea, dialog")) return;
    const isOver = plots.some((one) => one.plot?.cursor.left >= 0);
    if (!target.closest?.("figure.plot, #measure") && !isOver) return;
    const keys = { ...keysOfAxis(axis, event), ...keysOfCursors(cursors, () => timeAtHand(plots, view)) };
    if (!keys[key]) return;
    event.preventDefault();
    keys[key]();
  };

  // ---- The page ----

  const byFigure = new Map();
  const seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const plot = byFigure.get(target);
      plot.isVisible = isIntersecting;
      if (!isIntersecting) continue;
      plot.create();
      if (plot.isStale) plot.follow();
    }
  }, { rootMargin: "300px" });
  const sized = new ResizeObserver((entries) => {
    for (const { target } of entries) byFigure.get(target).resize(target.clientWidth);
  });
  const observe = (figure) => {
    seen.observe(figure);
    sized.observe(figure);
  };
  // The verdict is seen before any curve is drawn; a page that is not in sight is painted never, so not for long.
  let isPainted = false;
  const begin = () => {
    if (isPainted) return;
    isPainted = true;
    for (const figure of byFigure.keys()) observe(figure);
    setTimeout(drawNext, 10);
  };
  requestAnimationFrame(() => setTimeout(begin));
  setTimeout(begin, 500);
  const add = (figure, plot) => {
    plots.push(plot);
    byFigure.set(figure, plot);
    if (isPainted) observe(figure);
  };

  watchScroll();
  watchStatus();
  setTheme(wantsDark.matches);
  wantsDark.addEventListener("change", (event) => setTheme(event.matches));
  byId("theme").addEventListener("click", () => setTheme(root.dataset.theme !== "dark"));
  addEventListener("keydown", hearKey);
  byId("find").addEventListener("click", () => palette.open());
  showRange();

  for (const figure of document.querySelectorAll("figure[data-plot]")) add(figure, new TimePlot(figure, data.plots[figure.dataset.plot]));
  const histograms = byId("histograms");
  for (const [leg, title] of Object.entries(legs)) {
    if (!data.runs.some((run) => run.histograms.some((one) => one.leg === leg))) continue;
    const figure = figureOf(title + ": steps by time", histograms);
    add(figure, new Histogram(figure, leg));
  }

  for (const button of document.querySelectorAll("[data-jump]")) button.addEventListener("click", () => lookAt(Number(button.dataset.jump), 0.01, 0.05));
  for (const button of document.querySelectorAll("[data-from]")) {
    button.addEventListener("click", () => {
      const [from, until] = [Number(button.dataset.from), Number(button.dataset.until)];
      const width = Math.max((until - from) * 3, 40 * period);
      axis.go((from + until - width) / 2, (from + until + width) / 2);
    });
  }
  for (const button of document.querySelectorAll("[data-requirement]")) button.addEventListener("click", () => goToRequirement(button.dataset));

  const filter = byId("filter");
  const choices = [...document.querySelectorAll("input[name=signal]")];
  filter.addEventListener("input", () => {
    const words = filter.value.trim().split(/\s+/);
    const fits = words.map((word) => new RegExp(word.replace(/[.+^${}()|[\]\\]/g, "\\$&").replace(/\*/g, ".*").replace(/\?/g, "."), "i"));
    for (const choice of choices) choice.parentElement.hidden = !fits.every((one) => one.test(choice.value));
  });
  byId("plot").addEventListener("click", () => {
    const chosen = choices.filter((choice) => choice.checked);
    const units = [...new Set(chosen.map((choice) => unitOfSignal(choice.value)))];
    for (const unit of units) addSignals(chosen.map((choice) => choice.value).filter((name) => unitOfSignal(name) === unit), unit);
    for (const choice of chosen) choice.checked = false;
  });

  const drawAll = () => {
    for (const plot of plots) {
      plot.create();
      if (plot.isStale) plot.redraw();
    }
  };
  // What is not in sight is drawn one after another, so that the page answers meanwhile.
  const drawNext = () => {
    const next = plots.find((plot) => !plot.plot);
    if (!next) return;
    next.create();
    setTimeout(drawNext, 10);
  };

  let before;
  let closed = [];
  addEventListener("beforeprint", () => {
    before = root.dataset.theme === "dark";
    closed = [...document.querySelectorAll("details:not([open]):not(.keys)")];
    for (const one of closed) one.open = true;
    setTheme(false);
    drawAll();
    for (const [figure, plot] of byFigure) plot.resize(Math.min(figure.clientWidth, 680));
  });
  addEventListener("afterprint", () => {
    setTheme(before);
    for (const one of closed) one.open = false;
    for (const [figure, plot] of byFigure) plot.resize(figure.clientWidth);
  });
})();

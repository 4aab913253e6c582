"use strict";
// Draws the plots of a report. Signals are envelopes over one grid of simulated time: the least and the
// greatest value of each bucket, which may be a single step. Both are drawn, so no spike is ever hidden.
(() => {
  const data = JSON.parse(byId("data").textContent);
  const status = byId("status");

  // ---- Numbers ----

  const start = new Float64Array(bytesOf(data.grid).buffer);
  const buckets = start.length;

  const cache = new Map();
  const numbersOf = (text, isDouble) => new (isDouble ? Float64Array : Float32Array)(bytesOf(text).buffer);
  // The envelope of a run's signal, or undefined if the run has none.
  const signalOf = (run, name) => {
    const key = run + " " + name;
    if (cache.has(key)) return cache.get(key);
    const written = data.runs[run].signals[name];
    let found;
    if (written && written.same !== undefined) {
      found = signalOf(run, written.same);
    } else if (written && written.value !== undefined) {
      const flat = new Float64Array(buckets).fill(written.value);
      found = { least: flat, greatest: flat };
    } else if (written) {
      const least = numbersOf(written.least, written.is_double);
      found = { least, greatest: written.greatest ? numbersOf(written.greatest, written.is_double) : least };
    }
    cache.set(key, found);
    return found;
  };
  const unitOfSignal = (name) => {
    const run = data.runs.find((one) => one.signals[name]);
    return run ? run.signals[name].unit : "";
  };

  // The bucket that holds a time.
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
  const WANTED = [[8, 4], [14, 4]];
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

  // Shows the same time in every plot; those out of sight follow when they are seen.
  const show = (min, max) => {
    const least = Math.min(...data.runs.map((run) => run.period_s));
    const length = Math.min(Math.max(max - min, 2 * least), whole[1] - whole[0]);
    min = Math.min(Math.max(min, whole[0]), whole[1] - length);
    view = [min, min + length];
    for (const plot of plots) plot.follow();
    status.textContent = `${seconds(view[0])} to ${seconds(view[1])} s`;
  };

  const isOverlaid = data.runs.length > 1;
  const HEIGHT = 230;
  // Rows above a plot for the names of faults, handovers and marks.
  const names = new Set(data.runs.flatMap((run) => [...run.faults, ...run.changes, ...run.marks]).map((one) => one.label));
  const namedRows = Math.min(3, names.size);
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
      this.isOffset = false;
      figure.addEventListener("keydown", (event) => this.key(event));
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
      if (this.usual === undefined) this.linear = this.usual = this.spike();
      this.symmetric = this.linear && !this.isOffset ? symmetricScale(this.linear) : null;
      const points = this.series.map((one) => Array.from(one.values.greatest, (value) => (value === value ? (spec.log ? Math.abs(value) || null : value) : null)));
      this.plot = new uPlot({
        width: Math.max(280, box.clientWidth),
        height: HEIGHT,
        padding: [namedRows ? 13 * namedRows + 4 : null, null, null, null],
        legend: { show: false },
        cursor: { sync: { key: "report", setSeries: false, filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } }, drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false },
        scales: {
          x: { time: false, range: () => view },
          y: { distr: spec.log ? 3 : 1, ...this.symmetric, range: () => this.range() },
        },
        axes: [
          { ...axisOf(() => ink, 28), ...timeLabels },
          { ...axisOf(() => ink, valueAxis), ...(this.symmetric ? this.symmetricLabels() : labelsOf(spec)) },
        ],
        // The first are wider, so that those of one course are seen beneath each other.
        series: [{}, ...this.series.map((one, place) => ({ stroke: () => ink.series[one.colour % 8], width: 1.25 + Math.min(2, 0.9 * (this.series.length - 1 - place)), dash: one.dash, points: { show: false }, paths: (u, index, from, to) => this.path(u, one, from, to, this.raised(place)) }))],
        hooks: {
          drawClear: [(u) => this.shade(u)],
          draw: [(u) => this.judge(u)],
          setSelect: [(u) => this.select(u)],
          setCursor: [(u) => this.read(u.cursor.idx)],
          setScale: [(u, key) => key === "y" && this.tell()],
        },
      }, [Array.from(start), ...points], box);
      this.plot.over.addEventListener("dblclick", () => show(...whole));
      this.plot.over.addEventListener("wheel", (event) => {
        if (!event.ctrlKey) return;
        event.preventDefault();
        const at = this.plot.posToVal(event.offsetX, "x");
        this.zoom(event.deltaY > 0 ? 1.25 : 0.8, at);
      }, { passive: false });
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

    // Choices of this plot: its axis, and curves apart from each other.
    tools() {
      const box = this.figure.querySelector(".tools");
      const { spec } = this;
      if (!this.note) {
        this.note = document.createElement("span");
        this.note.className = "hint";
        box.append(this.note);
        const toggle = (text, title, isPressed, does) => {
          const button = document.createElement("button");
          button.type = "button";
          button.title = title;
          button.textContent = text;
          button.setAttribute("aria-pressed", String(isPressed));
          button.addEventListener("click", () => {
            button.setAttribute("aria-pressed", String(does()));
            this.again();
          });
          box.append(button);
        };
        if (!spec.log) toggle("symmetric log", "Linear for usual values and logarithmic beyond them, so that a spike leaves room for the rest", this.linear > 0, () => {
          this.linear = this.linear ? 0 : this.usual || this.threshold();
          return this.linear > 0;
        });
        if (!spec.log && this.series.length > 1) toggle("offset", "Draws the curves above each other", false, () => (this.isOffset = !this.isOffset));
      }
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
      const text = this.isOffset ? `Curves ${shownIn(this.apart, this.spec)} apart; limits are not shown`
        : this.symmetric ? `Linear to ±${shownIn(this.linear, this.spec)}, logarithmic beyond` : form.note;
      if (this.note.textContent !== text) this.note.textContent = text;
    }

    // How much a curve is raised.
    raised(nth) {
      return this.isOffset ? nth * this.apart : 0;
    }

    // The range of what is to be seen, levels included where they are near.
    range() {
      const { spec } = this;
      if (this.isOffset) return this.rangeApart();
      const from = Math.max(0, bucketOf(view[0]));
      const to = bucketOf(view[1]);
      let min = Infinity;
      let max = -Infinity;
      for (const { values, isShown } of this.series) {
        if (!isShown) continue;
        for (let i = from; i <= to; i++) {
          let low = values.least[i];
          let high = values.greatest[i];
          if (low !== low) continue;
          if (spec.log) [low, high] = magnitudes(low, high);
          if (low < min && Number.isFinite(low) && (low > 0 || !spec.log)) min = low;
          if (high > max && Number.isFinite(high)) max = high;
        }
      }
      const levels = levelsOf(spec, view);
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

    // With curves above each other, by more than the highest of them.
    rangeApart() {
      const [from, to] = [bucketOf(view[0]), bucketOf(view[1])];
      const ends = this.series.map(({ values }) => {
        let [min, max] = [Infinity, -Infinity];
        for (let i = from; i <= to; i++) if (Number.isFinite(values.least[i]) && Number.isFinite(values.greatest[i])) [min, max] = [Math.min(min, values.least[i]), Math.max(max, values.greatest[i])];
        return min > max ? [0, 0] : [min, max];
      });
      const highest = Math.max(...ends.map(([min, max]) => max - min));
      this.apart = roundUp(0.6 * highest || 1);
      const low = Math.min(...ends.map(([min], nth) => min + this.raised(nth)));
      const high = Math.max(...ends.map(([, max], nth) => max + this.raised(nth)));
      const room = (high - low || 1) * 0.06;
      return [low - room, high + room];
    }

    // Through the least and the greatest value of each bucket, the nearer one first.
    path(u, { values, period }, from, to, raised = 0) {
      const stroke = new Path2D();
      const { least, greatest } = values;
      const { left, width } = u.bbox;
      const scale = width / (view[1] - view[0]);
      const floor = u.scales.y.min;
      const isLog = this.spec.log;
      const ceiling = u.scales.y.max;
      const room = ceiling - floor;
      // What is far beyond what is seen, infinite even, is drawn to the edge.
      const y = (value) => u.valToPos(isLog ? Math.min(Math.max(value, floor), ceiling * 10) : Math.min(Math.max(value, floor - room), ceiling + room), "y", true);
      let isDown = false;
      let lastTime = -Infinity;
      let last = 0;
      for (let i = Math.max(0, from - 1); i <= Math.min(buckets - 1, to + 1); i++) {
        let low = least[i] + raised;
        let high = greatest[i] + raised;
        if (low !== low) continue;
        if (isLog) [low, high] = magnitudes(low, high);
        // A run of a lower rate has no step in many a bucket; that is no gap.
        const gap = i > 0 ? Math.max(1.5 * period, 1.01 * (start[i] - start[i - 1]) + period) : 0;
        if (start[i] - lastTime > gap) isDown = false;
        const x = left + (start[i] - view[0]) * scale;
        const isRising = Math.abs(last - low) <= Math.abs(last - high);
        const [first, second] = isRising ? [low, high] : [high, low];
        if (isDown) stroke.lineTo(x, y(first));
        else stroke.moveTo(x, y(first));
        // At the bucket's last step: what only rises or falls in it is drawn as it was.
        const end = i + 1 < buckets ? start[i + 1] - period : start[i];
        if (first !== second) stroke.lineTo(left + (Math.max(end, start[i]) - view[0]) * scale, y(second));
        else if (!isDown) stroke.lineTo(x + 0.01, y(first));
        isDown = true;
        last = second;
        lastTime = start[i];
      }
      return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
    }

    // Times in which faults act, where another controller took over, and notes; their names stand above the plot.
    shade(u) {
      const { ctx, bbox } = u;
      const ratio = devicePixelRatio;
      const names = [];
      within(u, (_, { left, top, width, height }) => {
        const seen = new Set();
        for (const run of data.runs) {
          for (const fault of [...run.faults, ...run.changes, ...run.marks]) {
            const key = `${fault.label} ${fault.from_s} ${fault.until_s}`;
            if (seen.has(key)) continue;
            seen.add(key);
            const from = u.valToPos(fault.from_s, "x", true);
            const to = u.valToPos(fault.until_s ?? whole[1], "x", true);
            if (to < left || from > left + width) continue;
            ctx.fillStyle = ink.fault;
            ctx.fillRect(from, top, Math.max(to - from, ratio), height);
            ctx.fillStyle = run.faults.includes(fault) ? ink.edge : ink.text;
            ctx.fillRect(from, top, ratio, height);
            names.push([fault.label, Math.max(from, left)]);
          }
        }
      });
      ctx.save();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      Object.assign(ctx, { textBaseline: "bottom", textAlign: "left", fillStyle: ink.text });
      const high = 13 * ratio;
      const taken = [];
      for (const [text, from] of names) {
        const wide = ctx.measureText(text).width;
        const at = Math.max(0, Math.min(from, u.ctx.canvas.width - wide - 2 * ratio));
        for (let row = 0; row < namedRows; row++) {
          const box = { left: at, right: at + wide + 6 * ratio, row };
          if (taken.some((one) => one.row === row && one.right > box.left && one.left < box.right)) continue;
          taken.push(box);
          ctx.fillText(text, at, bbox.top - 2 * ratio - row * high);
          break;
        }
      }
      ctx.restore();
    }

    // Level lines, limits of requirements, and where their margins come from.
    judge(u) {
      const { spec } = this;
      if (this.isOffset) return;
      within(u, (ctx, { left, top, width, height }, ratio) => {
        ctx.lineWidth = 1.25 * ratio;
        const y = (value) => u.valToPos(value, "y", true);
        const x = (value) => u.valToPos(value, "x", true);
        ctx.strokeStyle = ink.text;
        ctx.setLineDash([2 * ratio, 4 * ratio]);
        for (const level of spec.lines) {
          ctx.beginPath();
          ctx.moveTo(left, y(level));
          ctx.lineTo(left + width, y(level));
          ctx.stroke();
        }
        ctx.strokeStyle = ctx.fillStyle = ink.limit;
        ctx.setLineDash([6 * ratio, 3 * ratio]);
        for (const limit of spec.limits) {
          if (spec.log && limit.level <= 0) continue;
          const from = Math.max(x(limit.from_s), left);
          const to = Math.min(x(limit.until_s), left + width);
          const at = y(limit.level);
          ctx.beginPath();
          ctx.moveTo(from, at);
          ctx.lineTo(Math.max(to, from + 4 * ratio), at);
          ctx.stroke();
        }
        ctx.setLineDash([]);
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

    select(u) {
      if (u.select.width < 4) return;
      const from = u.posToVal(u.select.left, "x");
      const to = u.posToVal(u.select.left + u.select.width, "x");
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      show(from, to);
    }

    legend() {
      const box = this.figure.querySelector(".legend");
      box.textContent = "";
      this.time = document.createElement("span");
      this.time.className = "value";
      this.series.forEach((one, index) => {
        const button = document.createElement("button");
        button.type = "button";
        button.setAttribute("aria-pressed", String(one.isShown));
        one.shownValue = document.createElement("span");
        one.shownValue.className = "value";
        const name = document.createElement("code");
        name.textContent = one.name;
        button.append(lineOf(24, one.dash, one.colour % 8), one.label + " ", ...(one.label === one.name ? [] : [name, " "]), one.shownValue);
        if (!one.isShown) this.plot.setSeries(index + 1, { show: false });
        button.addEventListener("click", () => {
          one.isShown = !one.isShown;
          button.setAttribute("aria-pressed", String(one.isShown));
          this.plot.setSeries(index + 1, { show: one.isShown });
          this.redraw();
        });
        box.append(button);
      });
      for (const [level, names] of limitsOf(this.spec)) {
        const limit = document.createElement("span");
        limit.className = "limit";
        limit.append(lineOf(24, [6, 3], "limit"), `limit ${level}: `, [...names].join(", "));
        box.append(limit);
      }
      for (const name of this.spec.missing) box.append(`${name}: no value`);
      box.append(this.time);
    }

    // Shows the values at the cursor.
    read(bucket) {
      const isThere = bucket !== null && bucket !== undefined;
      if (this.time) this.time.textContent = isThere ? `at ${seconds(start[bucket])} s` : "";
      for (const one of this.series) {
        if (!one.shownValue) continue;
        const low = isThere ? one.values.least[bucket] : NaN;
        const high = isThere ? one.values.greatest[bucket] : NaN;
        one.shownValue.textContent = low !== low ? "" : low === high ? shownIn(low, this.spec) : `${shownIn(low, this.spec)} to ${shownIn(high, this.spec)}`;
      }
    }

    zoom(factor, at = (view[0] + view[1]) / 2) {
      show(at - (at - view[0]) * factor, at + (view[1] - at) * factor);
    }

    moveCursor(by) {
      const u = this.plot;
      const now = u.cursor.idx ?? bucketOf((view[0] + view[1]) / 2);
      const next = Math.min(Math.max(now + by, 0), buckets - 1);
      u.setCursor({ left: u.valToPos(start[next], "x"), top: 10 });
      this.read(next);
      const values = this.series.filter((one) => one.isShown).map((one) => `${one.label} ${one.shownValue.textContent}`);
      status.textContent = `${number(start[next])} s: ${values.join(", ")}`;
    }

    key(event) {
      if (event.target !== this.figure || event.ctrlKey || event.metaKey || event.altKey) return;
      const step = (view[1] - view[0]) / 10;
      const actions = {
        ArrowLeft: () => (event.shiftKey ? this.moveCursor(-1) : show(view[0] - step, view[1] - step)),
        ArrowRight: () => (event.shiftKey ? this.moveCursor(1) : show(view[0] + step, view[1] + step)),
        "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), 0: () => show(...whole),
      };
      if (!actions[event.key]) return;
      event.preventDefault();
      actions[event.key]();
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
        series: [{}, ...runs.map(({ number }) => ({
          stroke: () => ink.series[number % 8], width: 1.5, points: { show: false },
          paths: (u, index) => steps(u, edges, counts[index - 1]),
        }))],
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
    return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
  };
  const swatch = (run) => {
    const box = document.createElement("span");
    box.className = "swatch";
    box.dataset.run = run;
    return box;
  };
  const figureOf = (title, parent) => {
    const figure = document.createElement("figure");
    figure.className = "plot";
    figure.tabIndex = 0;
    figure.setAttribute("aria-label", "Plot: " + title);
    const caption = document.createElement("figcaption");
    caption.textContent = title;
    const canvas = document.createElement("div");
    canvas.className = "canvas";
    const legend = document.createElement("div");
    legend.className = "legend";
    const tools = document.createElement("div");
    tools.className = "tools";
    figure.append(caption, tools, canvas, legend);
    parent.append(figure);
    return figure;
  };

  const largestOf = ({ least, greatest }) => {
    let largest = 0;
    for (const values of [least, greatest]) for (const value of values) if (Number.isFinite(value) && Math.abs(value) > largest) largest = Math.abs(value);
    return largest;
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
  setTheme(wantsDark.matches);
  wantsDark.addEventListener("change", (event) => setTheme(event.matches));
  byId("theme").addEventListener("click", () => setTheme(root.dataset.theme !== "dark"));
  byId("whole").addEventListener("click", () => show(...whole));

  for (const figure of document.querySelectorAll("figure[data-plot]")) add(figure, new TimePlot(figure, data.plots[figure.dataset.plot]));
  const histograms = byId("histograms");
  for (const [leg, title] of Object.entries(legs)) {
    if (!data.runs.some((run) => run.histograms.some((one) => one.leg === leg))) continue;
    const figure = figureOf(title + ": steps by time", histograms);
    add(figure, new Histogram(figure, leg));
  }

  for (const button of document.querySelectorAll("[data-jump]")) {
    const at = Number(button.dataset.jump);
    const length = whole[1] - whole[0];
    button.addEventListener("click", () => show(at - 0.01 * length, at + 0.05 * length));
  }
  for (const button of document.querySelectorAll("[data-requirement]")) {
    const { requirement, run, at } = button.dataset;
    button.addEventListener("click", () => {
      const found = data.plots.findIndex((plot) => plot.marks.some((mark) => mark.requirement === requirement && mark.run === Number(run)));
      const length = (whole[1] - whole[0]) / 100;
      show(Number(at) - length, Number(at) + length);
      const figure = byId("plot-" + found);
      if (!figure) return;
      figure.scrollIntoView({ block: "center" });
      figure.focus({ preventScroll: true });
    });
  }

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
    for (const unit of units) {
      const signals = chosen.map((choice) => choice.value).filter((name) => unitOfSignal(name) === unit);
      const largest = signals.flatMap((name) => data.runs.map((_, run) => signalOf(run, name))).reduce((most, one) => (one ? Math.max(most, largestOf(one)) : most), 0);
      const display = shownUnit(unit, largest);
      const figure = figureOf(signals.join(", ") + unitOf(display.unit), byId("added"));
      add(figure, new TimePlot(figure, { title: "", unit, shown: display, words: signals, log: unit === "ns", signals, missing: [], lines: [], limits: [], marks: [] }));
    }
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

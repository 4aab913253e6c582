"use strict";
// Two cursors over the axis of time, A and B: lines in every plot, and what is measured at them and between them.

// The cursors of a page: `period` gives the length of a step, on which they stand; `changed` follows each change.
const cursorsOf = ({ period, changed }) => {
  // The step of each, and those before the last click and the one before that.
  let steps = [null, null];
  let before = [steps, steps];
  const set = (next) => {
    steps = next;
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

// ---- What is copied ----

const plain = (value) => (isNothing(value) ? "-" : String(value));
// A table of figures as text, with tabs between its columns and every digit.
const figuresAsText = ({ title, head, rows }) => [title, head.join("\t"), ...rows.map((row) => row.map(plain).join("\t"))].join("\n") + "\n";

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

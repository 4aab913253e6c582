"use strict";
// Width of the value axes of a page's plots: one for all of them, so that times stand beneath each other, as wide as
// the widest label that any plot has had. It never shrinks: plots that breathe are hard to read. `redraw` follows a
// change; the page's style has the width as `--axis`.
const commonAxis = (least, redraw) => {
  let width = least;
  return (plot, values, place) => {
    if (!values) return width;
    const { ctx, axes } = plot;
    const { font, gap, ticks } = axes[place];
    ctx.font = font[0];
    const widest = Math.max(0, ...values.map((text) => ctx.measureText(text ?? "").width)) / devicePixelRatio;
    const needed = Math.ceil(ticks.size + gap + widest) + 1;
    if (needed > width) {
      width = needed;
      document.documentElement.style.setProperty("--axis", `${width}px`);
      queueMicrotask(redraw);
    }
    return width;
  };
};

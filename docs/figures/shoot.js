// Takes the pictures of this folder from reports of the paper's scenarios. By hand, when what they show changes:
//
//   for law in pid nrsc ftsc; do
//     hil run scenarios/severe-leakage.toml --set controller.law=$law --out runs/s1-$law
//     hil run scenarios/slight-leakage.toml --set controller.law=$law --out runs/s2-$law
//   done
//   hil report runs/s1-pid runs/s1-nrsc runs/s1-ftsc -o s1.html
//   hil report runs/s2-pid runs/s2-nrsc runs/s2-ftsc -o s2.html
//   hil report runs/s1-ftsc -o one.html
//   npm install playwright-core && node docs/figures/shoot.js s1.html s2.html one.html
//
// That of the panel, of a run that is held behind its fault:
//
//   hil run scenarios/severe-leakage.toml --pace 1 --pause-at 0.001 --session demo &
//   hil panel --session demo --no-open --json > panel.json & hil step 83000 --session demo
//   PANEL=$(jq -r .url panel.json) node docs/figures/shoot.js
//
// That of a study, here a small one of 60 draws (`cases = 60` in a copy of studies/common-mode.toml):
//
//   hil campaign plan small.toml -o runs/study && hil campaign run runs/study && hil report runs/study -o study.html
//   STUDY=study.html node docs/figures/shoot.js
//
// That of the terminal, of the same run as that of the panel:
//
//   hil run scenarios/severe-leakage.toml --pace 1 --pause-at 8.3 --session demo &
//   tmux new-session -d -s monitor -x 104 -y 34 'COLORTERM=truecolor hil monitor --session demo'
//   tmux capture-pane -e -p -t monitor > monitor.ansi     # once the run is held
//   TERMINAL=monitor.ansi node docs/figures/shoot.js
//
// Each is then reduced to its 256 most frequent colours, and packed by `advpng -z -3`.
"use strict";
const fs = require("fs");
const path = require("path");
const { chromium } = require("playwright-core");

const [s1, s2, one] = process.argv.slice(2).map((file) => "file://" + path.resolve(file));
const drawn = () => document.querySelectorAll("[data-drawn]").length === document.querySelectorAll("figure.plot").length;

// Colours of a dark terminal, by their numbers from 30 and from 90.
const dark = ["#484f58", "#ff7b72", "#3fb950", "#d29922", "#58a6ff", "#bc8cff", "#39c5cf", "#c9d1d9"];
const bright = ["#6e7681", "#ffa198", "#56d364", "#e3b341", "#79c0ff", "#d2a8ff", "#56d4dd", "#ffffff"];

// Makes a page of the text that `tmux capture-pane -e` prints: colours, bold, dim, reverse.
function terminal(text) {
  let [fore, back, weight, dim, reverse] = [null, null, "normal", false, false];
  const extended = (codes) => {
    const [kind, n] = [codes.shift(), codes.shift()];
    if (kind === 2) return `rgb(${n},${codes.shift()},${codes.shift()})`;
    if (n < 16) return (n < 8 ? dark : bright)[n % 8];
    if (n > 231) return `rgb(${Array(3).fill(8 + 10 * (n - 232))})`;
    return `rgb(${[36, 6, 1].map((part) => [0, 95, 135, 175, 215, 255][Math.floor((n - 16) / part) % 6])})`;
  };
  const set = (codes) => {
    while (codes.length) {
      const code = codes.shift();
      if (code === 0) [fore, back, weight, dim, reverse] = [null, null, "normal", false, false];
      else if (code === 1) weight = "bold";
      else if (code === 2) dim = true;
      else if (code === 7) reverse = true;
      else if (code === 22) [weight, dim] = ["normal", false];
      else if (code === 27) reverse = false;
      else if (code >= 30 && code < 38) fore = dark[code - 30];
      else if (code === 38) fore = extended(codes);
      else if (code === 39) fore = null;
      else if (code >= 40 && code < 48) back = dark[code - 40];
      else if (code === 48) back = extended(codes);
      else if (code === 49) back = null;
      else if (code >= 90 && code < 98) fore = bright[code - 90];
      else if (code >= 100 && code < 108) back = bright[code - 100];
    }
  };
  // Braille as dots of its cell, since few fonts have it at the width of the others.
  const dots = (cell) => {
    const bits = cell.codePointAt(0) - 0x2800;
    const places = [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [1, 2], [0, 3], [1, 3]].filter((_, bit) => bits & (1 << bit));
    const circles = places.map(([x, y]) => `<circle cx="${2.5 + 5 * x}" cy="${2.5 + 5 * y}" r="1.5"/>`);
    return `<svg viewBox="0 0 10 20" preserveAspectRatio="none" style="width:1ch;height:20px;vertical-align:top;fill:currentColor">${circles.join("")}</svg>`;
  };
  const escape = (piece) => piece.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/[\u2801-\u28ff]/g, dots).replace(/\u2800/g, " ");
  const spans = text.split("\x1b[").map((piece, index) => {
    const style = index === 0 ? null : /^([\d;]*)m/.exec(piece);
    if (style) set(style[1].split(";").map(Number));
    const [color, ground] = reverse ? [back || "#0d1117", fore || "#e6edf3"] : [fore || "#e6edf3", back || "transparent"];
    const look = `color:${color};background:${ground};font-weight:${weight};opacity:${dim ? 0.7 : 1}`;
    return `<span style="${look}">${escape(style ? piece.slice(style[0].length) : piece)}</span>`;
  });
  const look = "margin:0;padding:16px;width:max-content;background:#0d1117;font:16px/20px 'DejaVu Sans Mono',monospace";
  return `<meta charset="utf-8"><body style="margin:0"><pre style="${look}">${spans.join("")}</pre>`;
}

(async () => {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
  if (process.env.PANEL) {
    const tab = await browser.newPage({ viewport: { width: 1400, height: 860 }, colorScheme: "light" });
    await tab.goto(process.env.PANEL);
    await tab.waitForSelector("html[data-state=paused] figure.plot canvas");
    await tab.waitForTimeout(1000);
    await tab.screenshot({ path: path.join(__dirname, "panel-light.png") });
    return browser.close();
  }
  if (process.env.STUDY) {
    const tab = await browser.newPage({ viewport: { width: 1300, height: 988 }, colorScheme: "light" });
    await tab.goto("file://" + path.resolve(process.env.STUDY));
    await tab.locator("h4", { hasText: "truth.force_fight_n" }).last().evaluate((title) => {
      title.scrollIntoView();
      window.scrollBy(0, -70); // below the bar that stays
    });
    await tab.waitForTimeout(2000);
    await tab.screenshot({ path: path.join(__dirname, "study-light.png") });
    return browser.close();
  }
  if (process.env.TERMINAL) {
    const tab = await browser.newPage({ viewport: { width: 1200, height: 900 } });
    await tab.setContent(terminal(fs.readFileSync(process.env.TERMINAL, "utf8").trimEnd()));
    await tab.locator("pre").screenshot({ path: path.join(__dirname, "terminal.png") });
    return browser.close();
  }
  const open = async (page, theme, width, height) => {
    const tab = await browser.newPage({ viewport: { width, height }, colorScheme: theme });
    await tab.goto(page);
    await tab.waitForFunction(drawn);
    return tab;
  };
  for (const page of [s1, s2]) {
    const tab = await open(page, "light", 1000, 900);
    await tab.addStyleTag({ content: ".tools button { visibility: hidden; }" });
    for (const figure of await tab.locator("figure.plot").all()) {
      const title = await figure.locator("figcaption").textContent();
      const number = /^Figure (\d+)/.exec(title)?.[1];
      if (!number) continue;
      const part = title.includes("u_2") || title.includes("C_t2") ? "b" : title.includes("u_1") || title.includes("C_t1") ? "a" : "";
      await figure.screenshot({ path: path.join(__dirname, `figure-${number.padStart(2, "0")}${part}.png`) });
    }
    await tab.close();
  }
  for (const theme of ["light", "dark"]) {
    const tab = await open(one, theme, 1280, 800);
    await tab.screenshot({ path: path.join(__dirname, `report-${theme}.png`) });
    await tab.close();
  }
  await browser.close();
})();

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
"use strict";
const path = require("path");
const { chromium } = require("playwright-core");

const [s1, s2, one] = process.argv.slice(2).map((file) => "file://" + path.resolve(file));
const drawn = () => document.querySelectorAll("[data-drawn]").length === document.querySelectorAll("figure.plot").length;

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
  const open = async (page, theme, height) => {
    const tab = await browser.newPage({ viewport: { width: 1000, height }, colorScheme: theme });
    await tab.goto(page);
    await tab.waitForFunction(drawn);
    return tab;
  };
  for (const page of [s1, s2]) {
    const tab = await open(page, "light", 900);
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
    const tab = await open(one, theme, 760);
    await tab.evaluate(() => document.getElementById("plots").scrollIntoView());
    await tab.screenshot({ path: path.join(__dirname, `report-${theme}.png`) });
    await tab.close();
  }
  await browser.close();
})();

"""Drives the page of a campaign in Chromium and compares what it says with the table of results.

    python3 tests/hosts/campaign_page.py PAGE.html DIR/results.parquet [CHROMIUM]

Needs playwright and pyarrow, and a study that varies two numbers first. Drags a range in a histogram and a rectangle
over points, types a range, hides a variant, chooses axes and colours, asks for a case, clears; prints JSON, and ends
with 1 if the page said anything else than the table.
"""

import json
import re
import statistics
import sys

import pyarrow.compute as pc
import pyarrow.parquet as pq
from playwright.sync_api import sync_playwright

CATCH = "window.wrong = []; addEventListener('securitypolicyviolation', (event) => wrong.push(event.blockedURI));"
# Draws texts three times as large, which makes labels long, and keeps the left end of those beside a value axis.
LARGE = """(() => {
  const context = CanvasRenderingContext2D.prototype, { fillText, clearRect } = context;
  const { get, set } = Object.getOwnPropertyDescriptor(context, "font");
  Object.defineProperty(context, "font", { get, set(font) { set.call(this, font.replace("11px", "33px")); } });
  context.clearRect = function (...box) { this.canvas.labels = []; return clearRect.apply(this, box); };
  context.fillText = function (text, x, y) {
    if (this.textAlign === "right") (this.canvas.labels ||= []).push([text, x - this.measureText(text).width]);
    return fillText.call(this, text, x, y);
  };
})()"""
TOOK = "performance.getEntriesByName('select').map((one) => one.duration)[0]"


def main(path, results, chromium="/usr/bin/chromium"):
    table = pq.read_table(results)
    wrong, times = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        page.on("console", lambda message: wrong.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if not request.url.startswith("file:") else None)
        page.add_init_script(CATCH)
        page.goto(f"file://{path}")
        page.wait_for_function("performance.getEntriesByName('select').length > 0")

        def settle():
            page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            times.append(page.evaluate(TOOK))

        def drag(canvas, start, end):
            canvas.evaluate("(one) => one.scrollIntoView({ block: 'center' })")
            settle()
            box = canvas.bounding_box()
            place = lambda at: (box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"])
            page.mouse.move(*place(start))
            page.mouse.down()
            for part in range(1, 11):
                page.mouse.move(*(a + (b - a) * part / 10 for a, b in zip(place(start), place(end))))
                settle()
            page.mouse.up()
            settle()

        def said():
            number = re.match(r"of (?:all )?([\d,]+) .*?(?:, ([\d.]+) %|, none)", page.inner_text("#count"))
            return int(number[1].replace(",", "")), float(number[2] or 0)

        def ranges():
            read = """() => [...document.querySelectorAll('#varied .plot')].map((plot) => [plot.querySelector('figcaption').textContent,
                ...[...plot.querySelectorAll('.range input')].map((one) => one.value)])"""
            return {name: limits for name, *limits in page.evaluate(read) if any(limits)}

        def expect(what, rows):
            passing = pc.sum(pc.equal(rows["class"], "pass")).as_py() or 0
            count, share = said()
            exact = 100 * passing / rows.num_rows if rows.num_rows else 0
            if count != rows.num_rows or abs(share - exact) > 0.02:
                wrong.append(f"{what}: the page says {count} and {share} %, the table {rows.num_rows} and {exact} %")

        def within(rows):
            for name, (low, high) in ranges().items():
                values = rows[name].cast("float32").cast("float64")
                keep = pc.and_(pc.greater_equal(values, float(low or "-inf")), pc.less_equal(values, float(high or "inf")))
                rows = rows.filter(keep)
            return rows

        expect("all", table)
        drag(page.locator("#varied canvas").nth(0), (0.3, 0.5), (0.6, 0.5))
        expect("a range", within(table))
        page.locator("#varied .range input").nth(2).fill("100")
        page.keyboard.press("Tab")
        settle()
        expect("a typed range", within(table))
        if len(ranges()) != 2:
            wrong.append(f"ranges are {ranges()}")
        boxes = page.locator("#legend input")
        if boxes.count() > 1:
            boxes.nth(boxes.count() - 1).click()
            settle()
            name = table["variant"][boxes.count() - 1].as_py()
            expect("without a variant", within(table.filter(pc.not_equal(table["variant"], name))))
        page.click("#clear")
        settle()
        expect("cleared", table)
        drag(page.locator("#mapped canvas").nth(0), (0.3, 0.2), (0.7, 0.8))
        if len(ranges()) != 2:
            wrong.append(f"a rectangle made {ranges()}")
        expect("a rectangle", within(table))
        if page.locator("#mapped canvas").count():
            page.select_option("#across", index=0)
        page.select_option("#colour", "variant")
        page.select_option("#heights", "log")
        page.click("#theme")
        page.click("#clear")
        settle()
        page.fill("#number", str(table["case"][7].as_py()))
        page.keyboard.press("Enter")
        shown = page.inner_text("#case")
        if f"Case {table['case'][7].as_py()}: {table['variant'][7].as_py()}" not in shown or "hil campaign case " not in shown:
            wrong.append(f"a case is shown as {shown}")
        wrong.extend(page.evaluate("wrong"))
        page.add_init_script(LARGE)
        page.reload()
        page.wait_for_function("performance.getEntriesByName('select').length > 0")
        labels = []
        for canvas in page.locator("figure.plot canvas").all():
            canvas.evaluate("(one) => one.scrollIntoView({ block: 'center' })")
            for _ in range(4):  # as often as a wider label may ask for another drawing
                settle()
            labels.extend(canvas.evaluate("(one) => one.labels || []"))
        wrong.extend(f"label {text} begins at {left}" for text, left in labels if left < 0)
        if not any(len(text) > 3 for text, _ in labels):
            wrong.append(f"no label is long: {labels}")
        browser.close()
    print(json.dumps({"rows": table.num_rows, "wrong": wrong, "median_ms": statistics.median(times), "longest_ms": max(times)}))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

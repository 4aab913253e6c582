"""Looks closer at the page of a report in Chromium, one play for each test, as `panel_page.py` does.

    python3 tests/hosts/report_closer.py PLAY PAGE [CHROMIUM]
"""

import sys
import time

import panel_page
from panel_closer import BANDED, FAINT, drag
from panel_page import OVERFLOW

RANGE = "document.documentElement.dataset.range.split(' ').map(Number)"
DRAWN = "document.querySelectorAll('figure.plot').length === document.querySelectorAll('figure[data-drawn]').length"


def wait(page, expression, arg=None):
    since = time.monotonic()
    while not page.evaluate(expression, arg):
        if time.monotonic() - since > 100:
            raise TimeoutError(f"{expression} {arg}")
        page.wait_for_timeout(30)


def opened(desk, **options):
    page = desk.open(**options)
    wait(page, DRAWN)
    return page


def over(page):
    """The box of the first plot that is in sight."""
    page.evaluate("document.querySelector('figure.plot').scrollIntoView({ block: 'center' })")
    return page.locator("figure.plot .u-over").first.bounding_box()


def typed(page, **times):
    for field, time in times.items():
        page.fill("#" + field.replace("_", "-"), time)
        page.keyboard.press("Enter")


def zoom(desk):
    """By drag, wheel, keys, typed numbers and fingers."""
    page = opened(desk)
    box = over(page)
    middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
    drag(page, box, 0.4, 0.6)
    result = {"dragged": page.evaluate(RANGE)}
    result["fields"] = [float(page.input_value(field)) for field in ("#from", "#to")]
    page.mouse.move(*middle)
    page.keyboard.down("Control")
    for _ in range(4):
        page.mouse.wheel(0, -120)
    page.keyboard.up("Control")
    wait(page, f"(before) => {{ const [from, to] = {RANGE}; return to - from < 0.5 * (before[1] - before[0]); }}", result["dragged"])
    result["wheeled"] = page.evaluate(RANGE)
    drag(page, over(page), 0.5, 0.75, "Shift")
    result["panned"] = page.evaluate(RANGE)
    page.mouse.move(0, 0)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("+")
    result["beside"] = page.evaluate(RANGE)
    typed(page, to="2.5")
    typed(page, **{"from": "2"})
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.keyboard.press("-")
    result["keyed"] = page.evaluate(RANGE)
    page.keyboard.press("ArrowRight")
    result["moved"] = page.evaluate(RANGE)
    box = over(page)
    page.mouse.dblclick(box["x"] + box["width"] / 3, box["y"] + box["height"] / 2)
    result["double"] = page.evaluate(RANGE)
    result["cursors"] = page.is_visible("#measure")
    desk.close(page)
    page = opened(desk, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    result["overflow"] = page.evaluate(OVERFLOW)
    box = over(page)
    touch = page.context.new_cdp_session(page)

    def fingers(kind, *parts):
        y = box["y"] + box["height"] / 2
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": box["x"] + box["width"] * part, "y": y, "id": nth} for nth, part in enumerate(parts)]})

    fingers("touchStart", 0.45)
    fingers("touchStart", 0.45, 0.55)
    for part in range(1, 6):
        fingers("touchMove", 0.45 - 0.05 * part, 0.55 + 0.05 * part)
    fingers("touchEnd")
    result["pinched"] = page.evaluate(RANGE)
    desk.close(page)
    return result


def cursors(desk):
    """Two cursors by click, key and number; their table, copied as text and as a requirement."""
    page = opened(desk)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    box = over(page)
    page.mouse.click(box["x"] + box["width"] * 0.3, box["y"] + box["height"] / 2)
    page.wait_for_selector("#measure:not([hidden])")
    result = {"clicked": float(page.input_value("#cursor-a")), "single": page.inner_text("#figures-head"), "one": page.inner_text("#figures")}
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.mouse.move(0, 0)
    page.keyboard.press("b")
    result["middle"] = float(page.input_value("#cursor-b"))
    page.keyboard.press(">")
    result["next"] = float(page.input_value("#cursor-b"))
    typed(page, cursor_a="1.25", cursor_b="1.75")
    result["steps"] = page.evaluate("document.documentElement.dataset.measured.split(' ').map(Number)")
    result["basis"] = page.inner_text("#basis")
    result["gap"] = page.inner_text("#gap")
    page.click("#copy-figures")
    wait(page, "document.getElementById('status').textContent === 'copied the table'")
    result["text"] = page.evaluate("navigator.clipboard.readText()")
    page.locator("[aria-label='Copy a requirement on truth.position_m']").click()
    wait(page, "document.getElementById('copied').textContent.includes('[[requirements]]')")
    result["requirement"] = page.evaluate("navigator.clipboard.readText()")
    result["legend"] = page.locator("figure.plot .legend button .value").first.inner_text()
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.keyboard.press("c")
    result["cleared"] = not page.is_visible("#measure")
    # The time that a legend reads under the pointer, and that of a cursor put there.
    result["pointer"] = []
    box = over(page)
    for part in (0.1101, 0.1504, 0.2507, 0.3313, 0.6116, 0.7319):
        page.mouse.move(box["x"] + box["width"] * part, box["y"] + 20)
        page.keyboard.press("a")
        result["pointer"].append([f"at {page.input_value('#cursor-a')} s", page.evaluate("[...document.querySelector('figure.plot .legend').children].at(-1).textContent")])
    desk.close(page)
    return result


def banded(desk):
    """The band of a baseline on three pages: what is shaded, and what a cursor reads of it."""
    result = {}
    for name in ("course", "range", "both"):
        page = desk.open(desk.url.replace("course.html", f"{name}.html"))
        wait(page, DRAWN)
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        one = result[name] = {"label": page.inner_text("#band"), "legend": page.locator("figure.plot .legend").first.inner_text()}
        one["ink"] = page.evaluate(FAINT, BANDED)
        page.evaluate("document.querySelector('figure.plot').focus()")
        page.keyboard.press("a")
        typed(page, cursor_a="0.7")
        one["steps"] = page.evaluate("document.documentElement.dataset.measured.split(' ').map(Number)")
        page.click("#copy-figures")
        wait(page, "document.getElementById('status').textContent === 'copied the table'")
        one["text"] = page.evaluate("navigator.clipboard.readText()")
        if len(sys.argv) > 4:
            page.screenshot(path=f"{sys.argv[4]}/banded-{name}.png")
        desk.close(page)
    return result


def palette(desk):
    """Plots, signals, faults, requirements and actions by their names, without a pointer."""
    page = opened(desk)

    def find(text):
        page.keyboard.press("Control+k")
        page.wait_for_selector("dialog#palette[open]")
        page.keyboard.type(text)
        first = page.locator("#found li").first
        parts = [first.locator("." + name).inner_text() for name in ("name", "kind")]
        page.keyboard.press("Enter")
        return parts

    result = {"signal": find("applied.force")}
    wait(page, DRAWN)
    result["added"] = page.inner_text("#added figcaption")
    result["focused"] = page.evaluate("document.activeElement.getAttribute('aria-label')")
    result["requirement"] = find("settles")
    result["range"] = page.evaluate(RANGE)
    result["whole"] = find("whole run")
    result["all"] = page.evaluate(RANGE)
    desk.close(page)
    return result


FOUND = """() => [...document.querySelectorAll('figure.plot')].filter((one) => one.querySelector('canvas') && !one.closest('#latency') && one.getBoundingClientRect().top < innerHeight && one.getBoundingClientRect().bottom > 0).map((figure) => {
  const canvas = figure.querySelector('canvas'), plot = figure.querySelector('.u-over').getBoundingClientRect(), box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width;
  const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height }).getContext('2d', { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const row = copy.getImageData((plot.left - box.left) * ratio, (plot.bottom - box.top - 3) * ratio, plot.width * ratio, 1).data, ink = getComputedStyle(document.documentElement).getPropertyValue('--found').trim();
  const colour = [1, 3, 5].map((at) => parseInt(ink.slice(at, at + 2), 16));
  let marked = 0;
  for (let at = 0; at < row.length; at += 4) if (colour.every((part, nth) => Math.abs(part - row[at + nth]) < 12)) marked++;
  return marked / (row.length / 4);
})"""


def where(desk):
    """Intervals of a formula of the command line: listed, marked, found by name, and zoomed to."""
    page = opened(desk)
    result = {"list": page.evaluate("[...document.querySelectorAll('#where button')].map((one) => one.textContent)"), "says": page.inner_text("#where p")}
    page.wait_for_timeout(100)
    result["marked"] = page.evaluate(FOUND)
    page.keyboard.press("Control+k")
    page.keyboard.type("tracking where")
    result["entry"] = [page.locator("#found li .name").first.inner_text(), page.locator("#found li .detail").first.inner_text()]
    page.keyboard.press("Escape")
    page.locator("#where button").first.click()
    result["range"] = page.evaluate(RANGE)
    result["overflow"] = page.evaluate(OVERFLOW)
    desk.close(page)
    return result


def legend(desk):
    """Legends under a mouse that moves, with a hidden curve, and bars of several runs."""
    page = opened(desk)
    heights, box = set(), over(page)
    for part in range(1, 40):
        page.mouse.move(box["x"] + box["width"] * part / 40, box["y"] + 60)
        page.wait_for_timeout(20)
        heights.add(tuple(page.evaluate("[...document.querySelectorAll('.legend')].map((one) => one.getBoundingClientRect().height)")))
    result = {"heights": len(heights), "value": page.locator("figure.plot .legend .value").first.inner_text()}
    button = page.locator("figure.plot .legend button").first
    button.click()
    result["hidden"] = button.evaluate("(one) => { const { opacity, textDecorationLine } = getComputedStyle(one); return [opacity, textDecorationLine, getComputedStyle(one.querySelector('line')).strokeWidth]; }")
    result["bars"] = page.evaluate("[...document.querySelectorAll('.uses li[data-verdict=pass]')].map((one) => [one.querySelector('button, span[title]').textContent, one.querySelector('.name .hint')?.textContent ?? null, getComputedStyle(one.querySelector('.fill') ?? one).backgroundColor])")
    desk.close(page)
    return result


def print_(desk):
    """Black on white, without controls."""
    page = opened(desk, color_scheme="dark")
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.keyboard.press("a")
    page.wait_for_selector("#measure:not([hidden])")
    result = {"before": page.evaluate("getComputedStyle(document.body).backgroundColor")}
    page.emulate_media(media="print", color_scheme="dark")
    result["after"] = page.evaluate("[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color]")
    result["controls"] = page.evaluate("[...document.querySelectorAll('button:not(.link), input, select, summary, dialog, #measure')].filter((one) => one.checkVisibility() && !one.closest('.legend') && !one.closest('main details')).map((one) => one.outerHTML)")
    result["unbroken"] = page.evaluate("[...document.querySelectorAll('figure')].every((one) => getComputedStyle(one).breakInside === 'avoid')")
    desk.close(page)
    return result


PLAYS = {"zoom": zoom, "banded": banded, "cursors": cursors, "palette": palette, "legend": legend, "where": where, "print": print_}

if __name__ == "__main__":
    panel_page.PLAYS = PLAYS
    panel_page.main(*sys.argv[1:4])

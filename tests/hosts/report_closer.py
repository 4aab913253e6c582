"""Looks closer at the page of a report in Chromium, one play for each test, as `panel_page.py` does.

    python3 tests/hosts/report_closer.py PLAY PAGE [CHROMIUM]
"""

import sys
import time

import panel_page
from panel_closer import drag
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


PLAYS = {"zoom": zoom, "cursors": cursors, "palette": palette, "print": print_}

if __name__ == "__main__":
    panel_page.PLAYS = PLAYS
    panel_page.main(*sys.argv[1:4])

"""Looks closer at a run in Chromium, one play for each test, as `panel_page.py` does.

    python3 tests/hosts/panel_closer.py PLAY URL [CHROMIUM]
"""

import os
import sys

import panel_page
from panel_page import OVERFLOW, inked, state, wait

SPANS = "() => [...document.querySelectorAll('figure.plot')].filter((one) => one.panelPlot.plot).map((one) => { const { min, max } = one.panelPlot.plot.scales.x; return [min, max]; })"
RANGE = "() => document.documentElement.dataset.range.split(' ').map(Number)"
READ = "() => document.documentElement.dataset.read.split(' ').map(Number)"
# Stretches, their length, and the numbers of the first signal of the first plot, as they are drawn.
DRAWN = """() => { const { part, series, from, to } = document.querySelector('figure.plot').panelPlot;
  const { least, greatest } = part.of(series[0].signal);
  return { first: part.first, length: part.length, least: [...least], greatest: [...greatest], name: series[0].signal.name }; }"""
# Share of each plot in sight that is marked along its lower edge.
MARKED = """() => [...document.querySelectorAll('figure.plot')].filter((one) => one.querySelector('canvas') && one.getBoundingClientRect().top < innerHeight).map((figure) => {
  const canvas = figure.querySelector('canvas'), { left, top, width, height } = figure.panelPlot.plot.bbox;
  const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height }).getContext('2d', { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const row = copy.getImageData(left, top + height - 3, width, 1).data, ink = getComputedStyle(document.documentElement).getPropertyValue('--found').trim();
  const colour = [1, 3, 5].map((at) => parseInt(ink.slice(at, at + 2), 16));
  let marked = 0;
  for (let at = 0; at < row.length; at += 4) if (colour.every((part, nth) => Math.abs(part - row[at + nth]) < 12)) marked++;
  return marked / width;
})"""
LISTED = "[...document.querySelectorAll('#intervals button')].map((one) => one.textContent)"


def opened(desk, **options):
    page = desk.open(**options)
    page.wait_for_selector("figure.plot canvas")
    wait(page, "document.documentElement.dataset.read !== undefined")
    return page


def over(page, nth=0):
    return page.locator("figure.plot .u-over").nth(nth).bounding_box()


def spans(page):
    """The ends of the time axis of every plot that is drawn, once they are the same."""
    for _ in range(100):
        ends = page.evaluate(SPANS)
        want = page.evaluate(RANGE)
        if all(abs(a - b) < 1e-9 for one in ends for a, b in zip(one, want)):
            break
        page.wait_for_timeout(50)
    return ends


def drag(page, box, start, end, key=None):
    y = box["y"] + box["height"] / 2
    if key:
        page.keyboard.down(key)
    page.mouse.move(box["x"] + box["width"] * start, y)
    page.mouse.down()
    for part in range(1, 6):
        page.mouse.move(box["x"] + box["width"] * (start + (end - start) * part / 5), y)
    page.mouse.up()
    if key:
        page.keyboard.up(key)


def zoom(desk):
    """By drag, wheel, keys, typed numbers and fingers; all plots follow; every step is there when there is room."""
    page = opened(desk)
    state(page, "recorded")
    result = {"whole": page.evaluate(RANGE), "first": page.evaluate(READ), "controls": page.evaluate("[...document.querySelectorAll('#pause, #step, #mark, #kind, #knobs, #clear-all')].filter((one) => one.offsetParent).map((one) => one.id)")}
    result["ink"] = inked(page)
    result["overview"] = page.evaluate(DRAWN)
    box = over(page)
    drag(page, box, 0.4, 0.6)
    result["dragged"], result["tied"] = page.evaluate(RANGE), spans(page)
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.keyboard.down("Control")
    for _ in range(12):
        page.mouse.wheel(0, -120)
    page.keyboard.up("Control")
    wait(page, "(before) => { const [from, to] = document.documentElement.dataset.range.split(' ').map(Number); return to - from < (before[1] - before[0]) / 10; }", result["dragged"])
    result["wheeled"] = page.evaluate(RANGE)
    wait(page, "document.documentElement.dataset.read.startsWith('1 ')")
    scrolled = page.evaluate("scrollY")
    page.mouse.wheel(0, 120)
    wait(page, "(before) => scrollY !== before || document.documentElement.scrollHeight <= innerHeight", scrolled)
    result["after scroll"] = page.evaluate(RANGE)
    page.evaluate("scrollTo(0, 0)")
    page.evaluate("document.querySelector('figure.plot').scrollIntoView({ block: 'center' })")
    box = over(page)
    drag(page, box, 0.5, 0.75, "Shift")
    result["panned"] = page.evaluate(RANGE)
    page.fill("#from", "1.2345")
    page.keyboard.press("Enter")
    page.fill("#to", "1.2645")
    page.keyboard.press("Enter")
    wait(page, "document.documentElement.dataset.range === '1.2345 1.2645'")
    wait(page, "(() => { const [length, first] = document.documentElement.dataset.read.split(' ').map(Number); return length === 1 && first <= 1234 && first > 1200; })()")
    page.wait_for_timeout(100)
    result["typed"], result["exact"] = page.evaluate(RANGE), page.evaluate(DRAWN)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    result["key panned"] = page.evaluate(RANGE)
    page.keyboard.press("-")
    result["key zoomed"] = page.evaluate(RANGE)
    page.fill("#to", "0")
    page.keyboard.press("Enter")
    result["refused"] = [page.inner_text("#status"), page.input_value("#to")]
    page.fill("#to", "7,5")
    page.keyboard.press("Enter")
    result["no number"] = [page.inner_text("#status"), page.input_value("#to")]
    page.fill("#to", "99")
    page.keyboard.press("Enter")
    result["beyond"] = page.evaluate(RANGE)
    page.keyboard.press("Escape")
    page.mouse.dblclick(box["x"] + box["width"] / 3, box["y"] + box["height"] / 2)
    result["double"] = page.evaluate(RANGE)
    result["cursors"] = page.is_visible("#measure")
    page.locator(".scale").first.click()
    wait(page, "document.querySelector('figure.plot').panelPlot.plot !== null")
    result["log"] = [page.get_attribute(".scale >> nth=0", "aria-pressed"), page.evaluate("document.querySelector('figure.plot').panelPlot.plot.scales.y.distr")]
    desk.close(page)
    # A phone: one finger moves the part in sight, two zoom in.
    page = opened(desk, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    result["overflow"] = page.evaluate(OVERFLOW)
    page.evaluate("document.querySelector('figure.plot').scrollIntoView({ block: 'center' })")
    touch = page.context.new_cdp_session(page)
    inked(page)  # the labels of its axis have their width
    box = over(page)
    y = box["y"] + box["height"] / 2

    def fingers(kind, *parts):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": box["x"] + box["width"] * part, "y": y, "id": nth} for nth, part in enumerate(parts)]})

    fingers("touchStart", 0.45)
    fingers("touchStart", 0.45, 0.55)
    for part in range(1, 6):
        fingers("touchMove", 0.45 - 0.05 * part, 0.55 + 0.05 * part)
    fingers("touchEnd")
    result["pinched"] = page.evaluate(RANGE)
    box = over(page)
    fingers("touchStart", 0.6)
    for part in range(1, 6):
        fingers("touchMove", 0.6 - 0.06 * part)
    fingers("touchEnd")
    result["swiped"] = page.evaluate(RANGE)
    desk.close(page)
    return result


def place(page, time, nth=0):
    """Clicks a plot at a time."""
    box = over(page, nth)
    start, end = page.evaluate(RANGE)
    page.mouse.click(box["x"] + box["width"] * (time - start) / (end - start), box["y"] + box["height"] / 2)


def measured(page, first, last):
    wait(page, "(ends) => document.documentElement.dataset.measured === ends", f"{first} {last}")


def pointer(desk):
    """What a legend reads under the pointer while the mass moves, and the time of a cursor that is put there."""
    page = opened(desk)
    box = over(page)
    legend = page.locator("figure.plot .legend button[title='truth.position_m'] .value").first
    result = {"length": page.evaluate(READ)[0], "read": []}
    for part in (0.1052, 0.1104, 0.1131, 0.1313, 0.1416, 0.1519):
        page.mouse.move(box["x"] + box["width"] * part, box["y"] + box["height"] / 2)
        page.keyboard.press("a")
        # By then the page has followed the pointer.
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        result["read"].append([page.input_value("#cursor-a"), legend.inner_text()])
    desk.close(page)
    return result


def cursors(desk):
    """Two cursors by click and by number; their table, copied as text and as a requirement."""
    page = opened(desk)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    place(page, 1.0)
    page.wait_for_selector("#measure:not([hidden])")
    wait(page, "document.getElementById('figures-head').textContent.includes('at A')")
    result = {"single": page.inner_text("#figures-head")}
    place(page, 2.0)
    result["clicked"] = [page.input_value("#cursor-a"), page.input_value("#cursor-b")]
    for field, time in (("#cursor-a", "1.25"), ("#cursor-b", "1.75")):
        page.fill(field, time)
        page.keyboard.press("Enter")
    measured(page, 1250, 1750)
    result["table"] = page.inner_text("#measure")
    page.click("#copy-figures")
    result["text"] = page.text_content("#copied")
    wait(page, "document.getElementById('status').textContent === 'copied the table'")
    result["clipboard"] = page.evaluate("navigator.clipboard.readText()")
    page.locator("[aria-label='Copy a requirement on truth.position_m']").click()
    wait(page, "document.getElementById('copied').textContent.includes('[[requirements]]')")
    result["requirement"] = page.evaluate("navigator.clipboard.readText()")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press(".")
    measured(page, 1251, 1750)
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/cursors.png")
    page.keyboard.press("c")
    result["cleared"] = not page.is_visible("#measure")
    desk.close(page)
    return result


def back(desk):
    """In the panel of a session: a part of a held run, its figures, and the newest records again."""
    page = desk.open()
    panel_page.attached(page)
    state(page, "paused")
    box = over(page)
    drag(page, box, 0.2, 0.4)
    wait(page, "document.documentElement.dataset.read !== undefined")
    result = {"range": page.evaluate(RANGE), "read": page.evaluate(READ), "ink": inked(page)}
    place(page, page.evaluate(RANGE)[0] + 0.1)
    page.fill("#cursor-a", "1.25")
    page.keyboard.press("Enter")
    page.fill("#cursor-b", "1.75")
    page.keyboard.press("Enter")
    measured(page, 1250, 1750)
    page.click("#copy-figures")
    result["text"], result["basis"] = page.text_content("#copied"), page.inner_text("#basis")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("c")
    page.keyboard.press("End")
    result["followed"] = page.evaluate("document.documentElement.dataset.range")
    desk.close(page)
    return result


def find(page, text):
    """Opens the list of everything and types some letters; gives what it lists."""
    page.keyboard.press("Control+k")
    page.wait_for_selector("dialog#palette[open]")
    page.keyboard.type(text)
    return page.evaluate("[...document.querySelectorAll('#found li')].map((row) => [...row.children].map((one) => one.textContent))")


def palette(desk):
    """In a session, by keys alone: a fault that asks first, a value, a plot; Escape closes."""
    page = desk.open()
    panel_page.attached(page)
    state(page, "paused")
    page.wait_for_selector("#tune-box:not([hidden])")
    result = {"dropouts": [row[1] for row in find(page, "dropout")]}
    page.keyboard.press("Escape")
    result["dropout"] = find(page, "drpos")[0]
    page.keyboard.press("Enter")
    result["armed"] = [page.is_visible("#armed"), page.inner_text("#armed-words")]
    page.keyboard.press("Enter")
    result["let go"] = page.is_visible("#armed")
    find(page, "drpos")
    page.keyboard.press("Escape")
    result["escaped"] = [page.locator("dialog#palette[open]").count(), page.is_visible("#armed")]
    find(page, "drpos")
    page.keyboard.press("Enter")
    page.keyboard.press("y")
    panel_page.says(page, "fault 1 dropout takes effect")
    result["kind"] = find(page, "stuck fault")[0]
    page.keyboard.press("Enter")
    result["kind armed"] = page.inner_text("#armed-words")
    page.keyboard.press("Escape")
    result["mass"] = find(page, "mass_kg")[0]
    page.keyboard.press("Enter")
    page.keyboard.press("Control+a")
    page.keyboard.type("1.5")
    page.keyboard.press("Enter")
    panel_page.says(page, "plant.parameters.mass_kg = 1.5 kg")
    result["plot"] = find(page, "force plot")[0]
    page.keyboard.press("ArrowDown")
    result["second"] = page.evaluate("[...document.querySelectorAll('#found li')].findIndex((row) => row.getAttribute('aria-selected') === 'true')")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    result["focused"] = page.evaluate("[document.activeElement.getAttribute('aria-label'), getComputedStyle(document.activeElement).outlineStyle]")
    result["nothing"] = find(page, "qqqq")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/palette.png")
    page.keyboard.press("Escape")
    desk.close(page)
    return result


def names(desk):
    """In a recorded run: any signal is drawn, and a requirement leads to its time."""
    page = opened(desk)
    result = {"entry": find(page, "apfor")[0]}
    page.keyboard.press("Enter")
    page.wait_for_selector("figure.plot >> nth=0")
    wait(page, "(() => { const { part, series } = document.querySelector('figure.plot').panelPlot; return part && part.of(series[0].signal) !== null; })()")
    result["plot"] = page.evaluate(DRAWN)
    find(page, "settles requirement")
    page.keyboard.press("Enter")
    result["range"], result["cursor"] = page.evaluate(RANGE), page.input_value("#cursor-a")
    desk.close(page)
    return result


def refusals(page):
    """What a page says to formulas that are none, or that cannot be judged at each step."""
    result = {}
    for formula in ("truth.nothing > 1", "always(truth.position_m < 1)", "truth.position_m >", "truth.position_m < 3 N"):
        page.evaluate("delete document.documentElement.dataset.found")
        page.fill("#where", formula)
        page.keyboard.press("Enter")
        wait(page, "document.documentElement.dataset.found !== undefined")
        result[formula] = [page.evaluate("document.documentElement.dataset.found"), page.inner_text("#where-says")]
    return result


def refused(desk):
    """The same in an object of their own."""
    page = opened(desk)
    result = {"refused": refusals(page)}
    desk.close(page)
    return result


def growing(desk):
    """In a session: the intervals of a formula up to now, after some more steps, and formulas that are refused."""
    page = desk.open()
    panel_page.attached(page)
    state(page, "paused")
    page.select_option("#window", label="whole run")
    page.keyboard.press("w")
    page.keyboard.type("truth.velocity_mps > 0")
    page.keyboard.press("Enter")

    def found(least):
        wait(page, "(least) => { const { judged, newest } = document.documentElement.dataset; return newest >= least && Number(judged) === Number(newest) + 1; }", least)
        page.wait_for_timeout(200)
        return {"says": page.inner_text("#where-says"), "list": page.evaluate(LISTED), "judged": page.evaluate("document.documentElement.dataset.judged"), "marked": page.evaluate(MARKED)}

    result = {"held": found(2498)}
    page.locator("#intervals button").last.focus()
    page.evaluate("window.focusedBefore = document.activeElement")
    panel_page.go()
    result["grown"] = found(3498)
    result["focused"] = page.evaluate("window.focusedBefore === document.activeElement")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/growing.png")
    result["refused"] = refusals(page)
    desk.close(page)
    return result


def where(desk):
    """The intervals of a formula, by keys, and a formula that is none."""
    page = opened(desk)
    page.keyboard.press("w")
    page.keyboard.type("abs(tracking_error_m) > 2e-3 and truth.position_m < 0.011")
    page.keyboard.press("Enter")
    wait(page, "document.documentElement.dataset.found !== undefined")
    result = {"says": page.inner_text("#where-says"), "list": page.evaluate(LISTED)}
    page.wait_for_timeout(100)
    result["marked"] = page.evaluate(MARKED)
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/where.png")
    page.locator("#intervals button").first.click()
    result["range"] = page.evaluate(RANGE)
    result["toast"] = page.inner_text("#status")
    result.update(refusals(page))

    def search(formula):
        page.evaluate("delete document.documentElement.dataset.found")
        page.fill("#where", formula)
        page.keyboard.press("Enter")
        wait(page, "document.documentElement.dataset.found !== undefined")

    search("truth.position_m > 0.01 or rise(truth.velocity_mps > 0)")
    result["top"] = page.evaluate("(() => { const box = document.getElementById('intervals'); return [box.scrollTop, box.scrollHeight > box.clientHeight]; })()")
    search(page.get_attribute("#where", "placeholder"))
    result["example"] = page.evaluate("document.documentElement.dataset.found")
    # So low that the answer is below the window.
    page.set_viewport_size({"width": 1280, "height": 300})
    search("truth.position_m > 0.01")
    result["out of sight"] = [page.inner_text("#status"), page.inner_text("#where-says")]
    desk.close(page)
    return result


def ghost(desk):
    """Another run behind the curves, and its difference at the cursors."""
    page = opened(desk)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    wait(page, "document.documentElement.dataset.ghost !== undefined")
    result = {"over": page.inner_text("#over"), "ghost": page.evaluate("""() => { const { series } = document.querySelector('figure.plot').panelPlot; return series.length; }""")}
    page.wait_for_timeout(200)
    result["ink"] = page.evaluate("""() => { const canvas = document.querySelector('figure.plot canvas');
      const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height }).getContext('2d', { willReadFrequently: true });
      copy.drawImage(canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, canvas.width, canvas.height), ink = getComputedStyle(document.documentElement).getPropertyValue('--ghost').trim();
      const colour = [1, 3, 5].map((at) => parseInt(ink.slice(at, at + 2), 16));
      let count = 0;
      for (let at = 0; at < data.length; at += 4) if (data[at + 3] > 150 && data[at + 3] < 220 && colour.every((part, nth) => Math.abs(part - data[at + nth]) < 30)) count++;
      return count; }""")
    page.keyboard.press("a")
    page.fill("#cursor-a", "0.6")
    page.keyboard.press("Enter")
    measured(page, 600, 600)
    wait(page, "document.getElementById('figures-head').textContent.includes('difference')")
    page.wait_for_timeout(200)
    page.click("#copy-figures")
    result["text"] = page.text_content("#copied")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/ghost.png")
    scrolls = "document.querySelector('#measure .scroll').hasAttribute('data-scrolls')"
    result["wide"] = page.evaluate(scrolls)
    page.set_viewport_size({"width": 390, "height": 844})
    result["narrow"] = wait(page, scrolls)
    result["differ"] = find(page, "runs differ")[0]
    page.keyboard.press("Enter")
    result["compare"] = page.inner_text("#status")
    desk.close(page)
    return result


# Pixels of the shade in the colour of a signal's curve, in the plot that has it.
FAINT = """(name) => { const isIt = (button) => [...button.querySelectorAll('code')].some((one) => one.textContent === name);
  const figure = [...document.querySelectorAll('figure.plot')].find((one) => [...one.querySelectorAll('.legend button')].some(isIt)), canvas = figure.querySelector('canvas');
  const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height }).getContext('2d', { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
  const line = [...figure.querySelectorAll('.legend button')].find(isIt).querySelector('line');
  const colour = getComputedStyle(line).stroke.match(/[\\d.]+/g).map(Number);
  let count = 0;
  for (let at = 0; at < data.length; at += 4) if (data[at + 3] > 30 && data[at + 3] < 55 && colour.every((part, nth) => Math.abs(part - data[at + nth]) < 12)) count++;
  return count; }"""
BANDED = "truth.position_m"


def banded(desk):
    """The band of a baseline behind the curves of a run or of a session that is held, and what a cursor reads of it."""
    page = desk.open()
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.wait_for_selector("figure.plot canvas")
    page.wait_for_selector("#band:not([hidden])")
    result = {"label": page.inner_text("#band"), "over": page.is_visible("#over")}
    if "range" not in result["label"]:
        wait(page, "document.documentElement.dataset.ghost !== undefined")
    page.keyboard.press("a")
    page.fill("#cursor-a", "0.55")
    page.keyboard.press("Enter")
    measured(page, 550, 550)
    wait(page, "/outside at A/.test(document.getElementById('figures-head').textContent)")
    page.wait_for_timeout(300)
    result["ink"] = page.evaluate(FAINT, BANDED)
    page.click("#copy-figures")
    result["text"] = page.text_content("#copied")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/banded.png")
    desk.close(page)
    return result


def branch(desk):
    """The command that goes on from the checkpoint before a cursor, and the branch at the cursor."""
    page = opened(desk)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    result = {"last": page.inner_text("#branch-command")}
    page.keyboard.press("a")
    page.fill("#cursor-a", "1.5")
    page.keyboard.press("Enter")
    result["says"], result["command"] = page.inner_text("#branch-says"), page.inner_text("#branch-command")
    page.click("#copy-branch")
    result["clipboard"] = page.evaluate("navigator.clipboard.readText()")
    page.click("#branch")
    result["armed"] = page.inner_text("#armed")
    page.keyboard.press("n")
    result["let go"] = [page.is_visible("#armed"), page.inner_text("#status"), page.locator("#branches li").count()]
    page.click("#branch")
    page.keyboard.press("y")
    page.wait_for_selector("html[data-branch=held]")
    result["held"], result["panel"] = page.inner_text("#branches li"), page.get_attribute("#branches a", "href")
    result["again"] = page.is_disabled("#branch")
    page.fill("#cursor-a", "0.5")
    page.keyboard.press("Enter")
    result["none"] = [page.inner_text("#branch-says"), page.is_visible("#branch-command")]
    desk.close(page)
    return result


PLOTS = """() => [...document.querySelectorAll('figure.plot')].map(({ panelPlot: { spec, series } }) => ({ title: spec.heading, section: spec.section, signals: series.map((one) => one.signal.name) })).filter(({ section }) => section !== 'Loop')
  .map(({ title, signals }) => ({ title, signals }))"""


def arrange(desk):
    """Plots moved, renamed, changed and removed, by keys and by mouse; what the scenario gets of them."""
    page = opened(desk)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])

    def figure(title):
        return page.locator(f"figure.plot[aria-label='Plot: {title}']")

    def focus():
        return page.evaluate("document.activeElement.getAttribute('aria-label')")

    result = {"before": page.evaluate(PLOTS), "closed": page.locator(".arrange").count()}
    page.keyboard.press("e")
    page.wait_for_selector(".arrange")
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.keyboard.press("Alt+ArrowDown")
    result["moved"], result["focus"], result["says"] = page.evaluate(PLOTS), focus(), page.inner_text("#status")
    figure("Position, wanted and true").get_by_label("Take reference.position_m away").click()
    title = figure("Force").get_by_label("Title")
    title.fill("Force of the actuator")
    title.press("Enter")
    figure("Force of the actuator").get_by_label("Add a signal").select_option(label="applied.force_n")
    result["added"] = focus()
    result["velocity"] = find(page, "truth.velocity")[0]
    page.keyboard.press("Enter")
    figure("truth.velocity_mps").get_by_label("Move down").click()
    last = page.evaluate(PLOTS)[-1]["title"]
    result["last"] = last
    figure(last).focus()
    page.keyboard.press("Delete")
    result["removed"] = page.evaluate(PLOTS)
    page.click("#undo")
    result["undone"] = page.evaluate(PLOTS)[-1]["title"]
    figure(last).focus()
    page.keyboard.press("Delete")
    result["after"] = page.evaluate(PLOTS)
    wait(page, "(() => { const { part, series } = document.querySelector('figure.plot').panelPlot; return part && series.every((one) => part.of(one.signal) !== null); })()")
    result["ink"] = inked(page)
    page.click("#keep")
    page.wait_for_selector("html[data-kept=shown]")
    result["toml"], result["left out"] = page.text_content("#kept-toml"), page.inner_text("#left-out")
    page.click("#copy-plots")
    wait(page, "document.getElementById('status').textContent === 'copied the plots'")
    result["clipboard"] = page.evaluate("navigator.clipboard.readText()")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/arrange.png")
    page.click("#write-plots")
    result["armed"] = page.inner_text("#armed")
    page.keyboard.press("Enter")
    result["let go"] = [page.is_visible("#armed"), page.inner_text("#status"), page.get_attribute("html", "data-kept")]
    page.click("#write-plots")
    page.keyboard.press("y")
    page.wait_for_selector("html[data-kept=written]")
    result["written"] = page.inner_text("#kept-says")
    page.reload()
    page.wait_for_selector("figure.plot canvas")
    result["reloaded"] = page.evaluate(PLOTS)
    # Kept once more: the file is now that of this panel.
    page.keyboard.press("e")
    page.evaluate("document.querySelector('figure.plot').focus()")
    page.keyboard.press("Alt+ArrowDown")
    result["again"] = page.evaluate(PLOTS)
    page.click("#keep")
    page.wait_for_selector("html[data-kept=shown]")
    page.click("#write-plots")
    page.keyboard.press("y")
    page.wait_for_selector("html[data-kept=written]")
    page.click("#reset")
    result["reset"] = page.evaluate(PLOTS)
    result["overflow"] = page.evaluate(OVERFLOW)
    desk.close(page)
    return result


def fold(desk):
    """The log and each answer in sight without scrolling, groups that fold, legends that stand still under the mouse."""
    page = desk.open(viewport={"width": 1280, "height": 800})
    panel_page.attached(page)
    state(page, "paused")
    page.wait_for_selector("#tune-box:not([hidden])")
    page.click("#step")
    panel_page.says(page, "paused before step")
    page.wait_for_selector("#status[data-shown]")
    result = {"log": page.evaluate("document.getElementById('log').getBoundingClientRect().bottom"), "toast": page.locator("#status").bounding_box(), "text": page.inner_text("#status")}
    box, heights = over(page), set()
    for part in range(1, 40):
        page.mouse.move(box["x"] + box["width"] * part / 40, box["y"] + 60)
        page.wait_for_timeout(20)
        heights.add(tuple(page.evaluate("[...document.querySelectorAll('.legend')].map((one) => one.getBoundingClientRect().height)")))
    result["heights"] = len(heights)
    page.click("#fold-tune summary")
    result["folded"] = page.is_visible("#knobs")
    page.reload()
    panel_page.attached(page)
    page.wait_for_selector("#tune-box:not([hidden])")
    result["again"] = page.is_visible("#knobs")
    page.keyboard.press("t")
    result["opened"] = page.is_visible("#knobs")
    desk.close(page)
    return result


# Places of what may move in each plot, from its upper edge, with width and height.
PLACES = """() => [...document.querySelectorAll('figure.plot')].map((figure) => {
  const { top } = figure.getBoundingClientRect();
  return [figure.querySelector('.canvas'), ...figure.querySelectorAll('.legend button')].map((one) => {
    const box = one.getBoundingClientRect();
    return [box.top - top, box.width, box.height].map(Math.round).join(' ');
  }).join(', ');
})"""


def still(desk):
    """Headings and legends while a run goes on, the pointer moves and the window changes: how many places each had."""
    result = {}
    for width in (1280, 700, 390):
        page = desk.open(viewport={"width": width, "height": 800})
        panel_page.attached(page)
        state(page, "paused")
        inked(page)
        places, values = set(), set()
        for window in ("0.05", "0.5", "5"):
            page.select_option("#window", value=window)
            for _ in range(4):
                before = page.evaluate("document.documentElement.dataset.newest")
                page.click("#steps")
                wait(page, "(before) => document.documentElement.dataset.newest !== before", before)
                box = over(page)
                for part in (0.1, 0.12, 0.5, 0.9):
                    page.mouse.move(box["x"] + box["width"] * part, box["y"] + 60)
                    page.wait_for_timeout(60)
                    places.add(tuple(page.evaluate(PLACES)))
                    values.update(page.evaluate("[...document.querySelectorAll('.legend .value')].map((one) => one.textContent)"))
        result[str(width)] = {"places": [list(one) for one in places], "values": sorted(values), "notes": page.evaluate("[...document.querySelectorAll('.canvas > .hint')].map((one) => one.textContent)"), "overflow": page.evaluate(OVERFLOW)}
        if len(sys.argv) > 4:
            page.screenshot(path=f"{sys.argv[4]}/still-{width}.png")
        desk.close(page)
    return result


AXE = """async () => {
  const { violations } = await axe.run(document, { preload: false, runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] });
  return violations.flatMap((rule) => rule.nodes.map((node) => `${rule.id} ${node.target}: ${node.failureSummary}`));
}"""


def accessible(desk):
    """What axe-core finds on a light desk and a dark phone: at first, with cursors and a hidden curve, with the list."""
    with open(os.environ["AXE"], encoding="utf-8") as file:
        axe = file.read()
    result = {"broken": [], "overflow": [], "dashes": []}
    for width, height, scheme in ((1280, 800, "light"), (390, 844, "dark")):
        page = desk.open(viewport={"width": width, "height": height}, color_scheme=scheme)
        page.wait_for_selector("figure.plot canvas")
        wait(page, "document.documentElement.dataset.state !== undefined")
        page.evaluate(axe)

        def look(name):
            result["broken"] += [f"{width} {scheme} {name}: {one}" for one in page.evaluate(AXE)]
            result["overflow"].append(page.evaluate(OVERFLOW))
            if len(sys.argv) > 4:
                page.screenshot(path=f"{sys.argv[4]}/{width}-{scheme}-{name}.png")

        look("first")
        page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
        page.locator(".legend button").first.press("Enter")
        page.locator("figure.plot").first.focus()
        for key in "eab>":
            page.keyboard.press(key)
        page.wait_for_selector("#figures tr")
        look("cursors")
        page.keyboard.press("Control+k")
        page.wait_for_selector("#found li")
        look("palette")
        result["dashes"].append(page.evaluate("[...document.querySelectorAll('.legend')].map((one) => [...one.querySelectorAll('line')].map((line) => line.getAttribute('stroke-dasharray')))"))
        desk.close(page)
    return result


PLAYS = {play.__name__: play for play in (zoom, pointer, cursors, back, palette, names, where, growing, refused, ghost, banded, branch, arrange, fold, still, accessible)}

if __name__ == "__main__":
    panel_page.PLAYS = PLAYS
    panel_page.main(*sys.argv[1:4])

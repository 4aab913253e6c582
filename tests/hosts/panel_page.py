"""Uses the panel of a session in Chromium, one play for each test, and tells what came of it.

    python3 tests/hosts/panel_page.py PLAY URL [CHROMIUM]

Needs playwright. Prints JSON: what the page showed, and under `wrong` every error, warning, refused load and request
to anywhere else, which must be none. A play may end with `go` on standard output and wait for a line: then the test
does something to the session.
"""

import json
import sys
import time
from urllib.parse import urlsplit

from playwright.sync_api import sync_playwright

CATCH = """window.wrong = [];
addEventListener('securitypolicyviolation', (event) => wrong.push('blocked ' + event.violatedDirective + ' ' + event.blockedURI));
addEventListener('unhandledrejection', (event) => wrong.push(String(event.reason)));"""
OVERFLOW = "() => document.documentElement.scrollWidth - innerWidth"
# Of each plot in sight: pixels in the colour of each curve.
INK = """() => [...document.querySelectorAll('figure.plot')].filter((figure) => figure.querySelector('canvas') && figure.getBoundingClientRect().top < innerHeight).map((figure) => {
  const canvas = figure.querySelector('canvas');
  // Of a copy: a browser warns of a canvas that is read again and again.
  const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height }).getContext('2d', { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const pixels = copy.getImageData(0, 0, canvas.width, canvas.height).data;
  const colours = [...figure.querySelectorAll('.legend line')].map((line) => getComputedStyle(line).stroke.match(/[\\d.]+/g).map(Number));
  const ink = colours.map(() => 0);
  for (let at = 0; at < pixels.length; at += 4) colours.forEach(([r, g, b], i) => {
    if (pixels[at + 3] > 150 && Math.abs(pixels[at] - r) + Math.abs(pixels[at + 1] - g) + Math.abs(pixels[at + 2] - b) < 60) ink[i]++;
  });
  return ink;
})"""

# Keeps what each canvas has been told to write, with the left end of each text.
TEXTS = """(() => {
  const context = CanvasRenderingContext2D.prototype, { fillText, clearRect } = context;
  context.clearRect = function (...box) { this.canvas.texts = []; return clearRect.apply(this, box); };
  context.fillText = function (text, x, y) {
    const wide = this.measureText(text).width;
    (this.canvas.texts ||= []).push([text, x - wide * { right: 1, center: 0.5 }[this.textAlign] || x]);
    return fillText.call(this, text, x, y);
  };
})()"""

# Waits for the ink of a curve.
DRAWN = f"""() => new Promise((done) => {{
  const ink = {INK};
  const look = () => document.documentElement.dataset.points > 0 && ink().some((plot) => plot.some((one) => one > 3)) ? done(true) : requestAnimationFrame(look);
  look();
}})"""
# Curves of the plots that are wholly in sight.
CURVES = "() => [...document.querySelectorAll('figure.plot')].filter((figure) => figure.getBoundingClientRect().bottom <= innerHeight).reduce((sum, figure) => sum + figure.querySelectorAll('.legend button').length, 0)"


class Desk:
    """One browser with its pages."""

    def __init__(self, browser, url):
        self.browser, self.url, self.wrong = browser, url, []

    def open(self, url=None, **options):
        options.setdefault("viewport", {"width": 1280, "height": 900})
        page = self.browser.new_context(**options).new_page()
        page.set_default_timeout(100_000)
        page.on("console", lambda message: self.wrong.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        home = urlsplit(self.url).netloc
        page.on("request", lambda request: self.wrong.append(request.url) if urlsplit(request.url).netloc not in (home, "") else None)
        page.add_init_script(CATCH)
        page.goto(url or self.url)
        return page

    def close(self, page):
        self.wrong.extend(page.evaluate("wrong"))
        page.close()


def wait(page, expression, arg=None):
    """Waits for something to be so; from outside, because the page's policy allows no texts as code."""
    since = time.monotonic()
    while not page.evaluate(expression, arg):
        if time.monotonic() - since > 100:
            raise TimeoutError(f"{expression} {arg}; log: {page.inner_text('#log')}; trouble: {page.inner_text('#trouble')}; state: {page.inner_text('#state')}")
        page.wait_for_timeout(30)
    return True


def attached(page):
    page.wait_for_selector("figure.plot canvas")
    wait(page, "document.documentElement.dataset.points > 0")
    page.wait_for_selector("#inject-box:not([hidden])")


def inked(page):
    """Waits until every curve in sight has ink, and gives how much."""
    for _ in range(100):
        ink = page.evaluate(INK)
        if ink and all(one for plot in ink for one in plot):
            break
        page.wait_for_timeout(100)
    return ink


def says(page, text):
    """Waits for a line of the log."""
    wait(page, "(text) => document.getElementById('log').textContent.includes(text)", text)


# The events of the log, the oldest first.
ROWS = "() => [...document.querySelectorAll('#log li[data-event]')].map((row) => row.textContent).reverse()"


def rows(page, *parts):
    """Waits until the log has an event with each of these words, and gives all of them."""
    wait(page, "(parts) => parts.every((part) => [...document.querySelectorAll('#log li[data-event]')].some((row) => row.textContent.includes(part)))", list(parts))
    return page.evaluate(ROWS)


def state(page, name):
    wait(page, "(name) => document.documentElement.dataset.state === name", name)


def go():
    print("go", flush=True)
    sys.stdin.readline()


def controls(desk):
    """Every control by pointer: step, mark, fault by form, its end, pause and resume, window, theme, legend."""
    page = desk.open()
    attached(page)
    state(page, "paused")
    page.click("#step")
    says(page, "paused before step 2501")
    page.click("#steps")
    says(page, "paused before step 2601")
    page.fill("#mark", "<b>felt & heard</b>")
    page.click("#mark-form button")
    says(page, "marked step 2601")
    page.select_option("#kind", "bias")
    page.select_option("#target", "measured.position_m")
    usual = page.input_value("#p-bias")
    page.fill("#p-bias", "-0.001")
    words = page.inner_text("#words")
    page.click("#inject button[type=submit]")
    says(page, "fault 1 bias takes effect at step 2601")
    page.fill("#p-bias", "lots")
    page.click("#inject button[type=submit]")
    says(page, "`lots` is not a number")
    page.click("#buttons button")
    says(page, "fault 2 dropout takes effect at step 2601")
    page.click("#steps")
    page.wait_for_selector("#faults li[data-state=active]")
    marked = wait(page, "document.getElementById('log').textContent.includes('<b>felt & heard</b>')")
    page.click("#faults li[data-state=active] button")
    says(page, "ends: step 2701 is the first without it")
    page.click("#step")
    wait(page, "document.querySelectorAll('#faults li[data-state=active]').length === 0")
    page.select_option("#window", label="1 s")
    wait(page, "document.documentElement.dataset.newest === '2701'")
    page.click("#theme")
    theme = page.evaluate("document.documentElement.dataset.theme")
    page.click(".legend button")
    pressed = page.get_attribute(".legend button", "aria-pressed")
    page.click("#pause")
    state(page, "running")
    page.click("#pause")
    state(page, "paused")
    held = page.inner_text("#time")
    page.wait_for_timeout(300)
    still = page.inner_text("#time")
    faults = page.inner_text("#faults")
    page.click("#pause")
    state(page, "ended")
    wait(page, "document.getElementById('state').textContent.startsWith('ended: ') && !document.getElementById('state').textContent.includes('completed')")
    ink = inked_but_first(page)
    told = {
        "usual": usual, "words": words, "marked": bool(marked), "theme": theme, "pressed": pressed, "held": held == still, "faults": faults,
        "state": page.inner_text("#state"), "trouble": page.inner_text("#trouble"), "requirements": page.inner_text("#requirements"),
        "ink": ink, "bold": page.locator("b").count(), "readings": page.inner_text("#readings"),
    }
    desk.close(page)
    return told


def tune(desk):
    """Sliders: typed, dragged, by keys, on a ramp, refused, and given back; another page follows."""
    page, other = desk.open(), desk.open()
    for one in (page, other):
        attached(one)
        state(one, "paused")
        one.wait_for_selector("#tune-box:not([hidden])")

    def slider(key):
        return page.locator(f"#knobs input[type=range][aria-label='{key}']")

    def field(key):
        return slider(key).locator("xpath=following-sibling::input")

    def value(one, key, wanted):
        wait(one, "([key, wanted]) => Math.abs(document.querySelector(`#knobs input[aria-label='${key}']`).nextSibling.value - wanted) < 1e-9", [key, wanted])

    mass, gain, position = "plant.parameters.mass_kg", "controller.pid.proportional_n_per_m", "reference.position_m"
    field(mass).fill("1.25")
    page.keyboard.press("Enter")
    says(page, mass + " = 1.25 kg")
    value(other, mass, 1.25)
    field(mass).fill("-1")
    page.keyboard.press("Enter")
    says(page, "out of range")
    value(page, mass, 1.25)
    for text in ("abc", "1e999"):
        field(mass).fill(text)
        page.keyboard.press("Enter")
        wait(page, "(text) => document.getElementById('status').textContent === `\\`${text}\\` is no number`", text)
        value(page, mass, 1.25)
    page.evaluate("document.activeElement.blur()")
    # From the middle of twice its value to three quarters, in some moves.
    box = slider(gain).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    for part in range(51, 76):
        page.mouse.move(box["x"] + box["width"] * part / 100, box["y"] + box["height"] / 2)
    page.mouse.up()
    says(page, gain)
    dragged = float(field(gain).input_value())
    value(other, gain, dragged)
    slider(gain).press("ArrowRight")
    pressed = float(field(gain).input_value())
    value(other, gain, pressed)
    page.fill("#tune-ramp", "0.1")
    field(position).fill("0.02")
    page.keyboard.press("Enter")
    says(page, position + " = 0.02 m")
    page.click("#steps")
    says(page, "paused before step 2600")
    page.locator(f"[aria-label='Stimulus again: {position}']").click()
    says(page, "follows its stimulus")
    page.locator(f"[aria-label='Reset {mass}']").click()
    says(page, mass + " = 1 kg")
    value(other, mass, 1)
    gains = [row for row in rows(page, gain, mass + " = 1.25 kg", position) if gain in row]
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("t")
    focused = page.evaluate("document.activeElement.getAttribute('aria-label')")
    if len(sys.argv) > 4:
        page.screenshot(path=f"{sys.argv[4]}/tune.png", full_page=True)
    page.click("#pause")
    state(page, "ended")
    told = {"dragged": dragged, "pressed": pressed, "focused": focused, "rows": gains}
    for one in (page, other):
        desk.close(one)
    return told


def keyboard(desk):
    """Everything without a pointer."""
    page = desk.open()
    attached(page)
    state(page, "paused")
    press = page.keyboard.press
    press("s")
    says(page, "paused before step 2501")
    press("Shift+S")
    says(page, "paused before step 2601")
    # Past the controls; the address keeps its secret.
    page.focus(".skip")
    press("Enter")
    skipped = [page.evaluate("document.activeElement.id"), page.url]
    press("m")
    page.keyboard.type("by keys")
    press("Enter")
    says(page, "marked step 2601")
    press("Escape")
    asks = []
    before = page.input_value("#window")
    press("-")
    wider = page.input_value("#window")
    press("+")
    press("+")
    narrower = page.input_value("#window")
    # Numbers that are typed with no field in focus inject nothing, however they end.
    for text in ("1", "11", "1.1", "y1", "1 y"):
        page.keyboard.type(text)
        press("Enter")
        asks.append(page.is_visible("#armed"))
    press("1")
    asks.append(page.is_visible("#armed") and page.inner_text("#armed"))
    press("Escape")
    asks.append(page.is_visible("#armed"))
    press("1")
    page.mouse.click(400, 500)
    asks.append(page.is_visible("#armed"))
    press("1")
    page.wait_for_selector("#armed", state="hidden")  # by itself
    page.evaluate("document.activeElement.blur()")
    press("y")
    press("1")
    press("y")
    says(page, "fault 1 dropout takes effect")
    press("f")
    # A list takes keys as one word only if they follow within a second, which a busy machine does not always manage.
    for _ in range(20):
        page.keyboard.type("stuck")
        if page.input_value("#kind") == "stuck":
            break
        page.wait_for_timeout(1500)
    else:
        raise AssertionError("the list of kinds does not go to what is typed")
    focused = page.evaluate("document.activeElement.id")
    # From the list on to the button that puts it in.
    for _ in range(12):
        press("Tab")
        if page.evaluate("document.activeElement.textContent") == "Inject":
            break
    press("Enter")
    says(page, "fault 2 stuck takes effect")
    # Every control can be reached, in an order, and shows that it has the focus.
    page.evaluate("document.activeElement.blur()")
    reached, outlined = [], True
    for _ in range(120):
        press("Tab")
        name = page.evaluate("document.activeElement.id || document.activeElement.textContent.slice(0, 20)")
        if name in reached[:1]:
            break
        reached.append(name)
        outlined = outlined and page.evaluate("document.activeElement === document.body || getComputedStyle(document.activeElement).outlineStyle !== 'none'")
    page.evaluate("document.activeElement.blur()")
    press(" ")
    # At full speed the end may come before a page has heard that it runs.
    wait(page, "document.documentElement.dataset.state !== 'paused'")
    told = {"window": [float(before), float(wider), float(narrower)], "focused": focused, "skipped": skipped, "reached": reached, "outlined": outlined, "asks": asks}
    desk.close(page)
    return told


# Of curves of several shapes over 1000 stretches: how far the path is from the least and the greatest value of a stretch
# at most, in pixels, its corners, and the pieces that gaps make of it.
COURSES = """() => {
  const pieces = [];
  const path = Path2D.prototype, { moveTo, lineTo } = path;
  path.moveTo = (x, y) => pieces.push([[x, y]]);
  path.lineTo = (x, y) => pieces.at(-1).push([x, y]);
  const u = { bbox: { left: 60, top: 10, width: 500, height: 150 }, scales: { x: { min: 0, max: 1000 }, y: { min: -1, max: 1 } } };
  const across = (time) => 60 + time / 2;
  const heightAt = (x) => {
    for (const piece of pieces) for (let nth = 1; nth < piece.length; nth++) {
      const [[fromX, fromY], [toX, toY]] = [piece[nth - 1], piece[nth]];
      if (fromX - 1e-9 <= x && x <= toX + 1e-9) return x >= toX ? toY : fromY + ((toY - fromY) * (x - fromX)) / (toX - fromX);
    }
    return NaN;
  };
  const shapes = {
    line: (n) => [n / 1000, n / 1000], spike: (n) => [n === 500 ? 0.9 : 0, n === 500 ? 0.9 : 0], sine: (n) => Array(2).fill(Math.sin(n / 60)),
    saw: (n) => [(n % 7) / 10 - 0.4, (n % 11) / 20 + 0.3], steps: (n) => Array(2).fill((n % 100 < 50) / 2), gaps: (n) => Array(2).fill(n % 250 < 20 ? NaN : n / 2000),
  };
  const told = {};
  for (const [name, shape] of Object.entries(shapes)) {
    pieces.length = 0;
    const [least, greatest] = [0, 1].map((end) => Float64Array.from({ length: 1000 }, (_, n) => shape(n)[end]));
    courseOf(u, { least, greatest }, { from: 0, to: 999, slot: (n) => n, begin: (n) => n, end: (n) => n + 0.75, isApart: (n, before) => n > before + 1 });
    let farthest = 0;
    for (let n = 0; n < 1000; n++) {
      if (Number.isNaN(least[n])) continue;
      const isOne = least[n] === greatest[n];
      const drawn = [n, isOne ? n : n + 0.75].map((time) => heightAt(across(time))).sort((a, b) => a - b);
      const meant = [greatest[n], least[n]].map((value) => 160 - (value + 1) * 75);
      farthest = Math.max(farthest, Math.abs(drawn[0] - meant[0]), Math.abs(drawn[1] - meant[1]));
    }
    told[name] = [farthest, pieces.reduce((sum, piece) => sum + piece.length, 0), pieces.length];
  }
  Object.assign(path, { moveTo, lineTo });
  return told;
}"""


def looks(desk):
    """A phone and a desk, light and dark, large text."""
    told = {}
    for name, width, scheme in [("desk-light", 1280, "light"), ("desk-dark", 1280, "dark"), ("phone-light", 360, "light"), ("phone-dark", 360, "dark")]:
        page = desk.open(viewport={"width": width, "height": 780}, color_scheme=scheme)
        attached(page)
        state(page, "paused")
        told[name] = {
            "theme": page.evaluate("document.documentElement.dataset.theme"), "overflow": page.evaluate(OVERFLOW), "ink": inked(page),
            "small": page.evaluate("[...document.querySelectorAll('button, input, select')].filter((one) => one.offsetParent && !one.closest('.legend') && one.getBoundingClientRect().height < 24).map((one) => one.id || one.textContent)"),
        }
        if len(sys.argv) > 4:
            page.screenshot(path=f"{sys.argv[4]}/{name}.png", full_page=True)
        if name == "desk-light":
            told["courses"] = page.evaluate(COURSES)
        desk.close(page)
    return told


def places(desk):
    """The button that pauses is the one that resumes, in its place and with its focus, whatever the texts beside it."""
    told = {}
    for width in (1280, 1000, 800, 360):
        page = desk.open(viewport={"width": width, "height": 800})
        attached(page)
        state(page, "paused")
        page.focus("#pause")
        seen = []
        for name in ("paused", "running", "paused"):
            state(page, name)
            wait(page, "(name) => document.getElementById('pause').textContent === name", "Resume" if name == "paused" else "Pause")
            if name == "running":
                wait(page, "document.getElementById('speed').textContent.includes('real time')")
            if len(sys.argv) > 4:
                page.screenshot(path=f"{sys.argv[4]}/places-{width}-{len(seen)}.png")
            seen.append([page.evaluate(f"(() => {{ const {{ x, y, width }} = document.getElementById('{one}').getBoundingClientRect(); return [x, y, width]; }})()") for one in ("pause", "step", "window", "plots")])
            seen[-1].append(page.evaluate("document.activeElement.id"))
            if len(seen) < 3:
                page.keyboard.press("Enter")
        told[str(width)] = seen
        desk.close(page)
    return told


CHOICES = """() => [document.documentElement.dataset.theme, document.getElementById('window').value,
  [...document.querySelectorAll('.legend button')].map((one) => one.getAttribute('aria-pressed'))]"""
HELD = "() => Object.entries(sessionStorage).concat(Object.entries(localStorage)).flat().concat(document.cookie)"


def reload(desk):
    """Window, theme and hidden curves outlast a reload; a storage of garbage, and none, are as a first visit."""
    page = desk.open()
    attached(page)
    first = page.evaluate(CHOICES)
    page.click("#theme")
    page.select_option("#window", label="1 s")
    page.click(".legend button")
    chosen = page.evaluate(CHOICES)
    page.reload()
    attached(page)
    told = {"first": first, "chosen": chosen, "again": page.evaluate(CHOICES), "ink": inked_but_first(page), "held": page.evaluate(HELD)}
    for name, value in [("text", "}{"), ("null", "null"), ("number", "7"), ("other", '{"window_s":"1e9","hidden":{"0":1}}'), ("list", '[["x"]]')]:
        page.evaluate("(value) => { for (const key of Object.keys(sessionStorage)) sessionStorage.setItem(key, value); }", value)
        page.reload()
        attached(page)
        told["garbage " + name] = page.evaluate(CHOICES)
    desk.close(page)
    page = desk.open("about:blank")
    page.add_init_script("Object.defineProperty(window, 'sessionStorage', { get() { throw new DOMException('refused', 'SecurityError'); } });")
    page.goto(desk.url)
    attached(page)
    told["refused"] = page.evaluate(CHOICES)
    page.click("#theme")
    page.click(".legend button")
    told["refused-chosen"] = page.evaluate(CHOICES)
    desk.close(page)
    return told


def inked_but_first(page):
    """Waits until every curve in sight but the first has ink; gives how much."""
    for _ in range(100):
        ink = page.evaluate(INK)
        if ink and all(ink[0][1:]) and all(one for plot in ink[1:] for one in plot):
            break
        page.wait_for_timeout(100)
    return ink


READ = "() => [...document.querySelectorAll('#readings dt')].map((one) => [one.textContent, one.nextSibling.textContent])"
LEGENDS = "() => [...document.querySelectorAll('.legend button')].map((one) => [one.title, one.querySelector('.value').textContent])"


def final(desk):
    """Values at the end of the run, and of a page that comes then; those of all plots, which are in sight."""
    page = desk.open(viewport={"width": 1280, "height": 5000})
    attached(page)
    title = page.text_content("#readings-box h2")
    page.click("#pause")
    state(page, "ended")
    told = {"before": title}
    for name in ("ended", "loaded"):
        wait(page, "document.documentElement.dataset.newest === '5000'")
        for _ in range(100):  # values are written every tenth of a second
            told[name] = [page.evaluate(READ), page.evaluate(LEGENDS), page.text_content("#readings-box h2")]
            if not any(value in ("", "-") for _, value in told[name][0] + told[name][1]):
                break
            page.wait_for_timeout(100)
        if len(sys.argv) > 4:
            page.screenshot(path=f"{sys.argv[4]}/final-{name}.png")
        if name == "ended":
            page.reload()
            page.wait_for_selector("figure.plot canvas")
    desk.close(page)
    return told


def labels(desk):
    """Left ends of all texts in plots, and where the legends begin, in both themes, sharp, and with another window."""
    told = {}
    for scheme, scale in [("light", 1), ("dark", 1), ("light", 2), ("dark", 1.5)]:
        page = desk.open("about:blank", color_scheme=scheme, device_scale_factor=scale)
        page.add_init_script(TEXTS)
        page.goto(desk.url)
        attached(page)
        inked(page)
        for window in ("whole run", "0.1 s"):
            page.evaluate("document.documentElement.dataset.points = '0'")
            page.select_option("#window", label=window)
            wait(page, "document.documentElement.dataset.points > 0")
            inked(page)
            if len(sys.argv) > 4:
                page.screenshot(path=f"{sys.argv[4]}/labels-{scheme}-{scale}-{window[0]}.png")
            told[f"{scheme} {scale} {window}"] = page.evaluate("""() => [...document.querySelectorAll('figure.plot')].filter((one) => one.querySelector('canvas')).map((figure) => ({
              texts: figure.querySelector('canvas').texts, over: figure.querySelector('.u-over').getBoundingClientRect().x - figure.getBoundingClientRect().x,
              legend: figure.querySelector('.legend button').getBoundingClientRect().x - figure.getBoundingClientRect().x }))""")
        desk.close(page)
    return told


def several(desk):
    """Two browsers: what one does the other shows."""
    one, other = desk.open(), desk.open(color_scheme="dark")
    for page in (one, other):
        attached(page)
        state(page, "paused")
    one.click("#step")
    wait(other, "document.getElementById('time').textContent.includes('step 2501')")
    other.select_option("#kind", "dropout")
    other.click("#inject button[type=submit]")
    says(other, "fault 1 dropout takes effect at step 2501")
    one.wait_for_selector("#faults li")
    other.fill("#mark", "from the other")
    other.keyboard.press("Enter")
    one.click("#step")
    says(one, "from the other")
    words = ("fault 1 dropout on", "from the other")
    log, other_log = rows(one, *words), rows(other, *words)
    other.reload()
    attached(other)
    told = {"log": log, "other-log": other_log, "loaded-log": rows(other, *words), "one": one.inner_text("#faults"), "newest": [page.evaluate("document.documentElement.dataset.newest") for page in (one, other)]}
    for page in (one, other):
        desk.close(page)
    return told


def reconnect(desk):
    """A connection that is cut comes back, so does a page that is loaded anew, with what was before."""
    page = desk.open()
    attached(page)
    page.fill("#mark", "before the cut")
    page.keyboard.press("Enter")
    before = rows(page, "before the cut")
    page.evaluate("document.documentElement.dataset.points = '0'")
    go()  # the test cuts every connection
    wait(page, "document.documentElement.dataset.connection === 'open' && document.documentElement.dataset.points > 0")
    cut, cut_log = inked(page), rows(page, "before the cut")
    page.click("#step")
    says(page, "paused before step 2501")
    page.reload()
    attached(page)
    wait(page, "document.documentElement.dataset.newest === '2500'")
    told = {"cut": cut, "log": before, "cut-log": cut_log, "loaded-log": rows(page, "before the cut"), "loaded": inked(page), "state": page.inner_text("#state"), "url": page.url}
    desk.wrong.clear()  # a browser says on its console that a connection broke
    page.close()
    return told


def strangers(desk):
    """Pages without the secret, with a wrong one, of another origin, and in a frame."""
    bare = urlsplit(desk.url)
    home = f"{bare.scheme}://{bare.netloc}/"
    told = {}
    for name, url in [("none", home), ("false", home + "#" + "0" * 32)]:
        page = desk.open(url)
        wait(page, "!document.getElementById('trouble').hidden")
        told[name] = page.inner_text("#trouble")
        told[name + "-plots"] = page.locator("figure.plot").count()
        page.close()
    page = desk.browser.new_context().new_page()
    page.goto("data:text/html,<iframe></iframe>")
    told["foreign"] = page.evaluate(
        """(home) => new Promise((done) => {
          const socket = new WebSocket(home.replace('http', 'ws') + 'live');
          socket.onopen = () => done('open'); socket.onerror = () => done('refused');
        })""", home)
    page.evaluate("(home) => { document.querySelector('iframe').src = home; }", home)
    page.wait_for_timeout(500)
    told["framed"] = page.evaluate("() => { try { return document.querySelector('iframe').contentDocument ? 'shown' : 'refused'; } catch { return 'refused'; } }")
    told["frames"] = [frame.url for frame in page.frames[1:]]
    page.close()
    desk.wrong.clear()  # refusals are on the console
    return told


def first(desk):
    """The first curve of a panel whose address comes by standard input once the browser is there: `drawn`."""
    print("go", flush=True)
    desk.url = sys.stdin.readline().strip()
    page = desk.open()
    page.evaluate(DRAWN)
    print("drawn", flush=True)
    desk.close(page)
    return {}


def pace(desk):
    """Time that the script takes for a frame with 20 curves in sight, by the clock and of the processor, and bytes that it is sent, for some seconds."""
    page = desk.open(viewport={"width": 1400, "height": 900})
    received = {"bytes": 0, "messages": 0}

    def took(payload):
        received["bytes"] += len(payload)
        received["messages"] += 1

    page.on("websocket", lambda socket: socket.on("framereceived", took))
    page.reload()
    attached(page)
    for height in range(900, 4000, 100):
        page.set_viewport_size({"width": 1400, "height": height})
        if page.evaluate(CURVES) >= 20:
            break
    page.wait_for_timeout(1000)
    page.evaluate("() => { window.spent = []; new PerformanceObserver((list) => spent.push(...list.getEntriesByName('frame').map((one) => one.duration))).observe({ entryTypes: ['measure'] }); }")
    browser = page.context.new_cdp_session(page)
    browser.send("Performance.enable", {"timeDomain": "threadTicks"})  # without the time that others have of its core

    def script_s():
        return next(one["value"] for one in browser.send("Performance.getMetrics")["metrics"] if one["name"] == "ScriptDuration")

    before, script, since = dict(received), script_s(), time.monotonic()
    page.wait_for_timeout(10_000)
    script, taken = script_s() - script, time.monotonic() - since
    frames = page.evaluate("spent")
    told = {
        "frame_ms": sorted(frames), "processor_ms": 1000 * script / max(1, len(frames)), "curves": page.evaluate(CURVES),
        "bytes_per_s": (received["bytes"] - before["bytes"]) / taken, "messages_per_s": (received["messages"] - before["messages"]) / taken,
    }
    page.close()
    return told


PLAYS = {play.__name__: play for play in (controls, tune, keyboard, looks, places, reload, final, labels, several, reconnect, strangers, first, pace)}


def main(play, url, chromium="/usr/bin/chromium"):
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"])
        desk = Desk(browser, url)
        told = PLAYS[play](desk)
        browser.close()
    print(json.dumps({**told, "wrong": desk.wrong}))


if __name__ == "__main__":
    main(*sys.argv[1:4])

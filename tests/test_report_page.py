#!/usr/bin/env python3
"""The report page of `amps remesh --report` in headless Chromium: it draws, every control works, nothing is complained about.

    test_report_page.py PATH_TO_AMPS

Returns 77 where there is no Chromium. Chromium is driven over pipes by the DevTools protocol, with the standard library only.
"""
import base64
import json
import os
import re
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib

SKIPPED = 77
failures = []


def check(holds, what):
    if not holds:
        failures.append(what)
        print("FAILED:", what)


class Browser:
    """One Chromium with one page. Complaints of the page and requests other than for files are collected."""

    def __init__(self, program, folder, *flags):
        to_browser, from_us = os.pipe()
        from_browser, to_us = os.pipe()
        command = [program, "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--remote-debugging-pipe", "--hide-scrollbars", "--disable-dev-shm-usage",
                   "--no-first-run", "--disable-background-networking", "--user-data-dir=" + folder, *flags, "about:blank"]
        # Chromium reads from descriptor 3 and writes to 4.
        shell = ["sh", "-c", 'exec "$@" 3<&%d 4>&%d' % (to_browser, to_us), "sh", *command]
        self.process = subprocess.Popen(shell, pass_fds=[to_browser, to_us], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(to_us)
        self.out, self.into, self.buffer = from_us, from_browser, b""
        self.number, self.events, self.complaints, self.requests, self.session = 0, [], [], [], None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ["Page", "Runtime", "Log", "Network"]:
            self.call(domain + ".enable")

    def message(self, seconds):
        until = time.monotonic() + seconds
        while b"\0" not in self.buffer:
            if not select.select([self.into], [], [], max(0, until - time.monotonic()))[0]:
                raise TimeoutError("Chromium does not answer")
            piece = os.read(self.into, 1 << 16)
            if not piece:
                raise EOFError("Chromium has ended")
            self.buffer += piece
        text, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(text)

    def note(self, event):
        method, about = event["method"], event.get("params", {})
        self.events.append(method)
        if method == "Runtime.exceptionThrown":
            self.complaints.append(about["exceptionDetails"].get("exception", {}).get("description", "exception"))
        elif method == "Runtime.consoleAPICalled" and about["type"] in ("error", "warning", "assert"):
            self.complaints.append(str([a.get("value") for a in about["args"]]))
        elif method == "Log.entryAdded" and about["entry"]["level"] in ("error", "warning"):
            # Of the test's own looking at pixels, not of the page.
            if "GPU stall due to ReadPixels" not in about["entry"]["text"]:
                self.complaints.append(about["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])

    def call(self, method, **parameters):
        self.number += 1
        request = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            request["sessionId"] = self.session
        os.write(self.out, json.dumps(request).encode() + b"\0")
        while True:
            answer = self.message(60)
            if "id" not in answer:
                self.note(answer)
            elif answer["id"] == self.number:
                if "error" in answer:
                    raise RuntimeError(method + ": " + answer["error"]["message"])
                return answer["result"]

    def open(self, path, width=700, height=850):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)
        self.events.clear()
        self.call("Page.navigate", url="file://" + os.path.abspath(path))
        while "Page.loadEventFired" not in self.events:
            self.note(self.message(60))

    def run(self, script):
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(script + ": " + str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def settle(self):
        """Until what was asked for is drawn, as sharp as it gets."""
        self.run("new Promise((done) => { const look = () => document.getElementById('canvas').dataset.sharp === 'yes' ?"
                 " requestAnimationFrame(done) : requestAnimationFrame(look); look(); })")

    def box(self, selector):
        return self.run("(() => { const r = document.querySelector('%s').getBoundingClientRect();"
                        " return [r.left, r.top, r.width, r.height]; })()" % selector)

    def picture(self, selector):
        """The pixels of an element: rows of bytes r, g, b."""
        self.settle()
        x, y, width, height = self.box(selector)
        left, top = self.run("[scrollX, scrollY]")
        shot = self.call("Page.captureScreenshot", format="png",
                         clip={"x": x + left, "y": y + top, "width": width, "height": height, "scale": 1})
        return pixels_of(base64.b64decode(shot["data"]))

    def click(self, selector):
        x, y, width, height = self.box(selector)
        for kind in ["mousePressed", "mouseReleased"]:
            self.call("Input.dispatchMouseEvent", type=kind, x=x + width / 2, y=y + height / 2, button="left", clickCount=1)

    def drag(self, selector, dx, dy, modifiers=0):
        x, y, width, height = self.box(selector)
        x, y = x + width / 2, y + height / 2
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", modifiers=modifiers)
        for step in range(1, 5):
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + dx * step / 4, y=y + dy * step / 4, button="left",
                      buttons=1, modifiers=modifiers)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + dx, y=y + dy, button="left", modifiers=modifiers)

    def touch(self, selector, paths):
        """`paths`: of each finger, from and to, relative to the middle of the element."""
        x, y, width, height = self.box(selector)
        def at(t):
            return [{"x": x + width / 2 + a[0] + t * (b[0] - a[0]), "y": y + height / 2 + a[1] + t * (b[1] - a[1]), "id": i}
                    for i, (a, b) in enumerate(paths)]
        self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=at(0))
        for step in range(1, 5):
            self.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=at(step / 4))
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def key(self, key, text="", modifiers=0):
        code = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9, " ": 32, "Home": 36, "Enter": 13}
        number = code.get(key, ord(key[0]))
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text, windowsVirtualKeyCode=number, modifiers=modifiers)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=number, modifiers=modifiers)

    def close(self):
        try:
            self.session = None
            self.call("Browser.close")
        except (OSError, EOFError, RuntimeError, TimeoutError):
            self.process.kill()
        self.process.wait()
        os.close(self.out)
        os.close(self.into)


def pixels_of(png):
    """The rows of a PNG of 8 bits, RGB or RGBA, without alpha."""
    at, data = 8, b""
    while at < len(png):
        size, kind = struct.unpack(">I4s", png[at:at + 8])
        body = png[at + 8:at + 8 + size]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            assert depth == 8 and colour in (2, 6)
        elif kind == b"IDAT":
            data += body
        at += 12 + size
    raw, n = zlib.decompress(data), 3 if colour == 2 else 4
    rows, above = [], bytearray(width * n)
    for y in range(height):
        start = y * (width * n + 1)
        row, how = bytearray(raw[start + 1:start + 1 + width * n]), raw[start]
        for i in range(len(row)):
            left = row[i - n] if i >= n else 0
            up, corner = above[i], above[i - n] if i >= n else 0
            if how == 1:
                row[i] = row[i] + left & 255
            elif how == 2:
                row[i] = row[i] + up & 255
            elif how == 3:
                row[i] = row[i] + (left + up) // 2 & 255
            elif how == 4:
                guess = left + up - corner
                nearest = min((abs(guess - left), 0, left), (abs(guess - up), 1, up), (abs(guess - corner), 2, corner))
                row[i] = row[i] + nearest[2] & 255
        above = row
        rows.append(bytes(row) if n == 3 else bytes(b for i, b in enumerate(row) if i % 4 != 3))
    return rows


def share(rows, holds):
    """Of the pixels that `holds` says yes to."""
    seen = [holds(row[i], row[i + 1], row[i + 2]) for row in rows for i in range(0, len(row), 3)]
    return sum(seen) / len(seen)


def changed(before, after):
    """Of the pixels that differ in two pictures of one size by more than noise."""
    pairs = [(a[i:i + 3], b[i:i + 3]) for a, b in zip(before, after) for i in range(0, len(a), 3)]
    return sum(max(abs(x - y) for x, y in zip(p, q)) > 8 for p, q in pairs) / len(pairs)


def is_drawn(rows):
    """Is there more than the background? That of the lower left corner."""
    ground = rows[-3][6:9]
    return share(rows, lambda *p: max(abs(x - y) for x, y in zip(p, ground)) > 24) > 0.05


VIEWS = ["#view-0", "#view-1"]
CONTROLS = ["colouring", "edges", "curves", "zoom-in", "zoom-out", "reset", "stage"]


def colour_by(browser, name):
    browser.run("(() => { const s = document.getElementById('colouring'); s.value = '%s';"
                " s.dispatchEvent(new Event('change')); })()" % name)


def is_calm(browser, where):
    check(not browser.complaints, where + ": the console says " + "; ".join(browser.complaints))
    check(all(url.startswith(("file:", "data:", "about:")) for url in browser.requests), where + ": it goes to the network")
    check(browser.run("document.querySelector('canvas').getContext('webgl2').getError()") == 0, where + ": an error of WebGL")
    browser.complaints.clear()


def test_controls(browser, path):
    """Of a page with curves and one radius."""
    browser.open(path)
    first = [browser.picture(v) for v in VIEWS]
    check(is_drawn(first[0]) and is_drawn(first[1]), "both meshes are drawn")

    def changes(action, what, least=0.002):
        before = [browser.picture(v) for v in VIEWS]
        action()
        after = [browser.picture(v) for v in VIEWS]
        for i, name in enumerate(["input", "output"]):
            check(changed(before[i], after[i]) > least, "%s changes nothing of the %s" % (what, name))

    def returns(action, what):
        action()
        now = [browser.picture(v) for v in VIEWS]
        check(all(changed(a, b) < 0.001 for a, b in zip(first, now)), what + " brings back the first view")

    legends = set()
    for name in ["valence", "smallest", "largest", "distance", "shape"]:
        if name != "shape":
            colour_by(browser, "shape")
        changes(lambda: colour_by(browser, name), "colour by " + name)
        legends.add(browser.run("document.getElementById('legend').textContent"))
    for name in ["radius", "gaps"]:
        colour_by(browser, name)
        legends.add(browser.run("document.getElementById('legend').textContent"))
    check(len(legends) == 7 and "" not in legends, "each colouring has a legend of its own: %s" % legends)
    check("No gaps" in browser.run("document.getElementById('legend').textContent"), "a maximal set has no gaps")
    colour_by(browser, "shape")

    for box in ["edges", "curves"]:
        changes(lambda: browser.click("#" + box), box + " by mouse")
        returns(lambda: browser.click("#" + box), box + " twice")
    changes(lambda: browser.click("#zoom-in"), "zoom in")
    returns(lambda: browser.click("#zoom-out"), "zoom out")
    stage = "#view-0"
    x, y, width, height = browser.box(stage)
    for what, action in [
        ("a drag", lambda: browser.drag(stage, 60, 20)),
        ("a drag with shift", lambda: browser.drag(stage, 60, 20, modifiers=8)),
        ("the wheel", lambda: browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x + 50, y=y + 50, deltaX=0, deltaY=-240)),
        ("a finger", lambda: browser.touch(stage, [((0, 0), (50, 30))])),
        ("a pinch", lambda: browser.touch(stage, [((-30, 0), (-70, 0)), ((30, 0), (70, 0))])),
    ]:
        changes(action, what)
        returns(lambda: browser.click("#reset"), "reset after " + what)

    # Keys: Tab finds every control, arrows, + and - act on the meshes.
    browser.run("document.activeElement.blur()")
    browser.click("h1")
    found = []
    for _ in range(12):
        browser.key("Tab")
        found.append(browser.run("document.activeElement.id"))
    check(all(c in found for c in CONTROLS), "Tab finds %s, not all of %s" % (found, CONTROLS))
    browser.run("document.getElementById('stage').focus()")
    for key, back in [("ArrowLeft", "ArrowRight"), ("ArrowUp", "ArrowDown"), ("+", "-")]:
        changes(lambda: browser.key(key), "key " + key)
        returns(lambda: browser.key(back), "key " + back)
    changes(lambda: browser.key("ArrowLeft", modifiers=8), "Shift and an arrow key")
    returns(lambda: browser.key("0"), "key 0")
    for control, press in [("edges", " "), ("curves", " "), ("zoom-in", "Enter")]:
        browser.run("document.getElementById('%s').focus()" % control)
        changes(lambda: browser.key(press, text="\r" if press == "Enter" else " "), "the keyboard on " + control)
    browser.run("document.getElementById('colouring').focus()")
    browser.key("v", text="v")  # the first one with this letter
    check(browser.run("document.getElementById('colouring').value") == "valence", "a letter chooses a colouring")

    tree = browser.call("Accessibility.getFullAXTree")["nodes"]
    named = {}
    for node in tree:
        role = node.get("role", {}).get("value")
        if role in ("combobox", "checkbox", "button", "application", "image"):
            named.setdefault(role, []).append(node.get("name", {}).get("value", ""))
    for role, n in [("combobox", 1), ("checkbox", 2), ("button", 3), ("application", 1), ("image", 4)]:
        check(len(named.get(role, [])) >= n and all(named[role]), "%d elements with role %s and a name: %s" % (n, role, named.get(role)))
    is_calm(browser, "controls")


def test_looks(browser, path):
    for width in [1400, 375]:
        browser.open(path, width=width)
        check(all(is_drawn(browser.picture(v)) for v in VIEWS), "both meshes are drawn on %d pixels" % width)
        check(browser.run("document.documentElement.scrollWidth") <= width, "the page is wider than %d pixels" % width)
    a, b = browser.box("#view-0"), browser.box("#view-1")
    check(b[1] >= a[1] + a[3], "on a narrow screen the views are one above the other")
    before = browser.picture("#view-0")
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    check(changed(before, browser.picture("#view-0")) > 0.5, "a dark page has a dark background")
    check(is_drawn(browser.picture("#view-0")), "the input is drawn on dark")
    browser.call("Emulation.setEmulatedMedia", features=[])
    is_calm(browser, "looks")


def test_gaps(browser, path, folder):
    """`remesh` leaves none, so one is put into the data: a triangle before the middle of the model."""
    text = open(path, encoding="utf-8").read()
    gap = struct.pack("<9f", -0.5, -0.5, 0.9, 0.5, -0.5, 0.9, 0, 0.5, 0.9)
    text, n = re.subn(r'"gaps": "[^"]*"', '"gaps": "%s"' % base64.b64encode(gap).decode(), text)
    check(n == 1, "the data have no gaps")
    changed_path = os.path.join(folder, "gaps.html")
    with open(changed_path, "w", encoding="utf-8") as out:
        out.write(text)
    browser.open(changed_path)
    def is_gap(r, g, b):
        return r > 90 and r > 1.7 * g and r > 2 * b
    for v in VIEWS:
        check(share(browser.picture(v), is_gap) < 0.001, "gaps are drawn unasked")
    colour_by(browser, "gaps")
    for v in VIEWS:
        check(share(browser.picture(v), is_gap) > 0.01, "gaps are drawn in " + v)
    is_calm(browser, "gaps")


def test_not_drawn(browser, path, folder):
    """Meshes of too many triangles have no numbers in the page; here they are taken out."""
    text = open(path, encoding="utf-8").read()
    for left in [1, 0]:  # meshes that are there
        for key in ["positions", "indices", "valences", "radii", "distances", "curves"]:
            text = re.sub(r'"%s": "[^"]*",?' % key, "", text, count=1)
        text = re.sub(r",(\s*})", r"\1", text)
        changed_path = os.path.join(folder, "left_%d.html" % left)
        with open(changed_path, "w", encoding="utf-8") as out:
            out.write(text)
        browser.open(changed_path)
        if left == 1:
            check([is_drawn(browser.picture(v)) for v in VIEWS] == [False, True], "the mesh that is there is drawn")
            for name in ["valence", "smallest", "radius", "gaps", "distance"]:
                colour_by(browser, name)
                check(is_drawn(browser.picture("#view-1")), "the mesh that is there is drawn by " + name)
            is_calm(browser, "one mesh")
        else:
            check(browser.run("document.getElementById('viewer').hidden"), "a viewer of nothing")
            check("Neither" in browser.run("document.getElementById('no-webgl').textContent"), "no word about meshes that are not drawn")
            check(not browser.complaints, "no mesh: %s" % browser.complaints)


def test_radii(browser, path):
    browser.open(path)
    before = [browser.picture(v) for v in VIEWS]
    colour_by(browser, "radius")
    after = [browser.picture(v) for v in VIEWS]
    check(changed(before[0], after[0]) == 0, "the input has no radii")
    check(changed(before[1], after[1]) > 0.05, "radii that vary are shown")
    check(browser.run("document.getElementById('curves').disabled"), "without curves the box can be ticked")
    is_calm(browser, "radii")


def test_numbers(path):
    """What the page holds against the files of the same run."""
    text = open(path("cube.html"), encoding="utf-8").read()
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S).group(1))
    report = json.load(open(path("cube.json"), encoding="utf-8"))
    def numbers(key, kind, mesh="output"):
        raw = base64.b64decode(data[mesh][key])
        return struct.unpack("<%d%s" % (len(raw) // struct.calcsize(kind), kind), raw)
    lines = open(path("cube & <co>.obj"), encoding="utf-8").read().splitlines()
    vertices = [[float(x) for x in line.split()[1:4]] for line in lines if line.startswith("v ")]
    corners = [int(x.split("/")[0]) - 1 for line in lines if line.startswith("f ") for x in line.split()[1:]]
    ends = [int(x) - 1 for line in lines if line.startswith("l ") for x in line.split()[1:]]
    def triples(numbers):  # the file has them patch by patch
        return sorted(tuple(numbers[i:i + 3]) for i in range(0, len(numbers), 3))
    check(triples(numbers("indices", "I")) == triples(corners), "the triangles are those of the output")
    check(len(ends) > 100 and len(numbers("curves", "I")) == 2 * report["curves"]["edges_kept"], "the lines are those that are kept")
    side = [max(v[k] for v in vertices) - min(v[k] for v in vertices) for k in range(3)]
    middle = [max(v[k] for v in vertices) / 2 + min(v[k] for v in vertices) / 2 for k in range(3)]
    half = sum(x * x for x in side) ** 0.5 / 2  # a cube keeps its corners, so its box
    expected = [(v[k] - middle[k]) / half for v in vertices for k in range(3)]
    positions = numbers("positions", "f")
    check(len(positions) == len(expected) and all(abs(a - b) < 1e-6 for a, b in zip(positions, expected)), "the vertices are those of the output")
    valences = numbers("valences", "B")
    check([valences.count(d) for d in range(15)] == report["quality"]["valence"][:15], "the valences are those of the report")
    check(set(numbers("valences", "B", "input")) <= {4, 5, 6, 7, 8} and len(numbers("distances", "f", "input")) * 3 == len(numbers("indices", "I", "input")),
          "numbers of the input")
    check(0 <= data["distance"]["farthest"] < 1e-9, "a cube with its creases is %g %% from itself" % data["distance"]["farthest"])
    knot = json.loads(re.search(r'id="data">(.*?)</script>', open(path("knot.html"), encoding="utf-8").read(), re.S).group(1))
    hausdorff = json.load(open(path("knot_distance.json"), encoding="utf-8"))["distance"]["hausdorff_percent"]
    farthest = knot["distance"]["farthest"]
    check(0.5 * hausdorff < farthest <= hausdorff, "seven points a triangle are %g %% away, all points %g %%" % (farthest, hausdorff))


def test_without_webgl(program, folder, path):
    browser = Browser(program, folder, "--disable-3d-apis")
    browser.open(path)
    check(browser.run("document.getElementById('viewer').hidden"), "the viewer is there without WebGL")
    check("WebGL" in browser.run("document.getElementById('no-webgl').textContent"), "no word about WebGL")
    for selector in ["#no-webgl", "#table", "#seconds", ".chart svg"]:
        check(browser.box(selector)[3] > 10, selector + " is not seen without WebGL")
    check(not [c for c in browser.complaints if "WebGL" not in c], "without WebGL: %s" % browser.complaints)
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(path)
    browser.call("Emulation.setScriptExecutionDisabled", value=False)
    check(browser.box("noscript p")[3] > 10, "no word about scripts")
    browser.close()


def main():
    amps = os.path.abspath(sys.argv[1])
    program = next((found for found in map(shutil.which, ["chromium", "chromium-browser", "google-chrome"]) if found), None)
    if program is None:
        print("skipped: there is no Chromium (Debian: chromium)")
        return SKIPPED
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        def path(name):
            return os.path.join(folder, name)
        def run(*words):
            subprocess.run([amps, *words, "--quiet"], check=True)
        run("make", "cube", path("cube.obj"), "--n", "300")
        run("remesh", path("cube.obj"), path("cube & <co>.obj"), "--vertices", "700", "--json", path("cube.json"), "--report", path("cube.html"))
        run("make", "knot", path("knot.obj"), "--n", "4000")
        run("remesh", path("knot.obj"), path("out.ply"), "--vertices", "1500", "--sizing", "lfs", "--report", path("knot.html"))
        run("info", path("out.ply"), "--reference", path("knot.obj"), "--json", path("knot_distance.json"))
        test_numbers(path)
        browser = Browser(program, path("profile"))
        try:
            test_controls(browser, path("cube.html"))
            test_looks(browser, path("cube.html"))
            test_gaps(browser, path("cube.html"), folder)
            test_not_drawn(browser, path("cube.html"), folder)
            test_radii(browser, path("knot.html"))
        finally:
            browser.close()
        test_without_webgl(program, path("profile without"), path("cube.html"))
    print("%d failures" % len(failures))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

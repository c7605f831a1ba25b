"""A real browser without a window: Debian's chromium, driven over its DevTools protocol.

The protocol goes through two pipes (`--remote-debugging-pipe`), JSON ended by a zero byte. So the standard library is
enough: no driver of the browser's version, no package that downloads a browser, and no port that others could reach.
"""

import base64
import io
import json
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time

import numpy as np
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--remote-debugging-pipe",
)
ANSWER_SECONDS = 120.0  # software drawing on a busy machine
KEYS = {
    name: (name, number)
    for name, number in (("ArrowLeft", 37), ("ArrowRight", 39), ("Home", 36), ("End", 35), ("Enter", 13))
}
KEYS[" "] = ("Space", 32)


class BrowserFault(AssertionError):
    """The browser answered with an error, not in time, or not at all."""


class Browser:
    """One page in a browser of its own, with a fresh profile; use it in a `with`.

    Skips the test where no chromium is installed. It finds no host but 127.0.0.1.
    """

    def __init__(self, folder, *, width=1280, height=720, flags=()):
        name = next(filter(None, map(shutil.which, NAMES)), None)
        if name is None:
            pytest.skip("chromium is not installed: no browser to test in (apt-get install chromium)")
        self.errors: list[str] = []
        """Errors and warnings of the console, and exceptions that no script caught."""
        self.requested: list[str] = []
        """URLs of every request that the page began, blocked ones and WebSockets included; no data: URL."""
        self.sent: list[float] = []
        """When the page sent messages over WebSockets [s], by the browser's clock."""
        self.received: list[tuple[float, int]] = []
        """When it received messages, and how many bytes they have in base64."""
        self._rest, self._number, self._session = b"", 0, None
        self._profile = tempfile.mkdtemp(prefix="profile", dir=folder)
        self._start([name, *FLAGS, *flags, f"--user-data-dir={self._profile}", "about:blank"])
        try:
            self._attach(width, height)
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """End the browser and all of its processes, and remove its profile."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for handle in (self._to, self._from):
            os.close(handle)
        shutil.rmtree(self._profile, ignore_errors=True)  # 10 MB

    def open(self, url, *, timeout=ANSWER_SECONDS):
        """Go to a URL and wait until it is loaded; what was requested and reported before is forgotten."""
        self.errors.clear()
        self.requested.clear()
        answer = self.call("Page.navigate", url=str(url))
        if "errorText" in answer:
            raise BrowserFault(f"{url}: {answer['errorText']}")
        self.wait("document.readyState === 'complete'", timeout=timeout)

    def run(self, script):
        """Value of a JavaScript expression in the page; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise BrowserFault(f"{script}: {_exception(answer['exceptionDetails'])}")
        return answer["result"].get("value")

    def wait(self, condition, *, timeout=ANSWER_SECONDS):
        """Wait until a JavaScript expression is truthy, such as an element that is there."""
        end = time.monotonic() + timeout
        while not self.run(f"Boolean({condition})"):
            if time.monotonic() > end:
                raise BrowserFault(f"not true within {timeout:g} s: {condition}; console: {self.errors}")
            self._listen(0.05)

    def settle(self, seconds):
        """Let the page go on, and take what it reports meanwhile."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._listen(left)

    def screenshot(self):
        """What is shown, as a PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def pixels(self):
        """What is shown, uint8, shape [row, column, 3]."""
        from PIL import Image

        return np.asarray(Image.open(io.BytesIO(self.screenshot())).convert("RGB"))

    def resize(self, width, height, *, touch=False):
        """Size of the window [pixel]; touch: as on a phone."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=touch)

    def prefer(self, **features):
        """What the user prefers, as in `prefer(prefers_reduced_motion="reduce")`."""
        listed = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.call("Emulation.setEmulatedMedia", features=listed)

    def press(self, key):
        """A key of the keyboard, by its name in JavaScript."""
        code, number = KEYS.get(key, (f"Key{key.upper()}", ord(key[0].upper())))
        named = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **named, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **named)

    def drag(self, *places):
        """Press the mouse at the first place [pixel], move it over the others, and release it; one place: a click."""
        for kind, (x, y) in [("mouseMoved", places[0]), ("mousePressed", places[0])]:
            self._mouse(kind, x, y)
        for x, y in places[1:]:
            self._mouse("mouseMoved", x, y)
        self._mouse("mouseReleased", *places[-1])

    def box(self, selector):
        """Left, top, width, height of an element [pixel]."""
        return self.run(
            f"(() => {{ const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
            " return [r.left, r.top, r.width, r.height] })()"
        )

    def click(self, selector):
        """Click the middle of an element with the mouse."""
        left, top, width, height = self.box(selector)
        self.drag((left + width / 2, top + height / 2))

    def call(self, method, **options):
        """Answer of the browser to a method of the DevTools protocol."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": options}
        if self._session:
            message["sessionId"] = self._session
        _write(self._to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + ANSWER_SECONDS
        while (answer := self._listen(end - time.monotonic(), self._number)) is None:
            if time.monotonic() > end:
                raise BrowserFault(f"{method}: no answer within {ANSWER_SECONDS:g} s")
        if "error" in answer:
            raise BrowserFault(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def _start(self, command):
        child_from, self._to = os.pipe()
        self._from, child_to = os.pipe()
        # The browser reads from descriptor 3 and writes to 4, whichever numbers the pipes have here.
        script = f'exec "$@" 3<&{child_from} 4>&{child_to}'
        self._process = subprocess.Popen(
            ["bash", "-c", script, "browser", *command],
            pass_fds=(child_from, child_to),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"HOME": self._profile},
            start_new_session=True,
        )
        os.close(child_from)
        os.close(child_to)

    def _attach(self, width, height):
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def _mouse(self, kind, x, y):
        held = {"button": "left", "buttons": int(kind != "mouseReleased"), "clickCount": 1}
        pressed = held if kind != "mouseMoved" else {"buttons": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **pressed)

    def _listen(self, seconds, number=None):
        """Take the browser's messages for a while, up to the answer of that number."""
        end = time.monotonic() + max(seconds, 0.0)
        while True:
            while b"\0" in self._rest:
                text, _, self._rest = self._rest.partition(b"\0")
                message = json.loads(text)
                if message.get("id") is not None and message["id"] == number:
                    return message
                self._note(message.get("method"), message.get("params", {}))
            left = end - time.monotonic()
            if left <= 0 or not select.select([self._from], [], [], left)[0]:
                return None
            block = os.read(self._from, 1 << 20)
            if not block:
                raise BrowserFault(f"the browser has ended, exit status {self._process.wait()}")
            self._rest += block

    def _note(self, method, params):
        if method == "Network.requestWillBeSent" and not params["request"]["url"].startswith("data:"):
            self.requested.append(params["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requested.append(params["url"])
        elif method == "Network.webSocketFrameSent":
            self.sent.append(params["timestamp"])
        elif method == "Network.webSocketFrameReceived":
            self.received.append((params["timestamp"], len(params["response"]["payloadData"])))
        elif method == "Runtime.exceptionThrown":
            self.errors.append(_exception(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            texts = [str(part.get("value", part.get("description", ""))) for part in params["args"]]
            self.errors.append(f"{params['type']}: {' '.join(texts)}")
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            if "GL Driver Message" in params["entry"]["text"]:
                return  # what a screenshot costs the software driver
            self.errors.append(f"{params['entry']['level']}: {params['entry']['text']}")


def _exception(details):
    return details.get("exception", {}).get("description") or details.get("text", "")


def _write(handle, block):
    while block:
        block = block[os.write(handle, block) :]

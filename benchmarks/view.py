"""Latency and drawing rate of the live viewer, in a real browser on this machine.

    python benchmarks/view.py FILE [FILE] [--steps 100] [--pause 0.1]

An arrow key moves the slider, as often as `--steps` says, `--pause` [s] after the answer to the one before. `answer` is
from the message that the page sends then to the data of the new pose at the page, by the browser's own clock (DevTools
protocol, of the worker that has the connection).
`drawn` is how many frames a second the page draws while the file plays, which depends on the machine's graphics: here
it may be software. `sent` is how many the viewer sends meanwhile.
"""

import argparse
import json
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "pages"))
from browser import Browser

from palpate.render.view.live.session import view_files

DATA_BYTES = 500  # of a message in base64: the numbers of a pose alone are longer
PLAYED = 3.0  # [s]
LONGEST = 60.0  # [s], for one answer on a busy machine


class WatchedBrowser(Browser):
    """A browser that notes the messages of the page's WebSocket, which a worker of the page has."""

    def __init__(self, folder: str) -> None:
        self.messages: list[tuple[bool, float, int]] = []
        """Whether it was sent by the page, when [s], and how long it was."""
        self._workers: list[str] = []
        super().__init__(folder)
        self.call("Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True, flatten=True)

    def watch_workers(self) -> None:
        """Listen to the workers that were started since."""
        page = self._session
        while self._workers:
            self._session = self._workers.pop()
            self.call("Network.enable")
            self.call("Runtime.runIfWaitingForDebugger")
            self._session = page

    def wait_data(self) -> tuple[float, float] | None:
        """When [s] the page sent its first message since `messages` was cleared, and when data came after it."""
        end = time.monotonic() + LONGEST
        while time.monotonic() < end:
            asked = [when for is_sent, when, _ in self.messages if is_sent][:1]
            came = [when for is_sent, when, size in self.messages if not is_sent and size > DATA_BYTES]
            if later := [when for when in came if asked and when > asked[0]]:
                return asked[0], later[0]
            self.settle(0.01)
        return None

    def _note(self, method, params) -> None:
        if method == "Target.attachedToTarget" and params["targetInfo"]["type"] == "worker":
            self._workers.append(params["sessionId"])
        elif method in ("Network.webSocketFrameSent", "Network.webSocketFrameReceived"):
            text = params["response"]["payloadData"]
            self.messages.append((method.endswith("Sent"), params["timestamp"], len(text)))
        super()._note(method, params)


def measure(paths: Sequence[str | Path], steps: int = 100, pause: float = 0.1) -> dict[str, float]:
    """Figures of one run."""
    ready, stop, address = threading.Event(), threading.Event(), []

    def tell(found: str) -> None:
        address.append(found)
        ready.set()

    server = threading.Thread(target=view_files, args=(paths,), kwargs={"ready": tell, "stop": stop})
    server.start()
    ready.wait(120)
    try:
        with tempfile.TemporaryDirectory() as folder, WatchedBrowser(folder) as browser:
            browser.call("Page.navigate", url=address[0])
            while not browser.run("document.body?.innerText.includes('of 0..') ?? false"):
                browser.settle(0.2)
                browser.watch_workers()
            browser.settle(5.0)
            return _answers(browser, steps, pause) | _rates(browser)
    finally:
        stop.set()
        server.join()


def _answers(browser: WatchedBrowser, steps: int, pause: float) -> dict[str, float]:
    browser.run("document.querySelectorAll('[role=slider]')[0].focus()")
    found = []
    for _ in range(steps):
        browser.messages.clear()
        browser.press("ArrowRight")
        if (times := browser.wait_data()) is not None:
            found.append(1e3 * (times[1] - times[0]))
        browser.settle(pause)
    if not found:
        raise SystemExit("no answer was seen: the viewer's page has changed")
    middle, late = np.percentile(found, [50, 95])
    return {"answers": len(found), "answer_p50_ms": float(middle), "answer_p95_ms": float(late)}


def _rates(browser: WatchedBrowser) -> dict[str, float]:
    browser.messages.clear()
    browser.run("[...document.querySelectorAll('button')].find((b) => b.innerText === 'play').click()")
    browser.wait_data()
    browser.messages.clear()
    drawn = browser.run(
        f"new Promise((done) => {{ let count = 0; const end = performance.now() + {1e3 * PLAYED};"
        "const tick = () => { count += 1; performance.now() < end ? requestAnimationFrame(tick) : done(count) };"
        "requestAnimationFrame(tick) })"
    )
    sent = sum(not is_sent and size > DATA_BYTES for is_sent, _, size in browser.messages)
    return {"drawn_hz": drawn / PLAYED, "sent_hz": sent / PLAYED}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--pause", type=float, default=0.1)
    given = parser.parse_args()
    print(json.dumps(measure(given.files, given.steps, given.pause), indent=1))

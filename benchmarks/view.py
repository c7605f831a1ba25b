"""Latency and drawing rate of the viewer, in a real browser on this machine.

    python benchmarks/view.py FILE [FILE] [--steps 100] [--pause 0.1]

The slider is moved to poses all over the file, as often as `--steps` says, `--pause` [s] after the answer to the one
before. `answer` is from the slider's event to the data of the new pose in the page's hands, by the page's own clock;
`drawn` is until the picture of it is drawn, which depends on the machine's graphics: here it may be software.
`drawn_hz` is how many frames a second the page draws while the file plays, `sent_hz` how many poses the viewer sends.
"""

import argparse
import json
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "pages"))
from browser import Browser

from palpate.render.view.served.viewing import view_files

PLAYED = 3.0  # [s]
STEPS = """(async () => {
  const slider = document.getElementById("time"), found = [];
  const pause = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
  const frame = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  let arrived = () => {};
  const take = WebSocket.prototype.send;  // the page's socket: its next message is the pose
  WebSocket.prototype.send = function (text) {
    this.addEventListener("message", () => arrived(performance.now()), { once: true });
    return take.call(this, text);
  };
  for (let step = 0; step < COUNT; step++) {
    await pause(PAUSE);
    const at = new Promise((done) => (arrived = done));
    const begun = performance.now();
    slider.value = (step * 24989 + 17) % (Number(slider.max) + 1);
    slider.dispatchEvent(new Event("input"));
    const answered = await at;
    await frame();
    found.push([answered - begun, performance.now() - begun]);
  }
  WebSocket.prototype.send = take;
  return found;
})()"""


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
        with tempfile.TemporaryDirectory() as folder, Browser(folder) as browser:
            browser.open(address[0])
            browser.wait("document.querySelector('[data-ready]')")
            browser.settle(3.0)
            found = browser.run(STEPS.replace("COUNT", str(steps)).replace("PAUSE", str(pause)))
            answer, drawn = np.percentile(found, [50, 95], axis=0).T
            names = ("answer_p50_ms", "answer_p95_ms", "drawn_p50_ms", "drawn_p95_ms")
            figures = dict(zip(names, (*answer.tolist(), *drawn.tolist()), strict=True))
            return {"answers": len(found), **figures, **_rates(browser)}
    finally:
        stop.set()
        server.join()


def _rates(browser: Browser) -> dict[str, float]:
    browser.press("Home")
    browser.settle(0.5)
    browser.press(" ")
    browser.received.clear()
    drawn = browser.run(
        f"new Promise((done) => {{ let count = 0; const end = performance.now() + {1e3 * PLAYED};"
        "const tick = () => { count += 1; performance.now() < end ? requestAnimationFrame(tick) : done(count) };"
        "requestAnimationFrame(tick) })"
    )
    return {"drawn_hz": drawn / PLAYED, "sent_hz": len(browser.received) / PLAYED}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--pause", type=float, default=0.1)
    given = parser.parse_args()
    print(json.dumps(measure(given.files, given.steps, given.pause), indent=1))

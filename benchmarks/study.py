"""Onsets of a study's intervals against their plan, from a whole run on the emulated array.

    python benchmarks/study.py [--trials 40] [--seconds 0.5] [--browser]

The participant is the page in a headless browser with `--browser`, else a program that speaks the page's protocol.
`late` is from the planned time of an interval to its first focal point, as the emulated board says when it was played.
`latency` is that part of it which follows the call that begins the stimulus. `pose_latency` is from a pose's time stamp
to its first focal point.
"""

import argparse
import contextlib
import json
import re
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "pages"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "cases" / "study"))
from answered_study import take_part
from browser import Browser, BrowserFault

from palpate.render import render, static_pose

PLAN = """
title = "Onsets"
participants = 1
noise_level = 0.1
[[stimulus]]
for = { strategy = ["oc", "cc"] }
name = "live-{strategy}"
object = "tube"
strategy = "{strategy}"
duration = SECONDS
[[stimulus]]
for = { number = [1, 2] }
name = "stored-{number}"
file = "stored-{number}.h5"
duration = SECONDS
[[block]]
for = { kind = ["live", "stored"] }
name = "{kind}"
design = "2ifc"
pairs = [PAIRS]
question = "Which one?"
repetitions = COUNT
gap = 0.5
rest = 0.5
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, and print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=40, help="of both blocks together, a multiple of 4")
    parser.add_argument("--seconds", type=float, default=0.5, help="of an interval [s]")
    parser.add_argument("--browser", action="store_true", help="the participant's page in a headless browser")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "onsets.toml"
        write_plan(plan, options.trials, options.seconds)
        run_study(plan, in_browser=options.browser)
        sys.stdout.write(json.dumps(figures(plan.with_suffix(".data") / "answers.sqlite"), indent=1) + "\n")
    return 0


def write_plan(plan: Path, trials: int, seconds: float) -> None:
    """A plan of live and stored intervals, and the files of the stored ones."""
    blocks = PLAN.split("[[block]]")
    pairs = {"live": '["live-oc", "live-cc"]', "stored": '["stored-1", "stored-2"]'}
    text = blocks[0] + "".join(
        "[[block]]" + blocks[1].replace('for = { kind = ["live", "stored"] }\n', "").replace("{kind}", kind)
        .replace("PAIRS", pair).replace("COUNT", str(max(trials // 4, 1)))
        for kind, pair in pairs.items()
    )  # fmt: skip
    plan.write_text(text.replace("SECONDS", str(seconds)))
    for number, height in ((1, 0.2), (2, 0.21)):
        render("cube", "palm", static_pose([0, 0, height]), "cc").save(plan.parent / f"stored-{number}.h5")


def run_study(plan: Path, *, in_browser: bool) -> None:
    """Run the study to its end; raises RuntimeError where it fails."""
    command = [sys.executable, "-m", "palpate.render.cli", "study", str(plan), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        told = []
        for line in process.stdout:
            told.append(line)
            if found := re.match(r"the participant's page: (\S+)", line):
                take = take_part_in_browser if in_browser else take_part
                threading.Thread(target=take, args=(found[1],), daemon=True).start()
    if process.returncode:
        raise RuntimeError("".join(told))


def take_part_in_browser(address: str) -> None:
    """Press keys in the page, whatever it shows, until the study has ended."""
    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(BrowserFault), Browser(Path(folder)) as browser:
        browser.open(address)
        while "That was all" not in browser.run("document.body.innerText"):
            for key in (" ", "ArrowLeft"):
                browser.press(key)
            time.sleep(0.15)


def figures(database: Path) -> dict:
    """Onsets by kind of stimulus [ms], and what else the data say."""
    connection = sqlite3.connect(database)
    columns = (
        "stimulus, (onset - onset_planned) * 1000, latency * 1000, pose_latency_p50 * 1000, pose_latency_p99 * 1000"
    )
    rows = connection.execute(f"SELECT {columns}, dropped, outcome, interval FROM intervals").fetchall()
    connection.close()
    found: dict = {"intervals": len(rows), "played": sum(row[6] == "played" for row in rows)}
    for kind in ("live", "stored"):
        own = [row for row in rows if row[0].startswith(kind)]
        found[kind] = {"late": _quantiles([row[1] for row in own]), "latency": _quantiles([row[2] for row in own])}
    live = [row for row in rows if row[0].startswith("live")]
    found["pose_latency_p50"] = _quantiles([row[3] for row in live if row[3] is not None])
    found["pose_latency_p99"] = _quantiles([row[4] for row in live if row[4] is not None])
    found["dropped"] = sum(row[5] or 0 for row in live)
    return found


def _quantiles(values: list[float]) -> dict[str, float]:
    if not values:  # the writer tells emissions four times a second: of very short intervals, none in time
        return {}
    middle, late, longest = np.quantile(values, (0.5, 0.95, 1.0)).round(2).tolist()
    return {"p50": middle, "p95": late, "max": longest}


if __name__ == "__main__":
    sys.exit(main())

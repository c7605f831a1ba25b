"""Plans whose strategies misbehave: a stage that raises, crashes, never ends, waits for ever, or takes all memory."""

import json

STAGES = """
import os
import signal
import time

from palpate.render import register_transform


def fail(batch, setting):
    raise RuntimeError("this stage fails")


def crash(batch, setting):
    os.kill(os.getpid(), signal.SIGSEGV)


def never_end(batch, setting):
    while True:
        pass


def sleep_on(batch, setting):
    time.sleep(1e6)


def take_all(batch, setting):
    held = []
    while True:
        held.append(bytes(b"x" * (50 << 20)))
        time.sleep(0.05)


def be_slow(batch, setting):
    time.sleep(0.5)
    return batch


for stage in (fail, crash, never_end, sleep_on, take_all, be_slow):
    register_transform(stage.__name__.replace("_", "-"), stage)
"""
PLAN = """
[object]
source = "cube"
[motion]
duration = 1.0
seed = [1, 2]
[strategy]
source = {}
"""
REASONS = {
    "fail": "this stage fails",
    "crash": "the worker that made it died",
    "never-end": "that a unit may take",
    "sleep-on": "that a unit may take",
    "take-all": "MemoryError",
}


def write_plan(folder, stages):
    """A plan of cc, hatch and a strategy for each of some stages; its path."""
    (folder / "bad_stages_of_mine.py").write_text(STAGES)
    for stage in stages:
        text = {"modules": ["bad_stages_of_mine"], "prune": ["outside"], "transform": ["close", stage]}
        (folder / f"{stage}.json").write_text(json.dumps(text))
    path = folder / "plan.toml"
    path.write_text(PLAN.format(json.dumps(["cc", "hatch", *(f"{stage}.json" for stage in stages)])))
    return path

"""A tracker that sees a hand as long as a file exists, for tests of what happens while nobody's hand is there."""

import time
from pathlib import Path

from palpate.render import SeenHand

FLAT = [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]  # the palm, 20 cm above the array


class GatedHand:
    """Poses 200 times a second; path: of the file."""

    clock = "monotonic"

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __repr__(self) -> str:
        return "GatedHand()"

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def __iter__(self):
        while True:
            time.sleep(0.005)
            now = time.monotonic()
            yield SeenHand(now, "right", "1", FLAT) if Path(self.path).exists() else SeenHand(now)

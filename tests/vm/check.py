"""What the virtual machine told, and what its FTDI chip got: `check.py CONSOLE SERIAL`; exit code 1 if one failed."""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from umockdev_player import DEFAULTS, content

from palpate.device import array_model

RESULT = "vm: result "
RUNS = 6


def tell(line: str) -> None:
    sys.stdout.write(line + "\n")


def main(console: Path, serial: Path) -> int:
    rows = [json.loads(line[len(RESULT) :]) for line in console.read_text().splitlines() if line.startswith(RESULT)]
    failed = len(rows) != RUNS
    for row in rows:
        good = row["error"] is None and row.get("equal", True) and row.get("off", True)
        failed |= not good
        tell(f"{'passed' if good else 'FAILED'}: {row['what']}, {row['frames']} frames, {row['message']}")
    sent = content(50, DEFAULTS["seed"], array_model("sonicsurface")).tobytes()
    arrived = serial.read_bytes().count(sent)
    failed |= arrived != 2
    tell(f"{'passed' if arrived == 2 else 'FAILED'}: QEMU's FT232BM got the 50 frames {arrived} times, of 2")
    tell(f"{len(rows)} of {RUNS} runs told of themselves")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))

"""What the virtual machine told: `check.py CONSOLE`; exit code 1 if a run failed."""

from __future__ import annotations

import json
import sys
from pathlib import Path

RESULT = "vm: result "
RUNS = 4


def tell(line: str) -> None:
    sys.stdout.write(line + "\n")


def main(console: Path) -> int:
    rows = [json.loads(line[len(RESULT) :]) for line in console.read_text().splitlines() if line.startswith(RESULT)]
    failed = len(rows) != RUNS
    for row in rows:
        good = row["error"] is None and row.get("equal", True) and row.get("off", True)
        failed |= not good
        tell(f"{'passed' if good else 'FAILED'}: {row['what']}, {row['frames']} frames, {row['message']}")
    tell(f"{len(rows)} of {RUNS} runs told of themselves")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))

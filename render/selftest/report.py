"""The report of a selftest as JSON: boards, versions, playbacks with their confirmed off, a person's answers."""

import hashlib
import json
import platform
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ...datasets.storage.durable import write_file
from ...device.errors import PlayInterrupted
from ...device.link import Link
from ...device.report import PlayReport
from ..errors import RenderError
from ..output_file import require_output
from ..playback.placed_arrays import PlacedArray
from ..terminal import console
from ..terminal.foreign_text import print_message

FORMAT = "palpate selftest"
VERSION = 1
PACKAGES = ("palpate", "numpy", "pyusb", "warp-lang", "pyserial", "autd3")
QUESTION = "What did you feel and hear, and where? One line, Enter ends it: "


class SelftestReport:
    """A report in the making; the file is replaced as a whole after each playback and each answer.

    Raises StrategyError for a path that exists (unless it may be overwritten) or whose folder does not, RenderError
    where it cannot be written.
    """

    def __init__(self, path: Path, *, overwrite: bool, calibration: Path | None) -> None:
        require_output(path, overwrite=overwrite)
        self.path = path
        self._stimuli: list[dict[str, object]] = []
        self._values: dict[str, object] = {
            "format": FORMAT,
            "version": VERSION,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
            "platform": platform.platform(),
            "arrays": [],
            # The name without its folder, which may name a person.
            "board_file": None if calibration is None else calibration.name,
            "board_file_sha256": None if calibration is None else hashlib.sha256(calibration.read_bytes()).hexdigest(),
            "ended_by": None,
            "failure": None,
            "stimuli": self._stimuli,
        }

    def describe(self, arrays: Sequence[PlacedArray], links: Sequence[Link], *, emulated: bool) -> None:
        """Note the opened boards."""
        self._values["arrays"] = [
            {
                "array": link.array.name,
                "serial": link.serial,
                "transport": link.transport,
                "clock": link.clock.name,
                "emulated": emulated or link.array.embedded,
                "calibrated": placed.model.calibrated,
            }
            for placed, link in zip(arrays, links, strict=True)
        ]

    def add(self, name: str, expected: str, reports: Sequence[PlayReport]) -> None:
        """Note a stimulus that was played, ask the person about it, and write the file."""
        played = [report.as_dict() for report in reports]
        entry: dict[str, object] = {"stimulus": name, "expected": expected, "played": played, "answer": None}
        self._stimuli.append(entry)
        self.write()  # a selftest that is killed at the question keeps what the boards did
        print_message(QUESTION)
        entry["answer"] = read_answer()
        self.write()

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Write the file on every way out but misuse, with what ended the selftest. The arrays are closed by then."""
        try:
            yield
        except KeyboardInterrupt as error:
            name = signal.Signals(error.signum).name if isinstance(error, PlayInterrupted) else str(error) or "SIGINT"
            self._end(name, error)
            raise
        except console.MISUSES:
            raise
        except Exception as error:
            self._end("failure", error)
            raise
        self._end("end", None)

    def _end(self, ended_by: str, error: BaseException | None) -> None:
        failed = getattr(error, "report", None)  # of a playback that did not reach its end
        if failed is not None:
            self._stimuli.append({"stimulus": None, "expected": None, "played": [failed.as_dict()], "answer": None})
        self._values |= {"ended_by": ended_by, "failure": None if error is None else str(error) or "interrupted"}
        self.write()
        print_message(f"The report is {self.path}. Please send it back, whatever it says.")

    def write(self) -> None:
        """Replace the file by what is known now."""
        text = json.dumps(console.finite(self._values), indent=1, allow_nan=False) + "\n"
        try:
            write_file(self.path, text.encode())
        except OSError as error:
            raise RenderError(f"{self.path}: cannot be written ({error.strerror or error})") from error


def read_answer() -> str | None:
    """The next line of standard input, which may be a script's; None at its end."""
    line = sys.stdin.readline()
    return line.strip() if line else None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None

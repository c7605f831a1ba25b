"""The report of an acceptance: questions, answers and playbacks as JSON, a whole file after each step."""

import hashlib
import json
import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ...datasets.storage.durable import write_file
from ...device.array import ArrayModel
from ..errors import RenderError, StrategyError
from ..terminal import console
from .question import Step

FORMAT = "palpate acceptance"
VERSION = 1
PACKAGES = ("palpate", "numpy", "pyusb", "warp-lang", "pyserial", "autd3")


class AcceptanceReport:
    """A report in the making; the file is replaced as a whole each time something is noted.

    Raises StrategyError for a path that exists (unless it may be overwritten) or that no file can have, RenderError
    where it cannot be written.
    """

    def __init__(self, path: Path, *, overwrite: bool, about: dict[str, object]) -> None:
        if path.is_dir() or not path.parent.is_dir():
            raise StrategyError(f"{path}: is a folder, or its folder does not exist")
        if path.exists() and not overwrite:
            raise StrategyError(f"{path}: exists; --overwrite replaces it")
        self.path = path
        self.steps: list[dict[str, object]] = []
        self._values: dict[str, object] = {"format": FORMAT, "version": VERSION, "date": now(), **about}
        self._values |= {"ended_by": None, "failure": None, "steps": self.steps}

    def write(self, **changes: object) -> None:
        """Change values of the head, and write the file."""
        self._values |= changes
        text = json.dumps(console.finite(self._values), indent=1, allow_nan=False) + "\n"
        try:
            write_file(self.path, text.encode())
        except OSError as error:
            raise RenderError(f"{self.path}: cannot be written ({error.strerror or error})") from error


def entry_of(step: Step) -> dict[str, object]:
    """A step as the report has it, before it is answered."""
    return {
        "step": step.name,
        "instruction": step.instruction,
        "question": step.question,
        "answers": {answer.key: answer.sentence for answer in step.answers},
        "expected": step.expected,
        "answer": None,
        "as_expected": None,
        "skipped_because": None,
        "date": now(),
        "played": [],
    }


def machine() -> dict[str, object]:
    """Versions and platform that an acceptance ran on; null for a package that is not installed."""
    versions: dict[str, object] = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    return {"versions": versions, "platform": platform.platform()}


def calibration_of(path: Path | None, model: ArrayModel) -> dict[str, object]:
    """The calibration that drives are made with: name and SHA-256 of the board file; null without one."""
    return {
        "calibrated": model.calibrated,
        "file": None if path is None else path.name,
        "sha256": None if path is None else hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def now() -> str:
    """Date and time, UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")

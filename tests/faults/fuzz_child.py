"""A process of the fuzzer: makes damaged inputs, reads them within bounds of memory, and tells what came of it."""

import contextlib
import io
import os
import random
import re
import resource
import shutil
import tempfile
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from fuzz_format import Format, Refused, Wrong
from fuzz_formats import FORMATS, damage_seed
from fuzz_mutations import PIPE

from palpate.datasets.errors import DatasetError
from palpate.device.errors import DeviceError
from palpate.render.errors import RenderError

ADDRESS_BYTES = 4 << 30
"""Address space that a case may take beside what the process has already."""
RESIDENT_BYTES = 1 << 30
"""Memory that reading a file of less than a megabyte may take."""

ACCEPTED, CLEAR, RAW, SIGNAL, HANG, MEMORY, WRONG = (
    "accepted", "clear error", "raw error", "signal", "hang", "memory", "wrong",
)  # fmt: skip
OUTCOMES = (ACCEPTED, CLEAR, RAW, SIGNAL, HANG, MEMORY, WRONG)
BAD = OUTCOMES[2:]

ELSEWHERE = ("outside", "relinked", "group loop", "group external")
"""What `damage_hdf5` says of an object that is not in the file that is read, or not where its name says."""

HOUSE = (DatasetError, RenderError, DeviceError)
BY_NAME = {form.name: form for form in FORMATS}


@dataclass(frozen=True)
class Case:
    """One damaged input: the same for the same seed, format and number."""

    form: str
    seed: int
    number: int

    def make(self, seeds: Path, folder: Path) -> tuple[Path, str]:
        """Put it into a folder; the path to read and how it was damaged."""
        rng = random.Random(f"{self.seed} {self.form} {self.number}")
        whole = rng.choice(sorted((seeds / self.form).iterdir()))
        path = copied(whole, folder)
        os.mkfifo(folder / PIPE)
        if path.is_dir():
            os.mkfifo(path / PIPE)
        how = damage_seed(BY_NAME[self.form], path, rng)
        return path, f"{whole.name}: {how}"


@dataclass(frozen=True)
class Outcome:
    """What came of a case."""

    kind: str
    """One of `OUTCOMES`."""
    place: str = ""
    """Of a bad one: error and where, alike for the same fault."""
    text: str = ""
    how: str = ""
    """How the input was damaged."""


def copied(whole: Path, folder: Path) -> Path:
    """A seed copied into an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / whole.name
    shutil.copytree(whole, path) if whole.is_dir() else shutil.copyfile(whole, path)
    return path


def quieten() -> None:
    """Have nobody warn of what damaged inputs lead to."""
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    wp.config.log_level = wp.LOG_ERROR  # else Warp tells what it loads


def serve(connection: Connection, seeds: Path, folder: Path) -> None:
    """Take cases until there are none; two answers to each: that reading begins, and what came of it."""
    os.environ["PALPATE_CACHE"] = "off"
    quieten()
    wholes: dict[Path, Any] = {}
    home = folder / "home"
    home.mkdir(parents=True)
    os.chdir(home)
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(quiet, stream)
    while (case := connection.recv()) is not None:
        form = BY_NAME[case.form]
        try:
            whole = whole_of(form, seeds, folder / "whole", wholes)
        except Exception as error:
            connection.send(RuntimeError(f"undamaged {case.form}: {''.join(traceback.format_exception(error))}"))
            continue
        path, how = case.make(seeds, folder / "case")
        connection.send("begun")
        connection.send(judged(form, path, how, whole[how.split(":")[0]]))


def whole_of(form: Format, seeds: Path, folder: Path, wholes: dict[Path, Any]) -> Any:
    """What undamaged seeds hold, read before memory is limited; a format that cannot read its seeds is a fault."""
    own = seeds / form.name
    if own not in wholes:
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        wholes[own] = {seed.name: form.read(copied(seed, folder)) for seed in own.iterdir()}
        limit = status_bytes("VmSize") + ADDRESS_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    return wholes[own]


def judged(form: Format, path: Path, how: str, whole: Any) -> Outcome:
    """Read a damaged input and say what came of it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # the highest resident memory counts from now on
    before = status_bytes("VmRSS")
    outcome = _read(form, path, how, whole)
    taken = status_bytes("VmHWM") - before
    if taken > RESIDENT_BYTES:
        return Outcome(MEMORY, f"{taken / 1e9:.1f} GB", outcome.text, how)
    return outcome


def _read(form: Format, path: Path, how: str, whole: Any) -> Outcome:
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            found = form.read(path)
    except (Refused, *HOUSE) as error:
        return Outcome(CLEAR, text=str(error)[:500], how=how)
    except Wrong as error:
        return Outcome(WRONG, re.sub(r"[\d.]+|'.*", "#", str(error))[:80], str(error)[:500], how)
    except MemoryError as error:
        return Outcome(MEMORY, place_of(error), "".join(traceback.format_exception(error)), how)
    except BaseException as error:
        return Outcome(RAW, place_of(error), "".join(traceback.format_exception(error)), how)
    if form.is_checked and "structure" not in how and (where := difference(found, whole)):
        return Outcome(WRONG, f"read without an error, but {re.sub('[0-9]+', '#', where)} differs", where, how)
    if any(word in how for word in ELSEWHERE):
        return Outcome(WRONG, "an object that is linked, or lies in another file, is accepted", how=how)
    return Outcome(ACCEPTED, how=how)


def place_of(error: BaseException) -> str:
    """The error's type and the last function of the house that it came through."""
    own = [
        f"{Path(frame.filename).parent.name}/{Path(frame.filename).name} {frame.name}"
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).parent.name in ("kernels", "render", "device", "datasets")
        and "site-packages" not in frame.filename
    ]
    return f"{type(error).__name__} in {own[-1] if own else 'no function of the house'}"


def status_bytes(name: str) -> int:
    """A figure of memory that Linux has of this process [byte]."""
    found = re.search(rf"^{name}:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
    return int(found[1]) * 1024 if found else 0


def difference(a: Any, b: Any) -> str:
    """Where two values differ; empty if they do not."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        one, two = np.asarray(a), np.asarray(b)
        if one.dtype != two.dtype or one.shape != two.shape:
            return "an array's type or shape"
        same = one.tolist() == two.tolist() if one.dtype.kind == "O" else one.tobytes() == two.tobytes()
        return "" if same else "an array's values"
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        if sorted(map(str, a)) != sorted(map(str, b)):
            return "which names there are"
        return next((f"{key}: {found}" for key in a if (found := difference(a[key], b[key]))), "")
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        if len(a) != len(b):
            return "how many there are"
        return next(
            (f"{k}: {found}" for k, pair in enumerate(zip(a, b, strict=True)) if (found := difference(*pair))), ""
        )
    return "" if repr(a) == repr(b) else "a value"


def temporary_folder() -> str:
    """Where inputs lie: in memory, if there is such a place."""
    return tempfile.mkdtemp(prefix="palpate-fuzz-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None)

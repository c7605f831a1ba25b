"""Output of the command line: progress and warnings on standard error, results on standard output, exit codes."""

import atexit
import contextlib
import errno
import json
import math
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Collection, Sequence
from numbers import Integral
from pathlib import Path
from time import perf_counter
from typing import Any, NoReturn

from ...datasets.counted import counted
from ...datasets.errors import DatasetError, NotStoreError, RecordingWarning
from ...datasets.storage.durable import discard_unfinished
from ...device.errors import DeviceError, PlayInterrupted, UnknownArrayError, UpdateRateError
from ...device.report import PlayReport
from ..errors import (
    PalpateWarning,
    PlacementError,
    PlanError,
    RenderError,
    RepairError,
    StrategyError,
    StudyPlanError,
    UntrustedCodeError,
)
from ..runtime.interrupt import ended_promptly
from ..runtime.kernel_cache import is_in_cache, kernels_lost, remove_own_builds, unusable_cache
from .foreign_text import (
    OutputError,
    discard_output,
    errors,
    print_message,
    set_quiet,
    show_table,
    visible,
    write,
    write_output,
)
from .value_words import UNITS, words_of
from .wording import Wording

SHOWN_WARNINGS = (PalpateWarning, RecordingWarning)

DONE, FAILED, MISUSED = 0, 1, 2

_wording = Wording()
_began = perf_counter()


def set_wording(wording: Wording) -> None:
    """Set the way that the running command writes arguments, for all messages."""
    global _wording  # one command runs in a process at a time
    _wording = wording


def worded(message: object) -> str:
    """A message with arguments written as the running command writes them."""
    return _wording(str(message))


MISUSES = (
    StrategyError,
    PlacementError,
    RepairError,
    PlanError,
    StudyPlanError,
    UntrustedCodeError,
    NotStoreError,
    UnknownArrayError,
    UpdateRateError,
)
"""Errors caused by the request (exit code MISUSED); others are failures of a valid request (FAILED)."""


def show_values(
    values: dict,
    *,
    as_json: bool,
    title: str,
    shown_names: Collection[str] | None = None,
    unknown: Collection[str] = (),
) -> None:
    """Print results: one JSON object with all values, or a table with those in `shown_names` (by default all).

    A value that is None has no row in the table, or "not known" if its name is in `unknown`.
    """
    if as_json:
        write_output(json_line(values))
        return
    rows = []
    for name, value in values.items():
        if shown_names is None or name in shown_names:
            if value is not None:
                rows.append((words_of(name), f"{shown(value)} {UNITS.get(name, '')}".rstrip()))
            elif name in unknown:
                rows.append((words_of(name), "not known"))
    show_table(title, rows)


def conclude(sentence: str, *, as_json: bool) -> None:
    """End a command's table with a sentence on what its numbers mean; with --json nothing is printed."""
    if not as_json:
        write(worded(sentence))


def json_line(values: object) -> str:
    """One line of ASCII JSON; NaN and infinity, which JSON does not have, become null."""
    return json.dumps(finite(values), allow_nan=False).replace("\x7f", "\\u007f") + "\n"  # json.dumps leaves DEL


def finite(value: object) -> object:
    """A value with numbers as Python's types, None for those that are not finite; containers element by element."""
    if isinstance(value, dict):
        return {str(key): finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    if isinstance(value, (str, bool, int)) or value is None:
        return value
    if isinstance(value, Integral):  # NumPy's
        return int(value)
    number = float(value)  # type: ignore[arg-type]  # only floats are left, NumPy's or Python's
    return number if math.isfinite(number) else None


def shown(value: object) -> str:
    """A value as text for a table."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict) and "stage" in value:
        options = ", ".join(f"{key} {shown(inner)}" for key, inner in value.items() if key != "stage")
        return f"{value['stage']} ({options})"
    if isinstance(value, dict):
        return ", ".join(f"{key} {shown(inner)}" for key, inner in value.items() if inner is not None)
    if isinstance(value, (list, tuple)):
        return " ".join(shown(inner) for inner in value) or "none"
    return str(value)


def parsed(app: Callable[..., object]) -> int:
    """Run a typer app and return its exit code; control characters in its messages and tracebacks are escaped."""
    open_streams()
    try:
        return _parsed(app)
    except OutputError as error:
        return _unwritten(error)


def _parsed(app: Callable[..., object]) -> int:
    try:
        code = app(standalone_mode=False)
        write_output("")
    except OutputError:
        raise
    except OSError as error:  # of help, of the version, or of a file that completion installs
        if error.filename is not None:
            return fail(f"{error.filename}: {error.strerror or error}", FAILED, "--json" in sys.argv)
        discard_output()
        return fail(f"{error.strerror or error} (standard output)", FAILED, False)
    except Exception as error:
        message = getattr(error, "message", None)
        if not hasattr(error, "format_message") or not isinstance(message, str):  # not an error of typer
            for line in "".join(traceback.format_exception(error)).splitlines():
                print_message(line)
            return FAILED
        shown: Any = error
        if sys.argv[1:]:  # without arguments the message is the help, whose line breaks must stay
            shown.message = visible(message)
        with contextlib.suppress(OSError):  # nobody reads messages
            shown.show()
        if sys.argv[1:] and "--json" in sys.argv:
            write_output(json_line({"error": shown.format_message()}))
        return int(shown.exit_code)
    return code if isinstance(code, int) else DONE


def run(command: Callable[[], object], *, as_json: bool, quiet: bool = False) -> int:
    """Run a command; errors become one sentence and an exit code, without a traceback. quiet: see `set_quiet`."""
    global _began  # as above
    _began = perf_counter()
    set_quiet(quiet)
    try:
        with ended_promptly(lambda: _end_at_once(as_json)):
            code = _run(command, as_json=as_json)
        if (lost := kernels_lost()) is not None:
            warn(lost)
    except OutputError as error:
        return _unwritten(error)
    return code


def since_start() -> float:
    """Time since the running command began [s], its imports included; Python's own start, 0.1 s, came before."""
    return perf_counter() - _began


def _end_at_once(as_json: bool) -> int:
    """Report that a command was interrupted, remove what it has half written, and return its exit code."""
    try:
        errors.write("\x1b[?25h" if errors.is_terminal else "")  # a bar may have hidden the cursor
        return fail("interrupted", FAILED, as_json)
    except OutputError:
        return FAILED
    finally:
        discard_unfinished()
        remove_own_builds()


def _unwritten(error: OutputError) -> int:
    if error.args:
        print_message(error, "error")
    return FAILED


def end_process(code: int) -> NoReturn:
    """End this process with an exit code: after what is registered for its end, without the interpreter's teardown.

    A signal may have broken off a native library as it started threads; joining these, or freeing what they use, waited
    for ever in 1 of 1,000 interrupted playbacks and crashed in 1 of 190 before.
    """
    for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(signum, signal.SIG_IGN)  # what is left takes milliseconds
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # nobody reads it, or it is closed
            stream.flush()
    os._exit(code)


def open_streams() -> None:
    """Open standard streams that the caller has closed: else a file that a command opens takes their number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if name == "stdout" else os.O_RDWR)  # results must not vanish unnoticed
        if getattr(sys, name) is None:
            stream = open(number, mode, encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115  # to the end
            setattr(sys, name, stream)


def _run(command: Callable[[], object], *, as_json: bool) -> int:
    with warnings.catch_warnings():
        for kind in SHOWN_WARNINGS:
            warnings.simplefilter("always", kind)
        shown: set[str] = set()  # several parts of one job may give the same warning

        def show(message: Warning | str, category: type[Warning], *rest: object) -> None:
            del category, rest
            if str(message) not in shown:
                shown.add(str(message))
                warn(str(message))

        warnings.showwarning = show
        try:
            code = command()
        except OutputError:
            raise
        except (RenderError, DatasetError, DeviceError) as error:
            faults = error.args if isinstance(error, PlanError | StudyPlanError) else ()
            # A path that stands for nothing is misuse, too.
            is_missing = isinstance(error.__cause__, FileNotFoundError | NotADirectoryError)
            misused = isinstance(error, MISUSES) or getattr(error, "names_nothing", False) or is_missing
            return fail(str(error), MISUSED if misused else FAILED, as_json, _report_of(error), lines=faults)
        except KeyboardInterrupt as error:
            message = str(error) if isinstance(error, PlayInterrupted) else "interrupted"
            return fail(message, FAILED, as_json, _report_of(error))
        except Exception as error:  # a bug in palpate: one sentence too, with the way to a traceback
            if os.environ.get("PALPATE_TRACEBACK"):
                raise
            if isinstance(error, OSError) and is_in_cache(error.filename):
                return fail(str(unusable_cache(error)), FAILED, as_json)
            if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
                longest = max(Path(str(error.filename)).parts, key=lambda part: len(os.fsencode(part)))
                sentence = f"a name of {len(os.fsencode(longest))} bytes is more than this file system takes"
                return fail(f"{error.filename}: {sentence} (most take 255)", MISUSED, as_json)
            name = f"{type(error).__name__}: {error}"
            return fail(f"{name} (unexpected; PALPATE_TRACEBACK=1 shows the traceback)", FAILED, as_json)
    return code if isinstance(code, int) else DONE


def fail(
    message: str, code: int, as_json: bool, report: PlayReport | None = None, *, lines: Sequence[object] = ()
) -> int:
    """Report an error and return its exit code; lines: the lines of a message that has several."""
    message = worded(message)
    first, *rest = [worded(line) for line in lines] or (message,)
    print_message(first, "error")
    for line in rest:
        print_message(line)
    if as_json:
        late = [late_warning(report)] if report and report.is_late else []
        played = {"report": report.as_dict(), "warnings": late} if report else {}
        write_output(json_line({"error": message, **played}))
    elif report:
        after = "" if report.off_after is None else f"off frames taken {report.off_after:.3g} s after the end; "
        print_message(f"played until then: {report.frames} frames; {after}{off_state(report)}")
        if report.is_late:
            warn(late_warning(report))
    return code


def off_state(report: PlayReport) -> str:
    """Whether an array is off, as a part of a sentence."""
    return report.off_doubt or "the array reports that it is off"


def late_warning(report: PlayReport) -> str:
    """Sentence on how often an array ran out of frames or was silent, and how late frames were, with the source."""
    board, silent = "the board's own count is not known", ""
    if report.board_underruns is not None and report.board_starved is not None:
        board = f"by the board's own count {report.board_underruns} times, for {report.board_starved:.4g} s"
    if report.silenced:
        silent = f"was silent for {report.silenced:.4g} s, since its board had to begin anew after a pause, "
    return (
        f"array {report.array} ran out of frames {report.underruns} times and had no new one for "
        f"{report.starved:.4g} s, {silent}so that frames were up to {report.lateness.max:.4g} s late, by the player's "
        f"estimate; {board}"
    )


def report_compiling(module_count: int) -> None:
    """Report that kernels are compiled before anything is played."""
    what = counted(module_count, "module")
    print_message(f"compiling {what} of kernels that sample contours: some seconds, once on a machine", "progress")


def warn(sentence: str) -> None:
    """Warn on standard error."""
    print_message(worded(sentence), "warning")


def _report_of(error: BaseException) -> PlayReport | None:
    return getattr(error, "report", None)
